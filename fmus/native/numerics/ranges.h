/* Limits and maxima that NaN passes through: no value stands for one that is not a number. */

#ifndef RANGES_H
#define RANGES_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

INTERNAL_INLINE double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

INTERNAL_INLINE double larger(double a, double b)
{
    return a > b || isnan(a) ? a : b;
}

INTERNAL_INLINE double smaller(double a, double b)
{
    return a < b || isnan(a) ? a : b;
}

/* Are all values within a range? NaN is not. */
INTERNAL_INLINE bool all_within(size_t n, const double *values, double low, double high)
{
    size_t beyond = 0;
    for (size_t k = 0; k < n; k++)
        beyond += (size_t) !(values[k] >= low && values[k] <= high);
    return beyond == 0;
}

#endif
