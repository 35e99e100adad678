/* Standard normal numbers, in any order. */

#ifndef NORMAL_NUMBER_H
#define NORMAL_NUMBER_H

#include <stdint.h>

#include "internal.h"

/* A standard normal number for a seed, sample and channel: order and step size do not matter (Box-Muller). */
INTERNAL double normal_number(uint64_t seed, uint64_t tick, uint64_t channel);

#endif
