#include "spline_transition.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "ranges.h"
#include "two_complex.h"
#include "vectors.h"

#define FREE_POINTS (SPANS - DEGREE)
#define SERIES_TERMS 14            /* of phi_6 for |z| < 1 */
#define SMALLEST_EXPONENT (-700.0) /* beyond, e^z is 0 to rounding */

/* Row k: coefficients of the k-th power of the fraction of a span, by its control points. */
static const double span_polynomials[DEGREE + 1][DEGREE + 1] = {
    {1.0 / 120, 26.0 / 120, 66.0 / 120, 26.0 / 120, 1.0 / 120, 0.0},
    {-1.0 / 24, -10.0 / 24, 0.0, 10.0 / 24, 1.0 / 24, 0.0},
    {1.0 / 12, 2.0 / 12, -6.0 / 12, 2.0 / 12, 1.0 / 12, 0.0},
    {-1.0 / 12, 2.0 / 12, 0.0, -2.0 / 12, 1.0 / 12, 0.0},
    {1.0 / 24, -4.0 / 24, 6.0 / 24, -4.0 / 24, 1.0 / 24, 0.0},
    {-1.0 / 120, 5.0 / 120, -10.0 / 120, 10.0 / 120, -5.0 / 120, 1.0 / 120},
};

static const double inverse_factorials[DEGREE + 1] = {1.0, 1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120};

/* A transition under way: control points; the span that the rest belongs to, -1 for none; amplitudes at its start; its
   control points and derivatives there as the modes see them. */
typedef struct {
    double *points;      /* (SPLINE_POINTS, voltages) */
    double *span;        /* (1,) */
    double *amplitudes;  /* (2 modes,) */
    double *projected;   /* (DEGREE + 1, 2 modes) */
    double *derivatives; /* (DEGREE + 1, 2 modes) */
} Spline;

static Spline spline_in(const SplineTransitions *tables, double *memory)
{
    const size_t width = 2 * tables->modes;
    double *const span = memory + SPLINE_POINTS * tables->voltages;
    double *const projected = span + 1 + width;
    return (Spline){.points = memory,
                    .span = span,
                    .amplitudes = span + 1,
                    .projected = projected,
                    .derivatives = projected + (DEGREE + 1) * width};
}

size_t spline_size(const SplineTransitions *tables)
{
    return SPLINE_POINTS * tables->voltages + 1 + (1 + 2 * (DEGREE + 1)) * 2 * tables->modes;
}

double *spline_of(const SplineTransitions *tables, const Motion *motion, size_t transition)
{
    return motion->splines + (motion->first + transition) % SLOTS * spline_size(tables);
}

/* Amplitudes of a transition, and the sum over all, (2 modes,) each. */
size_t spline_scratch(const SplineTransitions *tables)
{
    return 4 * tables->modes;
}

size_t spline_row(const SplineTransitions *tables, double shortest)
{
    size_t row = 0;
    while (row + 1 < tables->durations && tables->times[row] < shortest * (1 - 1e-9))
        row++;
    return row;
}

void begin_spline(const SplineTransitions *tables, size_t row, const double *change, double *spline)
{
    const size_t voltages = tables->voltages;
    const size_t width = FREE_POINTS * voltages;
    const double *table = tables->points + row * voltages * width;
    memset(spline, 0, (DEGREE + FREE_POINTS) * voltages * sizeof *spline);
    double *const free_points = spline + DEGREE * voltages;
    for (size_t j = 0; j < voltages; j++, table += width)
        vector_add_scaled(width, change[j], table, free_points);
    for (size_t i = DEGREE + FREE_POINTS; i < SPLINE_POINTS; i++)
        memcpy(spline + i * voltages, change, voltages * sizeof *spline);
    *spline_in(tables, spline).span = -1.0;
}

/* The span at tau within [0, 1], and how far in it that is, 0 ... 1. */
static size_t span_at(double tau, double *fraction)
{
    const double position = tau * SPANS;
    const double span = fmin(floor(position), SPANS - 1);
    *fraction = position - span;
    return (size_t)span;
}

void add_spline_voltages(const SplineTransitions *tables, const double *spline, double tau, double *u)
{
    double fraction;
    const double *const points = spline + span_at(tau, &fraction) * tables->voltages;
    double weights[DEGREE + 1];
    for (size_t q = 0; q <= DEGREE; q += 2) {
        Pair sum = pair_load(span_polynomials[DEGREE] + q);
        for (size_t k = DEGREE; k > 0; k--)
            sum = pair_add_product(pair_load(span_polynomials[k - 1] + q), pair_of(fraction), sum);
        pair_store(weights + q, sum);
    }
    for (size_t q = 0; q <= DEGREE; q++)
        vector_add_scaled(tables->voltages, weights[q], points + q * tables->voltages, u);
}

/* phi_0 = e^z and phi_k = integral over [0, 1] of e^((1 - s) z) s^(k-1) / (k-1)!, k = 1 ... 6: phi_k = z phi_(k+1) +
   1/k!, for |z| < 1 downwards from the series of phi_6. */
