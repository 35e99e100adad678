/* The smooth transition Theta of (37): the integral of exp(-(tau (1 - tau))^-g), normalised to Theta(1) = 1. */

#ifndef TRANSITION_H
#define TRANSITION_H

#include "flatness_feedforward.h"

#define transition_series fmi2FullName(transition_series)

/* Taylor coefficients Theta^(i)(tau) / i!, i = 0 ... degree, at tau within [0, 1]; `scratch` (2 degree,). */
SHARED void transition_series(double tau, size_t degree, double *coefficients, double *scratch);

#endif
