/* The contract between the mathematics of a unit and whoever runs it: the FMI functions, or a closed loop that it is
   a part of. It knows no FMI. A new kind of unit is a set of UnitHooks and a struct for its tables. */

#ifndef UNIT_H
#define UNIT_H

#include <stdbool.h>
#include <stddef.h>

#include "internal.h"

#define NAME_SIZE 48  /* bytes of a variable's name with its end */
#define TEXT_SIZE 256 /* bytes of a string variable or of a line in the log */

typedef struct {
    double start;   /* of a string, its index in the unit's texts */
    double minimum; /* -DBL_MAX where there is none */
    double maximum; /* DBL_MAX where there is none */
    char name[NAME_SIZE];
} Variable;

typedef enum { NOTE, WARNING, REFUSAL } Severity;

typedef struct UnitHooks UnitHooks;
typedef struct UnitInstance UnitInstance;

/* An instance as its mathematics sees it. */
struct UnitInstance {
    const UnitHooks *hooks;
    const void *data;          /* tables of the mathematics, such as a BeamPlantData */
    const Variable *variables; /* by value reference */
    double step_size;          /* s, the declared communication step */
    double start;              /* s, the time at which the instance starts */
    double elapsed;            /* s since then, at the end of the last step */
    double *values;            /* of each variable but strings, by value reference; the first is the time in s */
    const double *slopes;      /* d/dt of each input during the step, NULL where all are zero */
    double *state;             /* saved and restored together with the values */
    double *workspace;         /* zero at first; only what follows from values and state */
    double *changes;           /* of each variable, for `differentiate` */
    void (*log)(UnitInstance *unit, Severity severity, const char *line);
};

/* What the mathematics of a unit does. NULL in place of a hook that has nothing to do; `initialise` and `advance` must
   be there. Hooks that return bool call unit_refuse where they fail. */
struct UnitHooks {
    /* Doubles of the state and of the workspace. */
    size_t (*state_size)(const void *data);
    size_t (*workspace_size)(const void *data);
    /* First state and outputs from parameters and inputs; runs again where these change before the first step. */
    bool (*initialise)(UnitInstance *unit);
    /* The changes of Real outputs that `initialise`, which has just run, computes for the changes of inputs and
       parameters: its derivative times these, written over the zeros of the outputs. */
    void (*differentiate)(UnitInstance *unit);
    /* What a step of this size (s) needs, so that the first one takes no longer than the others. */
    bool (*prepare)(UnitInstance *unit, double step);
    /* After values and state were replaced by saved ones. */
    bool (*restore)(UnitInstance *unit);
    /* State and outputs from `time` to `time + step` (s since the start), inputs held or, with slopes, growing
       linearly. */
    bool (*advance)(UnitInstance *unit, double time, double step);
    /* The deferred variables, for the present state. */
    void (*complete)(UnitInstance *unit);
};

/* The hooks with NULL as none: for whoever runs a unit. */
INTERNAL size_t unit_state_size(const UnitHooks *hooks, const void *data);
INTERNAL size_t unit_workspace_size(const UnitHooks *hooks, const void *data);
INTERNAL bool unit_prepare(UnitInstance *unit, double step);
INTERNAL bool unit_restore(UnitInstance *unit);
INTERNAL void unit_complete(UnitInstance *unit);

/* How far a time (s since the start) may be from a multiple of `tick` (s) and mean it: rounding of the host's clock. */
INTERNAL double clock_tolerance(const UnitInstance *unit, double time, double tick);

/* Lines for the log: for the mathematics. Formats as in format_line.h. */
INTERNAL bool unit_refuse(UnitInstance *unit, const char *format, ...); /* false */
INTERNAL void unit_warn(UnitInstance *unit, const char *format, ...);
INTERNAL void unit_note(UnitInstance *unit, const char *format, ...);

#endif
