#include "unit.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>

#include "format_line.h"

size_t unit_state_size(const UnitHooks *hooks, const void *data)
{
    return hooks->state_size == NULL ? 0 : hooks->state_size(data);
}

size_t unit_workspace_size(const UnitHooks *hooks, const void *data)
{
    return hooks->workspace_size == NULL ? 0 : hooks->workspace_size(data);
}

bool unit_prepare(UnitInstance *unit, double step)
{
    return unit->hooks->prepare == NULL || unit->hooks->prepare(unit, step);
}

bool unit_restore(UnitInstance *unit)
{
    return unit->hooks->restore == NULL || unit->hooks->restore(unit);
}

void unit_complete(UnitInstance *unit)
{
    if (unit->hooks->complete != NULL)
        unit->hooks->complete(unit);
}

double clock_tolerance(const UnitInstance *unit, double time, double tick)
{
    return fmin(1e-6 * tick + 2 * DBL_EPSILON * (fabs(unit->start) + time), tick / 4);
}

static void log_values(UnitInstance *unit, Severity severity, const char *format, va_list values)
{
    char line[TEXT_SIZE];
    format_line(line, sizeof line, format, values);
    unit->log(unit, severity, line);
}

bool unit_refuse(UnitInstance *unit, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    log_values(unit, REFUSAL, format, values);
    va_end(values);
    return false;
}

void unit_warn(UnitInstance *unit, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    log_values(unit, WARNING, format, values);
    va_end(values);
}

void unit_note(UnitInstance *unit, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    log_values(unit, NOTE, format, values);
    va_end(values);
}
