/* Superposed transitions within the voltage limit: how long a new one must take (Remarks 4 and 5). */

#ifndef PLANNER_H
#define PLANNER_H

#include "flatness_feedforward.h"

#define SLOTS 8 /* transitions under way at once */

/* Transitions under way: u_j(t) = offset_j + sum_k changes_kj curve((t - starts_k) / durations_k), V and s.
   There is room for one more behind the last. */
typedef struct {
    size_t count;
    double *offset;    /* (voltages,) */
    double *starts;    /* (SLOTS,) */
    double *durations; /* (SLOTS,) */
    double *changes;   /* (SLOTS, voltages) */
} Motion;

/* How a target is reached: duration 0 means that it is refused. */
typedef struct {
    double duration;     /* s */
    double peak;         /* largest |u| of the whole motion with this duration, V */
    double peak_at_rest; /* largest |u| at the target, V */
} TransitionPlan;

/* The shortest transition from `now` of at least `shortest` s that keeps the whole motion within +-limit (V), or where
   the voltages are beyond it already, since it was lowered, no further than they are. `change` (voltages,) is that of
   the flat output; start, duration and change stand in the motion's next slot afterwards. `scratch` (3 voltages,). */
INTERNAL TransitionPlan plan_transition(const FlatnessFeedforwardData *data, const Motion *motion, double now,
                                        const double *change, double shortest, double limit, double *scratch);

#endif
