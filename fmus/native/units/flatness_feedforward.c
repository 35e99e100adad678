/* FlatnessFeedforward: voltages and states from a flat output (31)-(38) that moves by superposed transitions. */

#include "flatness_feedforward.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "planner.h"
#include "ranges.h"

#define TARGET_ROUNDING 1e-12 /* m: a host that interpolates a constant target moves it by less */
#define OFF_REACH 1e-3        /* of the largest target: one this far from what voltages reach is refused */

/* State: number of transitions under way, a double as all of the state; the target that they lead to (points,); then
   the motion. */
static size_t flatness_feedforward_state_size(const void *data)
{
    const FlatnessFeedforwardData *const feedforward = data;
    return 1 + feedforward->points + feedforward->flat.voltages + SLOTS * (2 + feedforward->flat.voltages);
}

static double *handled_target(const UnitInstance *unit)
{
    return unit->state + 1;
}

static Motion motion_of(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    double *const offset = handled_target(unit) + feedforward->points;
    double *const starts = offset + feedforward->flat.voltages;
    double *const durations = starts + SLOTS;
    return (Motion){.count = (size_t)unit->state[0],
                    .offset = offset,
                    .starts = starts,
                    .durations = durations,
                    .changes = durations + SLOTS};
}

/* Workspace: of the flat output's evaluation, and a change of its offset behind it; or the outputs' arguments; or a
   change, the limits of the voltages and scratch of the planner. */
static size_t flatness_feedforward_workspace_size(const void *data)
{
    const FlatnessFeedforwardData *const feedforward = data;
    const size_t evaluation = flat_output_scratch(&feedforward->flat) + feedforward->flat.voltages;
    const size_t outputs = feedforward->flat.states + feedforward->flat.voltages;
    const size_t planning = (3 + PLANNER_SCRATCH) * feedforward->flat.voltages;
    const size_t others = outputs > planning ? outputs : planning;
    return evaluation > others ? evaluation : others;
}

/* Transitions that have ended go into the offset; the others move up, in their order. Returns how many are left. */
static size_t retire_transitions(UnitInstance *unit, double time)
{
    const double reached = time + clock_tolerance(unit, time, unit->step_size);
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const Motion motion = motion_of(unit);
    const size_t voltages = feedforward->flat.voltages;
    size_t left = 0;
    for (size_t k = 0; k < motion.count; k++) {
        const double *const change = motion.changes + k * voltages;
        if (reached >= motion.starts[k] + motion.durations[k]) {
            for (size_t j = 0; j < voltages; j++)
                motion.offset[j] += change[j];
            continue;
        }
        motion.starts[left] = motion.starts[k];
        motion.durations[left] = motion.durations[k];
        memmove(motion.changes + left * voltages, change, voltages * sizeof *change);
        left++;
    }
    unit->state[0] = (double)left;
    return left;
}

/* Voltages, reference states and outputs of a motion at `time` in place of the variables' `values`. */
static void evaluate_references(const UnitInstance *unit, const Motion *motion, double time, double *values)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    const size_t states = feedforward->flat.states;
    double *const u = values + feedforward->u_ff;
    double *const x = values + feedforward->x_ref;
    evaluate_flat_output(&feedforward->flat, motion, time, u, x, unit->workspace);
    double *const state_and_input = unit->workspace;
    memcpy(state_and_input, x, states * sizeof *x);
    memcpy(state_and_input + states, u, voltages * sizeof *u);
    multiply_panels(feedforward->points, states + voltages, feedforward->reference_outputs, state_and_input, false,
                    values + feedforward->y_ref);
}

static void write_references(UnitInstance *unit, double time)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    unit->values[feedforward->moving] = retire_transitions(unit, time) > 0;
    const Motion motion = motion_of(unit);
    evaluate_references(unit, &motion, time, unit->values);
}

/* Part of the target at a point that no voltages reach, m. */
static double missed_at(const FlatnessFeedforwardData *feedforward, const double *target, size_t point)
{
    const double *const row = feedforward->unreachable + point * feedforward->points;
    double missed = 0.0;
    for (size_t k = 0; k < feedforward->points; k++)
        missed += row[k] * target[k];
    return missed;
}

