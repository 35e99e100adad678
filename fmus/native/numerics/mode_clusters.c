#include "mode_clusters.h"

#include <string.h>

#include "modes.h"
#include "vectors.h"

#define LARGEST_MIXING 0.01 /* coupling of two modes of different clusters over the distance of their eigenvalues */
#define MOST_ROUNDS 12

static bool take_clusters(ModeClusters *clusters, const BlockModes *modes, Pool *pool)
{
    const size_t n = modes->n;
    clusters->place = take_indices(pool, n);
    clusters->begin = take_indices(pool, n);
    clusters->end = take_indices(pool, n);
    clusters->alone = take_indices(pool, modes->blocks + 1);
    clusters->label = take_indices(pool, n);
    clusters->sizes = take_indices(pool, n);
    clusters->rows = take_doubles(pool, 2 * n);
    clusters->real = take_doubles(pool, n);
    clusters->imaginary = take_doubles(pool, n);
    clusters->to = take_doubles(pool, modes->links * n);
    clusters->from = take_doubles(pool, modes->links * n);
    return clusters->from != NULL;
}

/* The coordinates by their clusters. */
static void order_coordinates(ModeClusters *clusters, const BlockModes *modes)
{
    const size_t n = modes->n;
    const size_t *const label = clusters->label;
    size_t *const sizes = clusters->sizes;
    for (size_t c = 0; c < n; c++)
        sizes[c] = 0;
    for (size_t c = 0; c < n; c++)
        sizes[label[c]]++;
    size_t count = 0;
    for (size_t c = 0; c < n; c++) {
        if (sizes[c] <= mode_width(modes->imaginary, c))
            continue;
        const size_t begin = count;
        for (size_t other = c; other < n; other++)
            if (label[other] == c) {
                clusters->begin[count] = begin;
                clusters->end[count] = begin + sizes[c];
                clusters->place[count++] = other;
            }
    }
    clusters->shared = count;
    for (size_t b = 0; b < modes->blocks; b++) {
        clusters->alone[b] = count;
        for (size_t c = modes->begin[b]; c < modes->begin[b + 1]; c++) {
            const size_t width = mode_width(modes->imaginary, label[c]);
            if (sizes[label[c]] > width)
                continue;
            clusters->begin[count] = count - (c - label[c]);
            clusters->end[count] = clusters->begin[count] + width;
            clusters->place[count++] = c;
        }
    }
    clusters->alone[modes->blocks] = count;
}

/* A of a cluster in the coordinates of the blocks' modes */
static void fill_cluster(const BlockModes *modes, const size_t *place, size_t size, double *A)
{
    memset(A, 0, size * size * sizeof *A);
    for (size_t i = 0; i < size; i++)
        for (size_t k = 0; k < modes->links; k++) {
            const double factor = modes->to[k * modes->n + place[i]];
            for (size_t j = 0; j < size && factor != 0.0; j++)
                A[i * size + j] += factor * modes->from[k * modes->n + place[j]];
        }
    for (size_t i = 0; i < size;)
        i += add_mode(size, i, modes->real[place[i]], modes->imaginary[place[i]], A);
}

/* A link in coordinates of a cluster's modes; `gathered` has room for it. */
static void transform_link(const size_t *place, size_t size, const double *matrix, const double *link, double *gathered,
                           double *to)
{
    bool is_any = false;
    for (size_t i = 0; i < size; i++) {
        gathered[i] = link[place[i]];
        is_any = is_any || gathered[i] != 0.0;
    }
    for (size_t i = 0; i < size; i++)
        to[i] = is_any ? vector_product(size, matrix + i * size, gathered) : 0.0;
}

