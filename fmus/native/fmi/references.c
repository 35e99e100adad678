#include "references.h"

static const char types[][8] = {[REAL] = "Real", [INTEGER] = "Integer", [BOOLEAN] = "Boolean", [STRING] = "String"};
static const char causalities[][12] = {
    [INDEPENDENT] = "independent", [PARAMETER] = "parameter", [INPUT] = "input", [OUTPUT] = "output", [LOCAL] = "local",
};

VariableType type_of(const UnitDescription *unit, fmi2ValueReference reference)
{
    return unit->kinds[reference] & TYPE_MASK;
}

Causality causality_of(const UnitDescription *unit, fmi2ValueReference reference)
{
    return unit->kinds[reference] >> CAUSALITY_SHIFT & CAUSALITY_MASK;
}

const char *name_of_causality(Causality causality)
{
    return causalities[causality];
}

bool check_references(Instance *instance, const fmi2ValueReference references[], size_t count, VariableType type,
                      const void *values)
{
    if (count > 0 && (references == NULL || values == NULL)) {
        decline_null(instance, references == NULL ? "vr" : "value");
        return false;
    }
    const UnitDescription *const unit = instance->description;
    if (count > unit->variable_count) {
        decline(instance, "nvr must be <= %zu, the number of variables, got %zu", unit->variable_count, count);
        return false;
    }
    for (size_t k = 0; k < count; k++) {
        const fmi2ValueReference reference = references[k];
        if (reference >= unit->variable_count) {
            decline(instance, "value reference must be within 0..%zu, got %zu", unit->variable_count - 1,
                    (size_t)reference);
            return false;
        }
        const VariableType own = type_of(unit, reference);
        if (own != type) {
            decline(instance, "%s is %s, got a call for %s", unit->variables[reference].name, types[own], types[type]);
            return false;
        }
    }
    return true;
}

bool writable(Instance *instance, const fmi2ValueReference references[], size_t count, VariableType type,
              const void *values)
{
    if (instance->now.phase == TERMINATED) {
        decline(instance, "no variable can be set after fmi2Terminate");
        return false;
    }
    return check_references(instance, references, count, type, values);
}
