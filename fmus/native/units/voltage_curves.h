/* The voltages that the planner looks at, over transitions of either kind. */

#ifndef VOLTAGE_CURVES_H
#define VOLTAGE_CURVES_H

#include "flatness_feedforward.h"

#define LOOKS 16 /* times looked at together */

/* A transition: D_u(d/dt) Theta between two of the tabulated curves, which serves every input and target, since D_u is
   scalar; or a spline of all voltages. */
typedef struct {
    const double *shorter;
    const double *longer;
    double share;         /* of the longer */
    size_t index;         /* interval of the grid that was read last */
    double start;         /* s */
    double rate;          /* 1/s, reciprocal of the duration */
    const double *spline; /* NULL where there is none */
} VoltageCurve;

/* The curves of a motion, of `count` transitions, for times from `time` (s) on. */
INTERNAL void curves_of(const FlatnessFeedforwardData *data, const Motion *motion, double time, VoltageCurve *curves);
/* Planned voltages u (count, voltages) at up to LOOKS ascending `times` (count,), s. Each call goes on from the times
   of the one before; where times are earlier, curves_of begins anew. */
INTERNAL void voltages_at(const FlatnessFeedforwardData *data, const Motion *motion, VoltageCurve *curves, size_t count,
                          const double *times, double *u);

#endif
