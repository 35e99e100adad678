/* The clock of an instance: the time since its start, counted in steps.

   A host may multiply its step, add it up, or subtract times. What a step does depends on the time since the start
   and the communication step alone: the rounding of the host's times, which grows with their size, is tolerated and
   left out. */

#ifndef CLOCK_H
#define CLOCK_H

#include <stdbool.h>

#include "internal.h"

typedef struct {
    double start; /* s */
    double stop;  /* s, DBL_MAX where the host gave none */
    double time;  /* s, the end of the last step as the host counts it */
    double base;  /* s since the start when steps of the present size began, with what its rounding lost */
    double lost;
    double step;  /* s, the present size */
    double count; /* steps of that size, a double that is whole */
} Clock;

enum { CLOCK_FIELDS = sizeof(Clock) / sizeof(double) };

INTERNAL Clock clock_from(double start, double stop);
/* Time since the start, s. */
INTERNAL double clock_elapsed(const Clock *clock);
/* A step of `step` s from the host's `time` s is done. */
INTERNAL void clock_advance(Clock *clock, double time, double step);
/* What two times of a host near `time` s must differ by to be two, s. */
INTERNAL double clock_resolution(double time);
/* Can a clock have these values? */
INTERNAL bool clock_is_valid(const Clock *clock);

#endif
