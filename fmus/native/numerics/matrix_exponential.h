/* The exponential of a dense matrix. The caller owns all memory. */

#ifndef MATRIX_EXPONENTIAL_H
#define MATRIX_EXPONENTIAL_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

/* Doubles of the workspace of matrix_exponential. */
INTERNAL size_t matrix_exponential_size(size_t n);
/* exp(A) in place of A (n, n); false where A is too large. */
INTERNAL bool matrix_exponential(size_t n, double *A, double *workspace);

#endif
