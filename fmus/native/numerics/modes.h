/* Eigenvalues and eigenvectors of a real matrix A in real numbers: A V = V Lambda. The caller owns all memory. */

#ifndef MODES_H
#define MODES_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

/* A pair s +- i w takes two neighbouring places, the real and the imaginary part of the vector of s + i w, with
   [s, w; -w, s] in Lambda; a real eigenvalue one. */
typedef struct {
    size_t n;
    double *real;         /* (n,) s of each place */
    double *imaginary;    /* (n,) w of each place, >= 0 */
    double *transposed_V; /* (n, n) */
    double *inverse_V;    /* (n, n) */
} Modes;

/* A power of two near the largest of `count` entries; 0 where one is not finite. */
INTERNAL double scale_of(size_t count, const double *entries);

/* Places of the mode at place i. */
INTERNAL_INLINE size_t mode_width(const double *imaginary, size_t i)
{
    return imaginary[i] > 0.0 ? 2 : 1;
}

/* Adds the block of Lambda of the mode at place i to A (n, n); its places. */
INTERNAL_INLINE size_t add_mode(size_t n, size_t i, double real, double imaginary, double *A)
{
    A[i * n + i] += real;
    if (!(imaginary > 0.0))
        return 1;
    A[(i + 1) * n + i + 1] += real;
    A[i * n + i + 1] += imaginary;
    A[(i + 1) * n + i] -= imaginary;
    return 2;
}

/* Doubles that find_dense_modes works in. */
INTERNAL size_t modes_scratch_size(size_t n);
/* The modes of a dense A (n, n), which is destroyed; a vector has length 1, the two of a pair sqrt(2) together. False
   where A is not finite; inverse_V may not be either. */
INTERNAL bool find_dense_modes(const Modes *modes, double *A, double *scratch);
/* The largest condition number of an eigenvalue, |v| |w| / |w' v| of its right and left vectors, by which rounding
   errors grow: 1 where A is normal, HUGE_VAL where there are no independent eigenvectors. */
INTERNAL double eigenvalue_condition(const Modes *modes);

#endif
