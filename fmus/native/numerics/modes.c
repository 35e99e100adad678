/* By the real Schur form A = Q T Q' and the eigenvectors X of T: V = Q X, and V^-1 = X^-1 Q' by back-substitution. That
   keeps eigenvalues that coincide apart, as symmetry relations between left and right vectors do not. */

#include "modes.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "eigenvectors.h"
#include "schur.h"
#include "vectors.h"

double scale_of(size_t count, const double *entries)
{
    double largest = DBL_MIN;
    for (size_t k = 0; k < count; k++) {
        if (!(fabs(entries[k]) <= DBL_MAX))
            return 0.0;
        largest = fmax(largest, fabs(entries[k]));
    }
    int exponent;
    frexp(largest, &exponent);
    return ldexp(1.0, exponent - 1);
}

size_t modes_scratch_size(size_t n)
{
    return n * (2 * n + 5);
}

/* T = A / scale with rows and columns from the largest row to the smallest: in this order the small eigenvalues lose no
   digits to the large ones. `sizes` has room for n doubles. */
NOT_INLINED static void sort_by_size(size_t n, const double *A, double scale, double *T, double *order, double *sizes)
{
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
            T[i * n + j] = A[(size_t)order[i] * n + (size_t)order[j]] / scale;
}

/* The entries of the Schur vectors in the order of A again; `copy` has room for n doubles. */
static void restore_order(size_t n, double *transposed_Q, const double *order, double *copy)
{
    for (size_t k = 0; k < n; k++) {
        double *const vector = transposed_Q + k * n;
        memcpy(copy, vector, n * sizeof *vector);
        for (size_t i = 0; i < n; i++)
            vector[(size_t)order[i]] = copy[i];
    }
}

/* V' = X' Q' and V^-1 = X^-1 Q'; X and its inverse are block upper triangular. */
NOT_INLINED static void multiply_by_schur_vectors(const Modes *modes, const double *transposed_Q, const double *X,
                                                  const double *inverse)
{
    const size_t n = modes->n;
    memset(modes->transposed_V, 0, n * n * sizeof *X);
    memset(modes->inverse_V, 0, n * n * sizeof *X);
    for (size_t j = 0; j < n; j++)
        for (size_t k = 0; k < n && k <= j + 1; k++)
            if (X[k * n + j] != 0.0)
                vector_add_scaled(n, X[k * n + j], transposed_Q + k * n, modes->transposed_V + j * n);
    for (size_t i = 0; i < n; i++)
        for (size_t k = i > 0 ? i - 1 : 0; k < n; k++)
            if (inverse[i * n + k] != 0.0)
                vector_add_scaled(n, inverse[i * n + k], transposed_Q + k * n, modes->inverse_V + i * n);
}

bool find_dense_modes(const Modes *modes, double *A, double *scratch)
{
    const size_t n = modes->n;
    double *const T = modes->inverse_V;
    double *const X = A;
    double *const transposed_Q = scratch;
    double *const inverse = transposed_Q + n * n;
    double *const order = inverse + n * n;
    double *const row = order + n;
    double *const rest = row + n; /* (3, n) */
    const double scale = scale_of(n * n, A);
    if (!(scale > 0.0))
        return false;
    sort_by_size(n, A, scale, T, order, row);
    if (!real_schur(n, T, transposed_Q, rest))
        return false;
    restore_order(n, transposed_Q, order, row);
    schur_eigenvectors(n, T, X, modes->real, modes->imaginary, rest);
    invert_eigenvectors(n, T, X, inverse);
    for (size_t j = 0; j < n; j++) {
        modes->real[j] *= scale;
        modes->imaginary[j] *= scale;
    }
    multiply_by_schur_vectors(modes, transposed_Q, X, inverse);
    return true;
}

double eigenvalue_condition(const Modes *modes)
{
    const size_t n = modes->n;
    double largest = 0.0;
    for (size_t j = 0, width; j < n; j += width) {
        width = mode_width(modes->imaginary, j);
        const double *const v = modes->transposed_V + j * n;
        const double *const w = modes->inverse_V + j * n;
        const double product = vector_product(width * n, v, v) * vector_product(width * n, w, w);
        const double square = product / (double)(width * width);
        if (!(square <= largest)) /* NaN too */
            largest = square;
    }
    return largest <= DBL_MAX ? sqrt(largest) : HUGE_VAL;
}
