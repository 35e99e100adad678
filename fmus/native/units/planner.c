#include "planner.h"

#include <math.h>
#include <string.h>

#include "ranges.h"

#define LONGEST_FACTOR 8.0 /* longest transition tried, as a multiple of the longest one tabulated or under way */

/* D_u(d/dt) Theta over a transition of one duration: between two of the tabulated curves. One curve serves every input
   and target, since D_u is scalar. */
typedef struct {
    const double *shorter;
    const double *longer;
    double share; /* of the longer */
    size_t index; /* interval of the grid that was read last */
} VoltageCurve;

static VoltageCurve curve_of(const FlatnessFeedforwardData *data, double duration)
{
    const double *const durations = data->curve_durations;
    const size_t last = data->durations - 1;
    size_t low = 0;
    while (low < last - 1 && durations[low + 1] <= duration)
        low++;
    const double share = (duration - durations[low]) / (durations[low + 1] - durations[low]);
    const double *const row = data->curves + low * (data->intervals + 1);
    return (VoltageCurve){
        .shorter = row, .longer = row + data->intervals + 1, .share = clamp(share, 0.0, 1.0), .index = 0};
}

/* The curve at tau within [0, 1], linear on each interval. Quick where tau grows from one call to the next. */
static double curve_at(const FlatnessFeedforwardData *data, VoltageCurve *curve, double tau)
{
    const double *const grid = data->curve_grid;
    size_t index = curve->index;
    while (index + 1 < data->intervals && grid[index + 1] <= tau)
        index++;
    curve->index = index;
    const double left = (1 - curve->share) * curve->shorter[index] + curve->share * curve->longer[index];
    const double right = (1 - curve->share) * curve->shorter[index + 1] + curve->share * curve->longer[index + 1];
    const double width = grid[index + 1] - grid[index];
    return left + (right - left) * ((tau - grid[index]) / width);
}

/* Planned voltages u (voltages,) at a time. */
static void voltages_at(const FlatnessFeedforwardData *data, const Motion *motion, VoltageCurve *curves, double time,
                        double *u)
{
    memcpy(u, motion->offset, data->flat.voltages * sizeof *u);
    for (size_t k = 0; k < motion->count; k++) {
        const double tau = (time - motion->starts[k]) / motion->durations[k];
        const double height = curve_at(data, &curves[k], clamp(tau, 0.0, 1.0));
        for (size_t j = 0; j < data->flat.voltages; j++)
            u[j] += height * motion->changes[k * data->flat.voltages + j];
    }
}

/* Magnitude of the peak of the parabola through three neighbours where they turn, else of the middle one. */
static double parabola_peak(double before, double here, double after)
{
    if (!((here - before) * (after - here) < 0.0))
        return fabs(here);
    return fabs(here - (after - before) * (after - before) / (8 * (before - 2 * here + after)));
}

/* Largest planned |u| after `now`, between the times at which each transition is sampled too. `u` (3, voltages). */
static double motion_peak(const FlatnessFeedforwardData *data, const Motion *motion, double now, double *u)
{
    const size_t voltages = data->flat.voltages;
    const size_t last = motion->count - 1;
    VoltageCurve curves[SLOTS];
    for (size_t k = 0; k <= last; k++)
        curves[k] = curve_of(data, motion->durations[k]);
    double peak = 0.0;
    for (size_t k = 0; k <= last; k++) {
        for (size_t i = 0; i <= last; i++)
            curves[i].index = 0;
        double *before = u;
        double *here = u + voltages;
        double *after = here + voltages;
        size_t sampled = 0;
        for (size_t i = 0; i <= data->intervals; i++) {
            const double time = motion->starts[k] + motion->durations[k] * data->curve_grid[i];
            if (k != last && !(time > now))
                continue;
            double *const oldest = before;
            before = here;
            here = after;
            after = oldest;
            voltages_at(data, motion, curves, time, after);
            sampled++;
            for (size_t j = 0; j < voltages; j++) {
                peak = larger(peak, fabs(after[j]));
                if (sampled >= 3)
                    peak = larger(peak, parabola_peak(before[j], here[j], after[j]));
            }
        }
    }
    return peak;
}

/* Largest planned |u| at `now`. */
static double present_peak(const FlatnessFeedforwardData *data, const Motion *motion, double now, double *u)
{
    VoltageCurve curves[SLOTS];
    for (size_t k = 0; k < motion->count; k++)
        curves[k] = curve_of(data, motion->durations[k]);
    voltages_at(data, motion, curves, now, u);
    double peak = 0.0;
    for (size_t j = 0; j < data->flat.voltages; j++)
        peak = larger(peak, fabs(u[j]));
    return peak;
}

/* Largest |u| once the motion and a change have ended. */
static double peak_at_rest(const FlatnessFeedforwardData *data, const Motion *motion, const double *change)
{
    double peak = 0.0;
    for (size_t j = 0; j < data->flat.voltages; j++) {
        double goal = motion->offset[j] + change[j];
        for (size_t k = 0; k < motion->count; k++)
            goal += motion->changes[k * data->flat.voltages + j];
        peak = larger(peak, fabs(goal));
    }
    return peak;
}

TransitionPlan plan_transition(const FlatnessFeedforwardData *data, const Motion *motion, double now,
                               const double *change, double shortest, double limit, double *scratch)
{
    const double *const durations = data->curve_durations;
    const double at_rest = peak_at_rest(data, motion, change);
    TransitionPlan plan = {.peak = at_rest, .peak_at_rest = at_rest};
    if (!(at_rest <= limit * (1 + 1e-9)))
        return plan;
    const double tolerated = larger(limit, present_peak(data, motion, now, scratch)) * (1 + 1e-9);

    const size_t slot = motion->count;
    Motion extended = *motion;
    extended.count++;
    extended.starts[slot] = now;
    memcpy(extended.changes + slot * data->flat.voltages, change, data->flat.voltages * sizeof *change);
    double longest = fmax(durations[data->durations - 1], shortest);
    for (size_t k = 0; k < slot; k++)
        longest = fmax(longest, extended.durations[k]);
    const double growth = durations[1] / durations[0];
    for (double duration = fmax(shortest, durations[0]); duration <= longest * LONGEST_FACTOR; duration *= growth) {
        extended.durations[slot] = duration;
        plan.peak = motion_peak(data, &extended, now, scratch);
        if (plan.peak <= tolerated) {
            plan.duration = duration;
            break;
        }
    }
    return plan;
}
