#include "eigenvectors.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "complex_number.h"
#include "vectors.h"

/* The entries of an eigenvector of T that are known so far, from the last one of its diagonal block up. */
typedef struct {
    size_t n;
    const double *T;
    double *real;
    double *imaginary;
    size_t end;    /* of the entries */
    Complex value; /* eigenvalue */
    double least;  /* what stands for a smaller divisor */
} Eigenvector;

/* a / b, but of |b| below `least` as if it were that. */
static Complex complex_quotient(Complex a, Complex b, double least)
{
    const double size = fmax(fabs(b.real), fabs(b.imaginary));
    if (!(size >= least))
        return (Complex){a.real / least, a.imaginary / least};
    b.real /= size;
    b.imaginary /= size;
    const double square = (b.real * b.real + b.imaginary * b.imaginary) * size;
    const Complex product = complex_product(a, (Complex){b.real, -b.imaginary});
    return (Complex){product.real / square, product.imaginary / square};
}

static void set_entry(const Eigenvector *v, size_t i, Complex x)
{
    v->real[i] = x.real;
    v->imaginary[i] = x.imaginary;
}

/* Minus the product of row i of T, from column `first` on, and the vector. */
static Complex minus_product(const Eigenvector *v, size_t i, size_t first)
{
    const double *const row = v->T + i * v->n + first;
    return (Complex){-vector_product(v->end - first, row, v->real + first),
                     -vector_product(v->end - first, row, v->imaginary + first)};
}

static double complex_size(Complex a)
{
    return fabs(a.real) + fabs(a.imaginary);
}

static Complex complex_difference(Complex a, Complex b)
{
    return (Complex){a.real - b.real, a.imaginary - b.imaginary};
}

/* Entries i and i + 1, the rows of a 2 x 2 block of T, by elimination from its largest entry on: where the block has
   the eigenvalue of the vector too, the equations are consistent but for rounding, and so is the solution. */
static void solve_block(const Eigenvector *v, size_t i)
{
    const double *const block = v->T + i * v->n + i;
    const Complex matrix[2][2] = {
        {{block[0] - v->value.real, -v->value.imaginary}, {block[1], 0.0}},
        {{block[v->n], 0.0}, {block[v->n + 1] - v->value.real, -v->value.imaginary}},
    };
    const Complex right[2] = {minus_product(v, i, i + 2), minus_product(v, i + 1, i + 2)};
    size_t row = 0;
    size_t column = 0;
    for (size_t k = 1; k < 4; k++)
        if (complex_size(matrix[k / 2][k % 2]) > complex_size(matrix[row][column])) {
            row = k / 2;
            column = k % 2;
        }
    const Complex pivot = matrix[row][column];
    const Complex beside = matrix[row][1 - column];
    const Complex factor = complex_quotient(matrix[1 - row][column], pivot, v->least);
    const Complex divisor = complex_difference(matrix[1 - row][1 - column], complex_product(factor, beside));
    const Complex other =
        complex_quotient(complex_difference(right[1 - row], complex_product(factor, right[row])), divisor, v->least);
    const Complex own =
        complex_quotient(complex_difference(right[row], complex_product(beside, other)), pivot, v->least);
    set_entry(v, i + column, own);
    set_entry(v, i + 1 - column, other);
}

/* The eigenvector of the diagonal block that begins at row `begin` and ends before v->end. Where a block further up has
   the same eigenvalue a divisor vanishes; one of the size of rounding in its place gives an independent vector. */
NOT_INLINED static void find_eigenvector(Eigenvector *v, size_t begin)
{
    const size_t n = v->n;
    const double *const block = v->T + begin * n + begin;
    v->value = (Complex){block[0], 0.0};
    set_entry(v, begin, (Complex){1.0, 0.0});
    if (v->end - begin == 2) {
        const double half = (block[0] - block[n + 1]) / 2;
        v->value = (Complex){block[n + 1] + half, sqrt(-(half * half + block[1] * block[n]))};
        const double w = v->value.imaginary;
        const bool is_upper_larger = fabs(block[1]) > fabs(block[n]);
        set_entry(v, begin, is_upper_larger ? (Complex){block[1], 0.0} : (Complex){half, w});
        set_entry(v, begin + 1, is_upper_larger ? (Complex){-half, w} : (Complex){block[n], 0.0});
    }
    for (size_t i = begin; i-- > 0;) {
        if (i > 0 && v->T[i * n + i - 1] != 0.0) {
            solve_block(v, --i);
            continue;
        }
        const Complex divisor = {v->T[i * n + i] - v->value.real, -v->value.imaginary};
        set_entry(v, i, complex_quotient(minus_product(v, i, i + 1), divisor, v->least));
    }
}

static size_t end_of_block(size_t n, const double *T, size_t begin)
{
    return begin + (begin + 1 < n && T[(begin + 1) * n + begin] != 0.0 ? 2 : 1);
}

NOT_INLINED void schur_eigenvectors(size_t n, const double *T, double *X, double *real, double *imaginary,
                                    double *scratch)
{
    Eigenvector v = {.n = n, .T = T, .real = scratch, .imaginary = scratch + n};
    for (size_t k = 0; k < n * n; k++)
        v.least = fmax(v.least, DBL_EPSILON * fabs(T[k]));
    memset(X, 0, n * n * sizeof *X);
    for (size_t begin = 0; begin < n; begin = v.end) {
        v.end = end_of_block(n, T, begin);
        find_eigenvector(&v, begin);
        const double square = vector_product(v.end, v.real, v.real) + vector_product(v.end, v.imaginary, v.imaginary);
        const double scale = sqrt((double)(v.end - begin) / square);
        for (size_t j = begin; j < v.end; j++) {
            const double *const part = j == begin ? v.real : v.imaginary;
            for (size_t i = 0; i < v.end; i++)
                X[i * n + j] = part[i] * scale;
            real[j] = v.value.real;
            imaginary[j] = v.value.imaginary;
        }
    }
}

/* Rows of the inverse from their right sides: those of one diagonal block of X. */
static void divide_rows(size_t n, const double *block, size_t height, size_t count, double *rows)
{
    if (height == 1) {
        for (size_t j = 0; j < count; j++)
            rows[j] /= block[0];
        return;
    }
    const double determinant = block[0] * block[n + 1] - block[1] * block[n];
    for (size_t j = 0; j < count; j++) {
        const double x = rows[j];
        const double y = rows[n + j];
        rows[j] = (block[n + 1] * x - block[1] * y) / determinant;
        rows[n + j] = (block[0] * y - block[n] * x) / determinant;
    }
}

NOT_INLINED void invert_eigenvectors(size_t n, const double *T, const double *X, double *inverse)
{
    memset(inverse, 0, n * n * sizeof *inverse);
    for (size_t end = n; end > 0;) {
        const size_t begin = end - (end > 1 && T[(end - 1) * n + end - 2] != 0.0 ? 2 : 1);
        for (size_t i = begin; i < end; i++) {
            double *const row = inverse + i * n;
            row[i] = 1.0;
            for (size_t j = end; j < n; j++)
                vector_add_scaled(n - end, -X[i * n + j], inverse + j * n + end, row + end);
        }
        divide_rows(n, X + begin * n + begin, end - begin, n - begin, inverse + begin * n + begin);
        end = begin;
    }
}
