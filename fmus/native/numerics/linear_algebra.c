#include "linear_algebra.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "vectors.h"

size_t panels_size(size_t rows, size_t columns)
{
    return (rows + PANEL - 1) / PANEL * PANEL * columns;
}

void fill_panels(size_t rows, size_t columns, const double *matrix, size_t stride, double *panels)
{
    for (size_t i = 0; i < rows; i += PANEL)
        for (size_t j = 0; j < columns; j++)
            for (size_t k = 0; k < PANEL; k++)
                *panels++ = i + k < rows ? matrix[(i + k) * stride + j] : 0.0;
}

void multiply_panels(size_t rows, size_t columns, const double *panels, const double *x, bool add, double *y)
{
    for (size_t i = 0; i < rows; i += PANEL) {
        Pair sums[PANEL / 2] = {pair_of(0.0), pair_of(0.0), pair_of(0.0), pair_of(0.0)};
        for (size_t j = 0; j < columns; j++, panels += PANEL) {
            const Pair factor = pair_of(x[j]);
            sums[0] = pair_add_product(sums[0], pair_load(panels), factor);
            sums[1] = pair_add_product(sums[1], pair_load(panels + 2), factor);
            sums[2] = pair_add_product(sums[2], pair_load(panels + 4), factor);
            sums[3] = pair_add_product(sums[3], pair_load(panels + 6), factor);
        }
        double product[PANEL];
        for (size_t k = 0; k < PANEL / 2; k++)
            pair_store(product + 2 * k, sums[k]);
        for (size_t k = 0; k < PANEL && i + k < rows; k++)
            y[i + k] = add ? y[i + k] + product[k] : product[k];
    }
}

void multiply_panels_twice(size_t rows, size_t columns, const double *panels, const double *X, size_t stride,
                           size_t vectors, double *Y)
{
    if (vectors == 1) {
        multiply_panels(rows, columns, panels, X, false, Y);
        return;
    }
    const double *const other = X + stride;
    for (size_t i = 0; i < rows; i += PANEL) {
        const Pair zero = pair_of(0.0);
        Pair sums[2][PANEL / 2] = {{zero, zero, zero, zero}, {zero, zero, zero, zero}};
        for (size_t j = 0; j < columns; j++, panels += PANEL) {
            const Pair factor = pair_of(X[j]);
            const Pair second = pair_of(other[j]);
            const Pair entries[PANEL / 2] = {pair_load(panels), pair_load(panels + 2), pair_load(panels + 4),
                                             pair_load(panels + 6)};
            sums[0][0] = pair_add_product(sums[0][0], entries[0], factor);
            sums[0][1] = pair_add_product(sums[0][1], entries[1], factor);
            sums[0][2] = pair_add_product(sums[0][2], entries[2], factor);
            sums[0][3] = pair_add_product(sums[0][3], entries[3], factor);
            sums[1][0] = pair_add_product(sums[1][0], entries[0], second);
            sums[1][1] = pair_add_product(sums[1][1], entries[1], second);
            sums[1][2] = pair_add_product(sums[1][2], entries[2], second);
            sums[1][3] = pair_add_product(sums[1][3], entries[3], second);
        }
        double products[2][PANEL];
        for (size_t l = 0; l < 2; l++)
            for (size_t k = 0; k < PANEL / 2; k++)
                pair_store(products[l] + 2 * k, sums[l][k]);
        for (size_t k = 0; k < PANEL && i + k < rows; k++) {
            Y[i + k] = products[0][k];
            Y[rows + i + k] = products[1][k];
        }
    }
}

NOT_INLINED void multiply_matrices(size_t rows, size_t inner, size_t columns, const double *A, const double *B,
                                   double *C)
{
    memset(C, 0, rows * columns * sizeof *C);
    for (size_t i = 0; i < rows; i++)
        for (size_t k = 0; k < inner; k++) {
            const double factor = A[i * inner + k];
            const double *const row = B + k * columns;
            double *const sum = C + i * columns;
            for (size_t j = 0; j < columns; j++)
                sum[j] += factor * row[j];
        }
}

void transpose(size_t rows, size_t columns, const double *A, double *transposed)
{
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < columns; j++)
            transposed[j * rows + i] = A[i * columns + j];
}

bool cholesky(size_t n, double *A)
{
    for (size_t j = 0; j < n; j++) {
        double *const row = A + j * n;
        size_t first = 0;
        while (first < j && row[first] == 0.0)
            first++;
        for (size_t i = first; i < j; i++) {
            double sum = row[i];
            for (size_t k = first; k < i; k++)
                sum -= row[k] * A[i * n + k];
            row[i] = sum / A[i * n + i];
        }
        double pivot = row[j];
        for (size_t k = first; k < j; k++)
            pivot -= row[k] * row[k];
        if (!(pivot > 0.0 && pivot <= DBL_MAX))
            return false;
        row[j] = sqrt(pivot);
        for (size_t k = j + 1; k < n; k++)
            row[k] = 0.0;
    }
    return true;
}

void number_blocks(size_t n, const double *L, double *blocks)
{
    size_t leftmost = n; /* of this row and those below */
    for (size_t i = n; i-- > 0;) {
        size_t first = 0;
        while (first < i && L[i * n + first] == 0.0)
            first++;
        leftmost = first < leftmost ? first : leftmost;
        blocks[i] = leftmost == i ? 1.0 : 0.0; /* does a block begin? */
    }
    double number = -1.0;
    for (size_t i = 0; i < n; i++) {
        number += blocks[i];
        blocks[i] = number;
    }
}

void solve_lower(size_t n, size_t columns, const double *L, double *B)
{
    for (size_t i = 0; i < n; i++) {
        double *const row = B + i * columns;
        for (size_t k = 0; k < i; k++)
            if (L[i * n + k] != 0.0)
                vector_add_scaled(columns, -L[i * n + k], B + k * columns, row);
        for (size_t j = 0; j < columns; j++)
            row[j] /= L[i * n + i];
    }
}

void solve_lower_transposed(size_t n, const double *L, double *b)
{
    for (size_t i = n; i-- > 0;) {
        b[i] /= L[i * n + i];
        for (size_t k = 0; k < i; k++)
            b[k] -= L[i * n + k] * b[i];
    }
}

static void swap_rows(double *one, double *other, size_t columns)
{
    for (size_t j = 0; j < columns; j++) {
        const double value = one[j];
        one[j] = other[j];
        other[j] = value;
    }
}

NOT_INLINED bool solve_general(size_t n, size_t columns, double *A, double *B)
{
    for (size_t k = 0; k < n; k++) {
        size_t best = k;
        for (size_t i = k + 1; i < n; i++)
            if (fabs(A[i * n + k]) > fabs(A[best * n + k]))
                best = i;
        if (!(fabs(A[best * n + k]) > 0.0))
            return false;
        if (best != k) {
            swap_rows(A + k * n, A + best * n, n);
            swap_rows(B + k * columns, B + best * columns, columns);
        }
        for (size_t i = k + 1; i < n; i++) {
            const double factor = A[i * n + k] / A[k * n + k];
            for (size_t j = k + 1; j < n; j++)
                A[i * n + j] -= factor * A[k * n + j];
            for (size_t j = 0; j < columns; j++)
                B[i * columns + j] -= factor * B[k * columns + j];
        }
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++)
            for (size_t j = 0; j < columns; j++)
                B[i * columns + j] -= A[i * n + k] * B[k * columns + j];
        for (size_t j = 0; j < columns; j++)
            B[i * columns + j] /= A[i * n + i];
    }
    return true;
}
