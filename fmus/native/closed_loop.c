/* BeamClosedLoop: wired units as one unit. Values, states and workspaces of its parts are slices of its own.

   The parts exchange values at t_k = start + k h, h = unit_step_size, and hold them from one to the next. A step of the
   host that ends in between moves them up to its end, and the next one moves them on with what they were given at t_k. */

#include "closed_loop.h"

#include <math.h>
#include <string.h>

#include "text.h"

#define ROUNDING 1e-6      /* of the host's clock, in steps of h */
#define DIVISIONS 0x1p+30  /* of a step of h: equal pieces are equal to the last digit whatever the clock shows */
#define LINE 8             /* doubles of a cache line: a part's workspace begins on one where the whole's does */

/* State: steps of h that are done, share of the next one that is done, start time s; then that of each part. */
enum { DONE, GONE, START, PARTS };

typedef struct {
    unit unit;  /* first, so that the mathematics' pointer is the part's too */
    unit *whole;
    size_t number;
    mathematics own;
} part;

size_t unit_state_size(void)
{
    size_t size = PARTS;
    for (size_t k = 0; k < loop_part_count; k++)
        size += loop_mathematics(k).state_size();
    return size;
}

static size_t whole_lines(size_t doubles)
{
    return (doubles + LINE - 1) / LINE * LINE;
}

size_t unit_workspace_size(void)
{
    size_t size = 0;
    for (size_t k = 0; k < loop_part_count; k++)
        size += whole_lines(loop_mathematics(k).workspace_size());
    return size;
}

typedef bool action(part *part, double time, double step);

/* One part after the other; false where one fails. */
static bool each(unit *whole, action *act, double time, double step)
{
    part part = {.unit = {.state = whole->state + PARTS, .workspace = whole->workspace}, .whole = whole};
    for (; part.number < loop_part_count; part.number++) {
        part.unit.values = whole->values + loop_parts[part.number].values;
        part.own = loop_mathematics(part.number);
        if (!act(&part, time, step))
            return false;
        part.unit.state += part.own.state_size();
        part.unit.workspace += whole_lines(part.own.workspace_size());
    }
    return true;
}

/* Outputs to the inputs that they are wired to. */
static void pass_on(double *values, size_t first_wire, size_t wire_count)
{
    for (const loop_wire *wire = loop_wires + first_wire; wire < loop_wires + first_wire + wire_count; wire++)
        memcpy(values + wire->to, values + wire->from, wire->count * sizeof *values);
}

static void pass_on_to(const part *part)
{
    const loop_part *const own = &loop_parts[part->number];
    pass_on(part->whole->values, own->first_wire, own->wire_count);
}

static bool initialise(part *part, double time, double step)
{
    (void)step;
    pass_on_to(part);
    part->unit.values[0] = time;
    return part->own.initialise(&part->unit);
}

/* As often as the longest chain of parts whose first outputs depend on first inputs needs. */
bool unit_initialise(unit *unit)
{
    const double start = unit->values[0];
    unit->state[DONE] = unit->state[GONE] = 0.0;
    unit->state[START] = start;
    for (size_t k = 0; k < loop_part_count; k++)
        if (!each(unit, initialise, start, 0.0))
            return false;
    pass_on(unit->values, 0, loop_wire_count);
    return true;
}

static bool prepare(part *part, double time, double step)
{
    (void)time;
    return part->own.prepare(&part->unit, step);
}

bool unit_prepare(unit *unit, double step)
{
    return each(unit, prepare, 0.0, step);
}

static bool advance(part *part, double time, double step)
{
    if (loop_is_sequential && part->whole->state[GONE] == 0.0)
        pass_on_to(part);
    if (!part->own.advance(&part->unit, time, step))
        return false;
    part->unit.values[0] = time + step;
    return true;
}

/* Time s after so many steps of h. */
static double time_after(const unit *unit, double steps)
{
    return unit->state[START] + steps * unit_step_size;
}

bool unit_advance(unit *unit, double time, double step)
{
    double *const done = unit->state + DONE, *const gone = unit->state + GONE;
    for (;;) {
        const double left = (time + step - unit->state[START]) / unit_step_size - *done;
        const bool whole = left > 1 - ROUNDING;
        if (!whole && left - *gone < ROUNDING)
            return true;
        const double goal = whole ? 1.0 : floor(left * DIVISIONS + 0.5) / DIVISIONS;
        if (!each(unit, advance, time_after(unit, *done + *gone), (goal - *gone) * unit_step_size))
            return false;
        *gone = goal;
        if (whole) {
            *done += 1.0;
            *gone = 0.0;
            pass_on(unit->values, 0, loop_wire_count);
        }
    }
}

static bool restore(part *part, double time, double step)
{
    (void)step;
    part->unit.values[0] = time;
    return part->own.restore(&part->unit);
}

/* A count far behind the clock, which no saved state has, would keep the next step busy for ever. */
bool unit_restore(unit *unit)
{
    const double done = unit->state[DONE], gone = unit->state[GONE];
    const double behind = (unit->values[0] - unit->state[START]) / unit_step_size - done;
    if (gone >= 0.0 && gone < 1.0 && fabs(behind) <= 2.0 + 1e-9 * fabs(done))
        return each(unit, restore, time_after(unit, done + gone), 0.0);
    return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

static bool complete(part *part, double time, double step)
{
    (void)time;
    (void)step;
    part->own.complete(&part->unit);
    return true;
}

void unit_complete(unit *unit)
{
    each(unit, complete, 0.0, 0.0);
}

/* A part's line for the log, with its name in front where it does not begin with that of a variable. */
static void say(char *line, const part *part, const char *format, va_list values)
{
    const char *const name = loop_parts[part->number].name;
    const size_t length = strlen(name);
    char text[TEXT_SIZE];
    compose(text, format, values);
    line[0] = '\0';
    if (strncmp(text, name, length) != 0 || text[length] != '.')
        strcat(strcpy(line, name), ": ");
    strcat(line, text);
}

#define RELAY(service)                                     \
    const part *const own = (const part *)unit;            \
    char line[TEXT_SIZE + NAME_SIZE + 2];                  \
    va_list values;                                        \
    va_start(values, format);                              \
    say(line, own, format, values);                        \
    va_end(values);                                        \
    service(own->whole, "%s", line)

bool part_refuse(unit *unit, const char *format, ...)
{
    RELAY(unit_refuse);
    return false;
}

void part_warn(unit *unit, const char *format, ...)
{
    RELAY(unit_warn);
}

void part_note(unit *unit, const char *format, ...)
{
    RELAY(unit_note);
}
