#include "coupled_modes.h"

#include <string.h>

#include "block_modes.h"
#include "cluster_vectors.h"
#include "linear_algebra.h"
#include "mode_clusters.h"
#include "pool.h"
#include "vectors.h"

#define MOST_ATTEMPTS 8

/* The blocks' modes in clusters, and memory for one cluster after the other. */
typedef struct {
    BlockModes blocks;
    ModeClusters clusters;
    ClusterVectors cluster;
    double *M;              /* (size, size), in place of N of the cluster */
    double *M_transposed_V; /* (size, size) of the modes of M */
    double *M_inverse_V;    /* (size, size) */
    double *scratch;        /* for these */
} CoupledModes;

static bool take_cluster(CoupledModes *coupled, size_t begin, Pool pool)
{
    const ModeClusters *const clusters = &coupled->clusters;
    const size_t n = coupled->blocks.n;
    const size_t size = clusters->end[begin] - begin;
    size_t count = 0;
    for (size_t i = 0; i < clusters->shared; i = clusters->end[i])
        count++;
    coupled->cluster.begin = begin;
    coupled->cluster.size = size;
    coupled->cluster.inverses = take_doubles(&pool, size * n);
    coupled->cluster.Y = take_doubles(&pool, (size + 1) * n);
    coupled->cluster.N = coupled->M = take_doubles(&pool, size * size);
    coupled->cluster.leaving = take_doubles(&pool, (count + 2) * coupled->blocks.links);
    coupled->M_transposed_V = take_doubles(&pool, size * size);
    coupled->M_inverse_V = take_doubles(&pool, size * size);
    coupled->scratch = take_doubles(&pool, modes_scratch_size(size));
    return coupled->scratch != NULL;
}

/* sum (columns,) = x (rows,) times the matrix (rows, columns) row by row; behind the matrix. */
static const double *multiply_from_left(size_t size, const double *x, const double *matrix, double *sum)
{
    memset(sum, 0, size * sizeof *sum);
    for (size_t i = 0; i < size; i++, matrix += size)
        vector_add_scaled(size, x[i], matrix, sum);
    return matrix;
}

/* A vector (n,) of coordinates to the states, in its place; `scratch` has room for 2 n doubles. */
static void expand_vector(const CoupledModes *coupled, bool is_right, double *vector, double *scratch)
{
    const ModeClusters *const clusters = &coupled->clusters;
    const BlockModes *const blocks = &coupled->blocks;
    double *const y = scratch;
    double *const sum = scratch + blocks->n;
    const double *matrix = is_right ? clusters->transposed_V : clusters->inverse_V;
    for (size_t begin = 0; begin < clusters->shared; begin = clusters->end[begin]) {
        matrix = multiply_from_left(clusters->end[begin] - begin, vector + begin, matrix, sum);
        for (size_t i = begin; i < clusters->end[begin]; i++)
            y[clusters->place[i]] = sum[i - begin];
    }
    for (size_t i = clusters->shared; i < blocks->n; i++)
        y[clusters->place[i]] = vector[i];
    matrix = is_right ? blocks->transposed_V : blocks->inverse_V;
    for (size_t b = 0; b < blocks->blocks; b++) {
        const size_t begin = blocks->begin[b];
        matrix = multiply_from_left(blocks->begin[b + 1] - begin, y + begin, matrix, sum);
        for (size_t i = begin; i < blocks->begin[b + 1]; i++)
            vector[blocks->order[i]] = sum[i - begin];
    }
}

/* A matrix (size, size) times X (size, n), the vectors in its rows expanded, in place of X. */
static void mix_vectors(const CoupledModes *coupled, bool is_right, const double *matrix, double *X)
{
    const size_t n = coupled->blocks.n;
    const size_t size = coupled->cluster.size;
    double *const mixed = coupled->cluster.Y;
    memset(mixed, 0, size * n * sizeof *mixed);
    for (size_t j = 0; j < size; j++)
        for (size_t i = 0; i < size; i++)
            vector_add_scaled(n, matrix[j * size + i], X + i * n, mixed + j * n);
    memcpy(X, mixed, size * n * sizeof *X);
    for (size_t j = 0; j < size; j++)
        expand_vector(coupled, is_right, X + j * n, mixed);
}

