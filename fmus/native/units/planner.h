/* Superposed transitions within the voltage limit: how long a new one must take (Remarks 4 and 5). */

#ifndef PLANNER_H
#define PLANNER_H

#include "flatness_feedforward.h"

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
