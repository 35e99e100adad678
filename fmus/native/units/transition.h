/* The smooth transition Theta of (37): the integral of exp(-(tau (1 - tau))^-g), normalised to Theta(1) = 1. */

#ifndef TRANSITION_H
#define TRANSITION_H

#include <stddef.h>

#include "pair.h"

#define LOCAL_TERMS 16 /* that carry Theta from a node of its table to its neighbourhood without loss */

typedef struct {
    double exponent;     /* g */
    double norm;         /* the integral before it is normalised */
    size_t nodes;        /* intervals of the table */
    const double *table; /* (nodes + 1,): Theta at tau = i / nodes */
} Transition;

/* Highest power of the series that gives the coefficients up to `degree`. */
INTERNAL size_t transition_terms(size_t degree);

/* Two transitions side by side: Taylor coefficients Theta^(i)(tau) unit^i / i!, i = 0 ... degree, at two `tau` within
   [0, 1], in pairs; returns the units, at most tau (1 - tau), which keep them within the range of doubles. With terms =
   transition_terms(degree) `coefficients` has room for 2 (terms + 1) doubles, `scratch` for 4 terms. */
INTERNAL Pair transition_series(const Transition *transition, const double tau[2], size_t degree, double *coefficients,
                                double *scratch);

#endif
