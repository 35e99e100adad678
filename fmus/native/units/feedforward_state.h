/* State and workspace of a FlatnessFeedforward. */

#ifndef FEEDFORWARD_STATE_H
#define FEEDFORWARD_STATE_H

#include "planner.h"

/* Numbers of the state: transitions under way; ticks done; the tick at which the plan of a search takes effect, or
   NO_SEARCH. */
enum { COUNT, TICK, DUE, STATE_NUMBERS };
#define NO_SEARCH (-1.0)

INTERNAL size_t feedforward_state_size(const void *data);
INTERNAL size_t feedforward_workspace_size(const void *data);

/* The target that motion and search lead to (points,); the motion; the search. */
INTERNAL double *handled_target(const UnitInstance *unit);
INTERNAL Motion motion_of(const UnitInstance *unit);
INTERNAL PlanSearch search_of(const UnitInstance *unit);
/* Memory for what a call computes: scratch of an evaluation first. */
INTERNAL double *scratch_of(const UnitInstance *unit);
INTERNAL size_t evaluation_scratch(const FlatnessFeedforwardData *feedforward);

INTERNAL bool has_splines(const FlatnessFeedforwardData *feedforward);
INTERNAL bool is_moving(const UnitInstance *unit, double time);
/* Transitions that have ended, those before them too, go into the offset; the others move up. None does while a search
   looks at them. So the motion is the same whenever it is looked at. */
INTERNAL void retire_transitions(UnitInstance *unit, double time);
/* Whether the contents of a restored state can be those of a saved one: its numbers are used as indices. */
INTERNAL bool is_valid_state(const UnitInstance *unit);

#endif
