/* The controller of a batch before its first step: its filter in modal form, and what its law takes of the reference.
 */
#include <string.h>

#include "batch_kernel.h"
#include "modal_build.h"

/* The filter's coordinates at x_ref of the first step; offsets, which have no reference, at 0. */
static void start_filter(Batch *batch, const Modal *modal, double *scratch)
{
    double *const x = scratch + modal_scratch_size(modal->states);
    double *const z = x + modal->states;
    memset(x, 0, modal->states * sizeof *x);
    memcpy(x, batch->task->x_ref, (size_t)batch->task->controller.reduced_states * sizeof *x);
    modal_coordinates(modal, 1, x, z, scratch);
    for (size_t p = 0; p < batch->sizes.filter_states / 2; p++)
        batch->start[p] = (Couple){{z[modal_slot(p, 0)], z[modal_slot(p, 1)]}};
}

/* One member of a pair of the filter: growth by itself and by the other coordinate, inputs, law. */
static void write_filter_member(const Batch *batch, const Modal *modal, size_t pair, size_t member)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t slot = modal_slot(pair, member);
    const double imaginary = modal->imaginary[modal_slot(pair, 0)];
    Couple *const to = batch->filter + tile_place(filter_stride(s), pair, 0);
    to[0].of[member] = modal->real[slot];
    to[TILE].of[member] = member == 0 ? imaginary : -imaginary;
    for (size_t j = 0; j < s->filter_inputs; j++)
        to[(2 + j) * TILE].of[member] =
            modal->held_inputs[(slot / MODAL_BLOCK * s->filter_inputs + j) * MODAL_BLOCK + slot % MODAL_BLOCK];
    for (size_t i = 0; i < 2 * s->voltages; i++)
        to[(2 + s->filter_inputs + i) * TILE].of[member] = modal->output_rows[i * modal->slots + slot];
}

/* The filter in modal form, and the law on its coordinates: for each pair of coordinates its eigenvalue, its inputs and
   its part of the law. The filter's own matrix takes the place of a continuous one: a tick
   multiplies by its eigenvalues. */
bool open_filter(Batch *batch)
{
    const BatchController *const c = &batch->task->controller;
    const LoopSizes *const s = &batch->sizes;
    const size_t states = (size_t)c->states;
    const size_t even = s->filter_states;
    const size_t width = states + s->filter_inputs;
    const size_t rows = 2 * s->voltages;
    double *const A = batch->scratch;
    double *const B = A + even * even;
    double *const C = B + even * s->filter_inputs;
    double *const form = C + rows * even;
    const Modal modal = modal_in(form, even, s->filter_inputs, 0, rows);
    double *const scratch = form + modal_size(even, s->filter_inputs, 0, rows);
    memset(A, 0, (even * even + even * s->filter_inputs + rows * even) * sizeof *A);
    for (size_t i = 0; i < states; i++) {
        memcpy(A + i * even, c->filter + i * width, states * sizeof *A);
        memcpy(B + i * s->filter_inputs, c->filter + i * width + states, s->filter_inputs * sizeof *B);
    }
    for (size_t i = 0; i < rows; i++)
        memcpy(C + i * even, c->regulator + i * (states + s->voltages), states * sizeof *C);
    if (!(modal_build(&modal, A, NULL, B, C, scratch) <= LARGEST_CONDITION))
        return false;
    for (size_t p = 0; p < batch->sizes.filter_states / 2; p++)
        for (size_t member = 0; member < 2; member++)
            write_filter_member(batch, &modal, p, member);
    for (size_t i = 0; i < s->voltages; i++) /* G_0^+ D_pi */
        memcpy(batch->direct + i * s->voltages, c->regulator + (s->voltages + i) * (states + s->voltages) + states,
               s->voltages * sizeof *batch->direct);
    start_filter(batch, &modal, scratch);
    return true;
}

/* What the law takes of the reference: u_ff + K x_ref, then G_0^+ (H_pi x_ref + D_pi u_ff). */
void fill_references(Batch *batch)
{
    const BatchController *const c = &batch->task->controller;
    const size_t voltages = batch->sizes.voltages;
    const size_t states = (size_t)c->states;
    const size_t reduced = (size_t)c->reduced_states;
    for (size_t k = 0; k <= (size_t)batch->task->steps; k++) {
        const double *const x = batch->task->x_ref + k * reduced;
        const double *const u = batch->task->u_ff + k * voltages;
        double *const to = batch->references + k * 2 * voltages;
        for (size_t i = 0; i < 2 * voltages; i++) {
            const double *const row = c->regulator + i * (states + voltages);
            double sum = 0.0;
            for (size_t j = 0; j < reduced; j++)
                sum += row[j] * x[j];
            for (size_t j = 0; j < voltages; j++)
                sum += row[states + j] * u[j];
            to[i] = i < voltages ? u[i] + sum : sum;
        }
    }
}
