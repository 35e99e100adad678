/* The step of a modal form. For a pair with Lambda = [s, w; -w, s] a function f(l) = f + i g of the eigenvalue becomes
   [f, g; -g, f]. Of each block `hold` has a row f and a row g, -g in the slots of the seconds, for each of the three
   functions in exact_hold.h. */

#include "modal.h"

#include "exact_hold.h"
#include "vectors.h"

#define LARGEST_EXPONENT 700.0

size_t modal_size(size_t states, size_t held, size_t rare, size_t outputs)
{
    const size_t slots = (states + MODAL_BLOCK - 1) / MODAL_BLOCK * MODAL_BLOCK;
    return slots * (MODAL_HOLD_ROWS + held + rare + outputs + states + 4) + 2;
}

Modal modal_in(double *memory, size_t states, size_t held, size_t rare, size_t outputs)
{
    Modal modal = {.states = states, .held = held, .rare = rare, .outputs = outputs};
    modal.slots = (states + MODAL_BLOCK - 1) / MODAL_BLOCK * MODAL_BLOCK;
    modal.hold = memory;
    modal.held_inputs = modal.hold + MODAL_HOLD_ROWS * modal.slots;
    modal.rare_inputs = modal.held_inputs + held * modal.slots;
    modal.output_rows = modal.rare_inputs + rare * modal.slots;
    modal.vectors = modal.output_rows + outputs * modal.slots;
    modal.real = modal.vectors + states * modal.slots;
    modal.imaginary = modal.real + modal.slots;
    modal.inverse = modal.imaginary + modal.slots;
    modal.facts = modal.inverse + 2 * modal.slots;
    return modal;
}

static inline void store_function(double *rows, TwoComplex f, bool is_second)
{
    pair_store(rows, f.real);
    pair_store(rows + MODAL_BLOCK, is_second ? pair_subtract(pair_of(0.0), f.imaginary) : f.imaginary);
}

static inline void store_functions(double *rows, const HoldFunctions *f, bool is_second, bool with_ramp)
{
    store_function(rows, f->growth, is_second);
    store_function(rows + 2 * MODAL_BLOCK, f->hold, is_second);
    if (with_ramp)
        store_function(rows + 4 * MODAL_BLOCK, f->ramp, is_second);
}

NOT_INLINED bool modal_prepare(const Modal *modal, double step, bool grows)
{
    const size_t slots = modal->slots;
    const size_t paired_blocks = (size_t)modal->facts[0] / MODAL_LANES; /* whose seconds are known with the firsts */
    const double *const real = modal->real;
    const double *const imaginary = modal->imaginary;
    const double *const inverse = modal->inverse;
    double *hold = modal->hold;
    for (size_t block = 0; block < slots; block += MODAL_BLOCK, hold += MODAL_HOLD_ROWS * MODAL_BLOCK) {
        const bool is_paired = block / MODAL_BLOCK < paired_blocks;
        const size_t lanes = is_paired ? MODAL_LANES : MODAL_BLOCK;
        for (size_t lane = 0; lane < lanes; lane += 2) {
            const size_t slot = block + lane;
            const TwoComplex eigenvalue = {pair_load(real + slot), pair_load(imaginary + slot)};
            const TwoComplex inverted = {pair_load(inverse + slot), pair_load(inverse + slots + slot)};
            const HoldFunctions f = hold_functions(eigenvalue, inverted, step, grows);
            store_functions(hold + lane, &f, lane >= MODAL_LANES, grows);
            if (is_paired)
                store_functions(hold + lane + MODAL_LANES, &f, true, grows);
        }
    }
    return modal->facts[1] * step <= LARGEST_EXPONENT;
}

/* The coordinates of a block: four firsts, four seconds. */
typedef struct {
    Pair first[2];
    Pair second[2];
} ModalBlock;

static inline void add_inputs(ModalBlock *sum, size_t count, const double *columns, const double *v)
{
    for (size_t j = 0; j < count; j++, columns += MODAL_BLOCK) {
        const Pair input = pair_of(v[j]);
        sum->first[0] = pair_add_product(sum->first[0], pair_load(columns), input);
        sum->first[1] = pair_add_product(sum->first[1], pair_load(columns + 2), input);
        sum->second[0] = pair_add_product(sum->second[0], pair_load(columns + 4), input);
        sum->second[1] = pair_add_product(sum->second[1], pair_load(columns + 6), input);
    }
}

