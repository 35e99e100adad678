/* The real Schur form of a matrix. The caller owns all memory. */

#ifndef SCHUR_H
#define SCHUR_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

/* T in place of A (n, n), and the transpose of Q (n, n), with A = Q T Q', Q orthogonal, T upper triangular but for
   2 x 2 blocks on its diagonal, which hold a pair of complex eigenvalues each: a subdiagonal entry is 0 elsewhere. The
   largest entry of A should be near 1, as squares of others are neglected. `scratch` has room for 3 n doubles. False
   where the iteration does not end, as with an A that is not finite; no other is known. */
INTERNAL bool real_schur(size_t n, double *A, double *transposed_Q, double *scratch);

#endif