static void phi_by_series(TwoComplex z, TwoComplex phi[DEGREE + 2])
{
    static const double coefficients[SERIES_TERMS] = {
        /* 1 / (n + 6)!, n = 14 ... 1 */
        1 / 2432902008176640000.0,
        1 / 121645100408832000.0,
        1 / 6402373705728000.0,
        1 / 355687428096000.0,
        1 / 20922789888000.0,
        1 / 1307674368000.0,
        1 / 87178291200.0,
        1 / 6227020800.0,
        1 / 479001600.0,
        1 / 39916800.0,
        1 / 3628800.0,
        1 / 362880.0,
        1 / 40320.0,
        1 / 5040.0,
    };
    TwoComplex sum = {pair_of(coefficients[0]), pair_of(0.0)};
    for (size_t n = 1; n < SERIES_TERMS; n++)
        sum = add_real(multiply_complex(sum, z), coefficients[n]);
    sum = add_real(multiply_complex(sum, z), 1 / 720.0);
    phi[DEGREE + 1] = sum;
    for (size_t k = DEGREE + 1; k > 0; k--)
        phi[k - 1] = sum = add_real(multiply_complex(sum, z), inverse_factorials[k - 1]);
}

/* For |z| >= 1 upwards from e^z. */
static void phi_by_exponential(TwoComplex z, Pair square, TwoComplex phi[DEGREE + 2])
{
    const Pair real = pair_maximum(z.real, pair_of(SMALLEST_EXPONENT));
    const TwoComplex inverse = {pair_divide(z.real, square),
                                pair_subtract(pair_of(0.0), pair_divide(z.imaginary, square))};
    TwoComplex above = scale_complex(on_unit_circle(z.imaginary), pair_exponential(real));
    phi[0] = above;
    for (size_t k = 0; k <= DEGREE; k++)
        phi[k + 1] = above = multiply_complex(add_real(above, -inverse_factorials[k]), inverse);
}

static void phi_functions(TwoComplex z, TwoComplex phi[DEGREE + 2])
{
    const Pair square = pair_add_product(pair_multiply(z.real, z.real), z.imaginary, z.imaginary);
    double squares[2];
    pair_store(squares, square);
    if (squares[0] < 1.0 && squares[1] < 1.0) {
        phi_by_series(z, phi);
        return;
    }
    phi_by_exponential(z, square, phi);
    if (!(squares[0] < 1.0 || squares[1] < 1.0))
        return;
    TwoComplex series[DEGREE + 2];
    phi_by_series(z, series);
    for (size_t k = 0; k < DEGREE + 2; k++)
        phi[k] = squares[0] < 1.0 ? join_complex(series[k], phi[k]) : join_complex(phi[k], series[k]);
}

/* Two modes from arrays of all; `both` is 0 where there is only one, which then stands beside itself. */
static TwoComplex modes_at(const double *values, size_t modes, size_t mode, size_t both)
{
    return (TwoComplex){pair(values[mode], values[mode + both]),
                        pair(values[modes + mode], values[modes + mode + both])};
}

/* Amplitudes (2 modes,) at a fraction s of the span (length h, s): e^(z s) y + h sum_k beta U_k s^(k+1) phi_(k+1)(z s),
   z = lambda h, which is exact, since the voltages are a polynomial there. */
static void amplitudes_within(const SplineTransitions *tables, const Spline *spline, double length, double fraction,
                              double *amplitudes)
{
    const size_t modes = tables->modes;
    const Pair time = pair_of(length * fraction);
    Pair powers[DEGREE + 1];
    powers[0] = time;
    for (size_t k = 1; k <= DEGREE; k++)
        powers[k] = pair_multiply(powers[k - 1], pair_of(fraction));
    for (size_t l = 0; l < modes; l += 2) {
        const size_t both = l + 1 < modes;
        TwoComplex phi[DEGREE + 2];
        phi_functions(scale_complex(modes_at(tables->eigenvalues, modes, l, both), time), phi);
        TwoComplex sum = multiply_complex(phi[0], modes_at(spline->amplitudes, modes, l, both));
        for (size_t k = 0; k <= DEGREE; k++) {
            const TwoComplex derivative = modes_at(spline->derivatives + 2 * modes * k, modes, l, both);
            sum = add_complex(sum, multiply_complex(phi[k + 1], scale_complex(derivative, powers[k])));
        }
        double stored[4];
        pair_store(stored, sum.real);
        pair_store(stored + 2, sum.imaginary);
        amplitudes[l] = stored[0];
        amplitudes[modes + l] = stored[2];
        amplitudes[l + both] = stored[both];
        amplitudes[modes + l + both] = stored[2 + both];
    }
}

static void project_point(const SplineTransitions *tables, const Spline *spline, size_t point, size_t place)
{
    const size_t width = 2 * tables->modes;
    multiply_panels(width, tables->voltages, tables->mode_inputs, spline->points + point * tables->voltages, false,
                    spline->projected + place * width);
}

