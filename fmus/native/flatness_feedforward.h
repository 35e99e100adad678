/* The generated tables of FlatnessFeedforward. */

#ifndef FLATNESS_FEEDFORWARD_H
#define FLATNESS_FEEDFORWARD_H

#include "unit.h"

#define feedforward fmi2FullName(feedforward)
#define input_series fmi2FullName(input_series)
#define state_series fmi2FullName(state_series)
#define static_inverse fmi2FullName(static_inverse)
#define reference_outputs fmi2FullName(reference_outputs)
#define transition_table fmi2FullName(transition_table)
#define shape_times fmi2FullName(shape_times)
#define shape_places fmi2FullName(shape_places)
#define shape_values fmi2FullName(shape_values)

typedef struct {
    size_t voltages, states, points;
    size_t degree;              /* highest derivative of the flat output */
    double exponent, norm;      /* of the transition, see transition.h */
    size_t nodes;               /* intervals of transition_table */
    size_t shapes, intervals;   /* rows of shape_values, intervals of a row */
    /* value references, of an array its first */
    unsigned y_target, u_ff, x_ref, y_ref, moving, target_refused, planned_time, planned_peak, transition_time,
        voltage_limit, preview;
} feedforward_table;

SHARED const feedforward_table feedforward;
SHARED const double input_series[];       /* (degree + 1,): u = sum_i c_i xi^(i) */
SHARED const double state_series[] ALIGNED;       /* panels (states, degree * voltages): x = sum_i X_i xi^(i) */
SHARED const double static_inverse[] ALIGNED;     /* panels (voltages, points), V/m */
SHARED const double reference_outputs[] ALIGNED;  /* panels (points, states + voltages): [H_pi, D_pi] */
SHARED const double transition_table[];   /* (nodes + 1,) */
SHARED const double shape_times[];        /* (shapes,), s, ascending */
SHARED const double shape_places[];       /* (intervals + 1,), from 0 to 1 */
SHARED const double shape_values[];       /* (shapes, intervals + 1): D_u(d/dt) Theta there */

#endif
