/* The tables of FlatnessFeedforward. */

#ifndef FLATNESS_FEEDFORWARD_H
#define FLATNESS_FEEDFORWARD_H

#include "flat_output.h"
#include "unit.h"

typedef struct {
    size_t points;
    size_t durations; /* of the tabulated voltage curves */
    size_t intervals; /* of a voltage curve */
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
    FlatOutput flat;
    const double *static_inverse;    /* panels (voltages, points), V/m */
    const double *unreachable;       /* (points, points): part of a target that is refused */
    const double *reference_outputs; /* panels (points, states + voltages): [H_pi, D_pi] */
    const double *curve_durations;   /* (durations,), s, ascending */
    const double *curve_grid;        /* (intervals + 1,), from 0 to 1 */
    const double *curves;            /* (durations, intervals + 1): D_u(d/dt) Theta on the grid */
} FlatnessFeedforwardData;

INTERNAL const UnitHooks flatness_feedforward_hooks;

#endif
