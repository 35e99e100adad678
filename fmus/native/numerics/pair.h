/* Two doubles side by side. Compilers make vector instructions of them at every level of optimisation and never reorder
   a sum: left to themselves some write loops of four doubles three times slower at -O3 than at -O2. Where there are no
   vector types, or no instructions for them, the same operations on plain doubles give the same bits. */

#ifndef PAIR_H
#define PAIR_H

#include "internal.h"

#if defined(__GNUC__) && (defined(__SSE2__) || defined(__aarch64__))

#define WHOLE 6755399441055744.0 /* 1.5 2^52: doubles near it are whole numbers, which their last bits hold */

typedef double Pair __attribute__((vector_size(16)));
typedef double StoredPair __attribute__((vector_size(16), aligned(8), may_alias));
typedef unsigned long long PairBits __attribute__((vector_size(16)));

INTERNAL_INLINE Pair pair(double first, double second)
{
    return (Pair){first, second};
}

INTERNAL_INLINE Pair pair_load(const double *memory)
{
    return *(const StoredPair *)memory;
}

INTERNAL_INLINE void pair_store(double *memory, Pair a)
{
    *(StoredPair *)memory = a;
}

INTERNAL_INLINE Pair pair_add(Pair a, Pair b)
{
    return a + b;
}

INTERNAL_INLINE Pair pair_subtract(Pair a, Pair b)
{
    return a - b;
}

INTERNAL_INLINE Pair pair_multiply(Pair a, Pair b)
{
    return a * b;
}

INTERNAL_INLINE Pair pair_divide(Pair a, Pair b)
{
    return a / b;
}

/* The larger one of each. */
INTERNAL_INLINE Pair pair_maximum(Pair a, Pair b)
{
    const PairBits is_larger = (PairBits)(a > b);
    return (Pair)((is_larger & (PairBits)a) | (~is_larger & (PairBits)b));
}

/* The nearest whole numbers, magnitudes up to 2^50. */
INTERNAL_INLINE Pair pair_nearest(Pair a)
{
    return a + pair(WHOLE, WHOLE) - pair(WHOLE, WHOLE);
}

/* 2^a, whole numbers a within -1022 ... 1023. */
INTERNAL_INLINE Pair pair_power_of_two(Pair a)
{
    return (Pair)((PairBits)(a + pair(WHOLE + 1023, WHOLE + 1023)) << 52);
}

#undef WHOLE

#else

#include <math.h>

typedef struct {
    double first;
    double second;
} Pair;

INTERNAL_INLINE Pair pair(double first, double second)
{
    return (Pair){.first = first, .second = second};
}

INTERNAL_INLINE Pair pair_load(const double *memory)
{
    return pair(memory[0], memory[1]);
}

INTERNAL_INLINE void pair_store(double *memory, Pair a)
{
    memory[0] = a.first;
    memory[1] = a.second;
}

INTERNAL_INLINE Pair pair_add(Pair a, Pair b)
{
    return pair(a.first + b.first, a.second + b.second);
}

INTERNAL_INLINE Pair pair_subtract(Pair a, Pair b)
{
    return pair(a.first - b.first, a.second - b.second);
}

INTERNAL_INLINE Pair pair_multiply(Pair a, Pair b)
{
    return pair(a.first * b.first, a.second * b.second);
}

INTERNAL_INLINE Pair pair_divide(Pair a, Pair b)
{
    return pair(a.first / b.first, a.second / b.second);
}

INTERNAL_INLINE Pair pair_maximum(Pair a, Pair b)
{
    return pair(a.first > b.first ? a.first : b.first, a.second > b.second ? a.second : b.second);
}

INTERNAL_INLINE Pair pair_nearest(Pair a)
{
    return pair(nearbyint(a.first), nearbyint(a.second));
}

INTERNAL_INLINE Pair pair_power_of_two(Pair a)
{
    return pair(ldexp(1.0, (int)a.first), ldexp(1.0, (int)a.second));
}

#endif

/* The same double twice. */
INTERNAL_INLINE Pair pair_of(double value)
{
    return pair(value, value);
}

/* The sum of both. */
INTERNAL_INLINE double pair_sum(Pair a)
{
    double both[2];
    pair_store(both, a);
    return both[0] + both[1];
}

/* The first of one and the second of another. */
INTERNAL_INLINE Pair pair_join(Pair first, Pair second)
{
    double firsts[2];
    double seconds[2];
    pair_store(firsts, first);
    pair_store(seconds, second);
    return pair(firsts[0], seconds[1]);
}

/* sum + a b */
INTERNAL_INLINE Pair pair_add_product(Pair sum, Pair a, Pair b)
{
    return pair_add(sum, pair_multiply(a, b));
}

/* sum - a b */
INTERNAL_INLINE Pair pair_subtract_product(Pair sum, Pair a, Pair b)
{
    return pair_subtract(sum, pair_multiply(a, b));
}

#endif
