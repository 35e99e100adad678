/* Scaling and squaring with the Pade approximant of degree 13 (Higham 2005). */

#include "matrix_exponential.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"

#define LARGEST_NORM 5.371920351148152 /* for which the approximant is exact to rounding */
#define MOST_SQUARINGS 100

/* Coefficients of the approximant. */
static const double pade[14] = {64764752532480000.0,
                                32382376266240000.0,
                                7771770303897600.0,
                                1187353796428800.0,
                                129060195264000.0,
                                10559470521600.0,
                                670442572800.0,
                                33522128640.0,
                                1323241920.0,
                                40840800.0,
                                960960.0,
                                16380.0,
                                182.0,
                                1.0};

/* Largest sum of the magnitudes in a column. */
static double column_norm(size_t n, const double *A, double *sums)
{
    memset(sums, 0, n * sizeof *sums);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            sums[j] += fabs(A[i * n + j]);
    double largest = 0.0;
    for (size_t j = 0; j < n; j++)
        if (!(sums[j] <= largest)) /* NaN too */
            largest = sums[j];
    return largest;
}

size_t matrix_exponential_size(size_t n)
{
    return 6 * n * n;
}

NOT_INLINED bool matrix_exponential(size_t n, double *A, double *workspace)
{
    const size_t size = n * n;
    double *const A2 = workspace;
    double *const A4 = A2 + size;
    double *const A6 = A4 + size;
    double *const U = A6 + size;
    double *const V = U + size;
    double *const W = V + size;

    int exponent = 0;
    const double magnitude = column_norm(n, A, W) / LARGEST_NORM;
    if (!isfinite(magnitude))
        return false;
    frexp(magnitude, &exponent);
    const int squarings = magnitude > 1.0 ? exponent : 0;
    if (squarings > MOST_SQUARINGS)
        return false;
    const double scale = ldexp(1.0, -squarings);
    for (size_t k = 0; k < size; k++)
        A[k] *= scale;

    multiply_matrices(n, n, n, A, A, A2);
    multiply_matrices(n, n, n, A2, A2, A4);
    multiply_matrices(n, n, n, A2, A4, A6);
    for (size_t k = 0; k < size; k++)
        W[k] = pade[13] * A6[k] + pade[11] * A4[k] + pade[9] * A2[k];
    multiply_matrices(n, n, n, A6, W, V);
    for (size_t k = 0; k < size; k++)
        V[k] += pade[7] * A6[k] + pade[5] * A4[k] + pade[3] * A2[k];
    for (size_t k = 0; k < n; k++)
        V[k * n + k] += pade[1];
    multiply_matrices(n, n, n, A, V, U); /* the odd powers */
    for (size_t k = 0; k < size; k++)
        W[k] = pade[12] * A6[k] + pade[10] * A4[k] + pade[8] * A2[k];
    multiply_matrices(n, n, n, A6, W, V);
    for (size_t k = 0; k < size; k++)
        V[k] += pade[6] * A6[k] + pade[4] * A4[k] + pade[2] * A2[k];
    for (size_t k = 0; k < n; k++)
        V[k * n + k] += pade[0]; /* the even powers */

    /* Y = exp(A) - I = (V - U)^-1 2 U, and exp(2 A) - I = 2 Y + Y Y: beside I, small eigenvalues would lose digits. */
    for (size_t k = 0; k < size; k++) {
        A[k] = 2.0 * U[k];
        V[k] -= U[k];
    }
    if (!solve_general(n, n, V, A))
        return false;
    for (int square = 0; square < squarings; square++) {
        multiply_matrices(n, n, n, A, A, W);
        for (size_t k = 0; k < size; k++)
            A[k] = 2.0 * A[k] + W[k];
    }
    for (size_t k = 0; k < n; k++)
        A[k * n + k] += 1.0;
    return true;
}
