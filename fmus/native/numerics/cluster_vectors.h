/* Vectors that belong to a cluster of modes, with the couplings to all others. The caller owns all memory. */

#ifndef CLUSTER_VECTORS_H
#define CLUSTER_VECTORS_H

#include <stdbool.h>
#include <stddef.h>

#include "block_modes.h"
#include "internal.h"
#include "mode_clusters.h"

/* A's right vectors, or its left ones: right ones of the transpose. */
typedef struct {
    const BlockModes *blocks;
    ModeClusters *clusters;
    double sign; /* of the imaginary parts of the eigenvalues */
    const size_t *to_block;
    const size_t *from_block;
    const double *to;
    const double *from;
} VectorSide;

/* A cluster, and what its vectors are found in. */
typedef struct {
    size_t begin; /* coordinate */
    size_t size;
    double *inverses; /* (size, n) of distances of eigenvalues */
    double *Y;        /* (size, n) */
    double *N;        /* (size, size) */
    double *leaving;  /* (2 + clusters of several modes, links) */
} ClusterVectors;

/* Inverse distances of the cluster's eigenvalues to all others. */
INTERNAL void fill_distances(const VectorSide *side, const ClusterVectors *cluster);
/* X (size, n), vectors row by row, and N. Joins the cluster to those that mix with it too much; false then, or where X
   does not settle. */
INTERNAL bool find_cluster_vectors(const VectorSide *side, const ClusterVectors *cluster, double *X);

#endif
