/* Runs the modal form on a linear system. Standard input, all doubles: states, held, rare and number of outputs, length
   of step, number of steps, whether there are blocks; A, the block of each state, B, C, row by row; x at the start, v,
   and what v grows by in each step (rare inputs behind the held ones). Standard output, all doubles: condition, number
   of complex pairs, whether the step is in range; x and y after the steps. With the argument "hold": groups of real
   part, imaginary part and step to the functions of exact_hold.h, six doubles each. With the argument "blocks": n and a
   matrix (n, n) to the block of each row. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "exact_hold.h"
#include "linear_algebra.h"
#include "modal.h"
#include "modal_build.h"

static double *blocks[16];
static size_t block_count;

static double *doubles(size_t count)
{
    double *const memory = calloc(count + 1, sizeof *memory);
    if (memory == NULL || block_count == sizeof blocks / sizeof *blocks)
        abort();
    return blocks[block_count++] = memory;
}

static void free_blocks(void)
{
    while (block_count > 0)
        free(blocks[--block_count]);
}

static double *read_doubles(size_t count)
{
    double *const memory = doubles(count);
    if (fread(memory, sizeof *memory, count, stdin) != count)
        abort();
    return memory;
}

static void write_doubles(const double *memory, size_t count)
{
    if (fwrite(memory, sizeof *memory, count, stdout) != count)
        abort();
}

static int number(void)
{
    const double *const size = read_doubles(1);
    const size_t n = (size_t)size[0];
    const double *const L = read_doubles(n * n);
    double *const blocks_of_rows = doubles(n);
    number_blocks(n, L, blocks_of_rows);
    write_doubles(blocks_of_rows, n);
    return 0;
}

static int hold(void)
{
    double argument[3];
    while (fread(argument, sizeof *argument, 3, stdin) == 3) {
        const double square = argument[0] * argument[0] + argument[1] * argument[1];
        const double other[2] = {-3.0, 2.0}; /* in the second place, where nothing depends on it */
        const TwoComplex value = {pair(argument[0], other[0]), pair(argument[1], other[1])};
        const TwoComplex inverse = {pair(argument[0] / square, other[0] / 13),
                                    pair(-argument[1] / square, -other[1] / 13)};
        const HoldFunctions f = hold_functions(value, inverse, argument[2], true);
        const Pair results[6] = {f.growth.real,    f.growth.imaginary, f.hold.real,
                                 f.hold.imaginary, f.ramp.real,        f.ramp.imaginary};
        for (size_t k = 0; k < 6; k++) {
            double both[2];
            pair_store(both, results[k]);
            write_doubles(both, 1);
        }
    }
    return 0;
}

int main(int count, char **arguments)
{
    if (atexit(free_blocks) != 0)
        abort();
    if (count > 1 && strcmp(arguments[1], "hold") == 0)
        return hold();
    if (count > 1 && strcmp(arguments[1], "blocks") == 0)
        return number();
    const double *const sizes = read_doubles(7);
    const size_t states = (size_t)sizes[0];
    const size_t held = (size_t)sizes[1];
    const size_t rare = (size_t)sizes[2];
    const size_t outputs = (size_t)sizes[3];
    const double step = sizes[4];
    const size_t inputs = held + rare;
    double *const A = read_doubles(states * states);
    const double *const block_of = read_doubles(states);
    const double *const B = read_doubles(states * inputs);
    const double *const C = read_doubles(outputs * states);
    double *const x = read_doubles(states);
    double *const v = read_doubles(inputs);
    const double *const growth = read_doubles(inputs);
    double *const scratch = doubles(modal_scratch_size(states));
    const Modal modal = modal_in(doubles(modal_size(states, held, rare, outputs)), states, held, rare, outputs);
    const double condition = modal_build(&modal, A, sizes[6] != 0.0 ? block_of : NULL, B, C, scratch);
    if (!(condition <= 1e6)) {
        write_doubles(&condition, 1);
        return 0;
    }
    double *const z = doubles(modal.slots);
    modal_coordinates(&modal, 1, x, z, scratch);
    bool is_growing = false;
    for (size_t j = 0; j < inputs; j++)
        is_growing = is_growing || growth[j] != 0.0;
    const double facts[3] = {condition, modal.facts[0], modal_prepare(&modal, step, is_growing)};
    for (size_t k = 0; k < (size_t)sizes[5]; k++) {
        modal_step(&modal, v, is_growing ? growth : NULL, z);
        for (size_t j = 0; j < inputs; j++)
            v[j] += growth[j];
    }
    double *const y = doubles(outputs);
    modal_state(&modal, z, x);
    modal_outputs(&modal, z, y);
    write_doubles(facts, 3);
    write_doubles(x, states);
    write_doubles(y, outputs);
    return 0;
}
