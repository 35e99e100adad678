/* FlatnessFeedforward: voltages and states from a flat output (31)-(38) that moves by superposed transitions. */

#include "flatness_feedforward.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "targets.h"

static void evaluate(const UnitInstance *unit, const Motion *motion, double time, double *u, double *x)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    if (has_splines(feedforward))
        evaluate_splines(&feedforward->splines, motion, time, u, x, scratch_of(unit));
    else
        evaluate_flat_output(&feedforward->flat, motion, time, u, x, scratch_of(unit));
}

/* Voltages, reference states and outputs of a motion at `time` in place of the variables' `values`. */
static void evaluate_references(const UnitInstance *unit, const Motion *motion, double time, double *values)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    const size_t states = feedforward->flat.states;
    double *const u = values + feedforward->u_ff;
    double *const x = values + feedforward->x_ref;
    evaluate(unit, motion, time, u, x);
    double *const state_and_input = scratch_of(unit);
    memcpy(state_and_input, x, states * sizeof *x);
    memcpy(state_and_input + states, u, voltages * sizeof *u);
    multiply_panels(feedforward->points, states + voltages, feedforward->reference_outputs, state_and_input, false,
                    values + feedforward->y_ref);
}

static void write_references(UnitInstance *unit, double time)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    retire_transitions(unit, time);
    const Motion motion = motion_of(unit);
    evaluate_references(unit, &motion, time, unit->values);
    unit->values[feedforward->moving] = is_moving(unit, time);
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
    memset(unit->state, 0, feedforward_state_size(feedforward) * sizeof *unit->state);
    unit->state[DUE] = NO_SEARCH;
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
    const Motion motion = {.offset = scratch_of(unit) + evaluation_scratch(feedforward)};
    multiply_panels(feedforward->flat.voltages, feedforward->points, feedforward->static_inverse,
                    unit->changes + feedforward->y_target, false, motion.offset);
    evaluate_references(unit, &motion, 0.0, unit->changes);
}

/* Every tick inside [time, time + step): targets are seen and transitions start there. Outputs are those of time + step
   + preview. At rest they stay. */
static bool flatness_feedforward_advance(UnitInstance *unit, double time, double step)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    double *const tick = unit->state + TICK;
    const double end = time + step;
    const double last = (end - clock_tolerance(unit, end, feedforward->sample_time)) / feedforward->sample_time;
    while (*tick < last) {
        if (unit->state[DUE] == NO_SEARCH && !is_new_target(unit)) {
            *tick = ceil(last);
            break;
        }
        pass_tick(unit, *tick);
        *tick += 1.0;
    }
    const bool rests = unit->state[COUNT] == 0.0 && unit->values[feedforward->moving] == 0.0;
    if (!rests)
        write_references(unit, end + unit->values[feedforward->preview]);
    return true;
}

/* The splines of motion and search follow from the state. */
static bool flatness_feedforward_restore(UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    if (!is_valid_state(unit))
        return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
    const Motion motion = motion_of(unit);
    if (has_splines(feedforward)) {
        for (size_t k = 0; k < motion.count; k++)
            begin_spline(&feedforward->splines, spline_row(&feedforward->splines, motion.durations[k]),
                         motion.changes + k * feedforward->flat.voltages, spline_of(&feedforward->splines, &motion, k));
        double *const u = scratch_of(unit) + evaluation_scratch(feedforward);
        evaluate(unit, &motion, unit->elapsed + unit->values[feedforward->preview], u, u + feedforward->flat.voltages);
    }
    if (unit->state[DUE] != NO_SEARCH)
        restore_search(feedforward, &motion, search_of(unit));
    return true;
}

SHARED_DATA const UnitHooks flatness_feedforward_hooks = {
    .state_size = feedforward_state_size,
    .workspace_size = feedforward_workspace_size,
    .initialise = flatness_feedforward_initialise,
    .differentiate = flatness_feedforward_differentiate,
    .restore = flatness_feedforward_restore,
    .advance = flatness_feedforward_advance,
};
