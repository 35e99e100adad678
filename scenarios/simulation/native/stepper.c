#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200809L
#endif
#include "stepper.h"

#include <string.h>
#include <time.h>

#if defined(_WIN32)
#include <windows.h>

double pace_clock(void)
{
    LARGE_INTEGER count;
    LARGE_INTEGER frequency;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&frequency);
    return (double)count.QuadPart / (double)frequency.QuadPart;
}

static void sleep_until(double due)
{
    for (double left = due - pace_clock(); left > 0; left = due - pace_clock())
        if (left > 2e-3)
            Sleep((DWORD)(1e3 * left) - 1);
}
#else
double pace_clock(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void sleep_until(double due)
{
    double left = due - pace_clock();
    while (left > 0) {
        const time_t seconds = (time_t)left;
        struct timespec rest = {seconds, (long)(1e9 * (left - (double)seconds))};
        nanosleep(&rest, NULL);
        left = due - pace_clock();
    }
}
#endif

enum { SET, STEP, GET };
enum { WARNING = 1 };

static int failed(CoupledRun *run, size_t i, int function, int status)
{
    if (status <= WARNING)
        return 0;
    run->failed_unit = (int64_t)i;
    run->failed_function = function;
    run->failed_status = status;
    return 1;
}

/* Before each call of a unit's function: log lines are assigned to calls by their number. */
static void *next_call(CoupledRun *run, size_t i)
{
    run->calls++;
    return run->units[i].component;
}

static void gather(const double *signals, const SignalSpan *spans, size_t n, double *out)
{
    for (size_t k = 0; k < n; k++) {
        memcpy(out, signals + spans[k].first, (size_t)spans[k].count * sizeof *out);
        out += spans[k].count;
    }
}

static int write_integers(CoupledRun *run, size_t i, SetIntegers set, const unsigned int *references, size_t n,
                          const double *values)
{
    SteppedUnit *const unit = &run->units[i];
    if (n == 0)
        return 0;
    for (size_t k = 0; k < n; k++)
        unit->scratch[k] = (int)values[k];
    return failed(run, i, SET, set(next_call(run, i), references, n, unit->scratch));
}

static int write_inputs(CoupledRun *run, size_t i)
{
    SteppedUnit *const unit = &run->units[i];
    const TypedReferences *const written = &unit->written;
    if (unit->n_sources == 0)
        return 0;
    const double *values = run->signals + unit->sources[0].first;
    if (unit->n_sources > 1 || unit->n_conversions > 0) {
        gather(run->signals, unit->sources, unit->n_sources, unit->inputs);
        for (size_t k = 0; k < unit->n_conversions; k++) {
            double *const input = &unit->inputs[unit->conversions[k].input];
            *input *= unit->conversions[k].factor; /* two statements: no fused multiply-add */
            *input += unit->conversions[k].offset;
        }
        values = unit->inputs;
    }
    if (written->n_reals > 0 &&
        failed(run, i, SET, unit->set_real(next_call(run, i), written->reals, written->n_reals, values)))
        return 1;
    values += written->n_reals;
    return write_integers(run, i, unit->set_integer, written->integers, written->n_integers, values) ||
           write_integers(run, i, unit->set_boolean, written->booleans, written->n_booleans,
                          values + written->n_integers);
}

static int read_integers(CoupledRun *run, size_t i, GetIntegers get, const unsigned int *references, size_t n,
                         double *out)
{
    SteppedUnit *const unit = &run->units[i];
    if (n == 0)
        return 0;
    if (failed(run, i, GET, get(next_call(run, i), references, n, unit->scratch)))
        return 1;
    for (size_t k = 0; k < n; k++)
        out[k] = unit->scratch[k];
    return 0;
}

static int read_outputs(CoupledRun *run, size_t i)
{
    SteppedUnit *const unit = &run->units[i];
    const TypedReferences *const read = &unit->read;
    double *out = run->signals + unit->first_output;
    if (read->n_reals > 0 && failed(run, i, GET, unit->get_real(next_call(run, i), read->reals, read->n_reals, out)))
        return 1;
    out += read->n_reals;
    return read_integers(run, i, unit->get_integer, read->integers, read->n_integers, out) ||
           read_integers(run, i, unit->get_boolean, read->booleans, read->n_booleans, out + read->n_integers);
}

static int step_once(CoupledRun *run, size_t i, double time)
{
    return failed(run, i, STEP, run->units[i].do_step(next_call(run, i), time, run->step, 1));
}

static int jacobi(CoupledRun *run, double time)
{
    for (size_t i = 0; i < run->n_units; i++)
        if (write_inputs(run, i))
            return 1;
    for (size_t i = 0; i < run->n_units; i++)
        if (step_once(run, i, time))
            return 1;
    for (size_t i = 0; i < run->n_units; i++)
        if (read_outputs(run, i))
            return 1;
    return 0;
}

static int gauss_seidel(CoupledRun *run, double time)
{
    for (size_t i = 0; i < run->n_units; i++)
        if (write_inputs(run, i) || step_once(run, i, time) || read_outputs(run, i))
            return 1;
    return 0;
}

size_t run_block(CoupledRun *run, int64_t first, size_t count, const double *external, int64_t every, double *rows,
                 const Pace *pace)
{
    const size_t n_external = run->n_external;
    for (size_t k = 0; k < count; k++) {
        const int64_t number = first + (int64_t)k;
        if (n_external > 0)
            memcpy(run->signals + run->first_external, external + k * n_external, n_external * sizeof *external);
        double *row = rows + (size_t)((number + every - 1) / every) * run->n_recorded;
        gather(run->signals, run->recorded, run->n_spans, row);
        if (pace != NULL) {
            const double due = pace->started + (double)number * pace->seconds_per_step;
            sleep_until(due);
            pace->lateness[k] = pace_clock() - due;
        }
        run->done = number;
        const double time = run->start_time + (double)number * run->step;
        if (run->gauss_seidel ? gauss_seidel(run, time) : jacobi(run, time))
            return k;
        run->done = number + 1;
    }
    return count;
}

size_t time_block(CoupledRun *run, int64_t first, size_t count, const double *external, double *seconds)
{
    for (size_t k = 0; k < count; k++) {
        const double begin = pace_clock();
        if (run_block(run, first + (int64_t)k, 1, external + k * run->n_external, 1, seconds, NULL) < 1)
            return k;
        seconds[k] = pace_clock() - begin;
    }
    return count;
}
