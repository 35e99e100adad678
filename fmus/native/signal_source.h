/* The generated tables of SignalSource. */

#ifndef SIGNAL_SOURCE_H
#define SIGNAL_SOURCE_H

#include <stdint.h>

#include "unit.h"

#define source_count fmi2FullName(source_count)
#define source_signals fmi2FullName(source_signals)
#define source_numbers fmi2FullName(source_numbers)
#define source_bits fmi2FullName(source_bits)

enum kind {
    CONSTANT, STEP, PULSE, TARGETS, LINEAR_CHIRP, LOGARITHMIC_CHIRP, BINARY, LEVELS, HELD_TABLE, JOINED_TABLE
};

/* What drives some outputs. Parameters by their value references, of an array its first; 0 where there is none. */
typedef struct {
    enum kind kind;
    unsigned output;          /* value reference of the first output */
    size_t outputs;
    size_t width;             /* values: one for all outputs or one for each */
    unsigned time, duration;  /* s; of targets the time of each row */
    unsigned value;           /* (width,), of targets (rows, width); of a pulse its integral, else the amplitude */
    unsigned first, last;     /* frequencies of a chirp, Hz; the first alone: how long a level holds, s */
    size_t rows;              /* of targets and tables; of a binary sequence its period */
    size_t data;              /* place of a table in source_numbers: times (rows,), then values (rows, width) */
    size_t begin;             /* of a binary sequence, its number within the period at the start */
    uint64_t seed;            /* of levels */
} source_signal;

SHARED const size_t source_count;
SHARED const source_signal source_signals[];
SHARED const double source_numbers[];
SHARED const unsigned char source_bits[];  /* the binary sequences, each from a whole byte on, bit 0 first */

#endif
