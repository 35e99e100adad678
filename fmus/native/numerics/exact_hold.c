/* Elementary functions from additions and multiplications alone: quicker than the C library's, two at once, and with
   the same bits on every machine whose doubles are those of IEEE 754. */

#include "exact_hold.h"

#include <math.h>
#include <stddef.h>

#define SMALL_SQUARE 0.25      /* |l|^2 up to which the series of phi2 is taken */
#define SMALLEST_REAL (-700.0) /* part of l: beyond, exp(l) is 0 to rounding */
#define LARGEST_SQUARE 1e18    /* |l|^2 beyond which whole turns are taken off first */
#define TURN 6.283185307179586

static inline TwoComplex scale_complex(TwoComplex a, Pair factor)
{
    return (TwoComplex){pair_multiply(a.real, factor), pair_multiply(a.imaginary, factor)};
}

static inline TwoComplex add_real(TwoComplex a, double b)
{
    return (TwoComplex){pair_add(a.real, pair_of(b)), a.imaginary};
}

static inline TwoComplex multiply_complex(TwoComplex a, TwoComplex b)
{
    const Pair real = pair_multiply(a.real, b.real);
    const Pair imaginary = pair_multiply(a.real, b.imaginary);
    return (TwoComplex){pair_subtract_product(real, a.imaginary, b.imaginary),
                        pair_add_product(imaginary, a.imaginary, b.real)};
}

/* ((((sum x + a) x + b) x + c) x + d): written out, as not every compiler unrolls a loop of it. */
static inline Pair four_terms(Pair sum, Pair x, double a, double b, double c, double d)
{
    sum = pair_add_product(pair_of(a), sum, x);
    sum = pair_add_product(pair_of(b), sum, x);
    sum = pair_add_product(pair_of(c), sum, x);
    return pair_add_product(pair_of(d), sum, x);
}

/* exp(x): Taylor's series for |x| <= log(2) / 2, doublings beyond. */
static inline Pair pair_exponential(Pair x)
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
static inline TwoComplex on_unit_circle(Pair x)
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

/* For |l| <= 1/2: phi2(l) = sum_k l^k / (k + 2)!, a real polynomial, by division by (x - l)(x - l*). */
static inline HoldFunctions by_series(TwoComplex l, Pair square, double step)
{
    static const double coefficients[] = {
        1 / 1307674368000.0, 1 / 87178291200.0, 1 / 6227020800.0, 1 / 479001600.0, 1 / 39916800.0,
        1 / 3628800.0,       1 / 362880.0,      1 / 40320.0,      1 / 5040.0,      1 / 720.0,
        1 / 120.0,           1 / 24.0,          1 / 6.0,
    };
    const Pair twice = pair_add(l.real, l.real);
    Pair last = pair_of(0.0);
    Pair sum = pair_of(coefficients[0]);
    for (size_t k = 1; k < sizeof coefficients / sizeof *coefficients; k++) {
        const Pair next = pair_subtract_product(pair_add_product(pair_of(coefficients[k]), twice, sum), square, last);
        last = sum;
        sum = next;
    }
    const Pair constant = pair_subtract_product(pair_of(0.5), square, last);
    const TwoComplex phi2 = {pair_add_product(constant, sum, l.real), pair_multiply(sum, l.imaginary)};
    const TwoComplex phi1 = add_real(multiply_complex(l, phi2), 1.0);
    return (HoldFunctions){multiply_complex(l, phi1), scale_complex(phi1, pair_of(step)),
                           scale_complex(phi2, pair_of(step))};
}

/* h phi1(l) = (exp(l) - 1) / a and h phi2(l) = (h phi1(l) - h) / (a h) */
static inline HoldFunctions by_definition(TwoComplex l, TwoComplex inverse, double step)
{
    const TwoComplex growth = add_real(scale_complex(on_unit_circle(l.imaginary), pair_exponential(l.real)), -1.0);
    const TwoComplex hold = multiply_complex(growth, inverse);
    const TwoComplex ramp = scale_complex(multiply_complex(add_real(hold, -step), inverse), pair_of(1 / step));
    return (HoldFunctions){growth, hold, ramp};
}

static inline TwoComplex join_complex(TwoComplex first, TwoComplex second)
{
    return (TwoComplex){pair_join(first.real, second.real), pair_join(first.imaginary, second.imaginary)};
}

HoldFunctions hold_functions(TwoComplex eigenvalue, TwoComplex inverse, double step)
{
    TwoComplex l = scale_complex(eigenvalue, pair_of(step));
    l.real = pair_maximum(l.real, pair_of(SMALLEST_REAL));
    const Pair square = pair_add_product(pair_multiply(l.real, l.real), l.imaginary, l.imaginary);
    double squares[2];
    pair_store(squares, square);
    if (squares[0] <= SMALL_SQUARE && squares[1] <= SMALL_SQUARE)
        return by_series(l, square, step);
    if (!(squares[0] <= LARGEST_SQUARE && squares[1] <= LARGEST_SQUARE)) {
        double angles[2];
        pair_store(angles, l.imaginary);
        l.imaginary = pair(fmod(angles[0], TURN), fmod(angles[1], TURN));
    }
    const HoldFunctions direct = by_definition(l, inverse, step);
    if (squares[0] > SMALL_SQUARE && squares[1] > SMALL_SQUARE)
        return direct;
    const HoldFunctions series = by_series(l, square, step);
    const HoldFunctions first = squares[0] > SMALL_SQUARE ? direct : series;
    const HoldFunctions second = squares[1] > SMALL_SQUARE ? direct : series;
    return (HoldFunctions){join_complex(first.growth, second.growth), join_complex(first.hold, second.hold),
                           join_complex(first.ramp, second.ramp)};
}
