/* Complex numbers side by side, one of each sample. */
#ifndef FLEXBEAMS_COMPLEX_LANES_H
#define FLEXBEAMS_COMPLEX_LANES_H

#include "lanes.h"

typedef struct {
    Lanes real;
    Lanes imaginary;
} Complex;

#define NO_COMPLEX ((Complex){lanes_of(0.0), lanes_of(0.0)})

INLINE Complex times(Complex a, Complex b)
{
    return (Complex){lanes_subtract(lanes_multiply(a.real, b.real), lanes_multiply(a.imaginary, b.imaginary)),
                     lanes_add(lanes_multiply(a.real, b.imaginary), lanes_multiply(a.imaginary, b.real))};
}

INLINE Complex scaled(Lanes factor, Complex a)
{
    return (Complex){lanes_multiply(factor, a.real), lanes_multiply(factor, a.imaginary)};
}

INLINE Complex plus(Complex a, Complex b)
{
    return (Complex){lanes_add(a.real, b.real), lanes_add(a.imaginary, b.imaginary)};
}

INLINE Complex minus(Complex a, Complex b)
{
    return (Complex){lanes_subtract(a.real, b.real), lanes_subtract(a.imaginary, b.imaginary)};
}

/* a of the lanes where the condition holds, b of the others */
INLINE Complex chosen(LaneMask condition, Complex a, Complex b)
{
    return (Complex){lanes_choose(condition, a.real, b.real), lanes_choose(condition, a.imaginary, b.imaginary)};
}

/* |a|^2 */
INLINE Lanes square_of(Complex a)
{
    return lanes_add(lanes_multiply(a.real, a.real), lanes_multiply(a.imaginary, a.imaginary));
}

INLINE Complex quotient(Complex a, Complex b)
{
    const Complex conjugate = minus((Complex){b.real, lanes_of(0.0)}, (Complex){lanes_of(0.0), b.imaginary});
    return scaled(lanes_divide(lanes_of(1.0), square_of(b)), times(a, conjugate));
}

#endif
