/* Clusters of blocks' modes that couplings mix: few at low frequencies, and those that nearly coincide. The caller owns
   all memory. */

#ifndef MODE_CLUSTERS_H
#define MODE_CLUSTERS_H

#include <stdbool.h>
#include <stddef.h>

#include "block_modes.h"
#include "internal.h"
#include "pool.h"

/* Coordinates of the modes of each cluster as if it were alone: clusters of several modes of blocks first, each in one
   piece, then the modes that are alone, block by block. Links as in block_modes.h, which couple no two coordinates of a
   cluster now. */
typedef struct {
    bool is_changed;      /* have clusters been joined since? */
    size_t shared;        /* number of coordinates of clusters of several modes */
    size_t *place;        /* (n,) which coordinate of the blocks' modes stands there; those of a cluster are mixed */
    size_t *begin;        /* (n,) first coordinate of its cluster */
    size_t *end;          /* (n,) */
    size_t *alone;        /* (blocks + 1,) first coordinate of the modes of each block that are alone */
    size_t *label;        /* (n,) of each coordinate of the blocks' modes: the first one of its cluster */
    size_t *sizes;        /* (n,) number of coordinates with each label */
    double *real;         /* (n,) as in modes.h */
    double *imaginary;    /* (n,) */
    double *transposed_V; /* of each cluster of several modes, one behind the other */
    double *inverse_V;
    double *to;   /* (links, n) */
    double *from; /* (links, n) */
    double *rows; /* (2, n) of couplings */
} ModeClusters;

/* Each mode of a block is a cluster at first; false where that takes more than the memory. */
INTERNAL bool start_clusters(ModeClusters *clusters, const BlockModes *modes, Pool *pool);
/* Makes one cluster of the ones that coordinates i and j belong to; nothing but labels changes yet. */
INTERNAL void join_clusters(ModeClusters *clusters, size_t n, size_t i, size_t j);
/* Joins clusters until modes of different ones mix little. False where that takes too large a cluster, or more than the
   memory. */
INTERNAL bool find_clusters(ModeClusters *clusters, const BlockModes *modes, Pool *pool);

#endif
