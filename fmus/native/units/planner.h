/* Superposed transitions within the voltage limits: how long a new one must take (Remarks 4 and 5). */

#ifndef PLANNER_H
#define PLANNER_H

#include "flatness_feedforward.h"
#include "voltage_limits.h"

#define PLANNER_SCRATCH 7 /* doubles for each voltage */

/* How a target is reached: duration 0 means that it is refused. */
typedef struct {
    double duration;     /* s */
    double peak;         /* largest |u| of the whole motion with this duration, V; refused at rest, at the target */
    bool at_rest;        /* refused for the voltages at the target */
    Violation violation; /* why it is refused, or why it takes longer than asked */
} TransitionPlan;

/* The shortest transition from `now` of at least `shortest` s that keeps the whole motion within the limits, or where
   a voltage is beyond one already, since that was narrowed, no further than it is. `change` (voltages,) is that of
   the flat output; start, duration and change stand in the motion's next slot afterwards. `scratch`
   (PLANNER_SCRATCH, voltages). */
INTERNAL TransitionPlan plan_transition(const FlatnessFeedforwardData *data, const Motion *motion, double now,
                                        const double *change, double shortest, VoltageRange limits, double *scratch);

#endif
