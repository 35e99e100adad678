/* Targets of a FlatnessFeedforward: what can be reached, and the transitions to them, planned at the unit's ticks. */

#ifndef TARGETS_H
#define TARGETS_H

#include "feedforward_state.h"

/* Part of the target at a point that no voltages reach, m. */
INTERNAL double missed_at(const FlatnessFeedforwardData *feedforward, const double *target, size_t point);
/* The point of interest whose target is furthest from the nearest reachable one; `points` where that is close. */
INTERNAL size_t unreachable_point(const FlatnessFeedforwardData *feedforward, const double *target);
/* The limits of the voltages, behind a change in the scratch. */
INTERNAL VoltageRange limits_of(UnitInstance *unit);

/* For the log: the limit that a voltage is beyond, and the voltage; voltage_limit is one of magnitudes. */
typedef struct {
    const char *name;
    bool is_own; /* of the pair */
    double limit;
    double voltage;
} BrokenLimit;

INTERNAL BrokenLimit broken_limit(const UnitInstance *unit, Violation violation);

/* Is the target another one than the motion leads to? */
INTERNAL bool is_new_target(const UnitInstance *unit);
/* A tick: goes on with a search, ends it, sees a new target. */
INTERNAL void pass_tick(UnitInstance *unit, double tick);

#endif
