#include "instance.h"

#include <float.h>
#include <stdarg.h>
#include <string.h>

#include "format_line.h"
#include "ranges.h"

Instance *begin_call(fmi2Component component, const char *function)
{
    Instance *const instance = component;
    if (instance != NULL)
        instance->function = function;
    return instance;
}

/* One line; that of a refusal starts with the FMI function's name. */
static void say(Instance *instance, fmi2Status status, const char *text)
{
    static const char categories[][20] = {
        [fmi2OK] = "logAll",
        [fmi2Warning] = "logStatusWarning",
        [fmi2Discard] = "logStatusDiscard",
        [fmi2Error] = "logStatusError",
        [fmi2Fatal] = "logStatusFatal",
    };
    if ((instance->logged >> status & 1u) == 0)
        return;
    char line[TEXT_SIZE + 40];
    line[0] = '\0';
    if (status >= fmi2Discard && strncmp(text, instance->function, strlen(instance->function)) != 0) {
        strcpy(line, instance->function);
        strcat(line, ": ");
    }
    strcat(line, text);
    instance->callbacks.logger(instance->callbacks.componentEnvironment, instance->name, status, categories[status],
                               line);
}

#define FORMAT_TEXT(text, format)                                                                                      \
    do {                                                                                                               \
        va_list values;                                                                                                \
        va_start(values, format);                                                                                      \
        format_line(text, sizeof text, format, values);                                                                \
        va_end(values);                                                                                                \
    } while (false)

static fmi2Status fail(Instance *instance, const char *text)
{
    if (instance->now.failure[0] == '\0' && !instance->trying)
        strcpy(instance->now.failure, text);
    say(instance, fmi2Error, text);
    return fmi2Error;
}

fmi2Status refuse(Instance *instance, const char *format, ...)
{
    char text[TEXT_SIZE];
    FORMAT_TEXT(text, format);
    return fail(instance, text);
}

fmi2Status decline(Instance *instance, const char *format, ...)
{
    char text[TEXT_SIZE];
    FORMAT_TEXT(text, format);
    say(instance, fmi2Error, text);
    return fmi2Error;
}

fmi2Status discard(Instance *instance, const char *format, ...)
{
    char text[TEXT_SIZE];
    FORMAT_TEXT(text, format);
    say(instance, fmi2Discard, text);
    return fmi2Discard;
}

fmi2Status refuse_null(Instance *instance, const char *argument)
{
    return refuse(instance, "%s must not be NULL", argument);
}

fmi2Status decline_null(Instance *instance, const char *argument)
{
    return decline(instance, "%s must not be NULL", argument);
}

void log_of_unit(UnitInstance *unit, Severity severity, const char *line)
{
    Instance *const instance = (Instance *)unit;
    if (severity == REFUSAL)
        fail(instance, line);
    else
        say(instance, severity == WARNING ? fmi2Warning : fmi2OK, line);
    instance->warned = instance->warned || severity == WARNING;
}

bool require(Instance *instance, Phase phase)
{
    static const char phases[][24] = {"just instantiated", "in initialization mode", "initialised", "terminated"};
    if (instance->now.phase == phase)
        return true;
    refuse(instance, "%s needs an instance %s, this one is %s", instance->function, phases[phase],
           phases[instance->now.phase]);
    return false;
}

void keep_results(Instance *instance)
{
    const UnitDescription *const unit = instance->description;
    double *kept = instance->kept;
    for (const Results *span = unit->results; span < unit->results + unit->result_count; span++) {
        memcpy(kept, instance->unit.values + span->first, span->count * sizeof *kept);
        kept += span->count;
    }
}

bool check_results(Instance *instance)
{
    const UnitDescription *const unit = instance->description;
    const double *const values = instance->unit.values;
    for (const Results *span = unit->results; span < unit->results + unit->result_count; span++) {
        if (all_within(span->count, values + span->first, -DBL_MAX, DBL_MAX))
            continue;
        size_t k = span->first;
        while (isfinite(values[k]))
            k++;
        refuse(instance, "%s must be finite, a step gives %r: it keeps its last value", unit->variables[k].name,
               values[k]);
        return false;
    }
    return true;
}

void take_back_results(Instance *instance)
{
    const UnitDescription *const unit = instance->description;
    const double *kept = instance->kept;
    for (const Results *span = unit->results; span < unit->results + unit->result_count; span++) {
        memcpy(instance->unit.values + span->first, kept, span->count * sizeof *kept);
        kept += span->count;
    }
    instance->incomplete = false;
}

bool refresh(Instance *instance)
{
    if (!instance->stale)
        return true;
    keep_results(instance);
    if (!instance->unit.hooks->initialise(&instance->unit) || !check_results(instance)) {
        take_back_results(instance);
        return false;
    }
    instance->incomplete = true;
    instance->stale = false;
    return true;
}

bool try_refresh(Instance *instance)
{
    instance->trying = true;
    const bool done = refresh(instance);
    instance->trying = false;
    return done;
}

void complete(Instance *instance)
{
    if (instance->incomplete)
        unit_complete(&instance->unit);
    instance->incomplete = false;
}
