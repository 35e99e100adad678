/* x' = A x + B v, y = C x in steps that are exact for inputs v which are held or grow linearly: in modal form or, where
   eigenvalues are too sensitive for it, by the matrix exponential. The caller owns all memory. */

#ifndef LINEAR_SYSTEM_H
#define LINEAR_SYSTEM_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"
#include "modal.h"

/* Coordinates z (slots,): those of the modal form, or x and zeros. */
typedef struct {
    size_t states;
    size_t inputs;
    size_t outputs;
    size_t slots;
    double *facts; /* (3,) is it dense; length of the step that is prepared, s, 0 for none; may inputs grow in it */
    double *A;     /* (states, states); this and the next three of a dense system only */
    double *B;     /* (states, inputs) */
    double *transition; /* panels [A_d, B_d] (states, states + inputs), then those of the ramp (states, inputs) */
    double *C;          /* panels (outputs, states) */
    Modal modal;        /* of a system that is not dense */
    double *scratch;
} LinearSystem;

/* Doubles that a system takes, and those that it works in. Numbers as in modal.h. */
INTERNAL size_t linear_system_size(size_t states, size_t held, size_t rare, size_t outputs);
INTERNAL size_t linear_system_scratch_size(size_t states, size_t held, size_t rare);
/* A system with its data in `memory`. */
INTERNAL LinearSystem linear_system_in(double *memory, double *scratch, size_t states, size_t held, size_t rare,
                                       size_t outputs);

/* Takes A (states, states), finite, `blocks` (states,) as in modal_build.h, B (states, held + rare) and C (outputs,
   states), which lie outside the scratch memory. */
INTERNAL void linear_system_build(const LinearSystem *system, const double *A, const double *blocks, const double *B,
                                  const double *C);
/* z (slots, columns) of X (states, columns) outside the scratch memory, which is as linear_system_build left it. */
INTERNAL void linear_system_coordinates(const LinearSystem *system, size_t columns, const double *X, double *z);

/* Computes what a step of this length (s) takes, of inputs that are held or, where one `grows`, of all; nothing where
   the last one took the same. False where that is beyond the range of doubles. */
INTERNAL bool linear_system_prepare(const LinearSystem *system, double step, bool grows);
/* z after a step of the length that is prepared, in place of z before it; `growth` as in modal.h. */
INTERNAL void linear_system_step(const LinearSystem *system, const double *v, const double *growth, double *z);
/* y = C x (outputs,) */
INTERNAL void linear_system_outputs(const LinearSystem *system, const double *z, double *y);
/* x (states,) */
INTERNAL void linear_system_state(const LinearSystem *system, const double *z, double *x);

#endif