/* The point of interest whose target is furthest from the nearest reachable one; `points` where that is close. */
static size_t unreachable_point(const FlatnessFeedforwardData *feedforward, const double *target)
{
    double largest = 0.0;
    double furthest = 0.0;
    size_t point = 0;
    for (size_t k = 0; k < feedforward->points; k++) {
        const double missed = fabs(missed_at(feedforward, target, k));
        largest = fmax(largest, fabs(target[k]));
        if (missed > furthest) {
            furthest = missed;
            point = k;
        }
    }
    return furthest > OFF_REACH * largest ? point : feedforward->points;
}

/* The limits of the voltages, behind a change in the workspace. */
static VoltageRange limits_of(UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    const double *const values = unit->values;
    const VoltageRange limits = {.lowest = unit->workspace + voltages, .highest = unit->workspace + 2 * voltages};
    join_limits(voltages, values[feedforward->voltage_limit], values + feedforward->voltage_min,
                values + feedforward->voltage_max, limits);
    return limits;
}

/* For the log: the limit that a voltage is beyond, and the voltage; voltage_limit is one of magnitudes. */
typedef struct {
    const char *name;
    bool is_own; /* of the pair */
    double limit;
    double voltage;
} BrokenLimit;

static BrokenLimit broken_limit(const UnitInstance *unit, Violation violation)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const unsigned symmetric = feedforward->voltage_limit;
    const unsigned own =
        (violation.is_below ? feedforward->voltage_min : feedforward->voltage_max) + (unsigned)violation.pair;
    const bool is_own = fabs(unit->values[own]) < unit->values[symmetric];
    const unsigned limit = is_own ? own : symmetric;
    const char *const name = unit->variables[limit].name;
    const char *const point = strrchr(name, '.'); /* in a loop, of which the log has the part's name in front */
    return (BrokenLimit){.name = point == NULL ? name : point + 1,
                         .is_own = is_own,
                         .limit = unit->values[limit],
                         .voltage = is_own ? violation.voltage : fabs(violation.voltage)};
}

static void warn_of_refusal(UnitInstance *unit, double time, const TransitionPlan *plan)
{
    const BrokenLimit broken = broken_limit(unit, plan->violation);
    unit_warn(unit, "y_target at %.6g s is refused: it takes %.1f V %s, %s is %.1f V; the target before is held",
              unit->start + time, broken.voltage, plan->at_rest ? "at rest" : "on the way", broken.name, broken.limit);
}

static void note_stretching(UnitInstance *unit, double time, double shortest, const TransitionPlan *plan)
{
    const BrokenLimit broken = broken_limit(unit, plan->violation);
    unit_note(unit, "the transition at %.6g s is stretched from %.4g s to %.4g s to stay within %s%s%.1f V",
              unit->start + time, shortest, plan->duration, broken.is_own ? broken.name : "",
              broken.is_own ? " = " : "", broken.limit);
}

/* Start the transition to a changed target. */
static void start_transition(UnitInstance *unit, double time)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    double *const values = unit->values;
    double *const target = values + feedforward->y_target;
    const size_t point = unreachable_point(feedforward, target);
    if (point < feedforward->points) {
        memcpy(handled_target(unit), target, feedforward->points * sizeof *target);
        values[feedforward->target_refused] = true;
        unit_warn(unit,
                  "y_target at %.6g s is refused: no voltages reach it, the nearest reachable target has y_target[%zu] "
                  "= %.6g m in place of %.6g m; the target before is held",
                  unit->start + time, point + 1, target[point] - missed_at(feedforward, target, point), target[point]);
        return;
    }
    const Motion motion = motion_of(unit);
    const size_t voltages = feedforward->flat.voltages;
    double *const change = unit->workspace;
    multiply_panels(voltages, feedforward->points, feedforward->static_inverse, target, false, change);
    for (size_t j = 0; j < voltages; j++) {
        double sum = 0.0;
        for (size_t k = 0; k < motion.count; k++)
            sum += motion.changes[k * voltages + j];
        change[j] -= motion.offset[j] + sum;
    }
    const double shortest = values[feedforward->transition_time];
    const TransitionPlan plan =
        plan_transition(feedforward, &motion, time, change, shortest, limits_of(unit), unit->workspace + 3 * voltages);
    memcpy(handled_target(unit), target, feedforward->points * sizeof *target);
    const bool refused = !(plan.duration > 0.0);
    values[feedforward->target_refused] = refused;
    values[feedforward->planned_peak] = plan.peak;
    if (refused) {
        warn_of_refusal(unit, time, &plan);
        return;
    }
    if (plan.duration > shortest)
        note_stretching(unit, time, shortest, &plan);
    values[feedforward->planned_time] = plan.duration;
    motion.durations[motion.count] = plan.duration;
    unit->state[0] += 1.0;
}

