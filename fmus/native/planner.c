#include "planner.h"

#include <math.h>
#include <string.h>

#define SAMPLES 129   /* places along each transition at which a plan is checked */
#define PATIENCE 8.0  /* longest transition tried, as a multiple of the longest one tabulated or under way */

/* D_u(d/dt) Theta over a transition of one duration: between two of the tabulated curves. One curve serves every input
   and target, since D_u is scalar. */
typedef struct {
    const double *shorter, *longer;
    double share;  /* of the longer */
} shape;

static shape shape_of(double duration)
{
    const size_t last = feedforward.shapes - 1;
    size_t low = 0;
    while (low < last - 1 && shape_times[low + 1] <= duration)
        low++;
    const double whole = (duration - shape_times[low]) / (shape_times[low + 1] - shape_times[low]);
    const double *const row = shape_values + low * (feedforward.places + 1);
    return (shape){.shorter = row, .longer = row + feedforward.places + 1, .share = fmin(fmax(whole, 0.0), 1.0)};
}

/* The curve at tau within [0, 1], linear between its places. */
static double shape_at(const shape *shape, double tau)
{
    const double position = tau * (double)feedforward.places;
    size_t place = (size_t)position;
    if (place > feedforward.places - 1)
        place = feedforward.places - 1;
    const double left = (1 - shape->share) * shape->shorter[place] + shape->share * shape->longer[place];
    const double right = (1 - shape->share) * shape->shorter[place + 1] + shape->share * shape->longer[place + 1];
    return left + (right - left) * (position - (double)place);
}

/* Largest planned |u| at a time. */
static double voltage_at(const motion *motion, const shape *shapes, double time)
{
    double heights[SLOTS], largest = 0.0;
    for (size_t k = 0; k < motion->count; k++) {
        const double tau = (time - motion->starts[k]) / motion->durations[k];
        heights[k] = shape_at(&shapes[k], fmin(fmax(tau, 0.0), 1.0));
    }
    for (size_t j = 0; j < feedforward.voltages; j++) {
        double u = motion->offset[j];
        for (size_t k = 0; k < motion->count; k++)
            u += heights[k] * motion->steps[k * feedforward.voltages + j];
        largest = fmax(largest, fabs(u));
    }
    return largest;
}

/* Largest planned |u| from `now` on, where each transition is sampled. */
static double peak_of(const motion *motion, double now)
{
    shape shapes[SLOTS];
    for (size_t k = 0; k < motion->count; k++)
        shapes[k] = shape_of(motion->durations[k]);
    double peak = 0.0;
    for (size_t k = 0; k < motion->count; k++)
        for (size_t i = 0; i < SAMPLES; i++) {
            const double time = motion->starts[k] + motion->durations[k] * ((double)i / (SAMPLES - 1));
            if (time > now || k == motion->count - 1)
                peak = fmax(peak, voltage_at(motion, shapes, time));
        }
    return peak;
}

plan plan_transition(const motion *motion_now, double now, const double *step, double wanted, double limit)
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
    const double tolerated = limit * (1 + 1e-9);
    if (!(at_rest <= tolerated))
        return plan;

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
        plan.peak = peak_of(&extended, now);
        if (plan.peak <= tolerated) {
            plan.duration = duration;
            break;
        }
    }
    return plan;
}
