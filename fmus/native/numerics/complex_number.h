/* Complex numbers, one at a time. */

#ifndef COMPLEX_NUMBER_H
#define COMPLEX_NUMBER_H

#include "pair.h"

typedef struct {
    double real;
    double imaginary;
} Complex;

/* a b. Of a sum and a difference of plain products side by side some compilers make fused operations, allowed or not.
 */
INTERNAL_INLINE Complex complex_product(Complex a, Complex b)
{
    const Pair product = pair_multiply(pair_of(a.real), pair(b.real, b.imaginary));
    double parts[2];
    pair_store(parts, pair_add_product(product, pair(-a.imaginary, a.imaginary), pair(b.imaginary, b.real)));
    return (Complex){parts[0], parts[1]};
}

#endif
