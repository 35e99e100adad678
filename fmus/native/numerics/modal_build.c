#include "modal_build.h"

#include <math.h>
#include <string.h>

#include "coupled_modes.h"
#include "modes.h"
#include "vectors.h"

/* What modal_build works in. */
typedef struct {
    Modes modes;   /* its V where the form keeps it */
    double *slots; /* (n,) of each place of the modes */
    double *row;   /* (n,) */
    double *rest;  /* what finds the modes */
} ModalScratch;

size_t modal_scratch_size(size_t states)
{
    return states * (states + 4) + modes_scratch_size(states);
}

static ModalScratch modal_scratch_in(const Modal *modal, double *memory)
{
    const size_t n = modal->states;
    ModalScratch scratch = {.modes = {.n = n, .transposed_V = modal->vectors, .inverse_V = memory}};
    scratch.modes.real = memory + n * n;
    scratch.modes.imaginary = scratch.modes.real + n;
    scratch.slots = scratch.modes.imaginary + n;
    scratch.row = scratch.slots + n;
    scratch.rest = scratch.row + n;
    return scratch;
}

void modal_set_eigenvalue(const Modal *modal, size_t slot, double real, double imaginary)
{
    modal->real[slot] = real;
    modal->imaginary[slot] = imaginary;
    modal->facts[1] = fmax(modal->facts[1], real);
    const double size = fmax(fabs(real), imaginary);
    if (!(size > 0.0))
        return;
    const double square = (real / size * real + imaginary / size * imaginary) * size;
    modal->inverse[slot] = real / square;
    modal->inverse[modal->slots + slot] = -imaginary / square;
}

/* Slots and eigenvalues: complex pairs first, then the real ones two by two. */
static void fill_eigenvalues(const Modal *modal, const ModalScratch *s)
{
    const double *const real = s->modes.real;
    const double *const imaginary = s->modes.imaginary;
    memset(modal->real, 0, 4 * modal->slots * sizeof *modal->real);
    size_t paired = 0; /* places */
    for (size_t j = 0; j < modal->states; j++)
        paired += imaginary[j] > 0.0;
    modal->facts[0] = (double)(paired / 2);
    modal->facts[1] = 0.0;
    size_t complex_place = 0;
    size_t real_place = paired;
    for (size_t j = 0; j < modal->states; j++) {
        const size_t place = imaginary[j] > 0.0 ? complex_place++ : real_place++;
        const size_t slot = modal_slot(place / 2, place % 2);
        s->slots[j] = (double)slot;
        modal_set_eigenvalue(modal, slot, real[j], imaginary[j]);
    }
}

/* A' in place of A (n, n): tile by tile, as a cache holds a few columns only. */
static void transpose_in_place(size_t n, double *A)
{
    const size_t tile = 16;
    for (size_t top = 0; top < n; top += tile)
        for (size_t left = 0; left <= top; left += tile)
            for (size_t i = top; i < n && i < top + tile; i++)
                for (size_t j = left; j < i && j < left + tile; j++) {
                    const double entry = A[i * n + j];
                    A[i * n + j] = A[j * n + i];
                    A[j * n + i] = entry;
                }
}

/* V in slots, row by row, in place of V' without any. */
static void fill_vectors(const Modal *modal, const ModalScratch *s)
{
    const size_t n = modal->states;
    transpose_in_place(n, modal->vectors);
    for (size_t i = n; i-- > 0;) {
        double *const row = modal->vectors + i * modal->slots;
        memcpy(s->row, modal->vectors + i * n, n * sizeof *row);
        memset(row, 0, modal->slots * sizeof *row);
        for (size_t j = 0; j < n; j++)
            row[(size_t)s->slots[j]] = s->row[j];
    }
}

/* C V */
static void fill_output_rows(const Modal *modal, const double *C)
{
    memset(modal->output_rows, 0, modal->outputs * modal->slots * sizeof *modal->output_rows);
    for (size_t i = 0; i < modal->outputs; i++)
        for (size_t k = 0; k < modal->states; k++)
            if (C[i * modal->states + k] != 0.0)
                vector_add_scaled(modal->slots, C[i * modal->states + k], modal->vectors + k * modal->slots,
                                  modal->output_rows + i * modal->slots);
}

/* V^-1 x by place, in `row`; x (n,) with entries `stride` apart, zeros at its ends skipped. */
static void find_coordinates(size_t n, const double *x, size_t stride, const ModalScratch *s)
{
    size_t first = 0;
    size_t end = n;
    while (first < end && x[first * stride] == 0.0)
        first++;
    while (end > first && x[(end - 1) * stride] == 0.0)
        end--;
    for (size_t i = first; i < end; i++)
        s->rest[i] = x[i * stride];
    for (size_t i = 0; i < n; i++)
        s->row[i] = vector_product(end - first, s->modes.inverse_V + i * n + first, s->rest + first);
}

/* V^-1 of `count` columns of B (states, inputs) from `first` on, as blocks. */
NOT_INLINED static void fill_inputs(const Modal *modal, const double *B, size_t first, size_t count, double *blocks,
                                    const ModalScratch *s)
{
    memset(blocks, 0, count * modal->slots * sizeof *blocks);
    for (size_t j = 0; j < count; j++) {
        find_coordinates(modal->states, B + first + j, modal->held + modal->rare, s);
        for (size_t i = 0; i < modal->states; i++) {
            const size_t slot = (size_t)s->slots[i];
            blocks[(slot / MODAL_BLOCK * count + j) * MODAL_BLOCK + slot % MODAL_BLOCK] = s->row[i];
        }
    }
}

double modal_build(const Modal *modal, double *A, const double *blocks, const double *B, const double *C,
                   double *scratch)
{
    const ModalScratch s = modal_scratch_in(modal, scratch);
    if (!find_coupled_modes(&s.modes, A, blocks, s.rest) && !find_dense_modes(&s.modes, A, s.rest))
        return HUGE_VAL;
    const double condition = eigenvalue_condition(&s.modes);
    fill_eigenvalues(modal, &s);
    fill_vectors(modal, &s);
    fill_output_rows(modal, C);
    fill_inputs(modal, B, 0, modal->held, modal->held_inputs, &s);
    fill_inputs(modal, B, modal->held, modal->rare, modal->rare_inputs, &s);
    return condition;
}

NOT_INLINED void modal_coordinates(const Modal *modal, size_t columns, const double *X, double *z, double *scratch)
{
    const ModalScratch s = modal_scratch_in(modal, scratch);
    memset(z, 0, modal->slots * columns * sizeof *z);
    for (size_t j = 0; j < columns; j++) {
        find_coordinates(modal->states, X + j, columns, &s);
        for (size_t i = 0; i < modal->states; i++)
            z[(size_t)s.slots[i] * columns + j] = s.row[i];
    }
}
