/* Modes of a matrix made of blocks that few links couple. The caller owns all memory. */

#ifndef COUPLED_MODES_H
#define COUPLED_MODES_H

#include <stdbool.h>

#include "internal.h"
#include "modes.h"

/* The modes of A (n, n) from those of its blocks, see modal_build.h; `scratch` as for find_dense_modes. False where
   that is not worth it or does not converge. */
INTERNAL bool find_coupled_modes(const Modes *modes, const double *A, const double *block_of, double *scratch);

#endif