/* Modes of each cluster, and links in their coordinates. */
static bool diagonalise_clusters(ModeClusters *clusters, const BlockModes *modes, Pool *pool)
{
    const size_t n = modes->n;
    size_t squares = 0;
    for (size_t i = 0; i < clusters->shared; i++)
        squares += clusters->end[i] - clusters->begin[i];
    double *transposed_V = clusters->transposed_V = take_doubles(pool, squares);
    double *inverse_V = clusters->inverse_V = take_doubles(pool, squares);
    if (inverse_V == NULL)
        return false;
    for (size_t i = 0; i < clusters->shared; i = clusters->end[i]) {
        const size_t size = clusters->end[i] - i;
        Pool rest = *pool;
        double *const A = take_doubles(&rest, size * size);
        double *const scratch = take_doubles(&rest, modes_scratch_size(size));
        const Modes own = {.n = size,
                           .real = clusters->real + i,
                           .imaginary = clusters->imaginary + i,
                           .transposed_V = transposed_V,
                           .inverse_V = inverse_V};
        if (scratch == NULL || 2 * size > n)
            return false;
        fill_cluster(modes, clusters->place + i, size, A);
        if (!find_dense_modes(&own, A, scratch) || !(eigenvalue_condition(&own) <= LARGEST_BASIS_CONDITION))
            return false;
        for (size_t k = 0; k < modes->links; k++) {
            transform_link(clusters->place + i, size, inverse_V, modes->to + k * n, A, clusters->to + k * n + i);
            transform_link(clusters->place + i, size, transposed_V, modes->from + k * n, A, clusters->from + k * n + i);
        }
        transposed_V += size * size;
        inverse_V += size * size;
    }
    for (size_t i = clusters->shared; i < n; i++) {
        const size_t place = clusters->place[i];
        clusters->real[i] = modes->real[place];
        clusters->imaginary[i] = modes->imaginary[place];
        for (size_t k = 0; k < modes->links; k++) {
            clusters->to[k * n + i] = modes->to[k * n + place];
            clusters->from[k * n + i] = modes->from[k * n + place];
        }
    }
    return true;
}

/* Row i of the couplings. */
static void add_couplings(const ModeClusters *clusters, const BlockModes *modes, size_t i, double *row)
{
    const size_t n = modes->n;
    memset(row, 0, n * sizeof *row);
    for (size_t k = 0; k < modes->links; k++) {
        const double factor = clusters->to[k * n + i];
        if (factor == 0.0)
            continue;
        const size_t first = clusters->alone[modes->from_block[k]];
        const size_t end = clusters->alone[modes->from_block[k] + 1];
        vector_add_scaled(clusters->shared, factor, clusters->from + k * n, row);
        vector_add_scaled(end - first, factor, clusters->from + k * n + first, row + first);
    }
}

void join_clusters(ModeClusters *clusters, size_t n, size_t i, size_t j)
{
    size_t *const label = clusters->label;
    const size_t one = label[clusters->place[i]];
    const size_t other = label[clusters->place[j]];
    const size_t lower = one < other ? one : other;
    const size_t upper = one < other ? other : one;
    for (size_t c = upper; c < n && lower != upper; c++)
        if (label[c] == upper)
            label[c] = lower;
    clusters->is_changed = clusters->is_changed || lower != upper;
}

/* Joins clusters of which modes mix. */
static void join_mixed_clusters(ModeClusters *clusters, const BlockModes *modes)
{
    double *const rows = clusters->rows;
    const size_t n = modes->n;
    const double *const real = clusters->real;
    const double *const imaginary = clusters->imaginary;
    for (size_t i = 0, height; i < n; i += height) {
        height = mode_width(imaginary, i);
        for (size_t k = 0; k < height; k++)
            add_couplings(clusters, modes, i + k, rows + k * n);
        for (size_t j = 0, width; j < n; j += width) {
            width = mode_width(imaginary, j);
            double square = 0.0;
            for (size_t k = 0; k < height; k++)
                for (size_t l = 0; l < width; l++)
                    square += rows[k * n + j + l] * rows[k * n + j + l];
            const double x = real[i] - real[j];
            const double y = imaginary[i] - imaginary[j];
            const double most = LARGEST_MIXING * LARGEST_MIXING * (x * x + y * y);
            if (square > most && clusters->begin[i] != clusters->begin[j])
                join_clusters(clusters, n, i, j);
        }
    }
}

bool start_clusters(ModeClusters *clusters, const BlockModes *modes, Pool *pool)
{
    if (!take_clusters(clusters, modes, pool))
        return false;
    for (size_t c = 0, width; c < modes->n; c += width) {
        width = mode_width(modes->imaginary, c);
        clusters->label[c] = c;
        clusters->label[c + width - 1] = c;
    }
    clusters->is_changed = true;
    return true;
}

bool find_clusters(ModeClusters *clusters, const BlockModes *modes, Pool *pool)
{
    for (size_t round = 0; round < MOST_ROUNDS; round++) {
        Pool rest = *pool;
        order_coordinates(clusters, modes);
        if (!diagonalise_clusters(clusters, modes, &rest))
            return false;
        clusters->is_changed = false;
        join_mixed_clusters(clusters, modes);
        if (!clusters->is_changed) {
            *pool = rest;
            return true;
        }
    }
    return false;
}
