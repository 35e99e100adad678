/* Limits of the voltages, one pair after the other. */

#ifndef VOLTAGE_LIMITS_H
#define VOLTAGE_LIMITS_H

#include <stddef.h>

#include "ranges.h"

/* The lowest and the highest voltage of each pair, V. */
typedef struct {
    double *lowest;  /* (voltages,) */
    double *highest; /* (voltages,) */
} VoltageRange;

/* The voltage that is furthest beyond a limit. */
typedef struct {
    double excess; /* V; not above 0 where all are within */
    size_t pair;
    double voltage; /* V */
    bool is_below;  /* a lowest voltage */
} Violation;

/* What voltage_limit and each pair's voltage_min and voltage_max leave. */
INTERNAL_INLINE void join_limits(size_t voltages, double limit, const double *minimum, const double *maximum,
                                 VoltageRange limits)
{
    for (size_t k = 0; k < voltages; k++) {
        limits.lowest[k] = larger(minimum[k], -limit);
        limits.highest[k] = smaller(maximum[k], limit);
    }
}

INTERNAL_INLINE Violation furthest_beyond(size_t voltages, VoltageRange u, VoltageRange limits)
{
    Violation worst = {.excess = -HUGE_VAL};
    for (size_t k = 0; k < voltages; k++) {
        const double above = u.highest[k] - limits.highest[k];
        const double below = limits.lowest[k] - u.lowest[k];
        if (above > worst.excess || isnan(above))
            worst = (Violation){.excess = above, .pair = k, .voltage = u.highest[k], .is_below = false};
        if (below > worst.excess || isnan(below))
            worst = (Violation){.excess = below, .pair = k, .voltage = u.lowest[k], .is_below = true};
    }
    return worst;
}

INTERNAL_INLINE double largest_magnitude(size_t voltages, VoltageRange u)
{
    double largest = 0.0;
    for (size_t k = 0; k < voltages; k++)
        largest = larger(larger(fabs(u.lowest[k]), fabs(u.highest[k])), largest);
    return largest;
}

#endif
