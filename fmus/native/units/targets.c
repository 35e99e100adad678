#include "targets.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"

#define TARGET_ROUNDING 1e-12 /* m: a host that interpolates a constant target moves it by less */
#define OFF_REACH 1e-3        /* of the largest target: one this far from what voltages reach is refused */

double missed_at(const FlatnessFeedforwardData *feedforward, const double *target, size_t point)
{
    const double *const row = feedforward->unreachable + point * feedforward->points;
    double missed = 0.0;
    for (size_t k = 0; k < feedforward->points; k++)
        missed += row[k] * target[k];
    return missed;
}

size_t unreachable_point(const FlatnessFeedforwardData *feedforward, const double *target)
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

VoltageRange limits_of(UnitInstance *unit)
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

BrokenLimit broken_limit(const UnitInstance *unit, Violation violation)
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

bool is_new_target(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const double *const target = unit->values + feedforward->y_target;
    const double *const handled = handled_target(unit);
    bool changed = false;
    for (size_t k = 0; k < feedforward->points; k++)
        changed = changed || fabs(target[k] - handled[k]) > TARGET_ROUNDING;
    return changed;
}

void pass_tick(UnitInstance *unit, double tick)
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
