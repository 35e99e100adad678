#include "instance.h"

#include <string.h>

#include "text.h"

size_t saved_count(void)
{
    return 2 * unit_variable_count + unit_state_size();
}

instance *entered(fmi2Component component, const char *function)
{
    instance *const instance = component;
    if (instance != NULL)
        instance->function = function;
    return instance;
}

/* One line; that of a refusal starts with the FMI function's name. */
static void say(instance *instance, fmi2Status status, const char *text)
{
    static const char categories[][20] = {
        [fmi2OK] = "logAll", [fmi2Warning] = "logStatusWarning", [fmi2Discard] = "logStatusDiscard",
        [fmi2Error] = "logStatusError", [fmi2Fatal] = "logStatusFatal",
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

#define COMPOSE(text, format)            \
    do {                                 \
        va_list values;                  \
        va_start(values, format);        \
        compose(text, format, values);   \
        va_end(values);                  \
    } while (false)

static fmi2Status fail(instance *instance, const char *text)
{
    if (instance->now.failure[0] == '\0')
        strcpy(instance->now.failure, text);
    say(instance, fmi2Error, text);
    return fmi2Error;
}

fmi2Status refuse(instance *instance, const char *format, ...)
{
    char text[TEXT_SIZE];
    COMPOSE(text, format);
    return fail(instance, text);
}

fmi2Status decline(instance *instance, const char *format, ...)
{
    char text[TEXT_SIZE];
    COMPOSE(text, format);
    say(instance, fmi2Error, text);
    return fmi2Error;
}

fmi2Status discard(instance *instance, const char *format, ...)
{
    char text[TEXT_SIZE];
    COMPOSE(text, format);
    say(instance, fmi2Discard, text);
    return fmi2Discard;
}

fmi2Status refuse_null(instance *instance, const char *argument)
{
    return refuse(instance, "%s must not be NULL", argument);
}

bool unit_refuse(unit *unit, const char *format, ...)
{
    char text[TEXT_SIZE];
    COMPOSE(text, format);
    fail((instance *)unit, text);
    return false;
}

void unit_warn(unit *unit, const char *format, ...)
{
    char text[TEXT_SIZE];
    COMPOSE(text, format);
    say((instance *)unit, fmi2Warning, text);
}

void unit_note(unit *unit, const char *format, ...)
{
    char text[TEXT_SIZE];
    COMPOSE(text, format);
    say((instance *)unit, fmi2OK, text);
}

bool require(instance *instance, enum phase phase)
{
    static const char phases[][24] = {"just instantiated", "in initialization mode", "initialised", "terminated"};
    if (instance->now.phase == phase)
        return true;
    refuse(instance, "%s needs an instance %s, this one is %s", instance->function, phases[phase],
           phases[instance->now.phase]);
    return false;
}

bool refresh(instance *instance)
{
    if (instance->stale && !unit_initialise(&instance->unit))
        return false;
    if (instance->stale)
        instance->incomplete = true;
    instance->stale = false;
    return true;
}

void complete(instance *instance)
{
    if (instance->incomplete)
        unit_complete(&instance->unit);
    instance->incomplete = false;
}
