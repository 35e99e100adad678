/* Inner loops on arrays of doubles, in the same order of summation whatever compiles them. */

#ifndef VECTORS_H
#define VECTORS_H

#include <stddef.h>

#include "pair.h"

/* a' b, summed in four parts: those of the indices that leave the same remainder divided by 4. */
INTERNAL_INLINE double vector_product(size_t n, const double *a, const double *b)
{
    Pair low = pair_of(0.0);
    Pair high = pair_of(0.0);
    size_t k = 0;
    for (; k + 4 <= n; k += 4) {
        low = pair_add_product(low, pair_load(a + k), pair_load(b + k));
        high = pair_add_product(high, pair_load(a + k + 2), pair_load(b + k + 2));
    }
    double sum = pair_sum(pair_add(low, high));
    for (; k < n; k++)
        sum += a[k] * b[k];
    return sum;
}

/* sum += factor a */
INTERNAL_INLINE void vector_add_scaled(size_t n, double factor, const double *a, double *sum)
{
    const Pair factors = pair_of(factor);
    size_t k = 0;
    for (; k + 4 <= n; k += 4) {
        pair_store(sum + k, pair_add_product(pair_load(sum + k), factors, pair_load(a + k)));
        pair_store(sum + k + 2, pair_add_product(pair_load(sum + k + 2), factors, pair_load(a + k + 2)));
    }
    for (; k < n; k++)
        sum[k] += factor * a[k];
}

#endif
