/* FlatnessFeedforward: u = sum_i c_i xi^(i), x = sum_i X_i xi^(i) (31)-(38), with the flat output
   xi = offset + sum_k steps_k Theta((t - starts_k) / durations_k). */

#include "flatness_feedforward.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "planner.h"
#include "transition.h"

#define ROUNDING 1e-12  /* m: a host that interpolates a constant target moves it by less */

/* State: number of transitions under way, target they lead to (points,), then the motion. */
size_t unit_state_size(void)
{
    return 1 + feedforward.points + feedforward.voltages + SLOTS * (2 + feedforward.voltages);
}

static double *handled_target(const unit *unit) { return unit->state + 1; }

static motion motion_of(const unit *unit)
{
    double *const offset = handled_target(unit) + feedforward.points;
    double *const starts = offset + feedforward.voltages, *const durations = starts + SLOTS;
    return (motion){.count = (size_t)unit->state[0], .offset = offset, .starts = starts, .durations = durations,
                    .steps = durations + SLOTS};
}

/* Workspace: derivatives of the flat output (degree + 1, voltages), of one transition (terms + 1,) and scratch. */
static double *scratch_of(const unit *unit)
{
    const size_t degree = feedforward.degree;
    return unit->workspace + (degree + 1) * feedforward.voltages + transition_terms(degree) + 1;
}

size_t unit_workspace_size(void)
{
    const size_t degree = feedforward.degree, terms = transition_terms(degree), voltages = feedforward.voltages;
    const size_t outputs = feedforward.states + 3 * voltages;
    return (degree + 1) * voltages + terms + 1 + (outputs > 2 * terms ? outputs : 2 * terms);
}

/* Transitions that have ended go into the offset; the others move up, in their order. */
static size_t retire(unit *unit, double time)
{
    const motion motion = motion_of(unit);
    const size_t voltages = feedforward.voltages;
    size_t left = 0;
    for (size_t k = 0; k < motion.count; k++) {
        const double *const step = motion.steps + k * voltages;
        if (time >= motion.starts[k] + motion.durations[k]) {
            for (size_t j = 0; j < voltages; j++)
                motion.offset[j] += step[j];
            continue;
        }
        motion.starts[left] = motion.starts[k];
        motion.durations[left] = motion.durations[k];
        memmove(motion.steps + left * voltages, step, voltages * sizeof *step);
        left++;
    }
    unit->state[0] = (double)left;
    return left;
}

/* Derivatives of the flat output at `time`, (degree + 1, voltages) in the workspace. */
static void differentiate(unit *unit, double time)
{
    const motion motion = motion_of(unit);
    const size_t voltages = feedforward.voltages, degree = feedforward.degree;
    double *const xi = unit->workspace, *const theta = xi + (degree + 1) * voltages;
    memset(xi, 0, (degree + 1) * voltages * sizeof *xi);
    memcpy(xi, motion.offset, voltages * sizeof *xi);
    for (size_t k = 0; k < motion.count; k++) {
        const double tau = fmin(fmax((time - motion.starts[k]) / motion.durations[k], 0.0), 1.0);
        transition_series(tau, degree, theta, scratch_of(unit));
        double scale = 1.0;  /* i! / T^i */
        for (size_t i = 0; i <= degree; i++) {
            const double derivative = theta[i] * scale;
            for (size_t j = 0; j < voltages; j++)
                xi[i * voltages + j] += derivative * motion.steps[k * voltages + j];
            scale *= (double)(i + 1) / motion.durations[k];
        }
    }
}

/* Voltages, reference states and outputs at `time`. */
static void evaluate(unit *unit, double time)
{
    const size_t voltages = feedforward.voltages, states = feedforward.states, degree = feedforward.degree;
    const bool moving = retire(unit, time) > 0;
    differentiate(unit, time);
    const double *const xi = unit->workspace;
    double *const u = unit->values + feedforward.u_ff, *const x = unit->values + feedforward.x_ref;
    for (size_t j = 0; j < voltages; j++) {
        double sum = 0.0;
        for (size_t i = 0; i <= degree; i++)
            sum += input_series[i] * xi[i * voltages + j];
        u[j] = sum;
    }
    multiply_panels(states, degree * voltages, state_series, xi, false, x);
    double *const both = scratch_of(unit);
    memcpy(both, x, states * sizeof *both);
    memcpy(both + states, u, voltages * sizeof *both);
    multiply_panels(feedforward.points, states + voltages, reference_outputs, both, false,
                    unit->values + feedforward.y_ref);
    unit->values[feedforward.moving] = moving;
}

