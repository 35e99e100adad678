/* The generated tables of TrackingController. */

#ifndef TRACKING_CONTROLLER_H
#define TRACKING_CONTROLLER_H

#include "unit.h"

#define controller fmi2FullName(controller)
#define controller_filter fmi2FullName(controller_filter)
#define controller_regulator fmi2FullName(controller_regulator)
#define controller_estimates fmi2FullName(controller_estimates)

typedef struct {
    size_t states, voltages, points, gauges;
    double sample_time;  /* s */
    /* value references, of an array its first */
    unsigned y_pm, u_ff, x_ref, u, y_est, saturated, x_est, feedback, integral_gain, voltage_limit;
} controller_table;

SHARED const controller_table controller;

/* In panels: see linear_algebra.h. */
SHARED const double controller_filter[] ALIGNED;     /* [A_d - L H_pm, B_d - L D_pm, L] (states, states + voltages + gauges) */
SHARED const double controller_regulator[] ALIGNED;  /* [K, 0; G_0^+ H_pi, G_0^+ D_pi] (2 voltages, states + voltages) */
SHARED const double controller_estimates[] ALIGNED;  /* [H_pi, D_pi] (points, states + voltages) */

#endif
