/* Stepping loop of coupled FMI 2.0 co-simulation instances, in blocks of steps; the caller owns all memory. */
#ifndef FLEXBEAMS_STEPPER_H
#define FLEXBEAMS_STEPPER_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* Receives a formatted log line. */
typedef void (*LogLine)(int status, const char *line);
/* A logger of FMI 2.0, whose message has arguments as printf's. */
typedef void (*Logger)(void *environment, const char *instance, int status, const char *category, const char *message,
                       ...);

typedef int (*GetReals)(void *component, const unsigned int *references, size_t n, double *values);
typedef int (*SetReals)(void *component, const unsigned int *references, size_t n, const double *values);
typedef int (*GetIntegers)(void *component, const unsigned int *references, size_t n, int *values);
typedef int (*SetIntegers)(void *component, const unsigned int *references, size_t n, const int *values);
typedef int (*DoStep)(void *component, double time, double step, int no_restore);

/* Consecutive signals. */
typedef struct {
    int64_t first;
    int64_t count;
} SignalSpan;

/* An input that takes factor * signal + offset. */
typedef struct {
    int64_t input; /* number among all inputs */
    double factor;
    double offset;
} SignalConversion;

/* Value references of the variables of each type; Enumerations are Integers. */
typedef struct {
    const unsigned int *reals;
    size_t n_reals;
    const unsigned int *integers;
    size_t n_integers;
    const unsigned int *booleans;
    size_t n_booleans;
} TypedReferences;

/* One instance of a unit: its functions, and which signals its variables are. */
typedef struct {
    void *component;
    GetReals get_real;
    SetReals set_real;
    GetIntegers get_integer;
    GetIntegers get_boolean;
    DoStep do_step;
    SetIntegers set_integer;
    SetIntegers set_boolean;
    TypedReferences written;   /* inputs */
    const SignalSpan *sources; /* signals of the inputs, in their order: Real, then Integer, then Boolean ones */
    size_t n_sources;
    const SignalConversion *conversions;
    size_t n_conversions;
    double *inputs;       /* scratch, one value an input */
    TypedReferences read; /* outputs */
    int *scratch;         /* one value an Integer or Boolean input or output, whichever are more */
    int64_t first_output; /* first signal: Real outputs, then Integer, then Boolean ones */
} SteppedUnit;

/* A run: signals are all outputs by instance, then the external ones, then those that the caller holds. */
typedef struct {
    SteppedUnit *units;
    size_t n_units;
    int gauss_seidel;  /* 0: Jacobi, all instances read the values of t_k */
    double step;       /* s */
    double start_time; /* s, of step 0 */
    double *signals;
    int64_t first_external;
    size_t n_external;          /* signals that change from step to step */
    const SignalSpan *recorded; /* signals of a row, in their order */
    size_t n_spans;
    size_t n_recorded; /* values of a row */
    int64_t done;      /* number of the present or next step */
    int64_t calls;     /* of functions of units, with the present one */
    /* how a run ended */
    int64_t failed_unit;
    int failed_function; /* 0 set, 1 step, 2 get */
    int failed_status;
} CoupledRun;

/* Lateness of a paced run in s, one entry a step; NULL runs at full speed. Times are of the monotonic clock. */
typedef struct {
    double started;          /* when step 0 was due */
    double seconds_per_step; /* of wall clock */
    double *lateness;
} Pace;

/* Steps `count` times from step number `first`, each with its row of `external` (count, n_external).
 * Before each step the recorded signals go to row ceil(number / every) of `rows`: rows hold every `every`-th step,
 * and the last one holds the newest values until then. Returns the steps done. */
EXPORTED size_t run_block(CoupledRun *run, int64_t first, size_t count, const double *external, int64_t every,
                          double *rows, const Pace *pace);

/* Steps as run_block does, with nothing recorded, and notes how long each step took, seconds (count,). */
EXPORTED size_t time_block(CoupledRun *run, int64_t first, size_t count, const double *external, double *seconds);

/* A logger that passes its lines to `receiver` until it is released; NULL where all are in use. */
EXPORTED Logger take_logger(LogLine receiver);
EXPORTED void release_logger(Logger logger);

/* Seconds of the clock that a Pace counts in. */
EXPORTED double pace_clock(void);

#endif