/* Start the transition to a changed target. */
static void start_transition(unit *unit, double time)
{
    double *const values = unit->values, *const target = values + feedforward.y_target;
    const motion motion = motion_of(unit);
    const size_t voltages = feedforward.voltages;
    double *const change = unit->workspace;
    multiply_panels(voltages, feedforward.points, static_inverse, target, false, change);
    for (size_t j = 0; j < voltages; j++) {
        double sum = 0.0;
        for (size_t k = 0; k < motion.count; k++)
            sum += motion.steps[k * voltages + j];
        change[j] -= motion.offset[j] + sum;
    }
    const double wanted = values[feedforward.transition_time], limit = values[feedforward.voltage_limit];
    const plan plan = plan_transition(&motion, time, change, wanted, limit, scratch_of(unit));
    memcpy(handled_target(unit), target, feedforward.points * sizeof *target);
    const bool refused = !(plan.duration > 0.0);
    values[feedforward.target_refused] = refused;
    values[feedforward.planned_peak] = plan.peak;
    if (refused) {
        unit_warn(unit, "y_target at %.6g s is refused: it takes %.1f V %s, voltage_limit is %.1f V; the target before "
                  "is held", time, plan.peak, plan.at_rest > limit ? "at rest" : "on the way", limit);
        return;
    }
    if (plan.duration > wanted)
        unit_note(unit, "the transition at %.6g s is stretched from %.4g s to %.4g s to stay within %.1f V", time,
                  wanted, plan.duration, limit);
    values[feedforward.planned_time] = plan.duration;
    motion.durations[motion.count] = plan.duration;
    unit->state[0] += 1.0;
}

/* At rest at the first target. */
bool unit_initialise(unit *unit)
{
    double *const values = unit->values, *const target = values + feedforward.y_target;
    memset(unit->state, 0, unit_state_size() * sizeof *unit->state);
    memcpy(handled_target(unit), target, feedforward.points * sizeof *target);
    double *const offset = motion_of(unit).offset, limit = values[feedforward.voltage_limit];
    multiply_panels(feedforward.voltages, feedforward.points, static_inverse, target, false, offset);
    double peak = 0.0;
    for (size_t j = 0; j < feedforward.voltages; j++)
        peak = fmax(peak, fabs(offset[j]));
    if (peak > limit)
        return unit_refuse(unit, "y_target is out of reach: it takes %.1f V at rest, voltage_limit is %.1f V", peak,
                           limit);
    values[feedforward.planned_peak] = peak;
    evaluate(unit, values[0] + values[feedforward.preview]);
    return true;
}

/* A changed target starts a transition at `time`; outputs are those of time + step + preview. At rest they stay. */
bool unit_advance(unit *unit, double time, double step)
{
    const double *const target = unit->values + feedforward.y_target, *const handled = handled_target(unit);
    bool changed = false;
    for (size_t k = 0; k < feedforward.points; k++)
        changed = changed || fabs(target[k] - handled[k]) > ROUNDING;
    if (changed && unit->state[0] < SLOTS)
        start_transition(unit, time);
    const bool rests = unit->state[0] == 0.0 && unit->values[feedforward.moving] == 0.0;
    if (!rests)
        evaluate(unit, time + step + unit->values[feedforward.preview]);
    return true;
}

/* The number of transitions is used as an index; the planner tries durations up to a multiple of the longest. */
bool unit_restore(unit *unit)
{
    const double count = unit->state[0];
    bool sound = count >= 0.0 && count <= SLOTS && floor(count) == count;
    if (sound) {
        const motion motion = motion_of(unit);
        for (size_t k = 0; k < motion.count; k++)
            sound = sound && isfinite(motion.starts[k]) && motion.durations[k] > 0.0 && motion.durations[k] < 1e12;
    }
    return sound || unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

bool unit_prepare(unit *unit, double step)
{
    (void)unit;
    (void)step;
    return true;
}

void unit_complete(unit *unit)
{
    (void)unit;
}
