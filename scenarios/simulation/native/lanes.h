/* Eight doubles side by side, one of each of eight samples; and two of each sample, such as the coordinates of a pair,
   in parts of as many doubles as a register holds. Where there are no vector types the same operations on plain doubles
   give the same bits; FLEXBEAMS_PLAIN_LANES chooses these.

   To fill a register of 512 bits with a couple that is the same for all samples takes a shuffle, one of 256 bits comes
   with the load: a file that multiplies by such couples defines NARROW_PARTS. Parts lie in memory in the same way. */
#ifndef FLEXBEAMS_LANES_H
#define FLEXBEAMS_LANES_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#define LANES 8

#if defined(__AVX512F__) && !defined(NARROW_PARTS)
#define PART 8
#elif defined(__AVX__)
#define PART 4
#else
#define PART 2
#endif
#define PARTS (2 * LANES / PART) /* that hold two numbers of each sample */

#if defined(__GNUC__)
#define INLINE static inline __attribute__((unused, always_inline))
#else
#define INLINE static inline
#endif

#if defined(__has_builtin) && (defined(__SSE2__) || defined(__aarch64__)) && !defined(FLEXBEAMS_PLAIN_LANES)
#if __has_builtin(__builtin_shufflevector)
#define HAS_VECTORS
#endif
#endif

/* Two numbers that are the same for all samples. */
typedef struct {
    double of[2];
} Couple;

#ifdef HAS_VECTORS

#pragma GCC diagnostic ignored "-Wpsabi" /* no vector crosses a call: what takes or returns one is inlined */

typedef double Lanes __attribute__((vector_size(8 * LANES)));
typedef long long LaneMask __attribute__((vector_size(8 * LANES)));
typedef double Part __attribute__((vector_size(8 * PART)));

#define lanes_of(value) ((Lanes){(value), (value), (value), (value), (value), (value), (value), (value)})
#define lanes_add(a, b) ((a) + (b))
#define lanes_subtract(a, b) ((a) - (b))
#define lanes_multiply(a, b) ((a) * (b))
#define lanes_divide(a, b) ((a) / (b))
#define lanes_above(a, b) ((LaneMask)((a) > (b)))
#define lanes_both(a, b) ((a) & (b))
#define lanes_either(a, b) ((a) | (b))
#define lanes_magnitude(a) ((Lanes)(~(LaneMask)lanes_of(-0.0) & (LaneMask)(a)))

/* a of the lanes where the condition holds, b of the others */
INLINE Lanes lanes_choose(LaneMask condition, Lanes a, Lanes b)
{
    return (Lanes)((condition & (LaneMask)a) | (~condition & (LaneMask)b));
}

/* b where one of them is no number */
INLINE Lanes lanes_larger(Lanes a, Lanes b)
{
    return lanes_choose(lanes_above(a, b), a, b);
}

INLINE Lanes lanes_smaller(Lanes a, Lanes b)
{
    return lanes_choose(lanes_above(b, a), a, b);
}

INLINE bool lanes_any(LaneMask mask)
{
    long long any = 0;
    for (int l = 0; l < LANES; l++)
        any |= mask[l];
    return any != 0;
}

#define part_add(a, b) ((a) + (b))
#define part_multiply(a, b) ((a) * (b))
#define NO_PART ((Part){0.0})

/* `couple` for each sample */
INLINE Part part_of(Couple couple)
{
    typedef double Both __attribute__((vector_size(16)));
    const Both both = {couple.of[0], couple.of[1]};
#if PART == 8
    return __builtin_shufflevector(both, both, 0, 1, 0, 1, 0, 1, 0, 1);
#elif PART == 4
    return __builtin_shufflevector(both, both, 0, 1, 0, 1);
#else
    return both;
#endif
}

/* The two numbers of each sample exchanged. */
INLINE Part part_exchanged(Part a)
{
#if PART == 8
    return __builtin_shufflevector(a, a, 1, 0, 3, 2, 5, 4, 7, 6);
#elif PART == 4
    return __builtin_shufflevector(a, a, 1, 0, 3, 2);
#else
    return __builtin_shufflevector(a, a, 1, 0);
#endif
}

/* Parts with a sample's number twice. */
INLINE void spread_lanes(Lanes a, Part to[PARTS])
{
#if PART == 8
    to[0] = __builtin_shufflevector(a, a, 0, 0, 1, 1, 2, 2, 3, 3);
    to[1] = __builtin_shufflevector(a, a, 4, 4, 5, 5, 6, 6, 7, 7);
#elif PART == 4
    to[0] = __builtin_shufflevector(a, a, 0, 0, 1, 1);
    to[1] = __builtin_shufflevector(a, a, 2, 2, 3, 3);
    to[2] = __builtin_shufflevector(a, a, 4, 4, 5, 5);
    to[3] = __builtin_shufflevector(a, a, 6, 6, 7, 7);
#else
    to[0] = __builtin_shufflevector(a, a, 0, 0);
    to[1] = __builtin_shufflevector(a, a, 1, 1);
    to[2] = __builtin_shufflevector(a, a, 2, 2);
    to[3] = __builtin_shufflevector(a, a, 3, 3);
    to[4] = __builtin_shufflevector(a, a, 4, 4);
    to[5] = __builtin_shufflevector(a, a, 5, 5);
    to[6] = __builtin_shufflevector(a, a, 6, 6);
    to[7] = __builtin_shufflevector(a, a, 7, 7);
#endif
}