/* At rest at the first target. */
static bool flatness_feedforward_initialise(UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    double *const values = unit->values;
    double *const target = values + feedforward->y_target;
    const size_t point = unreachable_point(feedforward, target);
    if (point < feedforward->points)
        return unit_refuse(unit,
                           "y_target is out of reach: no voltages reach it, the nearest reachable target has "
                           "y_target[%zu] = %.6g m in place of %.6g m",
                           point + 1, target[point] - missed_at(feedforward, target, point), target[point]);
    memset(unit->state, 0, flatness_feedforward_state_size(feedforward) * sizeof *unit->state);
    memcpy(handled_target(unit), target, feedforward->points * sizeof *target);
    double *const offset = motion_of(unit).offset;
    multiply_panels(voltages, feedforward->points, feedforward->static_inverse, target, false, offset);
    const VoltageRange rest = {.lowest = offset, .highest = offset};
    const Violation violation = furthest_beyond(voltages, rest, limits_of(unit));
    if (!(violation.excess <= 0.0)) {
        const BrokenLimit broken = broken_limit(unit, violation);
        return unit_refuse(unit, "y_target is out of reach: it takes %.1f V at rest, %s is %.1f V", broken.voltage,
                           broken.name, broken.limit);
    }
    values[feedforward->planned_peak] = largest_magnitude(voltages, rest);
    write_references(unit, values[feedforward->preview]);
    return true;
}

/* At rest the outputs are linear in the flat output. */
static void flatness_feedforward_differentiate(UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const Motion motion = {.offset = unit->workspace + flat_output_scratch(&feedforward->flat)};
    multiply_panels(feedforward->flat.voltages, feedforward->points, feedforward->static_inverse,
                    unit->changes + feedforward->y_target, false, motion.offset);
    evaluate_references(unit, &motion, 0.0, unit->changes);
}

/* A changed target starts a transition at `time`; outputs are those of time + step + preview. At rest they stay. */
static bool flatness_feedforward_advance(UnitInstance *unit, double time, double step)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const double *const target = unit->values + feedforward->y_target;
    const double *const handled = handled_target(unit);
    bool changed = false;
    for (size_t k = 0; k < feedforward->points; k++)
        changed = changed || fabs(target[k] - handled[k]) > TARGET_ROUNDING;
    if (changed && unit->state[0] < SLOTS)
        start_transition(unit, time);
    const bool rests = unit->state[0] == 0.0 && unit->values[feedforward->moving] == 0.0;
    if (!rests)
        write_references(unit, time + step + unit->values[feedforward->preview]);
    return true;
}

/* The number of transitions is used as an index; the planner tries durations up to a multiple of the longest. */
static bool flatness_feedforward_restore(UnitInstance *unit)
{
    const double count = unit->state[0];
    bool is_valid = count >= 0.0 && count <= SLOTS && floor(count) == count;
    if (is_valid) {
        const Motion motion = motion_of(unit);
        for (size_t k = 0; k < motion.count; k++)
            is_valid =
                is_valid && isfinite(motion.starts[k]) && motion.durations[k] > 0.0 && motion.durations[k] < 1e12;
    }
    return is_valid || unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

INTERNAL_DATA const UnitHooks flatness_feedforward_hooks = {
    .state_size = flatness_feedforward_state_size,
    .workspace_size = flatness_feedforward_workspace_size,
    .initialise = flatness_feedforward_initialise,
    .differentiate = flatness_feedforward_differentiate,
    .restore = flatness_feedforward_restore,
    .advance = flatness_feedforward_advance,
};
