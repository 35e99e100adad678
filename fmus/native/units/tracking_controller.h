/* The tables of TrackingController. */

#ifndef TRACKING_CONTROLLER_H
#define TRACKING_CONTROLLER_H

#include "unit.h"

typedef struct {
    size_t states;         /* estimated: the reduced states and, offset-free, a strain offset of each gauge */
    size_t reduced_states; /* those that have a reference */
    size_t voltages;
    size_t points;
    size_t gauges;
    double sample_time; /* s */
    double widening;    /* V that a limit in force widens by in a sample */
    /* value references, of an array its first */
    unsigned y_pm;
    unsigned u_ff;
    unsigned x_ref;
    unsigned u;
    unsigned y_est;
    unsigned saturated;
    unsigned saturation_share;
    unsigned x_est; /* the offsets follow */
    unsigned feedback;
    unsigned integral_gain;
    unsigned voltage_limit;
    unsigned voltage_min;
    unsigned voltage_max;
    unsigned strain_limit;
    unsigned rejected_limit;
    unsigned rejected_samples;
    /* in panels, see linear_algebra.h */
    const double *filter;         /* [A_d - L H_pm, B_d - L D_pm, L] (states, states + voltages + gauges) */
    const double *regulator;      /* [K, 0; G_0^+ H_pi, G_0^+ D_pi] (2 voltages, states + voltages) */
    const double *estimates;      /* [H_pi, D_pi] (points, states + voltages) */
    const double *strains;        /* [H_pm, D_pm] (gauges, states + voltages) */
    const double *integral_range; /* (voltages, voltages), no panels: projection onto the range of G_0^+ */
} TrackingControllerData;

SHARED const UnitHooks tracking_controller_hooks;

#endif
