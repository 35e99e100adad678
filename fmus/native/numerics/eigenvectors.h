/* Eigenvectors of a real Schur form T (n, n) as real_schur makes it. The caller owns all memory. */

#ifndef EIGENVECTORS_H
#define EIGENVECTORS_H

#include <stddef.h>

#include "internal.h"

/* X (n, n), block upper triangular like T, with T X = X Lambda: in the column of a real eigenvalue its vector, of
   length 1; in the two columns of a pair s +- i w the real and imaginary part of the vector of s + i w, of length
   sqrt(2) together. real, imaginary (n,): s and w of each column, w >= 0. `scratch` has room for 2 n doubles. */
INTERNAL void schur_eigenvectors(size_t n, const double *T, double *X, double *real, double *imaginary,
                                 double *scratch);
/* X^-1 (n, n) */
INTERNAL void invert_eigenvectors(size_t n, const double *T, const double *X, double *inverse);

#endif