/* The modes of a cluster: with its right vectors X, left vectors Z and M G = G Lambda, V = X G and V^-1 has the rows
   G^-1 (Z X)^-1 Z. */
static bool find_cluster_modes(const Modes *modes, CoupledModes *coupled)
{
    const BlockModes *const blocks = &coupled->blocks;
    ModeClusters *const clusters = &coupled->clusters;
    const VectorSide right = {.blocks = blocks,
                              .clusters = clusters,
                              .sign = 1.0,
                              .to_block = blocks->to_block,
                              .from_block = blocks->from_block,
                              .to = clusters->to,
                              .from = clusters->from};
    const VectorSide left = {.blocks = blocks,
                             .clusters = clusters,
                             .sign = -1.0,
                             .to_block = blocks->from_block,
                             .from_block = blocks->to_block,
                             .to = clusters->from,
                             .from = clusters->to};
    const size_t n = modes->n;
    const size_t begin = coupled->cluster.begin;
    const size_t size = coupled->cluster.size;
    const Modes of_M = {.n = size,
                        .real = modes->real + begin,
                        .imaginary = modes->imaginary + begin,
                        .transposed_V = coupled->M_transposed_V,
                        .inverse_V = coupled->M_inverse_V};
    double *const X = modes->transposed_V + begin * n;
    double *const Z = modes->inverse_V + begin * n;
    fill_distances(&right, &coupled->cluster);
    if (!find_cluster_vectors(&left, &coupled->cluster, Z) || !find_cluster_vectors(&right, &coupled->cluster, X))
        return false;
    for (size_t i = 0; i < size;) /* M = Lambda + N */
        i += add_mode(size, i, clusters->real[begin + i], clusters->imaginary[begin + i], coupled->M);
    if (!find_dense_modes(&of_M, coupled->M, coupled->scratch))
        return false;
    double *const products = coupled->M;
    for (size_t i = 0; i < size; i++)
        for (size_t j = 0; j < size; j++)
            products[i * size + j] = vector_product(n, Z + i * n, X + j * n);
    if (!solve_general(size, n, products, Z))
        return false;
    mix_vectors(coupled, true, of_M.transposed_V, X);
    mix_vectors(coupled, false, of_M.inverse_V, Z);
    for (size_t i = 0; i < size; i++) {
        of_M.real[i] *= blocks->scale;
        of_M.imaginary[i] *= blocks->scale;
    }
    return true;
}

bool find_coupled_modes(const Modes *modes, const double *A, const double *block_of, double *scratch)
{
    Pool pool = {.next = scratch, .left = modes_scratch_size(modes->n)};
    CoupledModes coupled = {.blocks = {.n = modes->n}};
    ModeClusters *const clusters = &coupled.clusters;
    if (block_of == NULL || !find_block_modes(&coupled.blocks, A, block_of, &pool) ||
        !start_clusters(clusters, &coupled.blocks, &pool))
        return false;
    for (size_t attempt = 0; attempt < MOST_ATTEMPTS && clusters->is_changed; attempt++) {
        Pool rest = pool;
        bool is_found = true;
        if (!find_clusters(clusters, &coupled.blocks, &rest))
            return false;
        for (size_t begin = 0; begin < modes->n; begin = clusters->end[begin]) {
            if (!take_cluster(&coupled, begin, rest))
                return false;
            is_found = find_cluster_modes(modes, &coupled) && is_found;
        }
        if (is_found)
            return eigenvalue_condition(modes) <= LARGEST_BASIS_CONDITION;
    }
    return false;
}
