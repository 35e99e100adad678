/* Reduction to Hessenberg form by Householder's reflections, then QR steps with two shifts (Francis 1961), each a chain
   of reflections of three rows and columns. All loops run along rows but for one; sums keep their order, so the result
   is the same to the last bit wherever doubles are those of IEEE 754. */

#include "schur.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "vectors.h"

#define MOST_QR_STEPS 60         /* for one eigenvalue; about three are usual */
#define USUAL_QR_STEPS 10        /* after which a shift of another kind breaks a circle */
#define NEGLIGIBLE_SQUARE 1e-280 /* square of the length of a column, where entries are of size 1 */

static inline double *schur_entry(double *A, size_t n, size_t row, size_t column)
{
    return A + row * n + column;
}

/* row -= weight (row v) v' */
static void reflect_row(size_t n, double *row, const double *v, double weight)
{
    vector_add_scaled(n, -weight * vector_product(n, row, v), v, row);
}

/* Column k below the diagonal to (beta, 0, ..., 0) by 1 - weight v v', v = A[k + 1 ..][k] - beta e_1, kept in `v` and,
   but for its first entry, in place of the zeros. Returns the weight, 0 where there is nothing to do. */
static double reflect_column(size_t n, size_t k, double *A, double *v)
{
    double square = 0.0;
    for (size_t i = k + 1; i < n; i++) {
        v[i] = A[i * n + k];
        square += i > k + 1 ? v[i] * v[i] : 0.0;
    }
    if (!(square > NEGLIGIBLE_SQUARE))
        return 0.0;
    const double norm = sqrt(square + v[k + 1] * v[k + 1]);
    const double beta = v[k + 1] > 0.0 ? -norm : norm;
    v[k + 1] -= beta;
    A[(k + 1) * n + k] = beta;
    return -1 / (beta * v[k + 1]);
}

/* H in place of A, A = Q H Q', and Q' */
NOT_INLINED static void reduce_to_hessenberg(size_t n, double *A, double *transposed_Q, double *scratch)
{
    double *const v = scratch;
    double *const product = v + n;
    double *const weights = product + n;
    for (size_t k = 0; k + 2 < n; k++) {
        const double weight = weights[k] = reflect_column(n, k, A, v);
        const size_t first = k + 1;
        const size_t count = n - first;
        transposed_Q[k] = v[first];
        if (!(weight > 0.0))
            continue;
        memset(product + first, 0, count * sizeof *product);
        for (size_t i = first; i < n; i++)
            vector_add_scaled(count, v[i], A + i * n + first, product + first);
        for (size_t i = 0; i < n; i++) {
            double *const row = A + i * n + first;
            if (i >= first)
                vector_add_scaled(count, -weight * v[i], product + first, row);
            reflect_row(count, row, v + first, weight);
        }
    }
    double *const heads = product;
    memcpy(heads, transposed_Q, n * sizeof *heads);
    memset(transposed_Q, 0, n * n * sizeof *transposed_Q);
    for (size_t i = 0; i < n; i++)
        transposed_Q[i * n + i] = 1.0;
    for (size_t k = n < 2 ? 0 : n - 2; k-- > 0;) {
        v[k + 1] = heads[k];
        for (size_t i = k + 2; i < n; i++) {
            v[i] = A[i * n + k];
            A[i * n + k] = 0.0;
        }
        for (size_t i = k + 1; weights[k] > 0.0 && i < n; i++)
            reflect_row(n - k - 1, transposed_Q + i * n + k + 1, v + k + 1, weights[k]);
    }
}

/* A reflection 1 - (x, y, z)' (1, q, r) of three neighbouring rows or columns; of two where r = z = 0. */
typedef struct {
    double q;
    double r;
    double x;
    double y;
    double z;
} Reflection;

