/* The inner loop of a batch: one group of four samples from the first step to the last. */
#ifndef FLEXBEAMS_BATCH_KERNEL_H
#define FLEXBEAMS_BATCH_KERNEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "batch.h"
#include "beam_plant.h"
#include "lanes.h"
#include "modal.h"

#define ROWS 8 /* that are measured at once */

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

/* What differs from lane to lane. What a step takes of it fits into a first-level cache of 48 kB, that of a pair of the
   plant's coordinates follows one another. */
typedef struct {
    PairLanes *plant; /* of each pair: growth by itself, by the other one, inputs (voltages,), outputs (output_rows,) */
    PairLanes *force; /* (pairs, beams): inputs of forces */
    PairLanes *z;     /* (plant_pairs,) */
    PairLanes *filter_z; /* (filter_pairs,) */
    PairLanes *inputs;   /* (filter_inputs,) */
    Lanes *rows;         /* (ROWS, output_rows + voltages): y and u of the last steps */
    Lanes *law;          /* (law_rows,) */
    Lanes *integral;     /* (voltages,) */
    Lanes *growth;       /* (voltages,), of the integral */
    Lanes *figures;      /* (measures, BATCH_FIGURES) */
    Lanes *strain;       /* the largest so far */
} LoopLanes;

struct Batch {
    const BatchTask *task;
    BeamPlantData plant;
    Variable *variables;
    LoopSizes sizes;
    LoopLanes at;
    double *filter; /* of each pair filter_stride numbers two by two: growth by itself, by the other, inputs, law */
    const double *direct; /* G_0^+ D_pi (voltages, voltages), behind the pairs */
    double *start;        /* (2 filter_pairs,): the filter at x_ref of the first step */
    double *windup;       /* (5 + voltages, voltages): a lane's commands, growth and limits, scratch of hold_windup */
    double *references;   /* (steps + 1, 2 voltages) */
    double *scratch;
    void *raw_lanes;
};

/* y of step `number`, and behind it u. */
INLINE Lanes *row_of(const Batch *batch, int64_t number)
{
    return batch->at.rows + (size_t)number % ROWS * (batch->sizes.output_rows + batch->sizes.voltages);
}

INLINE Lanes *voltages_of(const Batch *batch, int64_t number)
{
    return row_of(batch, number) + batch->sizes.output_rows;
}

/* z of a pair is in this slot of a Modal and in the one MODAL_LANES behind it. */
INLINE size_t slot_of_pair(size_t pair)
{
    return pair / MODAL_LANES * MODAL_BLOCK + pair % MODAL_LANES;
}

/* Numbers of a pair of the filter's coordinates, and where those of an input and of a row of the law are. */
INLINE size_t filter_stride(const LoopSizes *s)
{
    return 2 * (2 + s->filter_inputs + s->law_rows);
}

INLINE size_t filter_input(size_t number)
{
    return 2 * (2 + number);
}

INLINE size_t filter_law(const LoopSizes *s, size_t row)
{
    return filter_input(s->filter_inputs) + 2 * row;
}

/* Rows padded to whole chunks. */
size_t padded_rows(size_t rows);
/* Doubles that the lanes take, and where they are in `memory`, which is aligned for PairLanes. */
size_t lanes_size(const LoopSizes *sizes, size_t measures);
void place_lanes(Batch *batch, double *memory);

/* Data of one lane of the plant; z at rest under voltages: rest (slots, voltages) times `start`. */
void set_plant_lane(Batch *batch, size_t lane, const Modal *modal, const double *rest, const double *start);
void clear_plant_lane(Batch *batch, size_t lane);
/* z after a step with the voltages among the inputs; then what a force (beams,) adds that was held over the step. */
void step_plant(Batch *batch);
void push_plant(Batch *batch, const double *force);
/* y of z */
void write_outputs(Batch *batch, Lanes *y);

/* The filter starts at the reference; voltages of the first step: the feedforward's. */
void start_controller(Batch *batch, Lanes *u);
/* The filter's z after a tick with the inputs (voltages, strains), and the law's sums of it. */
void step_filter(Batch *batch);
/* Voltages `next` = u_ff + K (x_ref - x_est) + integral within the limits, after u; see tracking_controller.c. */
void regulate(Batch *batch, const double *reference, const Lanes *u, Lanes *next);

/* Takes the figures of the steps from `first` to `last`, at most ROWS. */
void measure(Batch *batch, int64_t first, int64_t last);
/* Figures of a lane (measure_count, BATCH_FIGURES). */
void read_figures(const Batch *batch, size_t lane, double *figures);

/* Runs the group whose plants and states are set; values (LANES, value_count). A sample outside what the loop covers is
   marked in `outcomes`. */
void run_group(Batch *batch, const double *values, int32_t outcomes[LANES]);

#endif
