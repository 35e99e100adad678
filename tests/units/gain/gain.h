/* The tables of Gain. */

#ifndef GAIN_H
#define GAIN_H

#include "unit.h"

typedef struct {
    size_t width;
    unsigned u; /* value references, of an array its first */
    unsigned y;
    unsigned gain;
    const double *weights; /* (width,) */
} GainData;

SHARED const UnitHooks gain_hooks;

#endif
