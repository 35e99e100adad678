/* The inner loop of a batch: one group of four samples from the first step to the last. */
#ifndef FLEXBEAMS_BATCH_KERNEL_H
#define FLEXBEAMS_BATCH_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#include "batch.h"
#include "beam_plant.h"
#include "lanes.h"
#include "modal.h"

#define CHUNK 8 /* rows that are summed side by side, at most */

typedef struct {
    size_t voltages;
    size_t beams; /* 0 without forces */
    size_t points;
    size_t gauges;
    size_t outputs;     /* points, then gauges */
    size_t output_rows; /* padded to whole chunks */
    size_t plant_pairs;
    size_t filter_pairs;
    size_t filter_inputs; /* voltages, then gauges */
    size_t law_rows;      /* 2 voltages, padded */
} LoopSizes;

/* What differs from lane to lane. The data of a step fit into a first-level cache of 32 kB, about: those of a pair of
   the plant's coordinates follow one another. */
typedef struct {
    Lanes *plant;    /* of each pair: growth of the first (2), inputs (voltages, 2), outputs (2, output_rows) */
    Lanes *second;   /* (pairs, 2): growth of the second where a lane has a pair of real eigenvalues */
    Lanes *force;    /* (pairs, beams, 2): inputs of forces */
    Lanes *z;        /* (2 plant_pairs,) */
    Lanes *filter_z; /* (2 filter_pairs,) */
    Lanes *y;        /* (output_rows,) */
    Lanes *law;      /* (law_rows,) */
    Lanes *u;        /* (voltages,) */
    Lanes *integral; /* (voltages,) */
    Lanes *inputs;   /* (filter_inputs,) */
    Lanes *figures;  /* (measures, BATCH_FIGURES) */
} LoopLanes;

struct Batch {
    const BatchTask *task;
    BeamPlantData plant;
    Variable *variables;
    LoopSizes sizes;
    LoopLanes at;
    size_t complex_filter_pairs;
    size_t complex_pairs[LANES]; /* of the plants */
    double *filter;              /* of each pair: eigenvalue (2), inputs (filter_inputs, 2), law (2, law_rows) */
    const double *direct;        /* G_0^+ D_pi (voltages, voltages), behind the pairs */
    double *start;               /* (2 filter_pairs,): the filter at x_ref of the first step */
    double *windup;     /* (5 + voltages, voltages): a lane's commands, growth and limits, scratch of hold_windup */
    double *references; /* (steps + 1, 2 voltages) */
    double *scratch;
    void *raw_lanes;
};

/* Rows of a matrix in chunks of equal size, as few chunks as there may be. */
size_t padded_rows(size_t rows);
/* Lanes that the loop takes, and where they are in `memory`. */
size_t lanes_size(const LoopSizes *sizes, size_t measures);
void place_lanes(Batch *batch, Lanes *memory);

/* Data of one lane. */
void set_plant_lane(Batch *batch, size_t lane, const Modal *modal);
void clear_plant_lane(Batch *batch, size_t lane);

/* Runs the group whose plants and states are set; values (LANES, value_count). A sample outside what the loop covers is
   marked in `outcomes`. */
void run_group(Batch *batch, const double *values, int32_t outcomes[LANES]);
void read_figures(const Batch *batch, size_t lane, double *figures);

#endif