static void reflect_rows(size_t count, size_t stride, double *rows, const Reflection *by, size_t height)
{
    double *const first = rows;
    double *const second = rows + stride;
    double *const third = rows + (height - 1) * stride;
    const Pair q = pair_of(by->q);
    const Pair r = pair_of(by->r);
    const Pair x = pair_of(by->x);
    const Pair y = pair_of(by->y);
    const Pair z = pair_of(by->z);
    size_t j = 0;
    for (; height == 3 && j + 2 <= count; j += 2) {
        const Pair a = pair_load(first + j);
        const Pair b = pair_load(second + j);
        const Pair c = pair_load(third + j);
        const Pair sum = pair_add_product(pair_add_product(a, q, b), r, c);
        pair_store(first + j, pair_subtract_product(a, sum, x));
        pair_store(second + j, pair_subtract_product(b, sum, y));
        pair_store(third + j, pair_subtract_product(c, sum, z));
    }
    for (; j < count; j++) {
        const double sum = first[j] + by->q * second[j] + (height == 3 ? by->r * third[j] : 0.0);
        first[j] -= sum * by->x;
        second[j] -= sum * by->y;
        if (height == 3)
            third[j] -= sum * by->z;
    }
}

static void reflect_columns(size_t count, size_t stride, double *columns, const Reflection *by, size_t width)
{
    for (double *row = columns; row < columns + count * stride; row += stride)
        if (width == 3) {
            const double sum = by->x * row[0] + by->y * row[1] + by->z * row[2];
            row[0] -= sum;
            row[1] -= sum * by->q;
            row[2] -= sum * by->r;
        } else {
            const double sum = by->x * row[0] + by->y * row[1];
            row[0] -= sum;
            row[1] -= sum * by->q;
        }
}

/* The reflection that takes (p, q, r)' to (-*norm, 0, 0)'; *norm = 0 where there is none. */
static Reflection reflection_of(double p, double q, double r, double *norm)
{
    const double magnitude = fabs(p) + fabs(q) + fabs(r);
    *norm = 0.0;
    if (!(magnitude > 0.0))
        return (Reflection){0};
    p /= magnitude;
    q /= magnitude;
    r /= magnitude;
    const double length = p < 0.0 ? -sqrt(p * p + q * q + r * r) : sqrt(p * p + q * q + r * r);
    const double head = p + length;
    *norm = length * magnitude;
    return (Reflection){.q = q / head, .r = r / head, .x = head / length, .y = q / length, .z = r / length};
}

/* Is T[k][k - 1] negligible beside what surrounds it? */
static bool is_negligible(size_t n, double *T, size_t k, size_t end)
{
    const double before = k >= 2 ? fabs(*schur_entry(T, n, k - 1, k - 2)) : 0.0;
    const double after = k + 1 < end ? fabs(*schur_entry(T, n, k + 1, k)) : 0.0;
    const double least = before > 0.0 && after > 0.0 ? fmin(before, after) : fmax(before, after);
    const double around = fabs(*schur_entry(T, n, k, k)) + fabs(*schur_entry(T, n, k - 1, k - 1)) + least;
    return fabs(*schur_entry(T, n, k, k - 1)) <= DBL_EPSILON * around + DBL_MIN;
}

/* Two shifts by their sum and product. */
typedef struct {
    double sum;
    double product;
} Shifts;

/* The eigenvalues of the last 2 x 2 block of the rows before `end`, now and then others. */
static Shifts shifts_of(size_t n, double *T, size_t end, size_t step)
{
    const double last = *schur_entry(T, n, end - 1, end - 1);
    const double below = *schur_entry(T, n, end - 1, end - 2);
    if (step % USUAL_QR_STEPS == 0) {
        const double size = fabs(below) + fabs(*schur_entry(T, n, end - 2, end - 3));
        return (Shifts){.sum = 1.5 * size + 2 * last, .product = size * size + last * (1.5 * size + last)};
    }
    const double corner = *schur_entry(T, n, end - 2, end - 2);
    return (Shifts){.sum = last + corner, .product = last * corner - below * *schur_entry(T, n, end - 2, end - 1)};
}

