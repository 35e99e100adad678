/* Memory that is handed out piece by piece. A copy of a pool hands out pieces that last until the pool hands out its
   next. */

#ifndef POOL_H
#define POOL_H

#include <stddef.h>

#include "internal.h"

typedef struct {
    double *next;
    size_t left; /* doubles */
} Pool;

/* NULL where less is left. Then the pool is used up, whatever is asked of it later: of several pieces the last one
   tells whether all were there. */
INTERNAL_INLINE double *take_doubles(Pool *pool, size_t count)
{
    double *const taken = pool->next;
    if (taken == NULL || count > pool->left) {
        *pool = (Pool){.next = NULL, .left = 0};
        return NULL;
    }
    pool->next += count;
    pool->left -= count;
    return taken;
}

/* Indices, each in the place of a double. */
INTERNAL_INLINE size_t *take_indices(Pool *pool, size_t count)
{
    return (size_t *)(void *)take_doubles(pool, count);
}

#endif
