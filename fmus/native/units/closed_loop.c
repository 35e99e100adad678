/* BeamClosedLoop: wired units as one unit. Values, states and workspaces of its parts are slices of its own.

   The parts exchange values at t_k = start + k h, h = step_size, and hold them from one to the next. A step of the host
   that ends in between moves them up to its end, and the next one moves them on with what they were given at t_k. */

#include "closed_loop.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "ranges.h"

#define DIVISIONS 0x1p+30 /* of a step of h: equal pieces are equal to the last digit whatever the clock shows */
#define LINE_DOUBLES 8    /* of a cache line: a part's workspace begins on one where the whole's does */

/* State: steps of h that are done and the fraction of the next one that is done, doubles as all of the state; then the
   state of each part. */
enum { STEPS_DONE, FRACTION_DONE, PART_STATES };

typedef struct {
    UnitInstance unit; /* first, so that a pointer to it is one to the part */
    UnitInstance *whole;
    const LoopPart *description;
} Part;

static size_t closed_loop_state_size(const void *data)
{
    const ClosedLoopData *const loop = data;
    size_t size = PART_STATES;
    for (size_t k = 0; k < loop->part_count; k++)
        size += unit_state_size(loop->parts[k].hooks, loop->parts[k].data);
    return size;
}

static size_t whole_lines(size_t doubles)
{
    return (doubles + LINE_DOUBLES - 1) / LINE_DOUBLES * LINE_DOUBLES;
}

static size_t closed_loop_workspace_size(const void *data)
{
    const ClosedLoopData *const loop = data;
    size_t size = 0;
    for (size_t k = 0; k < loop->part_count; k++)
        size += whole_lines(unit_workspace_size(loop->parts[k].hooks, loop->parts[k].data));
    return size;
}

/* A part's line for the log is the whole's, with the part's name in front where it does not begin with that of a
   variable. */
static void log_of_part(UnitInstance *unit, Severity severity, const char *text)
{
    const Part *const part = (const Part *)unit;
    const char *const name = part->description->name;
    const size_t length = strlen(name);
    char line[TEXT_SIZE + NAME_SIZE + 2];
    line[0] = '\0';
    if (strncmp(text, name, length) != 0 || text[length] != '.')
        strcat(strcpy(line, name), ": ");
    strcat(line, text);
    line[TEXT_SIZE - 1] = '\0';
    part->whole->log(part->whole, severity, line);
}

typedef bool PartAction(Part *part, double time, double step);

/* One part after the other; false where one fails. */
static bool for_each_part(UnitInstance *whole, PartAction *action, double time, double step)
{
    const ClosedLoopData *const loop = whole->data;
    double *state = whole->state + PART_STATES;
    double *workspace = whole->workspace;
    for (size_t k = 0; k < loop->part_count; k++) {
        const LoopPart *const description = &loop->parts[k];
        Part part = {
            .unit = {.hooks = description->hooks,
                     .data = description->data,
                     .variables = whole->variables + description->values,
                     .step_size = description->step_size,
                     .start = whole->start,
                     .elapsed = time,
                     .values = whole->values + description->values,
                     .state = state,
                     .workspace = workspace,
                     .changes = whole->changes + description->values,
                     .log = log_of_part},
            .whole = whole,
            .description = description,
        };
        if (!action(&part, time, step))
            return false;
        state += unit_state_size(description->hooks, description->data);
        workspace += whole_lines(unit_workspace_size(description->hooks, description->data));
    }
    return true;
}

/* Outputs to the inputs that they are wired to. */
static void pass_on(const UnitInstance *whole, double *values, size_t first_wire, size_t wire_count)
{
    const ClosedLoopData *const loop = whole->data;
    for (const LoopWire *wire = loop->wires + first_wire; wire < loop->wires + first_wire + wire_count; wire++)
        memcpy(values + wire->to, values + wire->from, wire->count * sizeof *values);
}

static void pass_on_to(const Part *part)
{
    pass_on(part->whole, part->whole->values, part->description->first_wire, part->description->wire_count);
}

/* Have the inputs of these wires values within their bounds? */
static bool check_inputs(UnitInstance *whole, size_t first_wire, size_t wire_count)
{
    const ClosedLoopData *const loop = whole->data;
    for (const LoopWire *wire = loop->wires + first_wire; wire < loop->wires + first_wire + wire_count; wire++) {
        const double *const values = whole->values + wire->to;
        if (all_within(wire->count, values, wire->minimum, wire->maximum))
            continue;
        size_t k = 0;
        while (values[k] >= wire->minimum && values[k] <= wire->maximum)
            k++;
        const char *const name = whole->variables[wire->to + k].name;
        if (!isfinite(values[k]))
            return unit_refuse(whole, "%s must be finite, got %r", name, values[k]);
        const bool low = values[k] < wire->minimum;
        return unit_refuse(whole, "%s must be %s %r, got %r", name,
                           low ? ">=" : "<=", low ? wire->minimum : wire->maximum, values[k]);
    }
    return true;
}

