/* SignalSource: outputs that are functions of time alone.

   A time counts as reached from EARLY before on, so that rounding cannot shift an edge by a step; piecewise constant
   signals are continuous from the right. */

#include "signal_source.h"

#include <math.h>
#include <string.h>

#include "philox.h"

#define EARLY 1e-9         /* s */
#define MOST_LEVELS 0x1p53 /* beyond, they cannot be counted */
#define PI 0x1.921fb54442d18p+1

/* The host's time for `time` s since the start: the multiple of the step that it means where it is near one. */
static double sample_time(const UnitInstance *unit, double time)
{
    const double step = unit->step_size;
    const double host_time = unit->start + time;
    const double whole = floor(host_time / step + 0.5) * step;
    return fabs(host_time - whole) <= clock_tolerance(unit, time, step) ? whole : host_time;
}

/* Number of ascending times that are reached. */
static size_t reached(const double *times, size_t count, double time)
{
    size_t low = 0;
    size_t high = count;
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
static double pulse_value(const double *values, const SourceSignal *signal, double time)
{
    const double duration = values[signal->duration];
    const double phase = (time - values[signal->time]) / duration;
    if (!(time + EARLY >= values[signal->time] && phase < 1))
        return 0.0;
    return PI * values[signal->value] / (2 * duration) * sin(PI * phase);
}

/* A sine whose frequency runs from one value to another. */
static double chirp_value(const double *values, const SourceSignal *signal, double time)
{
    const double duration = values[signal->duration];
    const double tau = time - values[signal->time];
    const double first = values[signal->first];
    const double last = values[signal->last];
    if (!(tau + EARLY >= 0 && tau + EARLY < duration))
        return 0.0;
    const double share = tau / duration;
    double cycles = duration * (first * share + (last - first) * (share * share) / 2);
    if (signal->kind == LOGARITHMIC_CHIRP && last / first != 1.0)
        cycles = duration * first * expm1(share * log(last / first)) / log(last / first);
    return sin(2 * PI * cycles);
}

/* Level `number` of element k within -1 ... 1. */
static double level_value(const SignalSourceData *source, const SourceSignal *signal, uint64_t number, size_t k)
{
    if (signal->kind == LEVELS) {
        uint64_t words[4];
        philox(number / 4 + 1, signal->seed, k, words);
        return (double)(words[number % 4] >> 11) * 0x1p-52 - 1.0;
    }
    const uint64_t index = (number + signal->begin + k * signal->rows / signal->width) % signal->rows;
    return (source->bits[signal->data + index / 8] >> index % 8 & 1) != 0 ? 1.0 : -1.0;
}

/* Levels that each hold for a while. */
static double pseudo_random(const UnitInstance *unit, const SourceSignal *signal, double time, size_t k)
{
    const double *const values = unit->values;
    const double tau = time - values[signal->time] + EARLY;
    if (!(tau >= 0 && (signal->duration == 0 || tau < values[signal->duration])))
        return 0.0;
    const uint64_t number = (uint64_t)fmin(floor(tau / values[signal->first]), MOST_LEVELS);
    return level_value(unit->data, signal, number, k) * values[signal->value + k];
}

/* Column k of a table, its rows held or joined by lines. */
static double table_value(const SignalSourceData *source, const SourceSignal *signal, double time, size_t k)
{
    const double *const times = source->numbers + signal->data;
    const double *const column = times + signal->rows + k;
    const bool joined = signal->kind == JOINED_TABLE;
    const size_t above = reached(times, signal->rows, joined ? time : time + EARLY);
    const size_t row = above > 0 ? above - 1 : 0;
    const double here = column[row * signal->width];
    if (!joined || above == 0 || above == signal->rows)
        return here;
    return (column[above * signal->width] - here) / (times[above] - times[row]) * (time - times[row]) + here;
}

/* Value k of a signal. */
static double sample(const UnitInstance *unit, const SourceSignal *signal, double time, size_t k)
{
    const double *const values = unit->values;
    const double *const own = values + signal->value;
    switch (signal->kind) {
    case STEP:
        return time + EARLY >= values[signal->time] ? own[k] : 0.0;
    case PULSE:
        return pulse_value(values, signal, time);
    case TARGETS: {
        const size_t row = reached(values + signal->time, signal->rows, time + EARLY);
        return row > 0 ? own[(row - 1) * signal->width + k] : 0.0;
    }
    case LINEAR_CHIRP:
    case LOGARITHMIC_CHIRP:
        return chirp_value(values, signal, time) * own[k];
    case BINARY:
    case LEVELS:
        return pseudo_random(unit, signal, time, k);
    case HELD_TABLE:
    case JOINED_TABLE:
        return table_value(unit->data, signal, time, k);
    default:
        return own[k];
    }
}

static void write_signals(UnitInstance *unit, double time)
{
    const SignalSourceData *const source = unit->data;
    const double at = sample_time(unit, time);
    for (size_t s = 0; s < source->signal_count; s++) {
        const SourceSignal *const signal = &source->signals[s];
        for (size_t k = 0; k < signal->outputs; k++)
            unit->values[signal->output + k] = sample(unit, signal, at, signal->width > 1 ? k : 0);
    }
}

static bool check_positive(UnitInstance *unit, unsigned reference)
{
    return reference == 0 || unit->values[reference] > 0.0 ||
           unit_refuse(unit, "%s must be finite and > 0, got %r", unit->variables[reference].name,
                       unit->values[reference]);
}

/* Has a pulse a finite height, a chirp a finite number of cycles? */
static bool check_size(UnitInstance *unit, const SourceSignal *signal)
{
    const double *const values = unit->values;
    const double duration = values[signal->duration];
    if (signal->kind == PULSE && !isfinite(PI * values[signal->value] / (2 * duration)))
        return unit_refuse(unit, "%s must give a finite height over the duration %r, got %r",
                           unit->variables[signal->value].name, duration, values[signal->value]);
    if (signal->kind != LINEAR_CHIRP && signal->kind != LOGARITHMIC_CHIRP)
        return true;
    const unsigned faster = values[signal->first] > values[signal->last] ? signal->first : signal->last;
    return isfinite(2 * PI * duration * values[faster]) ||
           unit_refuse(unit, "%s must give a finite number of cycles over the duration %r, got %r",
                       unit->variables[faster].name, duration, values[faster]);
}

/* Are the parameters those of a signal? */
static bool check_signal(UnitInstance *unit, const SourceSignal *signal)
{
    if (!check_positive(unit, signal->duration))
        return false;
    if (signal->kind != LINEAR_CHIRP && !check_positive(unit, signal->first))
        return false;
    if (signal->kind == LOGARITHMIC_CHIRP && !check_positive(unit, signal->last))
        return false;
    if (!check_size(unit, signal))
        return false;
    const double *const times = unit->values + signal->time;
    for (unsigned k = 1; signal->kind == TARGETS && k < signal->rows; k++)
        if (!(times[k] > times[k - 1]))
            return unit_refuse(unit, "%s must be > %r, the time before, got %r", unit->variables[signal->time + k].name,
                               times[k - 1], times[k]);
    return true;
}

static bool signal_source_initialise(UnitInstance *unit)
{
    const SignalSourceData *const source = unit->data;
    for (size_t s = 0; s < source->signal_count; s++)
        if (!check_signal(unit, &source->signals[s]))
            return false;
    write_signals(unit, 0.0);
    return true;
}

/* Outputs after a step are those of its end. */
static bool signal_source_advance(UnitInstance *unit, double time, double step)
{
    write_signals(unit, time + step);
    return true;
}

SHARED_DATA const UnitHooks signal_source_hooks = {
    .initialise = signal_source_initialise,
    .advance = signal_source_advance,
};
