/* Dense matrices of doubles, row by row. The caller owns all memory. */

#ifndef LINEAR_ALGEBRA_H
#define LINEAR_ALGEBRA_H

#include "unit.h"

#define PANEL 8  /* rows side by side in a panel */

#define panels_size fmi2FullName(panels_size)
#define fill_panels fmi2FullName(fill_panels)
#define multiply_panels fmi2FullName(multiply_panels)
#define multiply_matrices fmi2FullName(multiply_matrices)
#define cholesky fmi2FullName(cholesky)
#define solve_lower fmi2FullName(solve_lower)
#define solve_general fmi2FullName(solve_general)
#define matrix_exponential_size fmi2FullName(matrix_exponential_size)
#define matrix_exponential fmi2FullName(matrix_exponential)

/* A matrix for fast products with vectors is stored in panels of PANEL rows, each column by column, the last
   panel filled up with zeros. */

/* Doubles of a (rows, columns) matrix in panels. */
SHARED size_t panels_size(size_t rows, size_t columns);
/* The panels of a (rows, columns) matrix whose rows start `stride` doubles apart. */
SHARED void fill_panels(size_t rows, size_t columns, const double *matrix, size_t stride, double *panels);
/* y = A x, or y += A x where `add`; A (rows, columns) in panels, x (columns,), y (rows,) apart from x. */
SHARED void multiply_panels(size_t rows, size_t columns, const double *panels, const double *x, bool add, double *y);

/* C = A B; A (rows, inner), B (inner, columns), C (rows, columns) apart from both. */
SHARED void multiply_matrices(size_t rows, size_t inner, size_t columns, const double *A, const double *B, double *C);
/* L with A = L L' in place of A (n, n), zeros above the diagonal; false where A is not positive definite. */
SHARED bool cholesky(size_t n, double *A);
/* X with L X = B in place of B (n, columns); L (n, n) lower triangular. */
SHARED void solve_lower(size_t n, size_t columns, const double *L, double *B);
/* X with A X = B in place of B (n, columns), by elimination with row exchanges, which destroys A (n, n);
   false where A is singular. */
SHARED bool solve_general(size_t n, size_t columns, double *A, double *B);

/* Doubles that matrix_exponential works in. */
SHARED size_t matrix_exponential_size(size_t n);
/* exp(A) in place of A (n, n); false where A is too large. */
SHARED bool matrix_exponential(size_t n, double *A, double *workspace);

#endif
