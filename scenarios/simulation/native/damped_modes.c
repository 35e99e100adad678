/* Damped modes s, v of s^2 v + s G v + S^2 v = 0 with the damping G in terms of the undamped modes, side by side. A
   damped mode differs little from an undamped one: the other entries of v follow from those before by a fixed-point
   iteration. */
#include <float.h>

#include "group_modes.h"
#include "modal_build.h"

#define ITERATIONS 60

/* s with s^2 + s g + square = 0 and a positive imaginary part. Not finite where the
   roots are real, or nearly so. */
INLINE Complex eigenvalue(Complex g, Lanes square)
{
    const Lanes none = lanes_of(0.0);
    const Complex half = scaled(lanes_of(0.5), g);
    const Complex radicand = minus((Complex){square, none}, times(half, half));
    const Lanes size = lanes_root(square_of(radicand));
    const Lanes root = lanes_root(lanes_multiply(lanes_of(0.5), lanes_add(size, radicand.real)));
    const Lanes real = lanes_choose(lanes_above(radicand.real, none), root, none);
    const Lanes imaginary = lanes_divide(lanes_multiply(lanes_of(0.5), radicand.imaginary), real);
    return minus((Complex){lanes_subtract(none, imaginary), real}, half);
}

/* a (n,) times v. */
INLINE Complex product_with(size_t n, const Lanes *a, const Complex *v)
{
    Complex sums[2] = {NO_COMPLEX, NO_COMPLEX};
    for (size_t i = 0; i < n; i++)
        sums[i % 2] = plus(sums[i % 2], scaled(a[i], v[i]));
    return plus(sums[0], sums[1]);
}

/* v with an entry of 1 at the undamped mode, and s; returns the lanes that have not converged. */
INLINE LaneMask iterate(const Modes *m, size_t mode, Complex *s)
{
    const size_t n = m->n;
    const Lanes limit = lanes_of(64 * DBL_EPSILON * DBL_EPSILON); /* of a squared change */
    LaneMask changing = lanes_above(lanes_of(1.0), lanes_of(0.0));
    for (size_t j = 0; j < n; j++)
        m->v[j] = (Complex){lanes_of(j == mode ? 1.0 : 0.0), lanes_of(0.0)};
    for (size_t iteration = 0; iteration < ITERATIONS && lanes_any(changing); iteration++) {
        for (size_t j = 0; j < n; j++)
            m->forces[j] = product_with(n, m->damping + j * n, m->v);
        const Complex next = eigenvalue(m->forces[mode], m->squares[mode]);
        const Complex square = times(next, next);
        Lanes change = lanes_of(0.0);
        for (size_t j = 0; j < n; j++) {
            if (j == mode)
                continue;
            const Lanes damping = m->damping[j * n + j];
            const Complex coupling = minus(scaled(damping, m->v[j]), m->forces[j]);
            const Complex stiffness = plus(square, (Complex){m->squares[j], lanes_of(0.0)});
            const Complex entry = quotient(times(next, coupling), plus(stiffness, scaled(damping, next)));
            change = lanes_larger(square_of(minus(entry, m->v[j])), change);
            m->v[j] = chosen(changing, entry, m->v[j]);
        }
        *s = chosen(changing, next, *s);
        changing = lanes_both(changing, lanes_above(change, limit));
    }
    return changing;
}

/* The results of a mode s, v. With right vectors r = (S v / s, v) and left ones l = (S v / s, -v), the coordinate of an
   input is 2 l'B / (l'r) and an output R r. Returns the lanes where the mode is badly conditioned, or not the only one
   that this v may belong to: where its own entry of 1 outweighs all others in each mode, no two are the same. */
INLINE LaneMask write_mode(const Modes *m, const BeamPlantData *plant, size_t mode, Complex s)
{
    const Lanes one = lanes_of(1.0);
    const Complex inverse = quotient((Complex){one, lanes_of(0.0)}, s);
    const Complex inverse_square = times(inverse, inverse);
    Complex product = NO_COMPLEX;  /* l'r */
    Lanes norm = lanes_of(0.0);    /* |l| |r| */
    Lanes others = lanes_of(-1.0); /* entries of v but its own */
    for (size_t j = 0; j < m->n; j++) {
        const Complex square = times(m->v[j], m->v[j]);
        const Lanes upper_norm = lanes_multiply(m->squares[j], square_of(inverse));
        product = plus(product, minus(scaled(m->squares[j], times(square, inverse_square)), square));
        norm = lanes_add(norm, lanes_multiply(square_of(m->v[j]), lanes_add(one, upper_norm)));
        others = lanes_add(others, lanes_add(lanes_magnitude(m->v[j].real), lanes_magnitude(m->v[j].imaginary)));
    }
    const Complex factor = quotient((Complex){lanes_of(-2.0), lanes_of(0.0)}, product);
    Complex *const to = m->results + mode * (1 + m->vectors);
    to[0] = s;
    for (size_t k = 0; k < m->vectors; k++) {
        const Complex share = product_with(m->n, m->columns + k * m->n, m->v);
        to[1 + k] = times(k < plant->patches + plant->beams ? factor : inverse, share);
    }
    const LaneMask is_sound =
        lanes_above(lanes_multiply(lanes_of(LARGEST_CONDITION), lanes_root(square_of(product))), norm);
    const LaneMask is_own = lanes_both(lanes_above(one, others), lanes_above(s.imaginary, lanes_of(0.0)));
    const Lanes is_good = lanes_choose(lanes_both(is_sound, is_own), one, lanes_of(0.0));
    return lanes_above(one, is_good);
}

void find_damped(const Modes *m, const BeamPlantData *plant, size_t mode)
{
    Complex s = NO_COMPLEX;
    const LaneMask changing = iterate(m, mode, &s);
    const LaneMask missing = lanes_either(changing, write_mode(m, plant, mode, s));
    *m->is_found = lanes_choose(missing, lanes_of(0.0), *m->is_found);
}
