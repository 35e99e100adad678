/* Integral action at the limits of the voltages. */

#ifndef WINDUP_H
#define WINDUP_H

#include <stddef.h>

#include "internal.h"
#include "voltage_limits.h"

/* The growth of the integral without what drives a voltage further into its limit: the nearest within the range of
   G_0^+ that leaves the integrals of these voltages as they are. What left that range no deviation would ever take
   back. The first voltage that winds up is held, then the first of those that still or now do. integral_range
   (voltages, voltages) is the projection onto the range of G_0^+, `scratch` (voltages, 1 + voltages). */
INTERNAL void hold_windup(size_t voltages, const double *integral_range, const double *commanded, VoltageRange limits,
                          double *growth, double *scratch);

#endif
