/* By the real Schur form A = Q T Q' and the eigenvectors X of T: V = Q X, and V^-1 = X^-1 Q' by back-substitution. That
   keeps eigenvalues that coincide apart, as symmetry relations between left and right vectors do not. */

#include "modal_build.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "eigenvectors.h"
#include "schur.h"
#include "vectors.h"

/* What modal_build works in. */
typedef struct {
    size_t n;
    double *transposed_Q; /* (n, n) */
    double *T;            /* (n, n) */
    double *inverse;      /* X^-1 (n, n) */
    double *X;            /* (n, n), in place of A */
    double *slots;        /* (n,) of each column of X */
    double *row;          /* (n,) */
    double *rest;         /* (4, n) */
} ModalScratch;

size_t modal_scratch_size(size_t states)
{
    return states * (3 * states + 6);
}

static ModalScratch modal_scratch_in(double *memory, size_t n, double *X)
{
    ModalScratch scratch = {.n = n, .transposed_Q = memory, .X = X};
    scratch.T = scratch.transposed_Q + n * n;
    scratch.inverse = scratch.T + n * n;
    scratch.slots = scratch.inverse + n * n;
    scratch.row = scratch.slots + n;
    scratch.rest = scratch.row + n;
    return scratch;
}

/* A power of two near the largest entry; 0 where A is not finite. */
static double scale_of(size_t count, const double *A)
{
    double largest = DBL_MIN;
    for (size_t k = 0; k < count; k++) {
        if (!(fabs(A[k]) <= DBL_MAX))
            return 0.0;
        largest = fmax(largest, fabs(A[k]));
    }
    int exponent;
    frexp(largest, &exponent);
    return ldexp(1.0, exponent - 1);
}

/* T = A / scale with rows and columns from the largest row to the smallest: in this order the small eigenvalues lose no
   digits to the large ones. The order is left in `slots`. */
