/* Dense matrices of doubles, row by row. The caller owns all memory. */

#ifndef LINEAR_ALGEBRA_H
#define LINEAR_ALGEBRA_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

#define PANEL 8 /* rows side by side in a panel */

/* A matrix for fast products with vectors is stored in panels of PANEL rows, each column by column, the last
   panel filled up with zeros. */

/* Doubles of a (rows, columns) matrix in panels. */
INTERNAL size_t panels_size(size_t rows, size_t columns);
/* The panels of a (rows, columns) matrix whose rows start `stride` doubles apart. */
INTERNAL void fill_panels(size_t rows, size_t columns, const double *matrix, size_t stride, double *panels);
/* y = A x, or y += A x where `add`; A (rows, columns) in panels, x (columns,), y (rows,) apart from x. */
INTERNAL void multiply_panels(size_t rows, size_t columns, const double *panels, const double *x, bool add, double *y);
/* Y (vectors, rows) = A x for one or two vectors x (columns,), which start `stride` doubles apart. */
INTERNAL void multiply_panels_twice(size_t rows, size_t columns, const double *panels, const double *X, size_t stride,
                                    size_t vectors, double *Y);

/* C = A B; A (rows, inner), B (inner, columns), C (rows, columns) apart from both. */
INTERNAL void multiply_matrices(size_t rows, size_t inner, size_t columns, const double *A, const double *B, double *C);
/* `transposed` (columns, rows) = A', A (rows, columns) apart from it. */
INTERNAL void transpose(size_t rows, size_t columns, const double *A, double *transposed);
/* L with A = L L' in place of A (n, n), zeros above the diagonal; false where A is not positive definite. Zeros at the
   beginning of a row, which stay, take no time. */
INTERNAL bool cholesky(size_t n, double *A);
/* Of each row the number, from 0 on, of the diagonal block of L (n, n), lower triangular, that it belongs to. */
INTERNAL void number_blocks(size_t n, const double *L, double *blocks);
/* X with L X = B in place of B (n, columns); L (n, n) lower triangular. */
INTERNAL void solve_lower(size_t n, size_t columns, const double *L, double *B);
/* x with L' x = b in place of b (n,); L (n, n) lower triangular. */
INTERNAL void solve_lower_transposed(size_t n, const double *L, double *b);
/* X with A X = B in place of B (n, columns), by elimination with row exchanges, which destroys A (n, n);
   false where A is singular. */
INTERNAL bool solve_general(size_t n, size_t columns, double *A, double *B);

#endif
