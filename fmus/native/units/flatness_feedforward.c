/* FlatnessFeedforward: voltages and states from a flat output (31)-(38) that moves by superposed transitions. */

#include "flatness_feedforward.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "planner.h"
#include "ranges.h"

#define TARGET_ROUNDING 1e-12 /* m: a host that interpolates a constant target moves it by less */
#define OFF_REACH 1e-3        /* of the largest target: one this far from what voltages reach is refused */

/* State: number of transitions under way; ticks done; the tick at which the plan of a search takes effect, or
   NO_SEARCH; the target that all of these lead to (points,); the motion; the search. Whole numbers are doubles as all
   of the state. */
enum { COUNT, TICK, DUE, STATE_NUMBERS };
#define NO_SEARCH (-1.0)

static size_t flatness_feedforward_state_size(const void *data)
{
    const FlatnessFeedforwardData *const feedforward = data;
    const size_t voltages = feedforward->flat.voltages;
    return STATE_NUMBERS + feedforward->points + voltages + SLOTS * (2 + voltages) + search_size(feedforward);
}

static double *handled_target(const UnitInstance *unit)
{
    return unit->state + STATE_NUMBERS;
}

static bool has_splines(const FlatnessFeedforwardData *feedforward)
{
    return feedforward->splines.durations > 0;
}

static Motion motion_of(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    double *const offset = handled_target(unit) + feedforward->points;
    double *const starts = offset + feedforward->flat.voltages;
    double *const durations = starts + SLOTS;
    return (Motion){.count = (size_t)unit->state[COUNT],
                    .offset = offset,
                    .starts = starts,
                    .durations = durations,
                    .changes = durations + SLOTS,
                    .splines = unit->workspace + 1,
                    .first = has_splines(feedforward) ? (size_t)*unit->workspace : 0};
}

static size_t splines_size(const FlatnessFeedforwardData *feedforward)
{
    return has_splines(feedforward) ? 1 + SLOTS * spline_size(&feedforward->splines) : 0;
}

/* Workspace: place of the first spline of the motion, and these; then scratch of its evaluation, at most with voltages
   and states behind it; or the outputs' arguments; or a change, the limits of the voltages, and scratch of a search. */
static size_t evaluation_scratch(const FlatnessFeedforwardData *feedforward)
{
    return has_splines(feedforward) ? spline_scratch(&feedforward->splines) : flat_output_scratch(&feedforward->flat);
}

static size_t flatness_feedforward_workspace_size(const void *data)
{
    const FlatnessFeedforwardData *const feedforward = data;
    const size_t voltages = feedforward->flat.voltages;
    const size_t evaluation = evaluation_scratch(feedforward) + voltages + feedforward->flat.states;
    const size_t planning = 3 * voltages + search_scratch(feedforward);
    return splines_size(feedforward) + (evaluation > planning ? evaluation : planning);
}

static double *scratch_of(const UnitInstance *unit)
{
    return unit->workspace + splines_size(unit->data);
}

static PlanSearch search_of(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    return search_in(feedforward, motion_of(unit).changes + SLOTS * voltages, scratch_of(unit) + 3 * voltages);
}

static double reached_by(const UnitInstance *unit, double time)
{
    return time + clock_tolerance(unit, time, unit->step_size);
}

/* Transitions that have ended, those before them too, go into the offset; the others move up. None does while a search
   looks at them. So the motion is the same whenever it is looked at. */
static void retire_transitions(UnitInstance *unit, double time)
{
    if (unit->state[DUE] != NO_SEARCH)
        return;
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const Motion motion = motion_of(unit);
    const size_t voltages = feedforward->flat.voltages;
    const double reached = reached_by(unit, time);
    size_t ended = 0;
    while (ended < motion.count && reached >= motion.starts[ended] + motion.durations[ended]) {
        for (size_t j = 0; j < voltages; j++)
            motion.offset[j] += motion.changes[ended * voltages + j];
        ended++;
    }
    if (ended == 0)
        return;
    const size_t left = motion.count - ended;
    memmove(motion.starts, motion.starts + ended, left * sizeof(double));
    memmove(motion.durations, motion.durations + ended, left * sizeof(double));
    memmove(motion.changes, motion.changes + ended * voltages, left * voltages * sizeof(double));
    if (has_splines(feedforward))
        *unit->workspace = (double)((motion.first + ended) % SLOTS);
    unit->state[COUNT] = (double)left;
}

