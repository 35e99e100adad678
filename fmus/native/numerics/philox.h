/* Philox 4x64 with 10 rounds (Salmon et al. 2011): four random words for a counter and a key, in any order. */

#ifndef PHILOX_H
#define PHILOX_H

#include <stdint.h>

#include "internal.h"

/* The words of the counter (count, 0, 0, 0) with the key (low, high). */
INTERNAL void philox(uint64_t count, uint64_t low, uint64_t high, uint64_t words[4]);

#endif
