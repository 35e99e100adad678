/* Brings a linear system into modal form. The caller owns all memory. */

#ifndef MODAL_BUILD_H
#define MODAL_BUILD_H

#include <stddef.h>

#include "internal.h"
#include "modal.h"

#ifndef LARGEST_CONDITION
#define LARGEST_CONDITION 100.0 /* of an eigenvalue, up to which a form is accurate */
#endif

/* Doubles that modal_build works in. */
INTERNAL size_t modal_scratch_size(size_t states);

/* Fills a form from A (states, states), which is destroyed, B (states, held + rare) and C (outputs, states). `blocks`
   (states,): the number of the block that each state belongs to, from 0 on, where A is made of some whose couplings are
   of low rank; NULL else. It is quicker by them, the result is the same but for rounding. Returns the largest condition
   number of an eigenvalue, |v| |w| / |w' v| of its right and left vectors, by which rounding errors grow: 1 where A is
   normal, HUGE_VAL where there is no modal form. */
INTERNAL double modal_build(const Modal *modal, double *A, const double *blocks, const double *B, const double *C,
                            double *scratch);

/* The eigenvalue of a slot, in a form whose eigenvalues and inverses are 0 before. */
INTERNAL void modal_set_eigenvalue(const Modal *modal, size_t slot, double real, double imaginary);

/* z (slots, columns) = V^-1 X of X (states, columns), with the scratch memory as modal_build left it. */
INTERNAL void modal_coordinates(const Modal *modal, size_t columns, const double *X, double *z, double *scratch);

#endif