NOT_INLINED static void sort_by_size(const double *A, double scale, const ModalScratch *s)
{
    const size_t n = s->n;
    double *const order = s->slots;
    double *const sizes = s->row;
    for (size_t i = 0; i < n; i++) {
        double size = 0.0;
        for (size_t j = 0; j < n; j++)
            size += fabs(A[i * n + j]) / scale;
        size_t position = i;
        for (; position > 0 && sizes[position - 1] < size; position--) {
            sizes[position] = sizes[position - 1];
            order[position] = order[position - 1];
        }
        sizes[position] = size;
        order[position] = (double)i;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            s->T[i * n + j] = A[(size_t)order[i] * n + (size_t)order[j]] / scale;
}

/* The entries of the Schur vectors in the order of A again. */
static void restore_order(const ModalScratch *s)
{
    for (size_t k = 0; k < s->n; k++) {
        double *const vector = s->transposed_Q + k * s->n;
        memcpy(s->row, vector, s->n * sizeof *vector);
        for (size_t i = 0; i < s->n; i++)
            vector[(size_t)s->slots[i]] = s->row[i];
    }
}

static size_t slot_of(size_t pair, size_t member)
{
    return pair / MODAL_LANES * MODAL_BLOCK + member * MODAL_LANES + pair % MODAL_LANES;
}

/* Slots and eigenvalues: complex pairs first, then the real ones two by two. */
static void fill_eigenvalues(const Modal *modal, const double *real, const double *imaginary, const ModalScratch *s)
{
    memset(modal->real, 0, 4 * modal->slots * sizeof *modal->real);
    size_t paired = 0; /* columns */
    for (size_t j = 0; j < s->n; j++)
        paired += imaginary[j] > 0.0;
    modal->facts[0] = (double)(paired / 2);
    modal->facts[1] = 0.0;
    size_t complex_column = 0;
    size_t real_column = paired;
    for (size_t j = 0; j < s->n; j++) {
        const size_t column = imaginary[j] > 0.0 ? complex_column++ : real_column++;
        const size_t slot = slot_of(column / 2, column % 2);
        s->slots[j] = (double)slot;
        modal->real[slot] = real[j];
        modal->imaginary[slot] = imaginary[j];
        modal->facts[1] = fmax(modal->facts[1], real[j]);
        const double size = fmax(fabs(real[j]), imaginary[j]);
        if (!(size > 0.0))
            continue;
        const double square = (real[j] / size * real[j] + imaginary[j] / size * imaginary[j]) * size;
        modal->inverse[slot] = real[j] / square;
        modal->inverse[modal->slots + slot] = -imaginary[j] / square;
    }
}

/* V = Q X */
static void fill_vectors(const Modal *modal, const ModalScratch *s)
{
    const size_t n = s->n;
    memset(modal->vectors, 0, n * modal->slots * sizeof *modal->vectors);
    for (size_t j = 0; j < n; j++) {
        memset(s->row, 0, n * sizeof *s->row);
        for (size_t k = 0; k < n && k <= j + 1; k++)
            vector_add_scaled(n, s->X[k * n + j], s->transposed_Q + k * n, s->row);
        for (size_t i = 0; i < n; i++)
            modal->vectors[i * modal->slots + (size_t)s->slots[j]] = s->row[i];
    }
}

/* C V = (C Q) X */
static void fill_output_rows(const Modal *modal, const double *C, const ModalScratch *s)
{
    const size_t n = s->n;
    memset(modal->output_rows, 0, modal->outputs * modal->slots * sizeof *modal->output_rows);
    for (size_t i = 0; i < modal->outputs; i++) {
        memset(s->row, 0, n * sizeof *s->row);
        for (size_t k = 0; k < n; k++)
            vector_add_scaled(n, vector_product(n, C + i * n, s->transposed_Q + k * n), s->X + k * n, s->row);
        for (size_t j = 0; j < n; j++)
            modal->output_rows[i * modal->slots + (size_t)s->slots[j]] = s->row[j];
    }
}

/* V^-1 x at the columns of X, in `row`; x (n,) with entries `stride` apart. */
static void find_coordinates(const double *x, size_t stride, const ModalScratch *s)
{
    const size_t n = s->n;
    double *const product = s->rest;
    for (size_t i = 0; i < n; i++)
        s->row[i] = x[i * stride];
    for (size_t i = 0; i < n; i++)
        product[i] = vector_product(n, s->transposed_Q + i * n, s->row);
    for (size_t i = 0; i < n; i++)
        s->row[i] = vector_product(n, s->inverse + i * n, product);
}

/* V^-1 of `count` columns of B (states, inputs) from `first` on, as blocks. */
NOT_INLINED static void fill_inputs(const Modal *modal, const double *B, size_t first, size_t count, double *blocks,
                                    const ModalScratch *s)
{
    memset(blocks, 0, count * modal->slots * sizeof *blocks);
    for (size_t j = 0; j < count; j++) {
        find_coordinates(B + first + j, modal->held + modal->rare, s);
        for (size_t i = 0; i < s->n; i++) {
            const size_t slot = (size_t)s->slots[i];
            blocks[(slot / MODAL_BLOCK * count + j) * MODAL_BLOCK + slot % MODAL_BLOCK] = s->row[i];
        }
    }
}

double modal_build(const Modal *modal, double *A, const double *B, const double *C, double *scratch)
{
    const size_t n = modal->states;
    const ModalScratch s = modal_scratch_in(scratch, n, A);
    const double scale = scale_of(n * n, A);
    if (!(scale > 0.0))
        return HUGE_VAL;
    sort_by_size(A, scale, &s);
    if (!real_schur(n, s.T, s.transposed_Q, s.rest))
        return HUGE_VAL;
    restore_order(&s);
    double *const real = s.rest + 2 * n;
    double *const imaginary = real + n;
    schur_eigenvectors(n, s.T, s.X, real, imaginary, s.rest);
    invert_eigenvectors(n, s.T, s.X, s.inverse);
    for (size_t j = 0; j < n; j++) {
        real[j] *= scale;
        imaginary[j] *= scale;
    }
    fill_eigenvalues(modal, real, imaginary, &s);
    fill_vectors(modal, &s);
    fill_output_rows(modal, C, &s);
    fill_inputs(modal, B, 0, modal->held, modal->held_inputs, &s);
    fill_inputs(modal, B, modal->held, modal->rare, modal->rare_inputs, &s);
    return eigenvalue_condition(n, s.T, s.inverse);
}

NOT_INLINED void modal_coordinates(const Modal *modal, size_t columns, const double *X, double *z, double *scratch)
{
    const ModalScratch s = modal_scratch_in(scratch, modal->states, NULL);
    memset(z, 0, modal->slots * columns * sizeof *z);
    for (size_t j = 0; j < columns; j++) {
        find_coordinates(X + j, columns, &s);
        for (size_t i = 0; i < s.n; i++)
            z[(size_t)s.slots[i] * columns + j] = s.row[i];
    }
}
