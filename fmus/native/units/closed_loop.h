/* The tables of BeamClosedLoop: units wired to each other as one unit. */

#ifndef CLOSED_LOOP_H
#define CLOSED_LOOP_H

#include "unit.h"

typedef struct {
    const UnitHooks *hooks;
    const void *data;  /* tables of the part's own mathematics */
    double step_size;  /* s, of the part on its own */
    size_t values;     /* value reference of its time, which its other variables follow */
    size_t first_wire; /* of those that lead to it */
    size_t wire_count; /* of those that lead to it */
    char name[NAME_SIZE];
} LoopPart;

/* Inputs that take the values of outputs, `count` of each that follow each other; value references of the first. */
typedef struct {
    size_t from;
    size_t to;
    size_t count;
    double minimum; /* of the inputs */
    double maximum;
} LoopWire;

typedef struct {
    size_t part_count;
    const LoopPart *parts; /* (part_count,) in the order in which they step */
    size_t wire_count;
    const LoopWire *wires; /* (wire_count,) */
    bool is_sequential;    /* Gauss-Seidel: a part takes the newest values; else all take those of t_k */
} ClosedLoopData;

SHARED const UnitHooks closed_loop_hooks;

#endif
