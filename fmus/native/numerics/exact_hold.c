#include "exact_hold.h"

#include <math.h>
#include <stddef.h>

#define SMALL_SQUARE 0.25      /* |l|^2 up to which the series of phi2 is taken */
#define SMALLEST_REAL (-700.0) /* part of l: beyond, exp(l) is 0 to rounding */
#define LARGEST_SQUARE 1e18    /* |l|^2 beyond which whole turns are taken off first */
#define TURN 6.283185307179586

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
static inline HoldFunctions by_definition(TwoComplex l, TwoComplex inverse, double step, bool with_ramp)
{
    const TwoComplex growth = add_real(scale_complex(on_unit_circle(l.imaginary), pair_exponential(l.real)), -1.0);
    const TwoComplex hold = multiply_complex(growth, inverse);
    if (!with_ramp)
        return (HoldFunctions){growth, hold, {pair_of(0.0), pair_of(0.0)}};
    const TwoComplex ramp = scale_complex(multiply_complex(add_real(hold, -step), inverse), pair_of(1 / step));
    return (HoldFunctions){growth, hold, ramp};
}

HoldFunctions hold_functions(TwoComplex eigenvalue, TwoComplex inverse, double step, bool with_ramp)
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
    const HoldFunctions direct = by_definition(l, inverse, step, with_ramp);
    if (squares[0] > SMALL_SQUARE && squares[1] > SMALL_SQUARE)
        return direct;
    const HoldFunctions series = by_series(l, square, step);
    const HoldFunctions first = squares[0] > SMALL_SQUARE ? direct : series;
    const HoldFunctions second = squares[1] > SMALL_SQUARE ? direct : series;
    return (HoldFunctions){join_complex(first.growth, second.growth), join_complex(first.hold, second.hold),
                           join_complex(first.ramp, second.ramp)};
}