static bool is_moving(const UnitInstance *unit, double time)
{
    const Motion motion = motion_of(unit);
    const double reached = reached_by(unit, time);
    for (size_t k = 0; k < motion.count; k++)
        if (reached < motion.starts[k] + motion.durations[k])
            return true;
    return false;
}

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

/* The limits of the voltages, behind a change in the scratch. */
static VoltageRange limits_of(UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    const double *const values = unit->values;
    double *const behind = scratch_of(unit) + voltages;
    const VoltageRange limits = {.lowest = behind, .highest = behind + voltages};
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
    const FlatnessFeedforwardData *const feedforward = unit->data;
    if (has_splines(feedforward) && plan->violation.excess <= 0.0) {
        unit_note(unit, "the transition at %.6g s takes %.4g s, the next longer time of the design to %.4g s",
                  unit->start + time, plan->duration, shortest);
        return;
    }
    unit_note(unit, "the transition at %.6g s is stretched from %.4g s to %.4g s to stay within %s%s%.1f V",
              unit->start + time, shortest, plan->duration, broken.is_own ? broken.name : "",
              broken.is_own ? " = " : "", broken.limit);
}

/* The plan takes effect: a transition starts, or the target is refused. `seen` is the tick that saw it. */
static void follow_plan(UnitInstance *unit, const TransitionPlan *plan, double seen)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    double *const values = unit->values;
    const bool refused = !(plan->duration > 0.0);
    values[feedforward->target_refused] = refused;
    values[feedforward->planned_peak] = plan->peak;
    unit->state[DUE] = NO_SEARCH;
    if (refused) {
        warn_of_refusal(unit, seen * feedforward->sample_time, plan);
        return;
    }
    const Motion motion = motion_of(unit);
    const double shortest = values[feedforward->transition_time];
    if (plan->duration > shortest * (1 + 1e-9))
        note_stretching(unit, motion.starts[motion.count], shortest, plan);
    values[feedforward->planned_time] = plan->duration;
    unit->state[COUNT] += 1.0;
}

/* The change of the voltages at rest from the motion's end to the target. */
static void find_change(const UnitInstance *unit, double *change)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const Motion motion = motion_of(unit);
    const size_t voltages = feedforward->flat.voltages;
    multiply_panels(voltages, feedforward->points, feedforward->static_inverse, unit->values + feedforward->y_target,
                    false, change);
    for (size_t j = 0; j < voltages; j++) {
        double sum = 0.0;
        for (size_t k = 0; k < motion.count; k++)
            sum += motion.changes[k * voltages + j];
        change[j] -= motion.offset[j] + sum;
    }
}

/* Begins the transition to a target that a tick sees: at once from rest where the first duration fits, else after
   planning_ticks, which suffice to find one. */
static void plan_target(UnitInstance *unit, double tick)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const double *const target = unit->values + feedforward->y_target;
    const double time = tick * feedforward->sample_time;
    const size_t point = unreachable_point(feedforward, target);
    memcpy(handled_target(unit), target, feedforward->points * sizeof *target);
    if (point < feedforward->points) {
        unit->values[feedforward->target_refused] = true;
        unit_warn(unit,
                  "y_target at %.6g s is refused: no voltages reach it, the nearest reachable target has y_target[%zu] "
                  "= %.6g m in place of %.6g m; the target before is held",
                  unit->start + time, point + 1, target[point] - missed_at(feedforward, target, point), target[point]);
        return;
    }
    const Motion motion = motion_of(unit);
    const PlanSearch search = search_of(unit);
    double *const change = scratch_of(unit);
    find_change(unit, change);
    const VoltageRange limits = limits_of(unit);
    const double shortest = unit->values[feedforward->transition_time];
    const bool rests = motion.count == 0;
    const double later = (tick + feedforward->planning_ticks) * feedforward->sample_time;
    TransitionPlan plan;
    if (!begin_search(feedforward, &motion, search, rests ? time : later, change, shortest, limits, &plan)) {
        follow_plan(unit, &plan, tick);
        return;
    }
    if (rests && first_fits(feedforward, &motion, search)) {
        plan = conclude_search(feedforward, &motion, search);
        follow_plan(unit, &plan, tick);
        return;
    }
    unit->state[DUE] = tick + feedforward->planning_ticks;
    if (rests)
        begin_search(feedforward, &motion, search, later, change, shortest, limits, &plan);
    else
        continue_search(feedforward, &motion, search);
}

