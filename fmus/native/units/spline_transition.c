#include "spline_transition.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "ranges.h"
#include "vectors.h"

#define FREE_POINTS (SPANS - DEGREE)
#define SERIES_TERMS 14 /* of phi_6 for |z| < 1 */

/* Row k: the k-th derivative at the start of a span by its control points, spans as the unit of time. */
static const double span_derivatives[DEGREE + 1][DEGREE + 1] = {
    {1.0 / 120, 26.0 / 120, 66.0 / 120, 26.0 / 120, 1.0 / 120, 0.0},
    {-1.0 / 24, -10.0 / 24, 0.0, 10.0 / 24, 1.0 / 24, 0.0},
    {1.0 / 6, 2.0 / 6, -1.0, 2.0 / 6, 1.0 / 6, 0.0},
    {-0.5, 1.0, 0.0, -1.0, 0.5, 0.0},
    {1.0, -4.0, 6.0, -4.0, 1.0, 0.0},
    {-1.0, 5.0, -10.0, 10.0, -5.0, 1.0},
};

/* The same over factorials: row k has the coefficients of the k-th power of the fraction of a span. */
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

/* phi_0 = e^z and phi_k = integral over [0, 1] of e^((1 - s) z) s^(k-1) / (k-1)!, k = 1 ... 6, real parts and imaginary
   ones: phi_k = z phi_(k+1) + 1/k!, upwards for |z| >= 1, else downwards from the series of phi_6. */
static void phi_functions(double real, double imaginary, double phi_real[DEGREE + 2], double phi_imaginary[DEGREE + 2])
{
    const double square = real * real + imaginary * imaginary;
    double a;
    double b;
    if (square < 1.0) {
        a = 1.0;
        b = 0.0;
        for (size_t n = SERIES_TERMS; n > 0; n--) {
            const double divisor = 1.0 / (double)(n + 6);
            const double next = 1.0 + (a * real - b * imaginary) * divisor;
            b = (a * imaginary + b * real) * divisor;
            a = next;
        }
        a /= 720.0;
        b /= 720.0;
        phi_real[DEGREE + 1] = a;
        phi_imaginary[DEGREE + 1] = b;
        for (size_t k = DEGREE + 1; k > 0; k--) {
            const double next = a * real - b * imaginary + inverse_factorials[k - 1];
            b = a * imaginary + b * real;
            a = next;
            phi_real[k - 1] = a;
            phi_imaginary[k - 1] = b;
        }
        return;
    }
    const double size = exp(real);
    phi_real[0] = a = size * cos(imaginary);
    phi_imaginary[0] = b = size * sin(imaginary);
    const double inverse_real = real / square;
    const double inverse_imaginary = -imaginary / square;
    for (size_t k = 0; k <= DEGREE; k++) {
        const double left = a - inverse_factorials[k];
        a = left * inverse_real - b * inverse_imaginary;
        b = left * inverse_imaginary + b * inverse_real;
        phi_real[k + 1] = a;
        phi_imaginary[k + 1] = b;
    }
}

/* Amplitudes (2 modes,) at a fraction s of the span (length h, s): e^(z s) y + h sum_k beta U_k s^(k+1) phi_(k+1)(z s),
   z = lambda h, which is exact, since the voltages are a polynomial there. */
static void amplitudes_within(const SplineTransitions *tables, const Spline *spline, double length, double fraction,
                              double *amplitudes)
{
    const size_t modes = tables->modes;
    const size_t width = 2 * modes;
    const double time = length * fraction;
    double powers[DEGREE + 1];
    powers[0] = time;
    for (size_t k = 1; k <= DEGREE; k++)
        powers[k] = powers[k - 1] * fraction;
    for (size_t l = 0; l < modes; l++) {
        double phi_real[DEGREE + 2];
        double phi_imaginary[DEGREE + 2];
        phi_functions(tables->eigenvalues[l] * time, tables->eigenvalues[modes + l] * time, phi_real, phi_imaginary);
        const double y_real = spline->amplitudes[l];
        const double y_imaginary = spline->amplitudes[modes + l];
        double real = phi_real[0] * y_real - phi_imaginary[0] * y_imaginary;
        double imaginary = phi_real[0] * y_imaginary + phi_imaginary[0] * y_real;
        for (size_t k = 0; k <= DEGREE; k++) {
            const double force_real = powers[k] * spline->derivatives[k * width + l];
            const double force_imaginary = powers[k] * spline->derivatives[k * width + modes + l];
            real += force_real * phi_real[k + 1] - force_imaginary * phi_imaginary[k + 1];
            imaginary += force_real * phi_imaginary[k + 1] + force_imaginary * phi_real[k + 1];
        }
        amplitudes[l] = real;
        amplitudes[modes + l] = imaginary;
    }
}

static void project_point(const SplineTransitions *tables, const Spline *spline, size_t point, size_t place)
{
    const size_t width = 2 * tables->modes;
    multiply_panels(width, tables->voltages, tables->mode_inputs, spline->points + point * tables->voltages, false,
                    spline->projected + place * width);
}

static void project_derivatives(const SplineTransitions *tables, const Spline *spline)
{
    const size_t width = 2 * tables->modes;
    memset(spline->derivatives, 0, (DEGREE + 1) * width * sizeof(double));
    for (size_t k = 0; k <= DEGREE; k++)
        for (size_t q = 0; q <= DEGREE; q++)
            for (size_t l = 0; l < width; l++)
                spline->derivatives[k * width + l] += span_derivatives[k][q] * spline->projected[q * width + l];
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
        double *const memory = motion->splines + k * spline_size(tables);
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
