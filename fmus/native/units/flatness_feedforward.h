/* The tables of FlatnessFeedforward. */

#ifndef FLATNESS_FEEDFORWARD_H
#define FLATNESS_FEEDFORWARD_H

#include "flat_output.h"
#include "spline_transition.h"
#include "unit.h"

typedef struct {
    size_t points;
    size_t durations; /* of the tabulated voltage curves */
    size_t intervals; /* of the times at which the planner looks at a transition */
    /* value references, of an array its first */
    unsigned y_target;
    unsigned u_ff;
    unsigned x_ref;
    unsigned y_ref;
    unsigned moving;
    unsigned target_refused;
    unsigned planned_time;
    unsigned planned_peak;
    unsigned transition_time;
    unsigned voltage_limit;
    unsigned voltage_min;
    unsigned voltage_max;
    unsigned preview;
    double sample_time; /* s, of the ticks at which targets are seen and transitions start */
    FlatOutput flat;    /* of splines the numbers of voltages and states only */
    SplineTransitions splines;
    double planned_excess;           /* of the largest limit, by which a plan may exceed a limit */
    double planning_ticks;           /* sample times that a search takes */
    double planning_portion;         /* work of a tick, in transitions looked at, once each */
    double look_work;                /* that each time takes besides, likewise */
    double candidate_work;           /* that each duration takes besides */
    const double *static_inverse;    /* panels (voltages, points), V/m */
    const double *unreachable;       /* (points, points): part of a target that is refused */
    const double *reference_outputs; /* panels (points, states + voltages): [H_pi, D_pi] */
    const double *curve_durations;   /* (durations,), s, ascending */
    const double *curve_grid;        /* (intervals + 1,), from 0 to 1 */
    const double *curve_rates;       /* (intervals,): reciprocals of the grid's widths; NULL of splines */
    const double *curves;            /* (durations, intervals + 1): D_u(d/dt) Theta on the grid; NULL of splines */
} FlatnessFeedforwardData;

SHARED const UnitHooks flatness_feedforward_hooks;

#endif
