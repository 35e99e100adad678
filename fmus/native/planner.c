#include "planner.h"

#include <math.h>
#include <string.h>

#define PATIENCE 8.0  /* longest transition tried, as a multiple of the longest one tabulated or under way */

/* D_u(d/dt) Theta over a transition of one duration: between two of the tabulated curves. One curve serves every input
   and target, since D_u is scalar. */
typedef struct {
    const double *shorter, *longer;
    double share;  /* of the longer */
    size_t place;  /* where the curve was read last */
} shape;

static shape shape_of(double duration)
{
    const size_t last = feedforward.shapes - 1;
    size_t low = 0;
    while (low < last - 1 && shape_times[low + 1] <= duration)
        low++;
    const double whole = (duration - shape_times[low]) / (shape_times[low + 1] - shape_times[low]);
    const double *const row = shape_values + low * (feedforward.intervals + 1);
    return (shape){.shorter = row, .longer = row + feedforward.intervals + 1, .share = fmin(fmax(whole, 0.0), 1.0)};
}

/* The curve at tau within [0, 1], linear between its places. Quick where tau grows from one call to the next. */
static double shape_at(shape *shape, double tau)
{
    size_t place = shape->place;
    while (place + 1 < feedforward.intervals && shape_places[place + 1] <= tau)
        place++;
    shape->place = place;
    const double left = (1 - shape->share) * shape->shorter[place] + shape->share * shape->longer[place];
    const double right = (1 - shape->share) * shape->shorter[place + 1] + shape->share * shape->longer[place + 1];
    const double width = shape_places[place + 1] - shape_places[place];
    return left + (right - left) * ((tau - shape_places[place]) / width);
}

/* Planned voltages u (voltages,) at a time. */
static void voltages_at(const motion *motion, shape *shapes, double time, double *u)
{
    memcpy(u, motion->offset, feedforward.voltages * sizeof *u);
    for (size_t k = 0; k < motion->count; k++) {
        const double tau = (time - motion->starts[k]) / motion->durations[k];
        const double height = shape_at(&shapes[k], fmin(fmax(tau, 0.0), 1.0));
        for (size_t j = 0; j < feedforward.voltages; j++)
            u[j] += height * motion->steps[k * feedforward.voltages + j];
    }
}

/* Magnitude of the vertex of the parabola through three neighbours where they turn, else of the middle one. */
static double vertex(double before, double here, double after)
{
    if (!((here - before) * (after - here) < 0.0))
        return fabs(here);
    return fabs(here - (after - before) * (after - before) / (8 * (before - 2 * here + after)));
}

/* Largest planned |u| after `now`, between the places at which each transition is sampled too. `u` (3, voltages). */
static double peak_of(const motion *motion, double now, double *u)
{
    const size_t voltages = feedforward.voltages, last = motion->count - 1;
    shape shapes[SLOTS];
    for (size_t k = 0; k <= last; k++)
        shapes[k] = shape_of(motion->durations[k]);
    double peak = 0.0;
    for (size_t k = 0; k <= last; k++) {
        for (size_t i = 0; i <= last; i++)
            shapes[i].place = 0;
        double *before = u, *here = u + voltages, *after = here + voltages;
        size_t sampled = 0;
        for (size_t i = 0; i <= feedforward.intervals; i++) {
            const double time = motion->starts[k] + motion->durations[k] * shape_places[i];
            if (k != last && !(time > now))
                continue;
            double *const oldest = before;
            before = here;
            here = after;
            after = oldest;
            voltages_at(motion, shapes, time, after);
            sampled++;
            for (size_t j = 0; j < voltages; j++) {
                peak = fmax(peak, fabs(after[j]));
                if (sampled >= 3)
                    peak = fmax(peak, vertex(before[j], here[j], after[j]));
            }
        }
    }
    return peak;
}

/* Largest planned |u| at `now`. */
static double present_peak(const motion *motion, double now, double *u)
{
    shape shapes[SLOTS];
    for (size_t k = 0; k < motion->count; k++)
        shapes[k] = shape_of(motion->durations[k]);
    voltages_at(motion, shapes, now, u);
    double peak = 0.0;
    for (size_t j = 0; j < feedforward.voltages; j++)
        peak = fmax(peak, fabs(u[j]));
    return peak;
}

plan plan_transition(const motion *motion_now, double now, const double *step, double wanted, double limit,
                     double *scratch)
{
    const size_t voltages = feedforward.voltages, slot = motion_now->count;
    double at_rest = 0.0;
    for (size_t j = 0; j < voltages; j++) {
        double goal = motion_now->offset[j] + step[j];
        for (size_t k = 0; k < slot; k++)
            goal += motion_now->steps[k * voltages + j];
        at_rest = fmax(at_rest, fabs(goal));
    }
    plan plan = {.peak = at_rest, .at_rest = at_rest};
    if (!(at_rest <= limit * (1 + 1e-9)))
        return plan;
    const double tolerated = fmax(limit, present_peak(motion_now, now, scratch)) * (1 + 1e-9);

    motion extended = *motion_now;
    extended.count++;
    extended.starts[slot] = now;
    memcpy(extended.steps + slot * voltages, step, voltages * sizeof *step);
    double longest = fmax(shape_times[feedforward.shapes - 1], wanted);
    for (size_t k = 0; k < slot; k++)
        longest = fmax(longest, extended.durations[k]);
    const double growth = shape_times[1] / shape_times[0];
    for (double duration = fmax(wanted, shape_times[0]); duration <= longest * PATIENCE; duration *= growth) {
        extended.durations[slot] = duration;
        plan.peak = peak_of(&extended, now, scratch);
        if (plan.peak <= tolerated) {
            plan.duration = duration;
            break;
        }
    }
    return plan;
}