/* First column (p, q, r) of (T - a)(T - b) for the rows from `top` on, divided by T[top + 1][top]. */
static void first_column(size_t n, double *T, size_t top, Shifts shifts, double column[3])
{
    const double corner = *schur_entry(T, n, top, top);
    const double below = *schur_entry(T, n, top + 1, top);
    column[0] = (corner * (corner - shifts.sum) + shifts.product) / below + *schur_entry(T, n, top, top + 1);
    column[1] = corner + *schur_entry(T, n, top + 1, top + 1) - shifts.sum;
    column[2] = *schur_entry(T, n, top + 2, top + 1);
}

/* Can a step begin at row `top`, below two small subdiagonal entries in a row? */
static bool may_begin_at(size_t n, double *T, size_t top, const double column[3])
{
    const double around = fabs(*schur_entry(T, n, top - 1, top - 1)) + fabs(*schur_entry(T, n, top, top)) +
                          fabs(*schur_entry(T, n, top + 1, top + 1));
    const double spilled = fabs(*schur_entry(T, n, top, top - 1)) * (fabs(column[1]) + fabs(column[2]));
    return spilled <= DBL_EPSILON * fabs(column[0]) * around;
}

/* One QR step on the rows begin ... end - 1. */
NOT_INLINED static void qr_step(size_t n, double *T, double *transposed_Q, size_t begin, size_t end, Shifts shifts)
{
    double column[3];
    size_t top = end - 3;
    first_column(n, T, top, shifts, column);
    while (top > begin && !may_begin_at(n, T, top, column))
        first_column(n, T, --top, shifts, column);
    for (size_t k = top; k + 1 < end; k++) {
        const size_t height = k + 2 < end ? 3 : 2;
        if (k > top)
            for (size_t i = 0; i < 3; i++)
                column[i] = i < height ? *schur_entry(T, n, k + i, k - 1) : 0.0;
        double norm;
        const Reflection by = reflection_of(column[0], column[1], column[2], &norm);
        if (norm == 0.0)
            continue;
        if (k > top)
            for (size_t i = 0; i < height; i++)
                *schur_entry(T, n, k + i, k - 1) = i == 0 ? -norm : 0.0;
        else if (top > begin)
            *schur_entry(T, n, k, k - 1) *= 1 - by.x;
        reflect_rows(n - k, n, schur_entry(T, n, k, k), &by, height);
        reflect_columns(k + 4 < end ? k + 4 : end, n, T + k, &by, height);
        reflect_rows(n, n, schur_entry(transposed_Q, n, k, 0), &by, height);
    }
}

/* Makes the 2 x 2 block at rows k, k + 1 triangular where its eigenvalues are real. */
NOT_INLINED static void split_block(size_t n, double *T, double *transposed_Q, size_t k)
{
    double *const block = T + k * n + k;
    const double half = (block[0] - block[n + 1]) / 2;
    const double square = half * half + block[1] * block[n];
    if (block[n] == 0.0 || square < 0.0)
        return;
    const double root = half + (half < 0.0 ? -sqrt(square) : sqrt(square)); /* first eigenvalue less the last entry */
    double norm;
    const Reflection by = reflection_of(root, block[n], 0.0, &norm); /* eigenvector (root, subdiagonal) to (1, 0) */
    if (norm == 0.0)
        return;
    reflect_rows(n - k, n, block, &by, 2);
    reflect_columns(k + 2, n, T + k, &by, 2);
    reflect_rows(n, n, transposed_Q + k * n, &by, 2);
    block[n] = 0.0;
}

NOT_INLINED bool real_schur(size_t n, double *A, double *transposed_Q, double *scratch)
{
    reduce_to_hessenberg(n, A, transposed_Q, scratch);
    size_t step = 0;
    for (size_t end = n; end > 0;) {
        size_t begin = end - 1;
        while (begin > 0 && !is_negligible(n, A, begin, end))
            begin--;
        if (begin > 0)
            A[begin * n + begin - 1] = 0.0;
        if (end - begin <= 2) {
            if (end - begin == 2)
                split_block(n, A, transposed_Q, begin);
            end = begin;
            step = 0;
        } else if (++step > MOST_QR_STEPS) {
            return false;
        } else {
            qr_step(n, A, transposed_Q, begin, end, shifts_of(n, A, end, step));
        }
    }
    return true;
}
