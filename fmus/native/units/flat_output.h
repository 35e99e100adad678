/* Voltages and states that follow from the flat output (31)-(36), of transitions that add up. */

#ifndef FLAT_OUTPUT_H
#define FLAT_OUTPUT_H

#include "motion.h"
#include "transition.h"

/* Coefficients c_i of D_u and D_l,i of D_u without the factor of mode l occur as ratios only: c_i itself leaves the
   range of doubles. Complex numbers: real parts of all modes before the imaginary ones. */
typedef struct {
    size_t voltages;
    size_t states;
    size_t degree;             /* highest derivative of the flat output */
    size_t modes;              /* real eigenvalues and pairs */
    const double *ratios;      /* (degree,): (i + 1) c_(i+1) / c_i, s */
    const double *mode_series; /* panels (2 modes, degree): D_l,i / c_i */
    const double *mode_inputs; /* panels (2 modes, voltages): amplitudes for a voltage at rest */
    const double *mode_states; /* panels (states, 2 modes): state for amplitudes */
    Transition transition;
} FlatOutput;

/* Doubles of the scratch of evaluate_flat_output. */
INTERNAL size_t flat_output_scratch(const FlatOutput *flat);

/* u (voltages,) and x (states,) at `time` (s): the flat output xi_j(t) = offset_j + sum_k changes_kj Theta((t -
   starts_k) / durations_k). */
INTERNAL void evaluate_flat_output(const FlatOutput *flat, const Motion *motion, double time, double *u, double *x,
                                   double *scratch);

#endif
