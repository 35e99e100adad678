#include "clock.h"

#include <float.h>
#include <math.h>

#define MOST_STEPS 0x1p53 /* beyond, a count stands still */

Clock clock_from(double start, double stop)
{
    return (Clock){.start = start, .stop = stop, .time = start};
}

double clock_elapsed(const Clock *clock)
{
    return clock->base + (clock->lost + clock->count * clock->step);
}

void clock_advance(Clock *clock, double time, double step)
{
    if (step != clock->step) {
        const double added = clock->lost + clock->count * clock->step;
        const double base = clock->base + added;
        clock->lost = added - (base - clock->base); /* exact: base is the larger one, or 0 */
        clock->base = base;
        clock->step = step;
        clock->count = 0.0;
    }
    clock->count += 1.0;
    clock->time = time + step;
}

double clock_resolution(double time)
{
    return 2 * DBL_EPSILON * fabs(time);
}

bool clock_is_valid(const Clock *clock)
{
    const double elapsed = clock_elapsed(clock);
    return isfinite(clock->start) && isfinite(clock->time) && clock->stop > clock->start && clock->step >= 0.0 &&
           clock->count >= 0.0 && clock->count < MOST_STEPS && floor(clock->count) == clock->count &&
           clock->base >= 0.0 && isfinite(elapsed) && elapsed >= 0.0;
}
