/* An instance as the FMI functions see it. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include "unit.h"

enum phase { INSTANTIATED, INITIALISING, STEPPING, TERMINATED };

typedef struct {
    enum phase phase;
    double time;              /* s */
    bool sloped;              /* input derivatives were given for the next step */
    char failure[TEXT_SIZE];  /* why fmi2DoStep is refused; empty while all is well */
} condition;

typedef struct {
    unit unit;             /* first, so that the mathematics' pointer is the instance's too */
    condition now;
    bool stale;            /* parameters or inputs were set since unit_initialise */
    bool incomplete;       /* the deferred variables lag behind the state */
    const char *function;  /* the FMI function under way */
    unsigned logged;       /* bit s is set where lines of status s go into the log */
    fmi2CallbackFunctions callbacks;
    char *name;
    double memory[];       /* values, slopes and state, which are saved; workspace; name */
} instance;

#define saved_count fmi2FullName(saved_count)
#define entered fmi2FullName(entered)
#define refuse fmi2FullName(refuse)
#define decline fmi2FullName(decline)
#define discard fmi2FullName(discard)
#define refuse_null fmi2FullName(refuse_null)
#define require fmi2FullName(require)
#define refresh fmi2FullName(refresh)
#define complete fmi2FullName(complete)

SHARED size_t saved_count(void);  /* doubles at the start of `memory` that are saved */

/* The instance behind a component, or NULL; notes the function for the log. */
SHARED instance *entered(fmi2Component component, const char *function);

/* One line in the log, then fmi2Error, after which no step is done until fmi2Reset or fmi2SetFMUstate. */
SHARED fmi2Status refuse(instance *instance, const char *format, ...);
/* One line in the log, then fmi2Error; nothing has happened to the instance. */
SHARED fmi2Status decline(instance *instance, const char *format, ...);
/* One line in the log, then fmi2Discard. */
SHARED fmi2Status discard(instance *instance, const char *format, ...);
/* fmi2Error for an argument that is NULL. */
SHARED fmi2Status refuse_null(instance *instance, const char *argument);

/* Is the instance in this phase? If not, the call is refused. */
SHARED bool require(instance *instance, enum phase phase);

/* First state and outputs for what was set since; false where it is refused. */
SHARED bool refresh(instance *instance);
/* Bring the deferred variables up to date. */
SHARED void complete(instance *instance);

#endif
