/* The generated tables of BeamClosedLoop, and what its parts and it know of each other. */

#ifndef CLOSED_LOOP_H
#define CLOSED_LOOP_H

#include "unit.h"

/* The sources of a part carry names of their own, see part.h; what is declared here belongs to the whole. */
#ifndef WHOLE
#define WHOLE(name) fmi2FullName(name)
#endif

#define loop_part_count WHOLE(loop_part_count)
#define loop_parts WHOLE(loop_parts)
#define loop_wire_count WHOLE(loop_wire_count)
#define loop_wires WHOLE(loop_wires)
#define loop_is_sequential WHOLE(loop_is_sequential)
#define loop_mathematics WHOLE(loop_mathematics)
#define part_refuse WHOLE(part_refuse)
#define part_warn WHOLE(part_warn)
#define part_note WHOLE(part_note)

typedef struct {
    size_t values;                  /* value reference of its time, which its other variables follow */
    size_t first_wire, wire_count;  /* the wires that lead to it */
    char name[NAME_SIZE];
} loop_part;

/* Inputs that take the values of outputs, `count` of each that follow each other; value references of the first. */
typedef struct {
    size_t from, to, count;
} loop_wire;

/* The hooks of unit.h, those of one part. */
typedef struct {
    size_t (*state_size)(void), (*workspace_size)(void);
    bool (*initialise)(unit *unit), (*prepare)(unit *unit, double step), (*restore)(unit *unit);
    bool (*advance)(unit *unit, double time, double step);
    void (*complete)(unit *unit);
} mathematics;

SHARED const size_t loop_part_count;
SHARED const loop_part loop_parts[];     /* in the order in which they step */
SHARED const size_t loop_wire_count;
SHARED const loop_wire loop_wires[];
SHARED const bool loop_is_sequential;    /* Gauss-Seidel: a part takes the newest values; else all take those of t_k */
SHARED mathematics loop_mathematics(size_t part);

/* unit_refuse, unit_warn and unit_note for the mathematics of a part. */
SHARED bool part_refuse(unit *unit, const char *format, ...);  /* false */
SHARED void part_warn(unit *unit, const char *format, ...);
SHARED void part_note(unit *unit, const char *format, ...);

#endif