/* The sums of the samples in two parts. */
#if PART == 8
#define SUMS_OF(a, b)                                                                                                  \
    (__builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14) +                                                        \
     __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15))
#elif PART == 4
#define SUMS_OF(a, b) (__builtin_shufflevector(a, b, 0, 2, 4, 6) + __builtin_shufflevector(a, b, 1, 3, 5, 7))
#else
#define SUMS_OF(a, b) (__builtin_shufflevector(a, b, 0, 2) + __builtin_shufflevector(a, b, 1, 3))
#endif

/* Of each sample the sum of its two. */
INLINE Lanes sum_couples(const Part parts[PARTS])
{
#if PART == 8
    return SUMS_OF(parts[0], parts[1]);
#elif PART == 4
    const Part lower = SUMS_OF(parts[0], parts[1]);
    const Part upper = SUMS_OF(parts[2], parts[3]);
    return __builtin_shufflevector(lower, upper, 0, 1, 2, 3, 4, 5, 6, 7);
#else
    typedef double Half __attribute__((vector_size(4 * LANES)));
    const Part first = SUMS_OF(parts[0], parts[1]);
    const Part second = SUMS_OF(parts[2], parts[3]);
    const Part third = SUMS_OF(parts[4], parts[5]);
    const Part fourth = SUMS_OF(parts[6], parts[7]);
    const Half lower = __builtin_shufflevector(first, second, 0, 1, 2, 3);
    const Half upper = __builtin_shufflevector(third, fourth, 0, 1, 2, 3);
    return __builtin_shufflevector(lower, upper, 0, 1, 2, 3, 4, 5, 6, 7);
#endif
}

#else

typedef struct {
    double of[LANES];
} Lanes;
typedef struct {
    int of[LANES];
} LaneMask;
typedef struct {
    double of[PART];
} Part;

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
LANES_FUNCTION(Lanes, LANES, lanes_divide, (Lanes a, Lanes b), a.of[l] / b.of[l])
LANES_FUNCTION(LaneMask, LANES, lanes_above, (Lanes a, Lanes b), a.of[l] > b.of[l])
LANES_FUNCTION(LaneMask, LANES, lanes_both, (LaneMask a, LaneMask b), a.of[l] & b.of[l])
LANES_FUNCTION(LaneMask, LANES, lanes_either, (LaneMask a, LaneMask b), a.of[l] | b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_choose, (LaneMask mask, Lanes a, Lanes b), mask.of[l] ? a.of[l] : b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_larger, (Lanes a, Lanes b), a.of[l] > b.of[l] ? a.of[l] : b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_smaller, (Lanes a, Lanes b), a.of[l] < b.of[l] ? a.of[l] : b.of[l])
LANES_FUNCTION(Lanes, LANES, lanes_magnitude, (Lanes a), fabs(a.of[l]))
LANES_FUNCTION(Lanes, LANES, sum_couples, (const Part *parts),
               parts[2 * l / PART].of[2 * l % PART] + parts[2 * l / PART].of[2 * l % PART + 1])
LANES_FUNCTION(Part, PART, part_add, (Part a, Part b), a.of[l] + b.of[l])
LANES_FUNCTION(Part, PART, part_multiply, (Part a, Part b), a.of[l] * b.of[l])
LANES_FUNCTION(Part, PART, part_of, (Couple couple), couple.of[l % 2])
LANES_FUNCTION(Part, PART, part_exchanged, (Part a), a.of[l ^ 1])
#define NO_PART ((Part){{0.0}})

INLINE bool lanes_any(LaneMask mask)
{
    int any = 0;
    for (int l = 0; l < LANES; l++)
        any |= mask.of[l];
    return any != 0;
}

INLINE void spread_lanes(Lanes a, Part to[PARTS])
{
    for (int k = 0; k < 2 * LANES; k++)
        to[k / PART].of[k % PART] = a.of[k / 2];
}

#endif

#define lanes_add_product(sum, a, b) lanes_add(sum, lanes_multiply(a, b))
#define part_add_product(sum, a, b) part_add(sum, part_multiply(a, b))

INLINE void set_lane(Lanes *lanes, size_t lane, double value)
{
    ((double *)lanes)[lane] = value;
}

INLINE double get_lane(const Lanes *lanes, size_t lane)
{
    return ((const double *)lanes)[lane];
}

INLINE Lanes lanes_root(Lanes a)
{
    for (size_t lane = 0; lane < LANES; lane++)
        set_lane(&a, lane, sqrt(get_lane(&a, lane)));
    return a;
}

/* One of the two numbers of a sample; `apart` lie the parts from one another. */
INLINE void set_member(Part *parts, size_t apart, size_t lane, size_t member, double value)
{
    const size_t number = 2 * lane + member;
    ((double *)(parts + number / PART * apart))[number % PART] = value;
}

#endif
