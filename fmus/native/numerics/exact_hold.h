/* A step of h of x' = a x + b v for an eigenvalue a, exact for an input v that grows linearly: with l = a h,
   x(t + h) = x(t) + (exp(l) - 1) x(t) + h phi1(l) b v(t) + h phi2(l) b (v(t + h) - v(t)),
   phi1(l) = (exp(l) - 1) / l, phi2(l) = (phi1(l) - 1) / l. */

#ifndef EXACT_HOLD_H
#define EXACT_HOLD_H

#include <stdbool.h>

#include "two_complex.h"

typedef struct {
    TwoComplex growth; /* exp(l) - 1 */
    TwoComplex hold;   /* h phi1(l) */
    TwoComplex ramp;   /* h phi2(l), meaningless where it is not asked for */
} HoldFunctions;

/* For two eigenvalues, 1/s, and their inverses, which do not matter where an eigenvalue is 0. To rounding for
   eigenvalues of any size whose real part times h is not above 700. */
INTERNAL HoldFunctions hold_functions(TwoComplex eigenvalue, TwoComplex inverse, double step, bool with_ramp);

#endif