/* V^-1 B v of a block */
static inline ModalBlock driven_block(const Modal *modal, size_t block, const double *v, bool with_rare)
{
    ModalBlock sum = {{pair_of(0.0), pair_of(0.0)}, {pair_of(0.0), pair_of(0.0)}};
    add_inputs(&sum, modal->held, modal->held_inputs + block * modal->held, v);
    if (with_rare)
        add_inputs(&sum, modal->rare, modal->rare_inputs + block * modal->rare, v + modal->held);
    return sum;
}

/* sum += [f, g; -g, f] x of each pair; rows f and g */
static inline void add_function(ModalBlock *sum, const double *f, const ModalBlock *x)
{
    const double *const g = f + MODAL_BLOCK;
    sum->first[0] = pair_add_product(sum->first[0], pair_load(f), x->first[0]);
    sum->first[1] = pair_add_product(sum->first[1], pair_load(f + 2), x->first[1]);
    sum->second[0] = pair_add_product(sum->second[0], pair_load(f + 4), x->second[0]);
    sum->second[1] = pair_add_product(sum->second[1], pair_load(f + 6), x->second[1]);
    sum->first[0] = pair_add_product(sum->first[0], pair_load(g), x->second[0]);
    sum->first[1] = pair_add_product(sum->first[1], pair_load(g + 2), x->second[1]);
    sum->second[0] = pair_add_product(sum->second[0], pair_load(g + 4), x->first[0]);
    sum->second[1] = pair_add_product(sum->second[1], pair_load(g + 6), x->first[1]);
}

static bool is_any_nonzero(size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0.0)
            return true;
    return false;
}

void modal_step(const Modal *modal, const double *v, const double *growth, double *z)
{
    const bool with_rare = is_any_nonzero(modal->rare, v + modal->held);
    const double *hold = modal->hold;
    for (size_t block = 0; block < modal->slots; block += MODAL_BLOCK, hold += MODAL_HOLD_ROWS * MODAL_BLOCK) {
        double *const own = z + block;
        const ModalBlock before = {{pair_load(own), pair_load(own + 2)}, {pair_load(own + 4), pair_load(own + 6)}};
        const ModalBlock input = driven_block(modal, block, v, with_rare);
        ModalBlock after = before;
        add_function(&after, hold, &before);
        add_function(&after, hold + 2 * MODAL_BLOCK, &input);
        if (growth != NULL) {
            const ModalBlock growing = driven_block(modal, block, growth, true);
            add_function(&after, hold + 4 * MODAL_BLOCK, &growing);
        }
        pair_store(own, after.first[0]);
        pair_store(own + 2, after.first[1]);
        pair_store(own + 4, after.second[0]);
        pair_store(own + 6, after.second[1]);
    }
}

/* Two sums of a row with a vector. */
typedef struct {
    Pair low;
    Pair high;
} RowSums;

static inline RowSums add_columns(RowSums sums, const double *row, Pair low, Pair high)
{
    return (RowSums){pair_add_product(sums.low, pair_load(row), low),
                     pair_add_product(sums.high, pair_load(row + 2), high)};
}

/* y = A x; A (rows, columns) row by row, columns a multiple of 4. Four rows at a time. */
static void multiply_rows(size_t rows, size_t columns, const double *A, const double *x, double *y)
{
    size_t i = 0;
    for (; i + 4 <= rows; i += 4, A += 4 * columns) {
        const RowSums zero = {pair_of(0.0), pair_of(0.0)};
        RowSums first = zero;
        RowSums second = zero;
        RowSums third = zero;
        RowSums fourth = zero;
        for (size_t j = 0; j < columns; j += 4) {
            const Pair low = pair_load(x + j);
            const Pair high = pair_load(x + j + 2);
            first = add_columns(first, A + j, low, high);
            second = add_columns(second, A + columns + j, low, high);
            third = add_columns(third, A + 2 * columns + j, low, high);
            fourth = add_columns(fourth, A + 3 * columns + j, low, high);
        }
        y[i] = pair_sum(pair_add(first.low, first.high));
        y[i + 1] = pair_sum(pair_add(second.low, second.high));
        y[i + 2] = pair_sum(pair_add(third.low, third.high));
        y[i + 3] = pair_sum(pair_add(fourth.low, fourth.high));
    }
    for (; i < rows; i++, A += columns)
        y[i] = vector_product(columns, A, x);
}

void modal_outputs(const Modal *modal, const double *z, double *y)
{
    multiply_rows(modal->outputs, modal->slots, modal->output_rows, z, y);
}

void modal_state(const Modal *modal, const double *z, double *x)
{
    multiply_rows(modal->states, modal->slots, modal->vectors, z, x);
}
