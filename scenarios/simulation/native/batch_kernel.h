/* The inner loop of a batch: one group of eight samples from the first step to the last. */
#ifndef FLEXBEAMS_BATCH_KERNEL_H
#define FLEXBEAMS_BATCH_KERNEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "batch.h"
#include "batch_modes.h"
#include "beam_plant.h"
#include "lanes.h"
#include "modal.h"

#define ROWS 8 /* that are measured at once */
#define TILE 5 /* pairs of coordinates that are grown at once */

typedef struct {
    size_t voltages;
    size_t beams; /* 0 without forces */
    size_t points;
    size_t gauges;
    size_t outputs;     /* points, then gauges */
    size_t output_rows; /* padded to whole chunks */
    size_t plant_pairs; /* of coordinates, padded to whole tiles, as are those of the filter */
    size_t filter_pairs;
    size_t filter_states; /* an odd number of states gets one more, which stays 0 */
    size_t filter_inputs; /* voltages, then gauges */
    size_t law_rows;      /* 2 voltages, padded */
} LoopSizes;

/* What differs from lane to lane. Part by part: what a step takes of a part's plant fits into a first-level cache. */
typedef struct {
    Part *plant; /* (PARTS, plant_pairs, plant_stride) in tiles: growth by itself, by the other one, inputs (voltages,),
                    outputs (output_rows,) */
    Part *force; /* (PARTS, plant_pairs, beams): inputs of forces */
    Part *z;     /* (PARTS, plant_pairs) */
    Part *halfway;   /* (PARTS, plant_pairs): z between two steps that are taken at once */
    Part *driven;    /* (2, plant_pairs): what the voltages add to z of a part in either of these */
    Part *filter_z;  /* (PARTS, filter_pairs) */
    Part *inputs;    /* (2, filter_inputs, PARTS): of this step and of the next one */
    Part *sums;      /* (2, output_rows or law_rows, PARTS) */
    Lanes *rows;     /* (ROWS, output_rows + voltages): y and u of the last steps */
    Lanes *law;      /* (law_rows,) */
    Lanes *integral; /* (voltages,) */
    Lanes *growth;   /* (voltages,), of the integral */
    Lanes *figures;  /* (measures, BATCH_FIGURES) */
    Lanes *strain;   /* the largest so far */
} LoopLanes;

struct Batch {
    const BatchTask *task;
    BeamPlantData plant;
    Variable *variables;
    LoopSizes sizes;
    LoopLanes at;
    Couple *filter;     /* of each pair: growth by itself, by the other one, inputs (filter_inputs,), law (law_rows,) */
    Couple *start;      /* (filter_pairs,): the filter at x_ref of the first step */
    double *direct;     /* (voltages, voltages): G_0^+ D_pi */
    double *windup;     /* (5 + voltages, voltages): a lane's commands, growth and limits, scratch of hold_windup */
    double *references; /* (steps + 1, 2 voltages) */
    double *scratch;
    double *modes; /* of batch_modes.c */
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

/* Where the inputs (filter_inputs, PARTS) of the controller's next tick but `later` are. */
INLINE Part *inputs_of(const Batch *batch, size_t later)
{
    return batch->at.inputs + later * batch->sizes.filter_inputs * PARTS;
}

/* Numbers of a pair of the filter. */
INLINE size_t filter_stride(const LoopSizes *s)
{
    return 2 + s->filter_inputs + s->law_rows;
}

/* Where a number of a pair is. Those of a tile's pairs stand side by side: sums of a pair wait for one another, those
   of a tile's pairs do not. */
INLINE size_t tile_place(size_t stride, size_t pair, size_t number)
{
    return (pair / TILE * stride + number) * TILE + pair % TILE;
}

/* Rows padded to whole chunks. */
size_t padded_rows(size_t rows);
/* Doubles that the lanes take, and where they are in `memory`, which is aligned for lanes and parts. */
size_t lanes_size(const LoopSizes *sizes, size_t measures);
void place_lanes(Batch *batch, double *memory);

/* The filter in modal form, and its start; false where it has no such form. */
bool open_filter(Batch *batch);
/* What the law takes of the reference at each step. */
void fill_references(Batch *batch);
/* The plants of a group with their values (LANES, value_count), and whether this loop covers them. */
void set_plants(Batch *batch, double *values, int32_t outcomes[LANES]);

/* Data of one lane of the plant; z at rest under voltages: rest (slots, voltages) times `start`. */
void set_plant_lane(Batch *batch, size_t lane, const Modal *modal, const double *rest, const double *start);
void clear_plant_lane(Batch *batch, size_t lane);
/* z after a step with the voltages among the inputs; then what a force (beams,) adds that was held over the step. */
void step_plant(Batch *batch);
void push_plant(Batch *batch, const double *force);
/* z after two steps, the second with the voltages among the next inputs, and halfway. */
void step_plant_twice(Batch *batch);
/* y of z; y halfway and y of z */
void write_outputs(Batch *batch, Lanes *y);
void write_outputs_twice(Batch *batch, Lanes *halfway, Lanes *y);

/* The filter starts at the reference; voltages of the first step: the feedforward's. */
void start_controller(Batch *batch, Lanes *u);
/* The filter's z after the next tick but `later`, and the law's sums of it. */
void step_filter(Batch *batch, size_t later);
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
