#include "flat_output.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "ranges.h"

/* Workspace: terms (transition_terms + 1,), scratch of the series (2 transition_terms,), then of the modes the
   amplitudes for a change, the factor that the transition has reached, and the sum, (2 modes,) each. */
size_t flat_output_scratch(const FlatOutput *flat)
{
    return 3 * transition_terms(flat->degree) + 1 + 6 * flat->modes;
}

/* c_i Theta^(i), i = 0 ... degree, in place of the series' coefficients; returns their sum. Factors are combined in
   this order, which keeps each within the range of doubles: i! / T^i alone is not. */
static double weigh_series(const FlatOutput *flat, double duration, double unit, double *terms)
{
    double sum = terms[0];
    double scale = 1.0;
    for (size_t i = 0; i < flat->degree; i++) {
        scale *= flat->ratios[i] / (duration * unit);
        terms[i + 1] *= scale;
        sum += terms[i + 1];
    }
    return sum;
}

/* Amplitudes of the modes for `change`, times `reached` (complex, or 1 where NULL), added to `sum`. */
static void add_amplitudes(const FlatOutput *flat, const double *change, const double *reached, double *amplitudes,
                           double *sum)
{
    const size_t modes = flat->modes;
    multiply_panels(2 * modes, flat->voltages, flat->mode_inputs, change, false, amplitudes);
    for (size_t l = 0; l < modes; l++) {
        const double real = reached ? reached[l] : 1.0;
        const double imaginary = reached ? reached[modes + l] : 0.0;
        sum[l] += amplitudes[l] * real - amplitudes[modes + l] * imaginary;
        sum[modes + l] += amplitudes[l] * imaginary + amplitudes[modes + l] * real;
    }
}

void evaluate_flat_output(const FlatOutput *flat, const Motion *motion, double time, double *u, double *x,
                          double *scratch)
{
    const size_t terms = transition_terms(flat->degree);
    const size_t width = 2 * flat->modes;
    double *const series = scratch;
    double *const amplitudes = series + terms + 1 + 2 * terms;
    double *const reached = amplitudes + width;
    double *const sum = reached + width;
    memset(sum, 0, width * sizeof *sum);
    memcpy(u, motion->offset, flat->voltages * sizeof *u);
    add_amplitudes(flat, motion->offset, NULL, amplitudes, sum);
    for (size_t k = 0; k < motion->count; k++) {
        const double duration = motion->durations[k];
        const double *const change = motion->changes + k * flat->voltages;
        const double tau = clamp((time - motion->starts[k]) / duration, 0.0, 1.0);
        const double unit = transition_series(&flat->transition, tau, flat->degree, series, series + terms + 1);
        const double height = weigh_series(flat, duration, unit, series);
        for (size_t j = 0; j < flat->voltages; j++)
            u[j] += height * change[j];
        multiply_panels(width, flat->degree, flat->mode_series, series, false, reached);
        add_amplitudes(flat, change, reached, amplitudes, sum);
    }
    multiply_panels(flat->states, width, flat->mode_states, sum, false, x);
}
