/* FMI 2.0: derivatives with respect to time and to other variables. */

#include <math.h>
#include <string.h>

#include "instance.h"
#include "references.h"

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                       const fmi2Integer orders[], const fmi2Real values[])
{
    Instance *const instance = begin_call(component, "fmi2SetRealInputDerivatives");
    if (instance == NULL)
        return fmi2Error;
    const UnitDescription *const unit = instance->description;
    if (!unit->interpolates_inputs)
        return decline(instance, "this unit holds its inputs, canInterpolateInputs is false");
    if (!writable(instance, references, count, REAL, values))
        return fmi2Error;
    if (count > 0 && orders == NULL)
        return decline_null(instance, "order");
    for (size_t k = 0; k < count; k++) {
        const char *const name = unit->variables[references[k]].name;
        if (causality_of(unit, references[k]) != INPUT)
            return decline(instance, "%s must be an input, got the derivative %r", name, values[k]);
        if (orders[k] != 1)
            return decline(instance, "order of the derivative of %s must be 1, got %d", name, orders[k]);
        if (!isfinite(values[k]))
            return decline(instance, "derivative of %s must be finite, got %r", name, values[k]);
    }
    double *const slopes = instance->unit.values + unit->variable_count;
    for (size_t k = 0; k < count; k++) {
        slopes[references[k]] = values[k];
        instance->now.sloped = true;
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                        const fmi2Integer orders[], fmi2Real values[])
{
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    Instance *const instance = begin_call(component, "fmi2GetRealOutputDerivatives");
    if (instance == NULL)
        return fmi2Error;
    return decline(instance, "this unit has none, maxOutputDerivativeOrder is 0");
}

/* May this variable be an unknown of the present mode: is it a Real output? */
static bool is_unknown(Instance *instance, fmi2ValueReference reference)
{
    const UnitDescription *const unit = instance->description;
    const Causality causality = causality_of(unit, reference);
    if (causality == OUTPUT)
        return true;
    decline(instance, "%s is %s, unknowns are outputs", unit->variables[reference].name, name_of_causality(causality));
    return false;
}

/* May this variable be a known: an input, the time or, in initialization mode, a parameter? */
static bool is_known(Instance *instance, fmi2ValueReference reference)
{
    const UnitDescription *const unit = instance->description;
    const Causality causality = causality_of(unit, reference);
    const bool initialising = instance->now.phase == INITIALISING;
    if (causality == INPUT || causality == INDEPENDENT || (causality == PARAMETER && initialising))
        return true;
    decline(instance, "%s is %s, knowns are inputs%s and time", unit->variables[reference].name,
            name_of_causality(causality), initialising ? ", parameters" : "");
    return false;
}

typedef bool ReferenceRule(Instance *instance, fmi2ValueReference reference);

static bool check_all(Instance *instance, const fmi2ValueReference references[], size_t count, const void *values,
                      ReferenceRule *rule)
{
    if (!check_references(instance, references, count, REAL, values))
        return false;
    for (size_t k = 0; k < count; k++)
        if (!rule(instance, references[k]))
            return false;
    return true;
}

/* Changes of all variables for those of the knowns: outputs follow sampled states once they are initialised. */
static void differentiate(Instance *instance, const fmi2ValueReference knowns[], size_t count, const double changes[])
{
    UnitInstance *const unit = &instance->unit;
    memset(unit->changes, 0, instance->description->variable_count * sizeof *unit->changes);
    if (instance->now.phase != INITIALISING)
        return;
    for (size_t k = 0; k < count; k++)
        unit->changes[knowns[k]] += changes[k];
    unit->hooks->differentiate(unit);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknowns[],
                                        size_t unknown_count, const fmi2ValueReference knowns[], size_t known_count,
                                        const fmi2Real known_changes[], fmi2Real unknown_changes[])
{
    Instance *const instance = begin_call(component, "fmi2GetDirectionalDerivative");
    if (instance == NULL)
        return fmi2Error;
    const UnitDescription *const unit = instance->description;
    if (!unit->provides_derivatives)
        return decline(instance, "this unit has none, providesDirectionalDerivative is false");
    if (instance->now.phase == INSTANTIATED)
        return decline(instance, "is for instances in initialization mode and later, this one is just instantiated");
    if (!check_all(instance, unknowns, unknown_count, unknown_changes, is_unknown) ||
        !check_all(instance, knowns, known_count, known_changes, is_known))
        return fmi2Error;
    for (size_t k = 0; k < known_count; k++)
        if (!isfinite(known_changes[k]))
            return decline(instance, "change of %s must be finite, got %r", unit->variables[knowns[k]].name,
                           known_changes[k]);
    if (instance->now.phase == INITIALISING && !try_refresh(instance))
        return fmi2Error;
    differentiate(instance, knowns, known_count, known_changes);
    const double *const changes = instance->unit.changes;
    for (size_t k = 0; k < unknown_count; k++)
        if (!isfinite(changes[unknowns[k]]))
            return decline(instance, "change of %s is beyond the range of doubles", unit->variables[unknowns[k]].name);
    for (size_t k = 0; k < unknown_count; k++)
        unknown_changes[k] = changes[unknowns[k]];
    return fmi2OK;
}
