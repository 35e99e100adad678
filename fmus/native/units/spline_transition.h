/* Transitions as uniform quintic B-splines of all voltages, and the exact state of a reduced model under them.

   A transition has SPANS spans of equal length and SPANS + DEGREE control points (voltages,): the first DEGREE are
   zero, the last DEGREE the change. */

#ifndef SPLINE_TRANSITION_H
#define SPLINE_TRANSITION_H

#include "internal.h"
#include "motion.h"

#define SPANS 45
#define DEGREE 5
#define SPLINE_POINTS (SPANS + DEGREE)

/* Complex numbers: real parts of all modes before the imaginary ones. */
typedef struct {
    size_t voltages;
    size_t states;
    size_t modes;         /* real eigenvalues and pairs */
    size_t durations;     /* of the table; 0 where a unit has none */
    const double *times;  /* (durations,), s, ascending */
    const double *points; /* (durations, voltages, SPANS - DEGREE, voltages): the others, of 1 V more at each pair */
    const double *eigenvalues; /* (2 modes,), 1/s */
    const double *mode_inputs; /* panels (2 modes, voltages): beta of y' = lambda y + beta u */
    const double *mode_states; /* panels (states, 2 modes): state for amplitudes */
} SplineTransitions;

/* Doubles of what a transition under way follows from, in Motion.splines; its control points are the first. */
INTERNAL size_t spline_size(const SplineTransitions *tables);
/* That of a transition of a motion. */
INTERNAL double *spline_of(const SplineTransitions *tables, const Motion *motion, size_t transition);
/* Doubles of the scratch of evaluate_splines. */
INTERNAL size_t spline_scratch(const SplineTransitions *tables);

/* The row of the table with the first duration of at least `shortest` s, or the last one. */
INTERNAL size_t spline_row(const SplineTransitions *tables, double shortest);
/* Prepares the transition by `change` (voltages,) with the duration of a row of the table, in `spline` (spline_size,).
 */
INTERNAL void begin_spline(const SplineTransitions *tables, size_t row, const double *change, double *spline);
/* Adds the voltages at tau within [0, 1] of a transition that was begun to u (voltages,). */
INTERNAL void add_spline_voltages(const SplineTransitions *tables, const double *spline, double tau, double *u);

/* u (voltages,) and x (states,) of a motion at `time` (s). Quick where the time grows from one call to the next. */
INTERNAL void evaluate_splines(const SplineTransitions *tables, const Motion *motion, double time, double *u, double *x,
                               double *scratch);

#endif
