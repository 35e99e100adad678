/* Four doubles side by side, one of each of four samples. Where there are no vector types the same operations on plain
   doubles give the same bits. */
#ifndef FLEXBEAMS_LANES_H
#define FLEXBEAMS_LANES_H

#define LANES 4

#if defined(__GNUC__)
#define INLINE static inline __attribute__((unused, always_inline))
#else
#define INLINE static inline
#endif

#if defined(__GNUC__) && (defined(__SSE2__) || defined(__aarch64__))

typedef double Lanes __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));
typedef long long LaneBits __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));

#define lanes_of(value) ((Lanes){(value), (value), (value), (value)})
#define lanes_add(a, b) ((a) + (b))
#define lanes_subtract(a, b) ((a) - (b))
#define lanes_multiply(a, b) ((a) * (b))
/* a of the lanes where the condition holds, b of the others */
#define lanes_choose(condition, a, b) ((Lanes)(((condition) & (LaneBits)(a)) | (~(condition) & (LaneBits)(b))))
#define lanes_larger(a, b) lanes_choose((LaneBits)((a) > (b)), a, b)
#define lanes_smaller(a, b) lanes_choose((LaneBits)((a) < (b)), a, b)
/* b in place of a where b > a; NaN in b stays */
#define lanes_above(a, b) ((LaneBits)((a) > (b)))
#define lanes_both(a, b) ((a) & (b))
#define lanes_either(a, b) ((a) | (b))
typedef LaneBits LaneMask;

#else

typedef struct {
    double of[LANES];
} Lanes;
typedef struct {
    int of[LANES];
} LaneMask;

INLINE Lanes lanes_of(double value)
{
    return (Lanes){{value, value, value, value}};
}

#define LANES_OPERATION(name, expression)                                                                              \
    INLINE Lanes name(Lanes a, Lanes b)                                                                                \
    {                                                                                                                  \
        Lanes result;                                                                                                  \
        for (int l = 0; l < LANES; l++)                                                                                \
            result.of[l] = expression;                                                                                 \
        return result;                                                                                                 \
    }
LANES_OPERATION(lanes_add, a.of[l] + b.of[l])
LANES_OPERATION(lanes_subtract, a.of[l] - b.of[l])
LANES_OPERATION(lanes_multiply, a.of[l] * b.of[l])
LANES_OPERATION(lanes_larger, a.of[l] > b.of[l] ? a.of[l] : b.of[l])
LANES_OPERATION(lanes_smaller, a.of[l] < b.of[l] ? a.of[l] : b.of[l])

INLINE LaneMask lanes_above(Lanes a, Lanes b)
{
    LaneMask mask;
    for (int l = 0; l < LANES; l++)
        mask.of[l] = a.of[l] > b.of[l];
    return mask;
}

INLINE LaneMask lanes_both(LaneMask a, LaneMask b)
{
    LaneMask mask;
    for (int l = 0; l < LANES; l++)
        mask.of[l] = a.of[l] & b.of[l];
    return mask;
}

INLINE LaneMask lanes_either(LaneMask a, LaneMask b)
{
    LaneMask mask;
    for (int l = 0; l < LANES; l++)
        mask.of[l] = a.of[l] | b.of[l];
    return mask;
}

INLINE Lanes lanes_choose(LaneMask mask, Lanes a, Lanes b)
{
    Lanes result;
    for (int l = 0; l < LANES; l++)
        result.of[l] = mask.of[l] ? a.of[l] : b.of[l];
    return result;
}

#endif

#define lanes_add_product(sum, a, b) lanes_add(sum, lanes_multiply(a, b))

#endif
