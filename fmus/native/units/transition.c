#include "transition.h"

#include <math.h>
#include <string.h>

#define NEGLIGIBLE 600.0 /* p^-g - 4^g beyond which theta and all its derivatives vanish beside their maxima */

size_t transition_terms(size_t degree)
{
    return degree > LOCAL_TERMS ? degree : LOCAL_TERMS;
}

/* sum_k first[k] second[i - k], k = 1 ... i, of pairs, as four sums side by side, which need not wait for each other.
 */
static Pair convolution(size_t i, const double *first, const double *second)
{
    Pair sums[4] = {pair_of(0.0), pair_of(0.0), pair_of(0.0), pair_of(0.0)};
    const double *left = first + 2;
    const double *right = second + 2 * i;
    size_t k = 1;
    for (; k + 3 <= i; k += 4, left += 8) {
        right -= 8;
        sums[0] = pair_add_product(sums[0], pair_load(left), pair_load(right + 6));
        sums[1] = pair_add_product(sums[1], pair_load(left + 2), pair_load(right + 4));
        sums[2] = pair_add_product(sums[2], pair_load(left + 4), pair_load(right + 2));
        sums[3] = pair_add_product(sums[3], pair_load(left + 6), pair_load(right));
    }
    for (; k <= i; k++, left += 2) {
        right -= 2;
        sums[0] = pair_add_product(sums[0], pair_load(left), pair_load(right));
    }
    return pair_add(pair_add(sums[0], sums[1]), pair_add(sums[2], sums[3]));
}

/* theta = Theta' of both, unit^i / i! times its derivatives, i = 0 ... terms - 1, from the first p^-g and theta there.
   The coefficients of p^-g, p = tau (1 - tau), and of exp(-p^-g) follow by the recurrences of J. C. P. Miller and of
   the exponential. Near the ends, where p^-g is large, the unit shrinks so that they grow no faster than exp(degree).
 */
static Pair theta_series(double exponent, Pair tau, size_t terms, double *power, double *theta)
{
    const Pair g = pair_of(exponent);
    const Pair remaining = pair_subtract(pair_of(1.0), tau);
    const Pair first = pair_load(power);
    const Pair ratio = pair_divide(pair_of((double)terms), pair_multiply(g, first));
    const Pair shrink = pair_subtract(pair_of(0.0), pair_maximum(pair_of(-1.0), pair_subtract(pair_of(0.0), ratio)));
    const Pair unit = pair_multiply(pair_multiply(tau, remaining), shrink);
    const Pair down = pair_multiply(pair_subtract(pair_of(1.0), pair_add(tau, tau)), shrink);
    const Pair across = pair_multiply(unit, shrink);
    Pair before = first;
    Pair here = pair_multiply(pair_multiply(pair_subtract(pair_of(0.0), g), down), first);
    pair_store(power + 2, pair_subtract(pair_of(0.0), here));
    for (size_t i = 2; i < terms; i++) {
        const double k = (double)i;
        const Pair falls = pair_multiply(pair_multiply(pair_of(-(exponent + k - 1)), down), here);
        const Pair sum = pair_add(falls, pair_multiply(pair_multiply(pair_of(2 * exponent + k - 2), across), before));
        before = here;
        here = pair_divide(sum, pair_of(k));
        pair_store(power + 2 * i, pair_multiply(here, pair_of(-k)));
    }
    for (size_t i = 1; i < terms; i++)
        pair_store(theta + 2 * i, pair_divide(convolution(i, power, theta), pair_of((double)i)));
    return unit;
}

/* The first coefficients are the table's nearest values carried here by the same series. */
Pair transition_series(const Transition *transition, const double tau[2], size_t degree, double *coefficients,
                       double *scratch)
{
    const size_t terms = transition_terms(degree);
    const double g = transition->exponent;
    const double peak = pow(4.0, g);
    const double nodes = (double)transition->nodes;
    double *const power = scratch;
    double *const theta = scratch + 2 * terms;
    double at[2];
    double node[2];
    double flat[2]; /* 1 where theta and all its derivatives vanish, which is computed at the middle instead */
    for (size_t l = 0; l < 2; l++) {
        const double first = pow(tau[l] * (1 - tau[l]), -g);
        flat[l] = !(first < peak + NEGLIGIBLE);
        at[l] = flat[l] != 0.0 ? 0.5 : tau[l];
        power[l] = flat[l] != 0.0 ? peak : first;
        theta[l] = exp(peak - power[l]) / transition->norm;
        node[l] = nearbyint(at[l] * nodes);
    }
    memset(coefficients, 0, 2 * (terms + 1) * sizeof *coefficients);
    Pair unit = pair_of(1.0);
    if (flat[0] * flat[1] == 0.0) {
        const Pair place = pair_load(at);
        unit = theta_series(g, place, terms, power, theta);
        const Pair nearest = pair_divide(pair_load(node), pair_of(nodes));
        const Pair offset = pair_divide(pair_subtract(nearest, place), unit);
        Pair carried = pair_of(0.0);
        for (size_t i = terms; i > 0; i--) {
            const Pair term = pair_divide(pair_multiply(unit, pair_load(theta + 2 * (i - 1))), pair_of((double)i));
            pair_store(coefficients + 2 * i, term);
            carried = pair_multiply(pair_add(carried, term), offset);
        }
        const double *const table = transition->table;
        pair_store(coefficients, pair_subtract(pair(table[(size_t)node[0]], table[(size_t)node[1]]), carried));
    }
    for (size_t l = 0; l < 2; l++) {
        if (flat[l] == 0.0)
            continue;
        for (size_t i = 1; i <= terms; i++)
            coefficients[2 * i + l] = 0.0;
        coefficients[l] = tau[l] < 0.5 ? 0.0 : 1.0;
    }
    return unit;
}
