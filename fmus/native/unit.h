/* What the FMI functions, the mathematics of a unit and its generated tables know of each other.

   A unit is one set of the functions and tables declared here. Names shared between files are hidden, and
   carry the unit's function prefix where it has one, so that several units link into one program. */

#ifndef UNIT_H
#define UNIT_H

#include <stdbool.h>
#include <stddef.h>

#include "fmi2Functions.h"

#if defined(__GNUC__) && !defined(_WIN32)
#define SHARED extern __attribute__((visibility("hidden")))
#else
#define SHARED extern
#endif

/* Begins a table on a cache line, where the compiler can be told to. */
#if defined(__GNUC__)
#define ALIGNED __attribute__((aligned(64)))
#else
#define ALIGNED
#endif

#define NAME_SIZE 48   /* bytes of a variable's name with its end */
#define DIGEST_SIZE 32
#define TEXT_SIZE 256  /* bytes of a string variable or of a line in the log */

/* Tables */

enum type { REAL, INTEGER, BOOLEAN, STRING };
enum causality { INDEPENDENT, PARAMETER, INPUT, OUTPUT, LOCAL };

/* A variable's kind in one byte: type | causality << 2 | FIXED | DEFERRED. */
enum { TYPE_MASK = 3, CAUSALITY_SHIFT = 2, CAUSALITY_MASK = 7, FIXED = 32, DEFERRED = 64 };

typedef struct {
    double start;             /* of a string, its place in unit_texts */
    double minimum, maximum;  /* infinite where there is none */
    char name[NAME_SIZE];
} variable;

#define unit_variable_count fmi2FullName(unit_variable_count)
#define unit_kinds fmi2FullName(unit_kinds)
#define unit_variables fmi2FullName(unit_variables)
#define unit_texts fmi2FullName(unit_texts)
#define unit_guid fmi2FullName(unit_guid)
#define unit_digest fmi2FullName(unit_digest)
#define unit_step_size fmi2FullName(unit_step_size)
#define unit_interpolates_inputs fmi2FullName(unit_interpolates_inputs)

SHARED const size_t unit_variable_count;
SHARED const unsigned char unit_kinds[];    /* by value reference */
SHARED const variable unit_variables[];     /* by value reference */
SHARED const char unit_texts[][TEXT_SIZE];
SHARED const char unit_guid[];
SHARED const unsigned char unit_digest[DIGEST_SIZE]; /* of the unit's contents, in saved states */
SHARED const double unit_step_size;         /* s, the declared communication step */
SHARED const bool unit_interpolates_inputs;

/* An instance as its mathematics sees it */

typedef struct {
    double *values;        /* of each variable but strings, at its value reference */
    const double *slopes;  /* d/dt of each input during the step, NULL where all are zero */
    double *state;         /* saved and restored together with the values */
    double *workspace;     /* zero at first; only what follows from values and state */
} unit;

/* Hooks of the mathematics. Those that return bool call unit_refuse where they fail. */

#define unit_state_size fmi2FullName(unit_state_size)
#define unit_workspace_size fmi2FullName(unit_workspace_size)
#define unit_initialise fmi2FullName(unit_initialise)
#define unit_prepare fmi2FullName(unit_prepare)
#define unit_restore fmi2FullName(unit_restore)
#define unit_advance fmi2FullName(unit_advance)
#define unit_complete fmi2FullName(unit_complete)

SHARED size_t unit_state_size(void);      /* number of doubles */
SHARED size_t unit_workspace_size(void);  /* number of doubles */

/* First state and outputs from parameters and inputs; runs again where these change before the first step. */
SHARED bool unit_initialise(unit *unit);
/* What a step of this size needs, so that the first one takes no longer than the others. */
SHARED bool unit_prepare(unit *unit, double step);
/* After values and state were replaced by saved ones. */
SHARED bool unit_restore(unit *unit);
/* State and outputs from `time` to `time + step` (s), inputs held or, with slopes, growing linearly. */
SHARED bool unit_advance(unit *unit, double time, double step);
/* The deferred variables, for the present state. */
SHARED void unit_complete(unit *unit);

/* Services for the mathematics. Formats as in text.h. */

#define unit_refuse fmi2FullName(unit_refuse)
#define unit_warn fmi2FullName(unit_warn)
#define unit_note fmi2FullName(unit_note)

SHARED bool unit_refuse(unit *unit, const char *format, ...);  /* false */
SHARED void unit_warn(unit *unit, const char *format, ...);
SHARED void unit_note(unit *unit, const char *format, ...);

#endif
