/* FMI 2.0: reading and writing variables. */

#include <limits.h>
#include <math.h>
#include <string.h>

#include "instance.h"
#include "references.h"

/* The quick way for what hosts do at every step: consecutive Real variables, whose kinds agree with `kind` in the bits
   of `mask`. False where a call takes a closer look. */
static bool is_run(const UnitDescription *unit, const fmi2ValueReference references[], size_t count, unsigned mask,
                   unsigned kind)
{
    if (references == NULL || count == 0 || count > unit->variable_count ||
        references[0] > unit->variable_count - count)
        return false;
    fmi2ValueReference mismatch = 0;
    for (size_t k = 0; k < count; k++)
        mismatch |= references[k] ^ (references[0] + (fmi2ValueReference)k);
    unsigned char kind_mismatch = 0;
    if (mismatch == 0)
        for (size_t k = 0; k < count; k++)
            kind_mismatch |= (unsigned char)((unit->kinds[references[0] + k] ^ kind) & mask);
    return (mismatch | kind_mismatch) == 0;
}

/* Value k of a call, for the variable of a reference. */
static void put_value(const Instance *instance, fmi2ValueReference reference, VariableType type, void *values, size_t k)
{
    const UnitDescription *const unit = instance->description;
    const double value = instance->unit.values[reference];
    switch (type) {
    case REAL:
        ((fmi2Real *)values)[k] = value;
        break;
    case INTEGER:
        ((fmi2Integer *)values)[k] = (fmi2Integer)value;
        break;
    case BOOLEAN:
        ((fmi2Boolean *)values)[k] = value != 0.0 ? fmi2True : fmi2False;
        break;
    case STRING:
        ((fmi2String *)values)[k] = unit->texts[(size_t)unit->variables[reference].start];
        break;
    }
}

static fmi2Status get_values(fmi2Component component, const char *function, const fmi2ValueReference references[],
                             size_t count, VariableType type, void *values)
{
    Instance *const instance = begin_call(component, function);
    if (instance == NULL || !check_references(instance, references, count, type, values) ||
        (instance->now.phase == INITIALISING && !try_refresh(instance)))
        return fmi2Error;
    for (size_t k = 0; k < count; k++) {
        if (instance->description->kinds[references[k]] & DEFERRED)
            complete(instance);
        put_value(instance, references[k], type, values, k);
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count, fmi2Real values[])
{
    const Instance *const instance = component;
    if (instance != NULL && instance->now.phase != INITIALISING && values != NULL &&
        is_run(instance->description, references, count, TYPE_MASK | DEFERRED, REAL)) {
        memcpy(values, instance->unit.values + references[0], count * sizeof *values);
        return fmi2OK;
    }
    return get_values(component, "fmi2GetReal", references, count, REAL, values);
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          fmi2Integer values[])
{
    return get_values(component, "fmi2GetInteger", references, count, INTEGER, values);
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          fmi2Boolean values[])
{
    return get_values(component, "fmi2GetBoolean", references, count, BOOLEAN, values);
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference references[], size_t count,
                         fmi2String values[])
{
    return get_values(component, "fmi2GetString", references, count, STRING, values);
}

/* A refusal that ends in the refused value, as its type is written. */
static bool decline_value(Instance *instance, fmi2ValueReference reference, const char *rule, const double *bound,
                          double value, const char *text)
{
    const char *const name = instance->description->variables[reference].name;
    const VariableType type = type_of(instance->description, reference);
    if (bound != NULL && type == INTEGER)
        decline(instance, "%s %s %d, got %d", name, rule, (int)*bound, (int)value);
    else if (bound != NULL)
        decline(instance, "%s %s %r, got %r", name, rule, *bound, value);
    else if (type == STRING)
        decline(instance, "%s %s, got %q", name, rule, text == NULL ? "NULL" : text);
    else if (type == BOOLEAN)
        decline(instance, "%s %s, got %s", name, rule, value != 0.0 ? "True" : "False");
    else if (type == INTEGER)
        decline(instance, "%s %s, got %d", name, rule, (int)value);
    else
        decline(instance, "%s %s, got %r", name, rule, value);
    return false;
}

/* May this variable take this value now? */
static bool settable(Instance *instance, fmi2ValueReference reference, double value, const char *text)
{
    static const char fixed[] = "is fixed and cannot be set after initialisation";
    const UnitDescription *const unit = instance->description;
    const Causality causality = causality_of(unit, reference);
    if (causality != INPUT && causality != PARAMETER) {
        char rule[48] = "is ";
        strcat(rule, name_of_causality(causality));
        strcat(rule, " and cannot be set");
        return decline_value(instance, reference, rule, NULL, value, text);
    }
    if ((unit->kinds[reference] & FIXED) != 0 && instance->now.phase == STEPPING)
        return decline_value(instance, reference, fixed, NULL, value, text);
    if (!isfinite(value))
        return decline_value(instance, reference, "must be finite", NULL, value, text);
    const Variable *const variable = &unit->variables[reference];
    if (value < variable->minimum)
        return decline_value(instance, reference, "must be >=", &variable->minimum, value, text);
    if (value > variable->maximum)
        return decline_value(instance, reference, "must be <=", &variable->maximum, value, text);
    return true;
}

/* Are all values within the bounds of variables in a row? NaN is not. */
static bool within_bounds(const Variable variables[], const double values[], size_t count)
{
    size_t beyond = 0;
    for (size_t k = 0; k < count; k++)
        beyond += (size_t) !(values[k] >= variables[k].minimum && values[k] <= variables[k].maximum);
    return beyond == 0;
}

/* Value k of a call as units hold it; texts have none. */
static double value_of(VariableType type, const void *values, size_t k)
{
    switch (type) {
    case REAL:
        return ((const fmi2Real *)values)[k];
    case INTEGER:
        return ((const fmi2Integer *)values)[k];
    case BOOLEAN:
        return ((const fmi2Boolean *)values)[k] != fmi2False;
    case STRING:
        break;
    }
    return 0.0;
}

/* All values, or none where one of them is refused. */
static fmi2Status set_values(fmi2Component component, const char *function, const fmi2ValueReference references[],
                             size_t count, VariableType type, const void *values)
{
    Instance *const instance = begin_call(component, function);
    if (instance == NULL || !writable(instance, references, count, type, values))
        return fmi2Error;
    for (size_t k = 0; k < count; k++) {
        const char *const text = type == STRING ? ((const fmi2String *)values)[k] : NULL;
        if (!settable(instance, references[k], value_of(type, values, k), text))
            return fmi2Error;
    }
    for (size_t k = 0; k < count; k++)
        instance->unit.values[references[k]] = value_of(type, values, k);
    instance->stale = true;
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[])
{
    Instance *const instance = component;
    if (instance != NULL && instance->now.phase != TERMINATED && values != NULL &&
        is_run(instance->description, references, count, UCHAR_MAX, REAL | INPUT << CAUSALITY_SHIFT) &&
        within_bounds(instance->description->variables + references[0], values, count)) {
        memcpy(instance->unit.values + references[0], values, count * sizeof *values);
        instance->stale = true;
        return fmi2OK;
    }
    return set_values(component, "fmi2SetReal", references, count, REAL, values);
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          const fmi2Integer values[])
{
    return set_values(component, "fmi2SetInteger", references, count, INTEGER, values);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          const fmi2Boolean values[])
{
    return set_values(component, "fmi2SetBoolean", references, count, BOOLEAN, values);
}

/* All strings of a unit are constants: none is set. */
fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference references[], size_t count,
                         const fmi2String values[])
{
    return set_values(component, "fmi2SetString", references, count, STRING, values);
}
