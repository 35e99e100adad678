/* Bare loops of the units' arithmetic; the caller owns all memory. Matrices in panels, see linear_algebra.h. */
#ifndef FLEXBEAMS_BENCH_H
#define FLEXBEAMS_BENCH_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef struct {
    size_t states, inputs, shown;    /* inputs: voltages, then forces; shown: points, then gauges */
    const double *transition;        /* [A_d B_d] (states, states + inputs) */
    const double *outputs;           /* (shown, states / 2) */
    double *x, *driven, *held, *y;   /* (states,), (states + inputs,), (inputs,), (shown,) */
} bare_plant;

typedef struct {
    size_t states, voltages, gauges, points;
    double integral_gain, limit;     /* a sample, V */
    const double *filter;            /* (states, states + voltages + gauges) */
    const double *regulator;         /* (2 voltages, states + voltages) */
    const double *estimates;         /* (points, states + voltages) */
    double *x_est, *u, *integral, *y_est;
    double *scratch;                 /* (states + 3 voltages + gauges,) */
} bare_controller;

/* Transitions known from the start, in the order in which they begin and end. */
typedef struct {
    size_t count;
    const int64_t *begins;           /* (count,) number of the step that each begins with */
    const double *starts, *durations;  /* (count,), s */
    const double *steps;             /* (count, voltages) */
    double preview;                  /* s */
    size_t begun, ended;
    double *offset, *u_ff, *x_ref, *y_ref;
    double *scratch;                 /* (bare_feedforward_scratch(),) */
} bare_feedforward;

/* `count` steps of one unit; a row of inputs a step: (inputs,), and of the controller u_ff, x_ref and y_pm. */
EXPORTED void bare_plant_loop(bare_plant *p, size_t count, const double *rows);
EXPORTED void bare_controller_loop(bare_controller *c, size_t count, const double *rows);
EXPORTED void bare_feedforward_loop(bare_feedforward *f, int64_t first, size_t count, double step);
EXPORTED size_t bare_feedforward_scratch(void);

/* `count` steps of the closed loop from step 0, Jacobi coupling. */
EXPORTED void bare_loop(bare_plant *p, bare_controller *c, bare_feedforward *f, size_t count, double step);

#endif
