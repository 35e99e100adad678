/* What instructions this machine has. */
#ifndef FLEXBEAMS_PROCESSOR_LEVEL_H
#define FLEXBEAMS_PROCESSOR_LEVEL_H

#include <stdbool.h>

#include "batch.h"

/* 3 or 4 where it has those of x86-64-v3 or x86-64-v4, else 1. */
EXPORTED int processor_level(void);

#endif
