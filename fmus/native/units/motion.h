/* Transitions under way, each from a start over a duration by a change of the voltages at rest. */

#ifndef MOTION_H
#define MOTION_H

#include <stddef.h>

#define SLOTS 8 /* transitions under way at once */

/* There is room for one more behind the last. */
typedef struct {
    size_t count;
    double *offset;    /* (voltages,), V: at rest, that earlier transitions have reached */
    double *starts;    /* (SLOTS,), s */
    double *durations; /* (SLOTS,), s */
    double *changes;   /* (SLOTS, voltages), V */
    double *splines;   /* of splines, what follows from duration and change, SLOTS times spline_size */
    size_t first;      /* place of the first transition there; after the last place comes the first one */
} Motion;

#endif