static bool is_new_target(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const double *const target = unit->values + feedforward->y_target;
    const double *const handled = handled_target(unit);
    bool changed = false;
    for (size_t k = 0; k < feedforward->points; k++)
        changed = changed || fabs(target[k] - handled[k]) > TARGET_ROUNDING;
    return changed;
}

static void pass_tick(UnitInstance *unit, double tick)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const Motion motion = motion_of(unit);
    if (unit->state[DUE] != NO_SEARCH) {
        if (tick < unit->state[DUE]) {
            continue_search(feedforward, &motion, search_of(unit));
            return;
        }
        const TransitionPlan plan = conclude_search(feedforward, &motion, search_of(unit));
        follow_plan(unit, &plan, tick - feedforward->planning_ticks);
    }
    if (!is_new_target(unit))
        return;
    retire_transitions(unit, tick * feedforward->sample_time + unit->values[feedforward->preview]);
    if (unit->state[COUNT] < SLOTS)
        plan_target(unit, tick);
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

static bool is_valid_motion(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const Motion motion = motion_of(unit);
    for (size_t k = 0; k < motion.count; k++) {
        const double duration = motion.durations[k];
        if (!(isfinite(motion.starts[k]) && duration > 0.0 && duration < 1e12))
            return false;
        if (has_splines(feedforward) &&
            feedforward->splines.times[spline_row(&feedforward->splines, duration)] != duration)
            return false;
    }
    return true;
}

/* Whether the clocks of ticks and of a search can be those of a saved state: others would keep the next step busy. */
static bool is_valid_clock(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const double count = unit->state[COUNT];
    const double tick = unit->state[TICK];
    const double due = unit->state[DUE];
    const double behind = unit->elapsed / feedforward->sample_time - tick;
    return count >= 0.0 && count <= SLOTS && floor(count) == count && floor(tick) == tick &&
           fabs(behind) <= 2.0 + 4 * DBL_EPSILON * tick &&
           (due == NO_SEARCH || (due >= tick && due <= tick + feedforward->planning_ticks && floor(due) == due));
}

/* Numbers of a state are used as indices; the splines follow from them. */
static bool flatness_feedforward_restore(UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    if (!is_valid_clock(unit) || !is_valid_motion(unit))
        return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
    const Motion motion = motion_of(unit);
    const bool searches = unit->state[DUE] != NO_SEARCH;
    if (searches && !search_is_valid(feedforward, &motion, search_of(unit)))
        return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
    if (has_splines(feedforward)) {
        for (size_t k = 0; k < motion.count; k++)
            begin_spline(&feedforward->splines, spline_row(&feedforward->splines, motion.durations[k]),
                         motion.changes + k * feedforward->flat.voltages, spline_of(&feedforward->splines, &motion, k));
        double *const u = scratch_of(unit) + evaluation_scratch(feedforward);
        evaluate(unit, &motion, unit->elapsed + unit->values[feedforward->preview], u, u + feedforward->flat.voltages);
    }
    if (searches)
        restore_search(feedforward, &motion, search_of(unit));
    return true;
}

INTERNAL_DATA const UnitHooks flatness_feedforward_hooks = {
    .state_size = flatness_feedforward_state_size,
    .workspace_size = flatness_feedforward_workspace_size,
    .initialise = flatness_feedforward_initialise,
    .differentiate = flatness_feedforward_differentiate,
    .restore = flatness_feedforward_restore,
    .advance = flatness_feedforward_advance,
};
