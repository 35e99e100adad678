/* Four doubles side by side, one of each of four samples, and eight: two of each sample, such as the coordinates of a
   pair. Where there are no vector types the same operations on plain doubles give the same bits;
   FLEXBEAMS_PLAIN_LANES chooses these. */
#ifndef FLEXBEAMS_LANES_H
#define FLEXBEAMS_LANES_H

#include <math.h>
#include <stddef.h>

#define LANES 4

#if defined(__GNUC__)
#define INLINE static inline __attribute__((unused, always_inline))
#else
#define INLINE static inline
#endif

#if defined(__GNUC__) && (defined(__SSE2__) || defined(__aarch64__)) && !defined(FLEXBEAMS_PLAIN_LANES)

#pragma GCC diagnostic ignored "-Wpsabi" /* no vector crosses a call: what takes or returns one is inlined */

typedef double Lanes __attribute__((vector_size(8 * LANES)));
typedef long long LaneMask __attribute__((vector_size(8 * LANES)));
typedef double PairLanes __attribute__((vector_size(16 * LANES)));

#define lanes_of(value) ((Lanes){(value), (value), (value), (value)})
#define lanes_add(a, b) ((a) + (b))
#define lanes_subtract(a, b) ((a) - (b))
#define lanes_multiply(a, b) ((a) * (b))
#define lanes_above(a, b) ((LaneMask)((a) > (b)))
#define lanes_both(a, b) ((a) & (b))
#define lanes_either(a, b) ((a) | (b))
/* a of the lanes where the condition holds, b of the others */
#define lanes_choose(condition, a, b) ((Lanes)(((condition) & (LaneMask)(a)) | (~(condition) & (LaneMask)(b))))
#define lanes_larger(a, b) lanes_choose(lanes_above(a, b), a, b) /* b where one of them is no number */
#define lanes_smaller(a, b) lanes_choose(lanes_above(b, a), a, b)
#define lanes_magnitude(a) ((Lanes)(~(LaneMask)lanes_of(-0.0) & (LaneMask)(a)))

#define pairs_add(a, b) ((a) + (b))
#define pairs_multiply(a, b) ((a) * (b))
#define NO_PAIRS ((PairLanes){0.0})

#if defined(__clang__)

INLINE PairLanes pairs_of(const double *pair)
{
    typedef double Pair __attribute__((vector_size(16), aligned(8), may_alias));
    const Pair both = *(const Pair *)pair;
    return __builtin_shufflevector(both, both, 0, 1, 0, 1, 0, 1, 0, 1);
}
#define pairs_exchanged(a) __builtin_shufflevector(a, a, 1, 0, 3, 2, 5, 4, 7, 6)
#define pairs_of_lanes(a) __builtin_shufflevector(a, a, 0, 0, 1, 1, 2, 2, 3, 3)
#define firsts_of_pairs(a) __builtin_shufflevector(a, a, 0, 2, 4, 6)

#else

INLINE PairLanes pairs_of(const double *pair)
{
    return (PairLanes){pair[0], pair[1], pair[0], pair[1], pair[0], pair[1], pair[0], pair[1]};
}
#define pairs_exchanged(a) ((PairLanes){(a)[1], (a)[0], (a)[3], (a)[2], (a)[5], (a)[4], (a)[7], (a)[6]})
#define pairs_of_lanes(a) ((PairLanes){(a)[0], (a)[0], (a)[1], (a)[1], (a)[2], (a)[2], (a)[3], (a)[3]})
#define firsts_of_pairs(a) ((Lanes){(a)[0], (a)[2], (a)[4], (a)[6]})

#endif

#else

typedef struct {
    double of[LANES];
} Lanes;
typedef struct {
    int of[LANES];
} LaneMask;
typedef struct {
    double of[2 * LANES];
} PairLanes;

#define LANES_FUNCTION(Type, count, name, parameters, expression)                                                      \
    INLINE Type name parameters                                                                                        \
    {                                                                                                                  \
        Type result;                                                                                                   \
        for (int l = 0; l < count; l++)                                                                                \
            result.of[l] = expression;                                                                                 \
        return result;                                                                                                 \
    }
LANES_FUNCTION(Lanes, LANES, lanes_of, (double value), value)
LANES_FUNCTION(Lanes, LANES, lanes_add, (Lanes a, Lanes b), a.of[l] + b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_subtract, (Lanes a, Lanes b), a.of[l] - b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_multiply, (Lanes a, Lanes b), a.of[l] * b.of[l])
LANES_FUNCTION(LaneMask, LANES, lanes_above, (Lanes a, Lanes b), a.of[l] > b.of[l])
LANES_FUNCTION(LaneMask, LANES, lanes_both, (LaneMask a, LaneMask b), a.of[l] & b.of[l])
LANES_FUNCTION(LaneMask, LANES, lanes_either, (LaneMask a, LaneMask b), a.of[l] | b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_choose, (LaneMask mask, Lanes a, Lanes b), mask.of[l] ? a.of[l] : b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_larger, (Lanes a, Lanes b), a.of[l] > b.of[l] ? a.of[l] : b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_smaller, (Lanes a, Lanes b), a.of[l] < b.of[l] ? a.of[l] : b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_magnitude, (Lanes a), fabs(a.of[l]))
LANES_FUNCTION(PairLanes, 2 * LANES, pairs_add, (PairLanes a, PairLanes b), a.of[l] + b.of[l])
LANES_FUNCTION(PairLanes, 2 * LANES, pairs_multiply, (PairLanes a, PairLanes b), a.of[l] * b.of[l])
LANES_FUNCTION(PairLanes, 2 * LANES, pairs_of, (const double *pair), pair[l % 2])
LANES_FUNCTION(PairLanes, 2 * LANES, pairs_exchanged, (PairLanes a), a.of[l ^ 1])
LANES_FUNCTION(PairLanes, 2 * LANES, pairs_of_lanes, (Lanes a), a.of[l / 2])
LANES_FUNCTION(Lanes, LANES, firsts_of_pairs, (PairLanes a), a.of[2 * l])
#define NO_PAIRS ((PairLanes){{0.0}})

#endif

#define lanes_add_product(sum, a, b) lanes_add(sum, lanes_multiply(a, b))
#define pairs_add_product(sum, a, b) pairs_add(sum, pairs_multiply(a, b))

/* Of each sample the sum of its two. */
INLINE Lanes sums_of_pairs(PairLanes a)
{
    const PairLanes sums = pairs_add(a, pairs_exchanged(a));
    return firsts_of_pairs(sums);
}

INLINE void set_lane(Lanes *lanes, size_t lane, double value)
{
    ((double *)lanes)[lane] = value;
}

INLINE double get_lane(const Lanes *lanes, size_t lane)
{
    return ((const double *)lanes)[lane];
}

INLINE void set_pair_lane(PairLanes *lanes, size_t lane, size_t member, double value)
{
    ((double *)lanes)[2 * lane + member] = value;
}

#endif
