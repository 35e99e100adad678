/* The standard loop of many plants at once: plants differ, controller and feedforward are the same. Samples run eight
   side by side, each group from its first step to its last; measures are taken on the fly. The results of a sample do
   not depend on those beside it, nor on the instruction set: nothing is contracted or reordered. */
#ifndef FLEXBEAMS_BATCH_H
#define FLEXBEAMS_BATCH_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

enum { BATCH_TERM = 6 };                                   /* numbers of a term, see BatchPlant */
enum { BATCH_MEASURE = 6 };                                /* numbers of a measured element, see BatchTask */
enum { BATCH_DEFLECTIONS, BATCH_STRAINS, BATCH_VOLTAGES }; /* signals that are measured */
enum { BATCH_OK, BATCH_OUTSIDE };                          /* of a sample: outside what this loop covers */

/* What a measured element gives: smallest, largest, first and last value in its window, largest change from step to
   step, and the last step outside a band, -1 for none. */
enum { BATCH_SMALLEST, BATCH_LARGEST, BATCH_FIRST, BATCH_LAST, BATCH_CHANGE, BATCH_OUT, BATCH_FIGURES };

/* The tables of BeamPlant, see beam_plant.h. */
typedef struct {
    int64_t coordinates;
    int64_t patches;
    int64_t beams;
    int64_t points;
    int64_t gauges;
    int64_t value_count; /* of the unit, by value reference */
    int64_t parameter_count;
    const int64_t *parameters; /* (parameter_count, 2): value reference, may it vanish */
    int64_t term_count;
    const int64_t *terms; /* (term_count, 6): parameter, matrix, column, size, rows, block */
    const unsigned *rows;
    const double *blocks;
    const unsigned *starts; /* of the SparseRows of the outputs, (points + gauges + beams, coordinates) */
    const unsigned *columns;
    const double *values;
    int64_t start_at_rest_under; /* value references */
    int64_t strain_noise_std;
    int64_t noise_seed;
} BatchPlant;

/* The matrices of TrackingController, see tracking_controller.h; row by row. */
typedef struct {
    int64_t states;
    int64_t reduced_states;
    const double *filter;    /* (states, states + patches + gauges) */
    const double *regulator; /* (2 patches, states + patches) */
    double integral_gain;
    double strain_limit;
    const double *integral_range; /* (patches, patches), see windup.h */
    const double *lowest;         /* (patches,) V */
    const double *highest;
} BatchController;

typedef struct {
    BatchPlant plant;
    BatchController controller;
    double step; /* s, that of the plant and of the controller */
    int64_t steps;
    const double *x_ref; /* (steps + 1, reduced_states) */
    const double *u_ff;  /* (steps + 1, patches) */
    const double *force; /* (steps + 1, beams), NULL for none */
    int64_t measure_count;
    const int64_t *measures; /* (measure_count, 6): signal, element, first row, last row, are changes and band wanted */
    const double *bands;     /* (measure_count, 2): middle and half width */
} BatchTask;

typedef struct Batch Batch;

/* A batch whose task and all that it points to outlive it; NULL where there is not enough memory, or where the filter
   has no modal form. */
EXPORTED Batch *batch_open(const BatchTask *task);
EXPORTED void batch_close(Batch *batch);
/* Runs `count` samples, values (count, value_count) of the plant's variables by value reference; figures (count,
   measure_count, 6), of a sample outside what this loop covers all 0; outcomes (count,). */
EXPORTED void batch_run(Batch *batch, size_t count, const double *values, double *figures, int32_t *outcomes);

#endif