/* Derivatives at the start of a span, spans as the unit of time: those of span_polynomials times k!. */
static void project_derivatives(const SplineTransitions *tables, const Spline *spline)
{
    const size_t width = 2 * tables->modes;
    const double *const p = spline->projected;
    double *const derivatives = spline->derivatives;
    for (size_t l = 0; l < width; l += 2) {
        const Pair middle = pair_load(p + 2 * width + l);
        const Pair inner = pair_add(pair_load(p + width + l), pair_load(p + 3 * width + l));
        const Pair outer = pair_add(pair_load(p + l), pair_load(p + 4 * width + l));
        const Pair inner_rise = pair_subtract(pair_load(p + 3 * width + l), pair_load(p + width + l));
        const Pair outer_rise = pair_subtract(pair_load(p + 4 * width + l), pair_load(p + l));
        const Pair fourth = pair_add_product(pair_subtract_product(outer, pair_of(4.0), inner), pair_of(6.0), middle);
        const Pair around = pair_add(pair_load(p + width + l), pair_load(p + 5 * width + l));
        const Pair beside = pair_add(middle, pair_load(p + 4 * width + l));
        const Pair next = pair_add_product(pair_subtract_product(around, pair_of(4.0), beside), pair_of(6.0),
                                           pair_load(p + 3 * width + l)); /* the fourth at the end */
        const Pair value = pair_add_product(pair_add_product(outer, pair_of(26.0), inner), pair_of(66.0), middle);
        const Pair first = pair_add_product(outer_rise, pair_of(10.0), inner_rise);
        const Pair second = pair_subtract_product(pair_add_product(outer, pair_of(2.0), inner), pair_of(6.0), middle);
        const Pair third = pair_subtract_product(outer_rise, pair_of(2.0), inner_rise);
        pair_store(derivatives + l, pair_multiply(value, pair_of(1.0 / 120)));
        pair_store(derivatives + width + l, pair_multiply(first, pair_of(1.0 / 24)));
        pair_store(derivatives + 2 * width + l, pair_multiply(second, pair_of(1.0 / 6)));
        pair_store(derivatives + 3 * width + l, pair_multiply(third, pair_of(0.5)));
        pair_store(derivatives + 4 * width + l, fourth);
        pair_store(derivatives + 5 * width + l, pair_subtract(next, fourth));
    }
}

/* Makes a span the one that amplitudes and derivatives belong to: from the one before, or from rest at the first. */
static void go_to_span(const SplineTransitions *tables, const Spline *spline, size_t span, double length,
                       double *scratch)
{
    const size_t width = 2 * tables->modes;
    if (!(*spline->span >= 0.0 && *spline->span <= (double)span)) {
        memset(spline->amplitudes, 0, width * sizeof(double));
        for (size_t q = 0; q <= DEGREE; q++)
            project_point(tables, spline, q, q);
        project_derivatives(tables, spline);
        *spline->span = 0.0;
    }
    while (*spline->span < (double)span) {
        amplitudes_within(tables, spline, length, 1.0, scratch);
        memcpy(spline->amplitudes, scratch, width * sizeof *scratch);
        *spline->span += 1.0;
        memmove(spline->projected, spline->projected + width, DEGREE * width * sizeof(double));
        project_point(tables, spline, (size_t)*spline->span + DEGREE, DEGREE);
        project_derivatives(tables, spline);
    }
}

void evaluate_splines(const SplineTransitions *tables, const Motion *motion, double time, double *u, double *x,
                      double *scratch)
{
    const size_t modes = tables->modes;
    const size_t width = 2 * modes;
    double *const amplitudes = scratch;
    double *const sum = scratch + width;
    memcpy(u, motion->offset, tables->voltages * sizeof *u);
    multiply_panels(width, tables->voltages, tables->mode_inputs, motion->offset, false, amplitudes);
    for (size_t l = 0; l < modes; l++) { /* at rest: -beta u / lambda */
        const double real = tables->eigenvalues[l];
        const double imaginary = tables->eigenvalues[modes + l];
        const double square = real * real + imaginary * imaginary;
        sum[l] = -(amplitudes[l] * real + amplitudes[modes + l] * imaginary) / square;
        sum[modes + l] = -(amplitudes[modes + l] * real - amplitudes[l] * imaginary) / square;
    }
    for (size_t k = 0; k < motion->count; k++) {
        const double tau = clamp((time - motion->starts[k]) / motion->durations[k], 0.0, 1.0);
        double *const memory = spline_of(tables, motion, k);
        const Spline spline = spline_in(tables, memory);
        const double length = motion->durations[k] / SPANS;
        double fraction;
        const size_t span = span_at(tau, &fraction);
        go_to_span(tables, &spline, span, length, amplitudes);
        add_spline_voltages(tables, memory, tau, u);
        amplitudes_within(tables, &spline, length, fraction, amplitudes);
        for (size_t l = 0; l < width; l++)
            sum[l] += amplitudes[l];
    }
    multiply_panels(tables->states, width, tables->mode_states, sum, false, x);
}
