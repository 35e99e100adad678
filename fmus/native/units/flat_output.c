#include "flat_output.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "ranges.h"

/* Workspace, for two transitions: series (terms + 1,) in pairs and its scratch (4 terms,), terms (terms + 1,) of each;
   then of the modes (2 modes,) the sum and, of both, amplitudes for the change and the factor that is reached. */
size_t flat_output_scratch(const FlatOutput *flat)
{
    return 8 * transition_terms(flat->degree) + 4 + 10 * flat->modes;
}

/* c_i Theta^(i), i = 0 ... degree, of two transitions from their series; returns the sums. Factors are combined in this
   order, which keeps each within the range of doubles: i! / T^i alone is not. */
static Pair weigh_series(const FlatOutput *flat, Pair scaled_duration, const double *series, double *first,
                         double *second)
{
    Pair term = pair_load(series);
    Pair sum = term;
    Pair scale = pair_of(1.0);
    for (size_t i = 0;; i++) {
        double both[2];
        pair_store(both, term);
        first[i] = both[0];
        second[i] = both[1];
        if (i == flat->degree)
            return sum;
        scale = pair_multiply(scale, pair_divide(pair_of(flat->ratios[i]), scaled_duration));
        term = pair_multiply(pair_load(series + 2 * (i + 1)), scale);
        sum = pair_add(sum, term);
    }
}

/* Adds amplitudes (2 modes,) times `reached` (complex) to `sum`. */
static void add_amplitudes(size_t modes, const double *amplitudes, const double *reached, double *sum)
{
    for (size_t l = 0; l < modes; l++) {
        const double real = reached[l];
        const double imaginary = reached[modes + l];
        sum[l] += amplitudes[l] * real - amplitudes[modes + l] * imaginary;
        sum[modes + l] += amplitudes[l] * imaginary + amplitudes[modes + l] * real;
    }
}

/* Transitions two at a time; a last one alone stands beside itself. */
void evaluate_flat_output(const FlatOutput *flat, const Motion *motion, double time, double *u, double *x,
                          double *scratch)
{
    const size_t terms = transition_terms(flat->degree);
    const size_t modes = flat->modes;
    const size_t width = 2 * modes;
    double *const series = scratch;
    double *const first = series + 2 * (terms + 1) + 4 * terms;
    double *const second = first + terms + 1;
    double *const sum = second + terms + 1;
    double *const amplitudes = sum + width;
    double *const reached = amplitudes + 2 * width;
    memcpy(u, motion->offset, flat->voltages * sizeof *u);
    multiply_panels(width, flat->voltages, flat->mode_inputs, motion->offset, false, sum);
    for (size_t k = 0; k < motion->count; k += 2) {
        const size_t together = k + 1 < motion->count ? 2 : 1;
        const size_t other = k + together - 1;
        const double *const change = motion->changes + k * flat->voltages;
        const double duration[2] = {motion->durations[k], motion->durations[other]};
        const double tau[2] = {clamp((time - motion->starts[k]) / duration[0], 0.0, 1.0),
                               clamp((time - motion->starts[other]) / duration[1], 0.0, 1.0)};
        const Pair unit = transition_series(&flat->transition, tau, flat->degree, series, series + 2 * (terms + 1));
        double height[2];
        pair_store(height, weigh_series(flat, pair_multiply(pair_load(duration), unit), series, first, second));
        multiply_panels_twice(width, flat->degree, flat->mode_series, first, terms + 1, together, reached);
        multiply_panels_twice(width, flat->voltages, flat->mode_inputs, change, flat->voltages, together, amplitudes);
        for (size_t l = 0; l < together; l++) {
            for (size_t j = 0; j < flat->voltages; j++)
                u[j] += height[l] * change[l * flat->voltages + j];
            add_amplitudes(modes, amplitudes + l * width, reached + l * width, sum);
        }
    }
    multiply_panels(flat->states, width, flat->mode_states, sum, false, x);
}
