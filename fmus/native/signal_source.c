/* SignalSource: outputs that are functions of time alone.

   A time counts as reached from EARLY before on, so that rounding cannot shift an edge by a step; piecewise constant
   signals are continuous from the right. */

#include "signal_source.h"

#include <math.h>
#include <string.h>

#include "philox.h"

#define EARLY 1e-9  /* s */

static const double pi = 0x1.921fb54442d18p+1;

size_t unit_state_size(void)
{
    return 0;
}

size_t unit_workspace_size(void)
{
    return 0;
}

/* Hosts that add up steps drift from the whole multiple that they mean: the sample is taken there. */
static double sample_time(double time)
{
    const double whole = floor(time / unit_step_size + 0.5) * unit_step_size;
    return fabs(time - whole) <= 1e-6 * unit_step_size ? whole : time;
}

/* Number of ascending times that are reached. */
static size_t reached(const double *times, size_t count, double time)
{
    size_t low = 0, high = count;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (times[middle] <= time)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Half a sine whose integral is the impulse. */
static double pulse(const double *values, const source_signal *signal, double time)
{
    const double duration = values[signal->duration];
    const double phase = (time - values[signal->time]) / duration;
    if (!(time + EARLY >= values[signal->time] && phase < 1))
        return 0.0;
    return pi * values[signal->value] / (2 * duration) * sin(pi * phase);
}

/* A sine whose frequency runs from one value to another. */
static double chirp(const double *values, const source_signal *signal, double time)
{
    const double duration = values[signal->duration], tau = time - values[signal->time];
    const double first = values[signal->first], last = values[signal->last];
    if (!(tau + EARLY >= 0 && tau + EARLY < duration))
        return 0.0;
    const double share = tau / duration;
    double cycles = duration * (first * share + (last - first) * (share * share) / 2);
    if (signal->kind == LOGARITHMIC_CHIRP && last / first != 1.0)
        cycles = duration * first * expm1(share * log(last / first)) / log(last / first);
    return sin(2 * pi * cycles);
}

/* Level `number` of element k within -1 ... 1. */
static double level(const source_signal *signal, uint64_t number, size_t k)
{
    if (signal->kind == LEVELS) {
        uint64_t words[4];
        philox(number / 4 + 1, signal->seed, k, words);
        return (double)(words[number % 4] >> 11) * 0x1p-52 - 1.0;
    }
    const uint64_t place = (number + signal->begin + k * signal->rows / signal->width) % signal->rows;
    return (source_bits[signal->data + place / 8] >> place % 8 & 1) != 0 ? 1.0 : -1.0;
}

/* Levels that each hold for a while. */
static double pseudo_random(const double *values, const source_signal *signal, double time, size_t k)
{
    const double tau = time - values[signal->time] + EARLY;
    if (!(tau >= 0 && (signal->duration == 0 || tau < values[signal->duration])))
        return 0.0;
    return level(signal, (uint64_t)floor(tau / values[signal->first]), k) * values[signal->value + k];
}

/* Column k of a table, its rows held or joined by lines. */
static double table(const source_signal *signal, double time, size_t k)
{
    const double *const times = source_numbers + signal->data, *const column = times + signal->rows + k;
    const bool joined = signal->kind == JOINED_TABLE;
    const size_t above = reached(times, signal->rows, joined ? time : time + EARLY);
    const size_t row = above > 0 ? above - 1 : 0;
    const double here = column[row * signal->width];
    if (!joined || above == 0 || above == signal->rows)
        return here;
    return (column[above * signal->width] - here) / (times[above] - times[row]) * (time - times[row]) + here;
}

/* Value k of a signal. */
static double sample(const double *values, const source_signal *signal, double time, size_t k)
{
    const double *const own = values + signal->value;
    switch (signal->kind) {
    case STEP:
        return time + EARLY >= values[signal->time] ? own[k] : 0.0;
    case PULSE:
        return pulse(values, signal, time);
    case TARGETS: {
        const size_t row = reached(values + signal->time, signal->rows, time + EARLY);
        return row > 0 ? own[(row - 1) * signal->width + k] : 0.0;
    }
    case LINEAR_CHIRP:
    case LOGARITHMIC_CHIRP:
        return chirp(values, signal, time) * own[k];
    case BINARY:
    case LEVELS:
        return pseudo_random(values, signal, time, k);
    case HELD_TABLE:
    case JOINED_TABLE:
        return table(signal, time, k);
    default:
        return own[k];
    }
}

static void put_out(unit *unit, double time)
{
    const double at = sample_time(time);
    for (size_t s = 0; s < source_count; s++) {
        const source_signal *const signal = &source_signals[s];
        for (size_t k = 0; k < signal->outputs; k++)
            unit->values[signal->output + k] = sample(unit->values, signal, at, signal->width > 1 ? k : 0);
    }
}

static bool positive(unit *unit, unsigned reference)
{
    return reference == 0 || unit->values[reference] > 0.0 ||
           unit_refuse(unit, "%s must be finite and > 0, got %r", unit_variables[reference].name,
                       unit->values[reference]);
}

/* Are the parameters those of a signal? */
static bool sound(unit *unit, const source_signal *signal)
{
    if (!positive(unit, signal->duration) || (signal->kind != LINEAR_CHIRP && !positive(unit, signal->first)) ||
        (signal->kind == LOGARITHMIC_CHIRP && !positive(unit, signal->last)))
        return false;
    const double *const times = unit->values + signal->time;
    for (unsigned k = 1; signal->kind == TARGETS && k < signal->rows; k++)
        if (!(times[k] > times[k - 1]))
            return unit_refuse(unit, "%s must be > %r, the time before, got %r", unit_variables[signal->time + k].name,
                               times[k - 1], times[k]);
    return true;
}

bool unit_initialise(unit *unit)
{
    for (size_t s = 0; s < source_count; s++)
        if (!sound(unit, &source_signals[s]))
            return false;
    put_out(unit, unit->values[0]);
    return true;
}

/* Outputs after a step are those of its end. */
bool unit_advance(unit *unit, double time, double step)
{
    put_out(unit, time + step);
    return true;
}

bool unit_prepare(unit *unit, double step)
{
    (void)unit;
    (void)step;
    return true;
}

bool unit_restore(unit *unit)
{
    (void)unit;
    return true;
}

void unit_complete(unit *unit)
{
    (void)unit;
}