static bool initialise_part(Part *part, double time, double step)
{
    (void)step;
    pass_on_to(part);
    part->unit.values[0] = part->unit.start + time;
    return part->unit.hooks->initialise(&part->unit);
}

/* As often as the longest chain of parts whose first outputs depend on first inputs needs. */
static bool closed_loop_initialise(UnitInstance *unit)
{
    const ClosedLoopData *const loop = unit->data;
    unit->state[STEPS_DONE] = 0.0;
    unit->state[FRACTION_DONE] = 0.0;
    for (size_t k = 0; k < loop->part_count; k++)
        if (!for_each_part(unit, initialise_part, 0.0, 0.0))
            return false;
    pass_on(unit, unit->values, 0, loop->wire_count);
    return check_inputs(unit, 0, loop->wire_count);
}

static bool differentiate_part(Part *part, double time, double step)
{
    (void)time;
    (void)step;
    pass_on(part->whole, part->whole->changes, part->description->first_wire, part->description->wire_count);
    part->unit.hooks->differentiate(&part->unit);
    return true;
}

/* As often as closed_loop_initialise. */
static void closed_loop_differentiate(UnitInstance *unit)
{
    const ClosedLoopData *const loop = unit->data;
    for (size_t k = 0; k < loop->part_count; k++)
        for_each_part(unit, differentiate_part, 0.0, 0.0);
}

static bool prepare_part(Part *part, double time, double step)
{
    (void)time;
    return unit_prepare(&part->unit, step);
}

static bool closed_loop_prepare(UnitInstance *unit, double step)
{
    return for_each_part(unit, prepare_part, 0.0, step);
}

static bool advance_part(Part *part, double time, double step)
{
    const ClosedLoopData *const loop = part->whole->data;
    if (loop->is_sequential && part->whole->state[FRACTION_DONE] == 0.0) {
        pass_on_to(part);
        if (!check_inputs(part->whole, part->description->first_wire, part->description->wire_count))
            return false;
    }
    if (!part->unit.hooks->advance(&part->unit, time, step))
        return false;
    part->unit.values[0] = part->unit.start + (time + step);
    return true;
}

static bool closed_loop_advance(UnitInstance *unit, double time, double step)
{
    const ClosedLoopData *const loop = unit->data;
    double *const done = unit->state + STEPS_DONE;
    double *const fraction = unit->state + FRACTION_DONE;
    const double rounding = clock_tolerance(unit, time + step, unit->step_size) / unit->step_size;
    for (;;) {
        const double left = (time + step) / unit->step_size - *done;
        const bool whole = left > 1 - rounding;
        if (!whole && left - *fraction < rounding)
            return true;
        const double goal = whole ? 1.0 : floor(left * DIVISIONS + 0.5) / DIVISIONS;
        const double begin = (*done + *fraction) * unit->step_size;
        if (!for_each_part(unit, advance_part, begin, (goal - *fraction) * unit->step_size))
            return false;
        *fraction = goal;
        if (whole) {
            *done += 1.0;
            *fraction = 0.0;
            pass_on(unit, unit->values, 0, loop->wire_count);
            if (!check_inputs(unit, 0, loop->wire_count))
                return false;
        }
    }
}

static bool restore_part(Part *part, double time, double step)
{
    (void)step;
    part->unit.values[0] = part->unit.start + time;
    return unit_restore(&part->unit);
}

/* A count that the clock cannot have, which no saved state has, would keep the next step busy for ever. */
static bool closed_loop_restore(UnitInstance *unit)
{
    const double done = unit->state[STEPS_DONE];
    const double fraction = unit->state[FRACTION_DONE];
    const double ahead = (done + fraction) - unit->elapsed / unit->step_size;
    const double rounding = 0.5 + 4 * DBL_EPSILON * done;
    if (done >= 0.0 && floor(done) == done && fraction >= 0.0 && fraction < 1.0 && fabs(ahead) <= rounding)
        return for_each_part(unit, restore_part, (done + fraction) * unit->step_size, 0.0);
    return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

static bool complete_part(Part *part, double time, double step)
{
    (void)time;
    (void)step;
    unit_complete(&part->unit);
    return true;
}

static void closed_loop_complete(UnitInstance *unit)
{
    for_each_part(unit, complete_part, 0.0, 0.0);
}

SHARED_DATA const UnitHooks closed_loop_hooks = {
    .state_size = closed_loop_state_size,
    .workspace_size = closed_loop_workspace_size,
    .initialise = closed_loop_initialise,
    .differentiate = closed_loop_differentiate,
    .prepare = closed_loop_prepare,
    .restore = closed_loop_restore,
    .advance = closed_loop_advance,
    .complete = closed_loop_complete,
};
