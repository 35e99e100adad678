/* The modes of a matrix's blocks, each as if it were alone, and what couples them. The caller owns all memory. */

#ifndef BLOCK_MODES_H
#define BLOCK_MODES_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"
#include "pool.h"

#define LARGEST_BASIS_CONDITION 100.0 /* of an eigenvalue of a block, or of a cluster of modes */

/* A, divided by `scale`, is Lambda + the sum over links of to from' in coordinates of the blocks' modes. A link leads
   from the coordinates of one block to those of another. */
typedef struct {
    size_t n;
    double scale; /* a power of two */
    size_t blocks;
    size_t *order;        /* (n,) states, block by block: where the modes' coordinates have their places */
    size_t *begin;        /* (blocks + 1,) first place of each block */
    double *real;         /* (n,) as in modes.h */
    double *imaginary;    /* (n,) */
    double *transposed_V; /* of each block, one behind the other: its V', row by row */
    double *inverse_V;
    size_t links;
    size_t *to_block;   /* (links,) */
    size_t *from_block; /* (links,) */
    double *to;         /* (links, n) */
    double *from;       /* (links, n) */
} BlockModes;

/* Fills it from A (n, n) and the block of each state, as in modal_build.h. False where that is not worth it, or takes
   more than the memory. */
INTERNAL bool find_block_modes(BlockModes *modes, const double *A, const double *block_of, Pool *pool);

#endif
