#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200809L
#endif
#include "stepper.h"

#include <string.h>
#include <time.h>

#if defined(_WIN32)
#include <windows.h>

double pace_clock(void) {
    LARGE_INTEGER count, frequency;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&frequency);
    return (double)count.QuadPart / (double)frequency.QuadPart;
}

static void sleep_until(double due) {
    for (double left = due - pace_clock(); left > 0; left = due - pace_clock())
        if (left > 2e-3) Sleep((DWORD)(1e3 * left) - 1);
}
#else
double pace_clock(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void sleep_until(double due) {
    double left = due - pace_clock();
    while (left > 0) {
        const time_t seconds = (time_t)left;
        struct timespec pause = {seconds, (long)(1e9 * (left - (double)seconds))};
        nanosleep(&pause, NULL);
        left = due - pace_clock();
    }
}
#endif

enum { SET, STEP, GET };
enum { WARNING = 1 };

static int failed(run *r, size_t i, int function, int status) {
    if (status <= WARNING) return 0;
    r->failed_instance = (int64_t)i;
    r->failed_function = function;
    r->failed_status = status;
    return 1;
}

static void gather(const double *signals, const span *spans, size_t n, double *out) {
    for (size_t k = 0; k < n; k++) {
        memcpy(out, signals + spans[k].first, (size_t)spans[k].count * sizeof *out);
        out += spans[k].count;
    }
}

static int write_inputs(run *r, size_t i) {
    instance *unit = &r->instances[i];
    if (unit->n_written == 0) return 0;
    const double *values = r->signals + unit->sources[0].first;
    if (unit->n_sources > 1) {
        gather(r->signals, unit->sources, unit->n_sources, unit->inputs);
        values = unit->inputs;
    }
    return failed(r, i, SET, unit->set_real(unit->component, unit->written, unit->n_written, values));
}

static int read_integers(run *r, size_t i, get_integers get, const unsigned int *references, size_t n, double *out) {
    instance *unit = &r->instances[i];
    if (n == 0) return 0;
    if (failed(r, i, GET, get(unit->component, references, n, unit->scratch))) return 1;
    for (size_t k = 0; k < n; k++) out[k] = unit->scratch[k];
    return 0;
}

static int read_outputs(run *r, size_t i) {
    instance *unit = &r->instances[i];
    double *out = r->signals + unit->first_output;
    if (unit->n_read > 0 && failed(r, i, GET, unit->get_real(unit->component, unit->read, unit->n_read, out)))
        return 1;
    out += unit->n_read;
    return read_integers(r, i, unit->get_integer, unit->integers, unit->n_integers, out)
        || read_integers(r, i, unit->get_boolean, unit->booleans, unit->n_booleans, out + unit->n_integers);
}

static int step_once(run *r, size_t i, double time) {
    return failed(r, i, STEP, r->instances[i].do_step(r->instances[i].component, time, r->step, 1));
}

static int jacobi(run *r, double time) {
    for (size_t i = 0; i < r->n_instances; i++)
        if (write_inputs(r, i)) return 1;
    for (size_t i = 0; i < r->n_instances; i++)
        if (step_once(r, i, time)) return 1;
    for (size_t i = 0; i < r->n_instances; i++)
        if (read_outputs(r, i)) return 1;
    return 0;
}

static int gauss_seidel(run *r, double time) {
    for (size_t i = 0; i < r->n_instances; i++)
        if (write_inputs(r, i) || step_once(r, i, time) || read_outputs(r, i)) return 1;
    return 0;
}

size_t run_block(run *r, int64_t first, size_t count, const double *external, int64_t every, double *rows,
                 const pace *paced) {
    const size_t n_external = r->n_signals - (size_t)r->first_external;
    for (size_t k = 0; k < count; k++) {
        const int64_t number = first + (int64_t)k;
        if (n_external > 0)
            memcpy(r->signals + r->first_external, external + k * n_external, n_external * sizeof *external);
        double *row = rows + (size_t)((number + every - 1) / every) * r->n_recorded;
        gather(r->signals, r->recorded, r->n_spans, row);
        if (paced != NULL) {
            const double due = paced->started + (double)number * paced->seconds_per_step;
            sleep_until(due);
            paced->lateness[k] = pace_clock() - due;
        }
        const double time = (double)number * r->step;
        if (r->gauss_seidel ? gauss_seidel(r, time) : jacobi(r, time)) return k;
    }
    return count;
}

size_t time_block(run *r, int64_t first, size_t count, const double *external, double *seconds) {
    const size_t n_external = r->n_signals - (size_t)r->first_external;
    for (size_t k = 0; k < count; k++) {
        const double begin = pace_clock();
        if (run_block(r, first + (int64_t)k, 1, external + k * n_external, 1, seconds, NULL) < 1) return k;
        seconds[k] = pace_clock() - begin;
    }
    return count;
}
