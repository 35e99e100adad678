/* Bare loops of the units' arithmetic; the caller owns all memory. Matrices in panels, see linear_algebra.h. */
#ifndef FLEXBEAMS_BENCH_H
#define FLEXBEAMS_BENCH_H

#include <stddef.h>
#include <stdint.h>

#include "fmi2FunctionTypes.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef struct {
    size_t states;
    size_t inputs;            /* voltages, then forces */
    size_t output_count;      /* points, then gauges */
    const double *transition; /* [A_d B_d] (states, states + inputs) */
    const double *outputs;    /* (output_count, states / 2) */
    double *x;                /* (states,) */
    double *driven;           /* (states + inputs,) */
    double *held;             /* (inputs,) */
    double *y;                /* (output_count,) */
} BarePlant;

typedef struct {
    size_t states;
    size_t voltages;
    size_t gauges;
    size_t points;
    double integral_gain;    /* a sample */
    double limit;            /* V */
    const double *filter;    /* (states, states + voltages + gauges) */
    const double *regulator; /* (2 voltages, states + voltages) */
    const double *estimates; /* (points, states + voltages) */
    double *x_est;           /* (states,) */
    double *u;               /* (voltages,) */
    double *integral;        /* (voltages,) */
    double *y_est;           /* (points,) */
    double *scratch;         /* (states + 3 voltages + gauges,) */
} BareController;

/* Transitions known from the start, in the order in which they begin and end. */
typedef struct {
    size_t count;
    const int64_t *begins; /* (count,) number of the step that each begins with */
    double *starts;        /* (count,), s */
    double *durations;     /* (count,), s */
    double *changes;       /* (count, voltages) */
    double preview;        /* s */
    size_t begun;
    size_t ended;
    double *offset;  /* (voltages,) */
    double *u_ff;    /* (voltages,) */
    double *x_ref;   /* (states,) */
    double *y_ref;   /* (points,) */
    double *scratch; /* (bare_feedforward_scratch(),) */
} BareFeedforward;

/* `count` steps of one unit; a row of inputs a step: (inputs,), and of the controller u_ff, x_ref and y_pm. */
EXPORTED void bare_plant_loop(BarePlant *p, size_t count, const double *rows);
EXPORTED void bare_controller_loop(BareController *c, size_t count, const double *rows);
EXPORTED void bare_feedforward_loop(BareFeedforward *f, int64_t first, size_t count, double step);
EXPORTED size_t bare_feedforward_scratch(void);

/* `count` steps of a component from `time`, each of its own length (s); how many were done. */
EXPORTED size_t step_lengths(fmi2DoStepTYPE *do_step, fmi2Component component, double time, size_t count,
                             const double *lengths);

/* `count` steps of the closed loop from step 0, Jacobi coupling. */
EXPORTED void bare_loop(BarePlant *p, BareController *c, BareFeedforward *f, size_t count, double step);

#endif
