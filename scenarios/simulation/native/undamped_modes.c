/* Singular values and vectors of C = U S V', side by side: the undamped modes. By the one-sided Jacobi method, which
   turns pairs of columns until all are orthogonal. */
#include <float.h>

#include "group_modes.h"

#define SWEEPS 30

/* Turns two columns until they are orthogonal, in the lanes where they are not yet; these are returned. */
INLINE LaneMask orthogonalise(size_t n, Lanes *a, Lanes *b)
{
    const Lanes none = lanes_of(0.0);
    const Lanes one = lanes_of(1.0);
    const double smallest = (double)n * DBL_EPSILON; /* of the cosine between them */
    Lanes aa = none;
    Lanes bb = none;
    Lanes ab = none;
    for (size_t i = 0; i < n; i++) {
        aa = lanes_add_product(aa, a[i], a[i]);
        bb = lanes_add_product(bb, b[i], b[i]);
        ab = lanes_add_product(ab, a[i], b[i]);
    }
    const Lanes limit = lanes_multiply(lanes_of(smallest * smallest), lanes_multiply(aa, bb));
    const LaneMask turning = lanes_above(lanes_multiply(ab, ab), limit);
    if (!lanes_any(turning))
        return turning;
    const Lanes ratio = lanes_divide(lanes_subtract(bb, aa), lanes_add(ab, ab));
    const Lanes root = lanes_root(lanes_add_product(one, ratio, ratio));
    const Lanes size = lanes_divide(one, lanes_add(lanes_magnitude(ratio), root));
    const Lanes signed_size = lanes_choose(lanes_above(none, ratio), lanes_subtract(none, size), size);
    const Lanes tangent = lanes_choose(turning, signed_size, none);
    const Lanes cosine = lanes_divide(one, lanes_root(lanes_add_product(one, tangent, tangent)));
    const Lanes sine = lanes_multiply(cosine, tangent);
    for (size_t i = 0; i < n; i++) {
        const Lanes old = a[i];
        a[i] = lanes_subtract(lanes_multiply(cosine, old), lanes_multiply(sine, b[i]));
        b[i] = lanes_add(lanes_multiply(sine, old), lanes_multiply(cosine, b[i]));
    }
    return turning;
}

/* U S in place of C; returns the lanes that have not converged. The pairs of a sweep are ordered as in a tournament:
   those of a round have no column in common. */
INLINE LaneMask orthogonalise_all(size_t n, Lanes *U)
{
    const size_t even = n + n % 2;
    LaneMask turning = lanes_above(lanes_of(1.0), lanes_of(0.0));
    for (size_t sweep = 0; sweep < SWEEPS && lanes_any(turning); sweep++) {
        turning = lanes_above(lanes_of(0.0), lanes_of(0.0));
        for (size_t round = 0; round + 1 < even; round++)
            for (size_t k = 0; k < even / 2; k++) {
                const size_t a = (round + k) % (even - 1);
                const size_t b = k == 0 ? even - 1 : (round + even - 1 - k) % (even - 1);
                if (b < n)
                    turning = lanes_either(turning, orthogonalise(n, U + a * n, U + b * n));
            }
    }
    return turning;
}

/* a (rows, n) in terms of U: a U, in place of a. */
static void project(size_t n, const Lanes *U, size_t rows, Lanes *a, Lanes *scratch)
{
    for (size_t k = 0; k < rows; k++, a += n) {
        for (size_t i = 0; i < n; i++)
            scratch[i] = product_of(n, a, U + i * n);
        for (size_t i = 0; i < n; i++)
            a[i] = scratch[i];
    }
}

/* R C' behind the inputs among the columns. */
static void carry_outputs(const Modes *m, const BeamPlantData *plant)
{
    const size_t n = m->n;
    const size_t outputs = plant->points + plant->gauges;
    Lanes *to = m->columns + (m->vectors - outputs) * n;
    for (size_t k = 0; k < outputs; k++, to += n) {
        for (size_t i = 0; i < n; i++)
            to[i] = lanes_of(0.0);
        for (size_t j = 0; j < n; j++)
            for (size_t i = 0; i < n; i++)
                to[i] = lanes_add_product(to[i], m->rows[k * n + j], m->U[j * n + i]);
    }
}

void find_undamped(const Modes *m, const BeamPlantData *plant)
{
    const size_t n = m->n;
    carry_outputs(m, plant);
    const LaneMask turning = orthogonalise_all(n, m->U);
    for (size_t j = 0; j < n; j++) {
        Lanes *const column = m->U + j * n;
        m->squares[j] = product_of(n, column, column);
        const Lanes scale = lanes_divide(lanes_of(1.0), lanes_root(m->squares[j]));
        for (size_t i = 0; i < n; i++)
            column[i] = lanes_multiply(column[i], scale);
    }
    for (size_t j = 0; j < n; j++) /* G is symmetric: its rows are its columns */
        for (size_t i = 0; i < n; i++)
            m->product[j * n + i] = product_of(n, m->damping + i * n, m->U + j * n);
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++)
            m->damping[j * n + i] = product_of(n, m->U + i * n, m->product + j * n);
    project(n, m->U, m->vectors, m->columns, m->product);
    *m->is_found = lanes_choose(turning, lanes_of(0.0), lanes_of(1.0));
}
