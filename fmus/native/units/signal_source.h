/* The tables of SignalSource. */

#ifndef SIGNAL_SOURCE_H
#define SIGNAL_SOURCE_H

#include <stdint.h>

#include "unit.h"

typedef enum {
    CONSTANT,
    STEP,
    PULSE,
    TARGETS,
    LINEAR_CHIRP,
    LOGARITHMIC_CHIRP,
    BINARY,
    LEVELS,
    HELD_TABLE,
    JOINED_TABLE
} SignalKind;

/* What drives some outputs. Parameters by their value references, of an array its first; 0 where there is none. */
typedef struct {
    SignalKind kind;
    unsigned output; /* value reference of the first output */
    size_t outputs;
    size_t width;      /* values: one for all outputs or one for each */
    unsigned time;     /* s; of targets the time of each row */
    unsigned duration; /* s */
    unsigned value;    /* (width,), of targets (rows, width); of a pulse its integral, else the amplitude */
    unsigned first;    /* first frequency of a chirp, Hz; of levels how long each holds, s */
    unsigned last;     /* last frequency of a chirp, Hz */
    size_t rows;       /* of targets and tables; of a binary sequence its period */
    size_t data;       /* index of a table in `numbers`: times (rows,), then values (rows, width); of a binary sequence
                          that of its first byte in `bits` */
    size_t begin;      /* of a binary sequence, its number within the period at the start */
    uint64_t seed;     /* of levels */
} SourceSignal;

typedef struct {
    size_t signal_count;
    const SourceSignal *signals; /* (signal_count,) */
    const double *numbers;
    const unsigned char *bits; /* the binary sequences, each from a whole byte on, bit 0 first */
} SignalSourceData;

SHARED const UnitHooks signal_source_hooks;

#endif
