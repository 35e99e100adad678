#include "feedforward_state.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* State: its numbers; the target handled (points,); the motion; the search. Whole numbers are doubles as all of the
   state. */
size_t feedforward_state_size(const void *data)
{
    const FlatnessFeedforwardData *const feedforward = data;
    const size_t voltages = feedforward->flat.voltages;
    return STATE_NUMBERS + feedforward->points + voltages + SLOTS * (2 + voltages) + search_size(feedforward);
}

bool has_splines(const FlatnessFeedforwardData *feedforward)
{
    return feedforward->splines.durations > 0;
}

static size_t splines_size(const FlatnessFeedforwardData *feedforward)
{
    return has_splines(feedforward) ? 1 + SLOTS * spline_size(&feedforward->splines) : 0;
}

size_t evaluation_scratch(const FlatnessFeedforwardData *feedforward)
{
    return has_splines(feedforward) ? spline_scratch(&feedforward->splines) : flat_output_scratch(&feedforward->flat);
}

/* Workspace: place of the first spline of the motion, and these; then scratch of its evaluation, at most with voltages
   and states behind it; or the outputs' arguments; or a change, the limits of the voltages, and scratch of a search. */
size_t feedforward_workspace_size(const void *data)
{
    const FlatnessFeedforwardData *const feedforward = data;
    const size_t voltages = feedforward->flat.voltages;
    const size_t evaluation = evaluation_scratch(feedforward) + voltages + feedforward->flat.states;
    const size_t planning = 3 * voltages + search_scratch(feedforward);
    return splines_size(feedforward) + (evaluation > planning ? evaluation : planning);
}

double *handled_target(const UnitInstance *unit)
{
    return unit->state + STATE_NUMBERS;
}

Motion motion_of(const UnitInstance *unit)
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

double *scratch_of(const UnitInstance *unit)
{
    return unit->workspace + splines_size(unit->data);
}

PlanSearch search_of(const UnitInstance *unit)
{
    const FlatnessFeedforwardData *const feedforward = unit->data;
    const size_t voltages = feedforward->flat.voltages;
    return search_in(feedforward, motion_of(unit).changes + SLOTS * voltages, scratch_of(unit) + 3 * voltages);
}

static double reached_by(const UnitInstance *unit, double time)
{
    return time + clock_tolerance(unit, time, unit->step_size);
}

bool is_moving(const UnitInstance *unit, double time)
{
    const Motion motion = motion_of(unit);
    const double reached = reached_by(unit, time);
    for (size_t k = 0; k < motion.count; k++)
        if (reached < motion.starts[k] + motion.durations[k])
            return true;
    return false;
}

void retire_transitions(UnitInstance *unit, double time)
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

bool is_valid_state(const UnitInstance *unit)
{
    if (!is_valid_clock(unit) || !is_valid_motion(unit))
        return false;
    const Motion motion = motion_of(unit);
    return unit->state[DUE] == NO_SEARCH || search_is_valid(unit->data, &motion, search_of(unit));
}
