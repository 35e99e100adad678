/* Superposed transitions within the voltage limits: how long a new one must take (Remarks 4 and 5).

   A search of its duration is part of a unit's state and goes on in portions, so that no step takes long. */

#ifndef PLANNER_H
#define PLANNER_H

#include "flatness_feedforward.h"
#include "voltage_limits.h"

/* How a target is reached: duration 0 means that it is refused. */
typedef struct {
    double duration;     /* s */
    double peak;         /* largest |u| of the whole motion with this duration, V; refused at rest, at the target */
    bool at_rest;        /* refused for the voltages at the target */
    Violation violation; /* why it is refused, or why it takes longer than asked */
} TransitionPlan;

/* A search. Its transition is in the motion's slot behind the last. */
typedef struct {
    double *numbers;        /* see planner.c */
    VoltageRange tolerated; /* the limits, and where voltages are beyond one at the start, these */
    VoltageRange range;     /* of the duration that is tried, as far as it was looked at */
    double *latest;         /* (2, voltages): voltages at the times looked at last */
    double *rows;           /* scratch: these, and those that follow */
} PlanSearch;

/* Doubles of a search and of its scratch, and the search in `memory`, which is zero at first. */
INTERNAL size_t search_size(const FlatnessFeedforwardData *data);
INTERNAL size_t search_scratch(const FlatnessFeedforwardData *data);
INTERNAL PlanSearch search_in(const FlatnessFeedforwardData *data, double *memory, double *scratch);

/* Begins the search of a transition from `now` by `change` (voltages,), of at least `shortest` s, that keeps the whole
   motion within the limits, or where a voltage is beyond one at `now`, since that was narrowed, no further than it is.
   False, with the plan, where the voltages at the target are beyond them. */
INTERNAL bool begin_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search, double now,
                           const double *change, double shortest, VoltageRange limits, TransitionPlan *plan);
/* Tries the first duration; whether it fits. */
INTERNAL bool first_fits(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search);
/* Goes on by a portion. */
INTERNAL void continue_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search);
/* The plan, after what is left of the search; the transition is then in its slot. */
INTERNAL TransitionPlan conclude_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search);
/* Whether the numbers of a search can be those of one for a motion. */
INTERNAL bool search_is_valid(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search);
/* Rebuilds what the search needs beside its numbers. */
INTERNAL void restore_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search);

#endif
