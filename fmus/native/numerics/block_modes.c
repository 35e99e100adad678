#include "block_modes.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "modes.h"
#include "vectors.h"

#define NEGLIGIBLE_REST (8 * DBL_EPSILON) /* of a coupling's largest entry */

/* The states block by block; false where one is too large. */
static bool order_states(BlockModes *modes, const double *block_of, Pool *pool)
{
    const size_t n = modes->n;
    modes->blocks = 0;
    for (size_t i = 0; i < n; i++)
        if ((size_t)block_of[i] >= modes->blocks)
            modes->blocks = (size_t)block_of[i] + 1;
    modes->order = take_indices(pool, n);
    modes->begin = take_indices(pool, modes->blocks + 1);
    if (modes->begin == NULL)
        return false;
    size_t place = 0;
    for (size_t b = 0; b < modes->blocks; b++) {
        modes->begin[b] = place;
        for (size_t i = 0; i < n; i++)
            if ((size_t)block_of[i] == b)
                modes->order[place++] = i;
        if (2 * (place - modes->begin[b]) > n)
            return false;
    }
    modes->begin[modes->blocks] = place;
    return true;
}

static size_t block_size(const BlockModes *modes, size_t block)
{
    return modes->begin[block + 1] - modes->begin[block];
}

/* Where the matrices of a block begin behind those of the blocks before it; of the number of blocks: their size. */
static size_t matrix_begin(const BlockModes *modes, size_t block)
{
    size_t begin = 0;
    for (size_t b = 0; b < block; b++)
        begin += block_size(modes, b) * block_size(modes, b);
    return begin;
}

/* The part of A, scaled, in the rows of one block and the columns of another; is any entry not 0? */
static bool copy_part(const BlockModes *modes, const double *A, size_t to, size_t from, double *part)
{
    bool is_any = false;
    for (size_t i = modes->begin[to]; i < modes->begin[to + 1]; i++)
        for (size_t j = modes->begin[from]; j < modes->begin[from + 1]; j++) {
            *part = A[modes->order[i] * modes->n + modes->order[j]] / modes->scale;
            is_any = *part++ != 0.0 || is_any;
        }
    return is_any;
}

/* Modes of each block. */
static bool diagonalise_blocks(BlockModes *modes, const double *A, Pool *pool)
{
    const size_t squares = matrix_begin(modes, modes->blocks);
    modes->real = take_doubles(pool, modes->n);
    modes->imaginary = take_doubles(pool, modes->n);
    modes->transposed_V = take_doubles(pool, squares);
    modes->inverse_V = take_doubles(pool, squares);
    if (modes->inverse_V == NULL)
        return false;
    for (size_t b = 0; b < modes->blocks; b++) {
        const size_t size = block_size(modes, b);
        const size_t position = matrix_begin(modes, b);
        Pool rest = *pool;
        double *const part = take_doubles(&rest, size * size);
        double *const scratch = take_doubles(&rest, modes_scratch_size(size));
        const Modes own = {.n = size,
                           .real = modes->real + modes->begin[b],
                           .imaginary = modes->imaginary + modes->begin[b],
                           .transposed_V = modes->transposed_V + position,
                           .inverse_V = modes->inverse_V + position};
        if (scratch == NULL)
            return false;
        copy_part(modes, A, b, b, part);
        if (!find_dense_modes(&own, part, scratch) || !(eigenvalue_condition(&own) <= LARGEST_BASIS_CONDITION))
            return false;
    }
    return true;
}

/* y = M x of a block's matrix */
static void multiply_block(size_t size, const double *M, const double *x, double *y)
{
    for (size_t i = 0; i < size; i++)
        y[i] = vector_product(size, M + i * size, x);
}

/* Links of the coupling `part` of two blocks, each its largest entry's column and row, less what this takes away from
   the rest. `vectors` has room for two. */
static bool add_links(BlockModes *modes, size_t to, size_t from, size_t most, double *part, double *vectors)
{
    const size_t rows = block_size(modes, to);
    const size_t columns = block_size(modes, from);
    double *const column = vectors;
    double *const row = vectors + rows;
    const double *const to_inverse_V = modes->inverse_V + matrix_begin(modes, to);
    const double *const from_transposed_V = modes->transposed_V + matrix_begin(modes, from);
    for (double first = 0.0;;) {
        size_t pivot = 0;
        for (size_t k = 1; k < rows * columns; k++)
            if (fabs(part[k]) > fabs(part[pivot]))
                pivot = k;
        const double largest = part[pivot];
        first = fmax(first, fabs(largest));
        if (!(fabs(largest) > NEGLIGIBLE_REST * first))
            return true;
        if (modes->links == most)
            return false;
        memcpy(row, part + pivot / columns * columns, columns * sizeof *row);
        for (size_t i = 0; i < rows; i++) {
            column[i] = part[i * columns + pivot % columns] / largest;
            vector_add_scaled(columns, -column[i], row, part + i * columns);
        }
        const size_t link = modes->links++;
        modes->to_block[link] = to;
        modes->from_block[link] = from;
        multiply_block(rows, to_inverse_V, column, modes->to + link * modes->n + modes->begin[to]);
        multiply_block(columns, from_transposed_V, row, modes->from + link * modes->n + modes->begin[from]);
    }
}

/* All links. */
static bool find_links(BlockModes *modes, const double *A, Pool *pool)
{
    const size_t n = modes->n;
    const size_t most = n / 8;
    modes->to_block = take_indices(pool, most);
    modes->from_block = take_indices(pool, most);
    modes->to = take_doubles(pool, most * n);
    modes->from = take_doubles(pool, most * n);
    if (modes->from == NULL)
        return false;
    modes->links = 0;
    memset(modes->to, 0, most * n * sizeof *modes->to);
    memset(modes->from, 0, most * n * sizeof *modes->from);
    for (size_t to = 0; to < modes->blocks; to++)
        for (size_t from = 0; from < modes->blocks; from++) {
            Pool rest = *pool;
            double *const part = take_doubles(&rest, block_size(modes, to) * block_size(modes, from));
            double *const vectors = take_doubles(&rest, block_size(modes, to) + block_size(modes, from));
            if (vectors == NULL)
                return false;
            if (to != from && copy_part(modes, A, to, from, part) && !add_links(modes, to, from, most, part, vectors))
                return false;
        }
    return true;
}

bool find_block_modes(BlockModes *modes, const double *A, const double *block_of, Pool *pool)
{
    modes->scale = scale_of(modes->n * modes->n, A);
    return modes->scale > 0.0 && order_states(modes, block_of, pool) && diagonalise_blocks(modes, A, pool) &&
           find_links(modes, A, pool);
}
