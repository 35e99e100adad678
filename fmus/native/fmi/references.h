/* Value references in the arguments of a call. */

#ifndef REFERENCES_H
#define REFERENCES_H

#include "instance.h"

INTERNAL VariableType type_of(const UnitDescription *unit, fmi2ValueReference reference);
INTERNAL Causality causality_of(const UnitDescription *unit, fmi2ValueReference reference);
INTERNAL const char *name_of_causality(Causality causality);

/* Do the arguments of a call name variables of its type? If not, it is declined. */
INTERNAL bool check_references(Instance *instance, const fmi2ValueReference references[], size_t count,
                               VariableType type, const void *values);
/* The same for a call that sets variables. */
INTERNAL bool writable(Instance *instance, const fmi2ValueReference references[], size_t count, VariableType type,
                       const void *values);

#endif
