#include "transition.h"

#include <math.h>
#include <string.h>

#define NEGLIGIBLE 600.0 /* p^-g - 4^g beyond which theta and all its derivatives vanish beside their maxima */

size_t transition_terms(size_t degree)
{
    return degree > LOCAL_TERMS ? degree : LOCAL_TERMS;
}

/* sum_k first[k] second[i - k], k = 1 ... i, as four sums side by side, which need not wait for each other. */
static double convolution(size_t i, const double *first, const double *second)
{
    double sums[4] = {0};
    size_t k = 1;
    for (; k + 3 <= i; k += 4)
        for (size_t j = 0; j < 4; j++)
            sums[j] += first[k + j] * second[i - k - j];
    for (; k <= i; k++)
        sums[0] += first[k] * second[i - k];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* The coefficients of p^-g, p = tau (1 - tau), and of exp(-p^-g) follow by the recurrences of J. C. P. Miller and of
   the exponential; theta = Theta' gives all but the first. That one is the table's nearest value carried here by the
   same series. Near the ends, where p^-g is large, the unit shrinks so that the recurrences grow no faster than
   exp(degree). */
double transition_series(const Transition *transition, double tau, size_t degree, double *coefficients, double *scratch)
{
    const size_t terms = transition_terms(degree);
    memset(coefficients, 0, (terms + 1) * sizeof *coefficients);
    coefficients[0] = tau < 0.5 ? 0.0 : 1.0;
    const double g = transition->exponent;
    const double p0 = tau * (1 - tau);
    const double p1 = 1 - 2 * tau;
    const double peak = pow(4.0, g);
    double *const power = scratch;
    double *const theta = scratch + terms;
    power[0] = pow(p0, -g);
    if (!(power[0] < peak + NEGLIGIBLE))
        return 1.0;

    const double shrink = fmin(1.0, (double)terms / (g * power[0]));
    const double unit = p0 * shrink;
    const double down = p1 * shrink;
    const double across = unit * shrink;
    power[1] = -g * down * power[0];
    for (size_t i = 2; i < terms; i++) {
        const double k = (double)i;
        power[i] = (-(g + k - 1) * down * power[i - 1] + (2 * g + k - 2) * across * power[i - 2]) / k;
    }
    theta[0] = exp(peak - power[0]) / transition->norm;
    for (size_t i = 1; i < terms; i++)
        power[i] *= -(double)i;
    for (size_t i = 1; i < terms; i++)
        theta[i] = convolution(i, power, theta) / (double)i;

    const double nodes = (double)transition->nodes;
    const double node = nearbyint(tau * nodes);
    const double offset = (node / nodes - tau) / unit;
    double carried = 0.0;
    for (size_t i = terms; i > 0; i--) {
        coefficients[i] = unit * theta[i - 1] / (double)i;
        carried = (carried + coefficients[i]) * offset;
    }
    coefficients[0] = transition->table[(size_t)node] - carried;
    return unit;
}
