#include "planner.h"

#include <math.h>
#include <string.h>

#include "ranges.h"

#define LONGEST_FACTOR 8.0  /* longest transition tried, as a multiple of the longest one tabulated or under way */
#define LIMIT_ROUNDING 1e-9 /* of the largest limit: a voltage this far beyond its own is within */

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

/* Peak of the parabola through three neighbours where they turn, else the middle one. */
static double parabola_peak(double before, double here, double after)
{
    if (!((here - before) * (after - here) < 0.0))
        return here;
    return here - (after - before) * (after - before) / (8 * (before - 2 * here + after));
}

static void include(VoltageRange range, size_t pair, double voltage)
{
    range.lowest[pair] = smaller(voltage, range.lowest[pair]);
    range.highest[pair] = larger(voltage, range.highest[pair]);
}

/* Planned voltages of each pair after `now`, also those between the times at which each transition is sampled.
   `u` (3, voltages). */
static void find_extremes(const FlatnessFeedforwardData *data, const Motion *motion, double now, VoltageRange range,
                          double *u)
{
    const size_t voltages = data->flat.voltages;
    const size_t last = motion->count - 1;
    VoltageCurve curves[SLOTS];
    for (size_t k = 0; k <= last; k++)
        curves[k] = curve_of(data, motion->durations[k]);
    for (size_t j = 0; j < voltages; j++) {
        range.lowest[j] = HUGE_VAL;
        range.highest[j] = -HUGE_VAL;
    }
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
                include(range, j, after[j]);
                if (sampled >= 3)
                    include(range, j, parabola_peak(before[j], here[j], after[j]));
            }
        }
    }
}

/* The limits, and where the planned voltages are beyond one at `now`, since it was narrowed, these. `u` (voltages,). */
static void tolerate_present(const FlatnessFeedforwardData *data, const Motion *motion, double now, VoltageRange limits,
                             VoltageRange tolerated, double *u)
{
    VoltageCurve curves[SLOTS];
    for (size_t k = 0; k < motion->count; k++)
        curves[k] = curve_of(data, motion->durations[k]);
    voltages_at(data, motion, curves, now, u);
    for (size_t j = 0; j < data->flat.voltages; j++) {
        tolerated.lowest[j] = smaller(u[j], limits.lowest[j]);
        tolerated.highest[j] = larger(u[j], limits.highest[j]);
    }
}

/* Voltages once the motion and a change have ended. */
static void find_goal(const FlatnessFeedforwardData *data, const Motion *motion, const double *change, double *goal)
{
    for (size_t j = 0; j < data->flat.voltages; j++) {
        goal[j] = motion->offset[j] + change[j];
        for (size_t k = 0; k < motion->count; k++)
            goal[j] += motion->changes[k * data->flat.voltages + j];
    }
}

/* The duration that keeps within `tolerated`, for the motion with its new transition in the slot behind the last. */
static void find_duration(const FlatnessFeedforwardData *data, Motion *extended, double now, double shortest,
                          VoltageRange tolerated, TransitionPlan *plan, double *scratch)
{
    const double *const durations = data->curve_durations;
    const size_t voltages = data->flat.voltages;
    const size_t slot = extended->count - 1;
    const double rounding = LIMIT_ROUNDING * largest_magnitude(voltages, tolerated);
    const VoltageRange range = {.lowest = scratch, .highest = scratch + voltages};
    double longest = fmax(durations[data->durations - 1], shortest);
    for (size_t k = 0; k < slot; k++)
        longest = fmax(longest, extended->durations[k]);
    const double growth = durations[1] / durations[0];
    for (double duration = fmax(shortest, durations[0]); duration <= longest * LONGEST_FACTOR; duration *= growth) {
        extended->durations[slot] = duration;
        find_extremes(data, extended, now, range, scratch + 2 * voltages);
        plan->peak = largest_magnitude(voltages, range);
        const Violation violation = furthest_beyond(voltages, range, tolerated);
        if (violation.excess <= rounding) {
            plan->duration = duration;
            break;
        }
        plan->violation = violation;
    }
}

TransitionPlan plan_transition(const FlatnessFeedforwardData *data, const Motion *motion, double now,
                               const double *change, double shortest, VoltageRange limits, double *scratch)
{
    const size_t voltages = data->flat.voltages;
    const VoltageRange goal = {.lowest = scratch, .highest = scratch};
    find_goal(data, motion, change, goal.lowest);
    TransitionPlan plan = {.peak = largest_magnitude(voltages, goal),
                           .violation = furthest_beyond(voltages, goal, limits)};
    plan.at_rest = !(plan.violation.excess <= LIMIT_ROUNDING * largest_magnitude(voltages, limits));
    if (plan.at_rest)
        return plan;
    const VoltageRange tolerated = {.lowest = scratch, .highest = scratch + voltages};
    tolerate_present(data, motion, now, limits, tolerated, scratch + 2 * voltages);
    const size_t slot = motion->count;
    Motion extended = *motion;
    extended.count++;
    extended.starts[slot] = now;
    memcpy(extended.changes + slot * voltages, change, voltages * sizeof *change);
    find_duration(data, &extended, now, shortest, tolerated, &plan, scratch + 2 * voltages);
    return plan;
}
