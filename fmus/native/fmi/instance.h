/* An instance as the FMI functions see it. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include "clock.h"
#include "fmi2Functions.h"
#include "unit.h"

#define DIGEST_SIZE 32

typedef enum { REAL, INTEGER, BOOLEAN, STRING } VariableType;
typedef enum { INDEPENDENT, PARAMETER, INPUT, OUTPUT, LOCAL } Causality;

/* A variable's kind in one byte: type | causality << 2 | FIXED | DEFERRED. */
enum { TYPE_MASK = 3, CAUSALITY_SHIFT = 2, CAUSALITY_MASK = 7, FIXED = 32, DEFERRED = 64 };

/* Variables in a row that a step computes. */
typedef struct {
    size_t first; /* value reference */
    size_t count;
} Results;

/* A unit: its variables, as in modelDescription.xml, and its mathematics. */
typedef struct {
    const UnitHooks *hooks;
    const void *data; /* tables of the mathematics */
    const char *guid;
    unsigned char digest[DIGEST_SIZE]; /* of the unit's contents, in saved states */
    double step_size;                  /* s, the declared communication step */
    bool interpolates_inputs;
    bool provides_derivatives; /* directional ones */
    size_t variable_count;
    const unsigned char *kinds;     /* (variable_count,) by value reference */
    const Variable *variables;      /* (variable_count,) by value reference */
    const char (*texts)[TEXT_SIZE]; /* the string variables */
    size_t result_count;
    const Results *results; /* (result_count,) what a step computes at once, ascending */
} UnitDescription;

/* The unit that this file is compiled into; its tables define it. */
SHARED const UnitDescription this_unit;

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

typedef struct {
    Phase phase;
    Clock clock;
    bool sloped;             /* input derivatives were given for the next step */
    char failure[TEXT_SIZE]; /* why fmi2DoStep is refused; empty while all is well */
} Condition;

typedef struct {
    UnitInstance unit; /* first, so that the mathematics' pointer is the instance's too */
    const UnitDescription *description;
    Condition now;
    bool stale;           /* parameters or inputs were set since the unit was initialised */
    bool incomplete;      /* the deferred variables lag behind the state */
    bool warned;          /* a warning was logged in the step under way */
    bool trying;          /* what is refused now is declined: see try_refresh */
    const char *function; /* the FMI function under way */
    unsigned logged;      /* bit s is set where lines of status s go into the log */
    fmi2CallbackFunctions callbacks;
    char *name;
    double *kept;       /* results before the step under way */
    size_t saved_count; /* doubles at the start of `memory` that are saved: values, slopes and state */
    double memory[];    /* those, then workspace, kept results, changes and name */
} Instance;

/* The instance behind a component, or NULL; notes the function for the log. */
INTERNAL Instance *begin_call(fmi2Component component, const char *function);

/* One line in the log, then fmi2Error, after which no step is done until fmi2Reset or fmi2SetFMUstate. Formats as in
   format_line.h, here and below. */
INTERNAL fmi2Status refuse(Instance *instance, const char *format, ...);
/* One line in the log, then fmi2Error; nothing has happened to the instance. */
INTERNAL fmi2Status decline(Instance *instance, const char *format, ...);
/* One line in the log, then fmi2Discard. */
INTERNAL fmi2Status discard(Instance *instance, const char *format, ...);
/* The same for an argument that is NULL. */
INTERNAL fmi2Status refuse_null(Instance *instance, const char *argument);
INTERNAL fmi2Status decline_null(Instance *instance, const char *argument);
/* The log of the unit's mathematics. */
INTERNAL void log_of_unit(UnitInstance *unit, Severity severity, const char *line);

/* Is the instance in this phase? If not, the call is refused. */
INTERNAL bool require(Instance *instance, Phase phase);

/* First state and outputs for what was set since; false where it is refused. */
INTERNAL bool refresh(Instance *instance);
/* The same for a call that only reads: where it is refused, the instance goes on. */
INTERNAL bool try_refresh(Instance *instance);
/* The results of a step: keep those from before it; are the new ones finite? If not, it is refused; back to the kept.
 */
INTERNAL void keep_results(Instance *instance);
INTERNAL bool check_results(Instance *instance);
INTERNAL void take_back_results(Instance *instance);
/* Bring the deferred variables up to date. */
INTERNAL void complete(Instance *instance);

#endif
