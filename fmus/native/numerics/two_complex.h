/* Two complex numbers side by side, and their exponential from additions and multiplications alone: quicker than the C
   library's and with the same bits on every machine whose doubles are those of IEEE 754. */

#ifndef TWO_COMPLEX_H
#define TWO_COMPLEX_H

#include "pair.h"

typedef struct {
    Pair real;
    Pair imaginary;
} TwoComplex;

INTERNAL_INLINE TwoComplex scale_complex(TwoComplex a, Pair factor)
{
    return (TwoComplex){pair_multiply(a.real, factor), pair_multiply(a.imaginary, factor)};
}

INTERNAL_INLINE TwoComplex add_real(TwoComplex a, double b)
{
    return (TwoComplex){pair_add(a.real, pair_of(b)), a.imaginary};
}

INTERNAL_INLINE TwoComplex add_complex(TwoComplex a, TwoComplex b)
{
    return (TwoComplex){pair_add(a.real, b.real), pair_add(a.imaginary, b.imaginary)};
}

INTERNAL_INLINE TwoComplex multiply_complex(TwoComplex a, TwoComplex b)
{
    const Pair real = pair_multiply(a.real, b.real);
    const Pair imaginary = pair_multiply(a.real, b.imaginary);
    return (TwoComplex){pair_subtract_product(real, a.imaginary, b.imaginary),
                        pair_add_product(imaginary, a.imaginary, b.real)};
}

/* ((((sum x + a) x + b) x + c) x + d): written out, as not every compiler unrolls a loop of it. */
INTERNAL_INLINE Pair four_terms(Pair sum, Pair x, double a, double b, double c, double d)
{
    sum = pair_add_product(pair_of(a), sum, x);
    sum = pair_add_product(pair_of(b), sum, x);
    sum = pair_add_product(pair_of(c), sum, x);
    return pair_add_product(pair_of(d), sum, x);
}

/* exp(x): Taylor's series for |x| <= log(2) / 2, doublings beyond. */
INTERNAL_INLINE Pair pair_exponential(Pair x)
{
    const Pair doublings = pair_nearest(pair_multiply(x, pair_of(1.4426950408889634)));
    x = pair_subtract_product(x, doublings, pair_of(0x1.62e42feep-1));
    x = pair_subtract_product(x, doublings, pair_of(0x1.a39ef35793c76p-33));
    Pair sum = pair_add_product(pair_of(1 / 479001600.0), x, pair_of(1 / 6227020800.0));
    sum = four_terms(sum, x, 1 / 39916800.0, 1 / 3628800.0, 1 / 362880.0, 1 / 40320.0);
    sum = four_terms(sum, x, 1 / 5040.0, 1 / 720.0, 1 / 120.0, 1 / 24.0);
    sum = four_terms(sum, x, 1 / 6.0, 0.5, 1.0, 1.0);
    return pair_multiply(sum, pair_power_of_two(doublings));
}

/* cos(x) + i sin(x): Taylor's series for |x| <= pi / 2, half turns beyond. */
INTERNAL_INLINE TwoComplex on_unit_circle(Pair x)
{
    const Pair half_turns = pair_nearest(pair_multiply(x, pair_of(0.3183098861837907)));
    x = pair_subtract_product(x, half_turns, pair_of(0x1.921fb544p+1));
    x = pair_subtract_product(x, half_turns, pair_of(0x1.0b4611a6p-33));
    x = pair_subtract_product(x, half_turns, pair_of(0x1.3198a2e037073p-68));
    const Pair turns = pair_nearest(pair_multiply(half_turns, pair_of(0.5)));
    const Pair odd = pair_subtract_product(half_turns, turns, pair_of(2.0)); /* 0, 1 or -1 */
    const Pair sign = pair_subtract_product(pair_of(1.0), pair_multiply(odd, odd), pair_of(2.0));
    const Pair square = pair_multiply(x, x);
    Pair sine = pair_add_product(pair_of(-1 / 121645100408832000.0), square, pair_of(1 / 51090942171709440000.0));
    sine = four_terms(sine, square, 1 / 355687428096000.0, -1 / 1307674368000.0, 1 / 6227020800.0, -1 / 39916800.0);
    sine = four_terms(sine, square, 1 / 362880.0, -1 / 5040.0, 1 / 120.0, -1 / 6.0);
    Pair cosine = pair_add_product(pair_of(-1 / 6402373705728000.0), square, pair_of(1 / 2432902008176640000.0));
    cosine = four_terms(cosine, square, 1 / 20922789888000.0, -1 / 87178291200.0, 1 / 479001600.0, -1 / 3628800.0);
    cosine = four_terms(cosine, square, 1 / 40320.0, -1 / 720.0, 1 / 24.0, -0.5);
    return (TwoComplex){pair_add_product(sign, pair_multiply(sign, square), cosine),
                        pair_multiply(sign, pair_add_product(x, pair_multiply(x, square), sine))};
}

/* The first of one and the second of another. */
INTERNAL_INLINE TwoComplex join_complex(TwoComplex first, TwoComplex second)
{
    return (TwoComplex){pair_join(first.real, second.real), pair_join(first.imaginary, second.imaginary)};
}

#endif
