/* Modal form of x' = A x + B v, y = C x: x = V z with z' = Lambda z + V^-1 B v, exact for inputs v that are held or
   grow linearly over a step. A step costs states x (inputs + outputs) products, a new length of step one complex
   exponential for each pair of states. The caller owns all memory.

   Coordinates z stand in blocks of 8, those of four pairs: the first of each, then the second of each. A pair belongs
   to two complex eigenvalues s +- i w, with Lambda = [s, w; -w, s], or to two real ones. Padded with zeros to whole
   blocks, z has `slots` entries. */

#ifndef MODAL_H
#define MODAL_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

#define MODAL_LANES 4     /* pairs of a block */
#define MODAL_BLOCK 8     /* their coordinates */
#define MODAL_HOLD_ROWS 6 /* of a block in `hold` */

/* Sizes, and positions in memory. */
typedef struct {
    size_t states; /* even */
    size_t held;   /* inputs that count at every step */
    size_t rare;   /* inputs behind them, which cost nothing while all of them are 0 */
    size_t outputs;
    size_t slots;
    double *hold;        /* (slots / 8, 6, 8): of the present length of step, see modal.c */
    double *held_inputs; /* V^-1 B in blocks: (slots / 8, held, 8) */
    double *rare_inputs; /* (slots / 8, rare, 8) */
    double *output_rows; /* C V (outputs, slots), row by row */
    double *vectors;     /* V (states, slots), row by row */
    double *real;        /* (slots,) real part of the eigenvalue of each slot */
    double *imaginary;   /* (slots,) its imaginary part, >= 0 */
    double *inverse;     /* (2, slots) real and imaginary part of its inverse, 0 where there is none */
    double *facts;       /* (2,) number of complex pairs, which come first; largest real part, at least 0 */
} Modal;

/* The slot of a pair's first or second coordinate. */
INTERNAL_INLINE size_t modal_slot(size_t pair, size_t member)
{
    return pair / MODAL_LANES * MODAL_BLOCK + member * MODAL_LANES + pair % MODAL_LANES;
}

/* Doubles of memory that a form takes. */
INTERNAL size_t modal_size(size_t states, size_t held, size_t rare, size_t outputs);
/* A form with its data in `memory`. */
INTERNAL Modal modal_in(double *memory, size_t states, size_t held, size_t rare, size_t outputs);

/* Sets the length of step, s, and whether inputs may grow in it; false where the result is beyond the range of doubles.
 */
INTERNAL bool modal_prepare(const Modal *modal, double step, bool grows);
/* z after the step that was set, in place of z before it; inputs v (held + rare,) at its start, which grow by `growth`
   (held + rare,) until its end, NULL where none does. */
INTERNAL void modal_step(const Modal *modal, const double *v, const double *growth, double *z);
/* y = C x (outputs,) */
INTERNAL void modal_outputs(const Modal *modal, const double *z, double *y);
/* x = V z (states,) */
INTERNAL void modal_state(const Modal *modal, const double *z, double *x);

#endif
