#include "batch.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "batch_kernel.h"
#include "modal_build.h"

#define ALIGNMENT 64 /* bytes, of the widest vectors and of a line of the cache */

/* Memory of zeros, aligned for lanes and parts; `raw` is to be freed. */
static double *lanes_memory(size_t count, void **raw)
{
    *raw = calloc(count * sizeof(double) + ALIGNMENT, 1);
    return *raw == NULL ? NULL : (double *)((char *)*raw + (ALIGNMENT - (uintptr_t)*raw % ALIGNMENT));
}

/* The plant's tables in the form that plant_matrices.c takes; no stations. */
static bool open_plant(Batch *batch)
{
    const BatchPlant *const from = &batch->task->plant;
    PlantParameter *const parameters = calloc((size_t)from->parameter_count, sizeof *parameters);
    PlantTerm *const terms = calloc((size_t)from->term_count, sizeof *terms);
    batch->variables = calloc((size_t)from->value_count, sizeof *batch->variables);
    batch->plant = (BeamPlantData){
        .coordinates = (size_t)from->coordinates,
        .patches = (size_t)from->patches,
        .beams = (size_t)from->beams,
        .points = (size_t)from->points,
        .gauges = (size_t)from->gauges,
        .stations = 0,
        .parameter_count = (size_t)from->parameter_count,
        .term_count = (size_t)from->term_count,
        .parameters = parameters,
        .terms = terms,
        .rows = from->rows,
        .blocks = from->blocks,
        .outputs = {.starts = from->starts, .columns = from->columns, .values = from->values},
    };
    if (parameters == NULL || terms == NULL || batch->variables == NULL)
        return false;
    for (size_t k = 0; k < batch->plant.parameter_count; k++)
        parameters[k] = (PlantParameter){.reference = (unsigned)from->parameters[2 * k],
                                         .may_vanish = from->parameters[2 * k + 1] != 0};
    for (size_t k = 0; k < batch->plant.term_count; k++) {
        const int64_t *const row = from->terms + BATCH_TERM * k;
        terms[k] = (PlantTerm){.parameter = (unsigned)row[0],
                               .matrix = (PlantMatrix)row[1],
                               .column = (size_t)row[2],
                               .size = (size_t)row[3],
                               .rows = (size_t)row[4],
                               .block = (size_t)row[5]};
    }
    return true;
}

static size_t whole_tiles(size_t pairs)
{
    return (pairs + TILE - 1) / TILE * TILE;
}

static void fill_sizes(Batch *batch)
{
    const BatchTask *const task = batch->task;
    LoopSizes *const s = &batch->sizes;
    s->voltages = batch->plant.patches;
    s->beams = task->force == NULL ? 0 : batch->plant.beams;
    s->gauges = batch->plant.gauges;
    s->points = batch->plant.points;
    s->outputs = batch->plant.points + batch->plant.gauges;
    s->output_rows = padded_rows(s->outputs);
    s->plant_pairs = whole_tiles(batch->plant.coordinates);
    s->filter_states = (size_t)task->controller.states + (size_t)task->controller.states % 2;
    s->filter_pairs = whole_tiles(s->filter_states / 2);
    s->filter_inputs = s->voltages + s->gauges;
    s->law_rows = padded_rows(2 * s->voltages);
}

static bool open_memory(Batch *batch)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t n = 2 * batch->plant.coordinates;
    const size_t even = s->filter_states;
    const size_t plant_scratch = modal_size(n, batch->plant.patches, batch->plant.beams, s->outputs) +
                                 modal_scratch_size(n) + plant_matrices_size(&batch->plant) +
                                 (n + MODAL_BLOCK) * batch->plant.patches;
    const size_t filter_scratch = modal_size(even, s->filter_inputs, 0, 2 * s->voltages) + modal_scratch_size(even) +
                                  even * (even + s->filter_inputs + 2 * s->voltages) + 2 * (even + MODAL_BLOCK);
    const size_t scratch = plant_scratch > filter_scratch ? plant_scratch : filter_scratch;
    const size_t lanes = lanes_size(s, (size_t)batch->task->measure_count);
    batch->filter = calloc(s->filter_pairs * filter_stride(s), sizeof *batch->filter);
    batch->direct = calloc(s->voltages * s->voltages, sizeof *batch->direct);
    batch->windup = calloc((5 + s->voltages) * s->voltages, sizeof *batch->windup);
    batch->start = calloc(s->filter_pairs, sizeof *batch->start);
    batch->references = calloc(((size_t)batch->task->steps + 1) * 2 * s->voltages, sizeof *batch->references);
    batch->scratch = calloc(scratch, sizeof *batch->scratch);
    double *const memory = lanes_memory(lanes + modes_size(&batch->plant), &batch->raw_lanes);
    if (memory != NULL) {
        place_lanes(batch, memory);
        batch->modes = memory + lanes;
    }
    return batch->filter != NULL && batch->direct != NULL && batch->references != NULL && batch->start != NULL &&
           batch->windup != NULL && batch->scratch != NULL && memory != NULL;
}

Batch *batch_open(const BatchTask *task)
{
    Batch *const batch = calloc(1, sizeof *batch);
    if (batch == NULL)
        return NULL;
    batch->task = task;
    if (open_plant(batch)) {
        fill_sizes(batch);
        if (open_memory(batch) && open_filter(batch)) {
            fill_references(batch);
            return batch;
        }
    }
    batch_close(batch);
    return NULL;
}

void batch_close(Batch *batch)
{
    if (batch == NULL)
        return;
    free((void *)batch->plant.parameters);
    free((void *)batch->plant.terms);
    free(batch->variables);
    free(batch->filter);
    free(batch->direct);
    free(batch->start);
    free(batch->windup);
    free(batch->references);
    free(batch->scratch);
    free(batch->raw_lanes);
    free(batch);
}

void batch_run(Batch *batch, size_t count, const double *values, double *figures, int32_t *outcomes)
{
    const size_t width = (size_t)batch->task->plant.value_count;
    const size_t size = (size_t)batch->task->measure_count * BATCH_FIGURES;
    double *const own = calloc(width * LANES, sizeof *own);
    for (size_t first = 0; first < count; first += LANES) {
        int32_t group[LANES];
        const size_t filled = count - first < LANES ? count - first : LANES;
        for (size_t lane = 0; lane < LANES; lane++)
            group[lane] = BATCH_OUTSIDE;
        if (own != NULL) {
            for (size_t lane = 0; lane < LANES; lane++) /* lanes that are left over repeat the last sample */
                memcpy(own + lane * width, values + (first + (lane < filled ? lane : filled - 1)) * width,
                       width * sizeof *own);
            set_plants(batch, own, group);
            run_group(batch, own, group);
        }
        for (size_t lane = 0; lane < filled; lane++) {
            outcomes[first + lane] = group[lane];
            double *const to = figures + (first + lane) * size;
            memset(to, 0, size * sizeof *to);
            if (group[lane] == BATCH_OK)
                read_figures(batch, lane, to);
        }
    }
    free(own);
}
