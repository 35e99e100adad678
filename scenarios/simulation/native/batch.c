#include "batch.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "batch_kernel.h"
#include "modal_build.h"
#include "plant_matrices.h"

#define LARGEST_CONDITION 100.0 /* of an eigenvalue, as in linear_system.c */

/* Memory of zeros, aligned for lanes; `raw` is to be freed. */
static double *lanes_memory(size_t count, void **raw)
{
    const size_t alignment = sizeof(PairLanes);
    *raw = calloc(count * sizeof(double) + alignment, 1);
    return *raw == NULL ? NULL : (double *)((char *)*raw + (alignment - (uintptr_t)*raw % alignment));
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

/* Sizes of the loop, and where its arrays are in memory. */
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
    s->plant_pairs = batch->plant.coordinates;
    s->filter_pairs = ((size_t)task->controller.states + 1) / 2;
    s->filter_inputs = s->voltages + s->gauges;
    s->law_rows = padded_rows(2 * s->voltages);
}

static bool open_memory(Batch *batch)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t n = 2 * batch->plant.coordinates;
    const size_t even = 2 * s->filter_pairs;
    const size_t plant_scratch = modal_size(n, batch->plant.patches, batch->plant.beams, s->outputs) +
                                 modal_scratch_size(n) + plant_matrices_size(&batch->plant) +
                                 (n + MODAL_BLOCK) * batch->plant.patches;
    const size_t filter_scratch = modal_size(even, s->filter_inputs, 0, 2 * s->voltages) + modal_scratch_size(even) +
                                  even * (even + s->filter_inputs + 2 * s->voltages) + 2 * (even + MODAL_BLOCK);
    const size_t scratch = plant_scratch > filter_scratch ? plant_scratch : filter_scratch;
    const size_t lanes = lanes_size(s, (size_t)batch->task->measure_count);
    batch->filter = calloc(s->filter_pairs * filter_stride(s) + s->voltages * s->voltages, sizeof *batch->filter);
    batch->windup = calloc((5 + s->voltages) * s->voltages, sizeof *batch->windup);
    batch->start = calloc(even, sizeof *batch->start);
    batch->references = calloc(((size_t)batch->task->steps + 1) * 2 * s->voltages, sizeof *batch->references);
    batch->scratch = calloc(scratch, sizeof *batch->scratch);
    double *const memory = lanes_memory(lanes, &batch->raw_lanes);
    if (memory != NULL)
        place_lanes(batch, memory);
    return batch->filter != NULL && batch->references != NULL && batch->start != NULL && batch->windup != NULL &&
           batch->scratch != NULL && memory != NULL;
}

/* The filter's coordinates at x_ref of the first step; offsets, which have no reference, at 0. */
static void start_filter(Batch *batch, const Modal *modal, double *scratch)
{
    double *const x = scratch + modal_scratch_size(modal->states);
    double *const z = x + modal->states;
    memset(x, 0, modal->states * sizeof *x);
    memcpy(x, batch->task->x_ref, (size_t)batch->task->controller.reduced_states * sizeof *x);
    modal_coordinates(modal, 1, x, z, scratch);
    for (size_t p = 0; p < batch->sizes.filter_pairs; p++) {
        batch->start[2 * p] = z[slot_of_pair(p)];
        batch->start[2 * p + 1] = z[slot_of_pair(p) + MODAL_LANES];
    }
}

/* One member of a pair of the filter: growth by itself and by the other coordinate, inputs, law. The other member's
   numbers are between. */
static void write_filter_member(const Batch *batch, const Modal *modal, size_t pair, size_t member, double *to)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t slot = slot_of_pair(pair) + member * MODAL_LANES;
    const double imaginary = modal->imaginary[slot_of_pair(pair)];
    to[0] = modal->real[slot];
    to[2] = member == 0 ? imaginary : -imaginary;
    for (size_t j = 0; j < s->filter_inputs; j++)
        to[filter_input(j)] =
            modal->held_inputs[(slot / MODAL_BLOCK * s->filter_inputs + j) * MODAL_BLOCK + slot % MODAL_BLOCK];
    for (size_t i = 0; i < 2 * s->voltages; i++)
        to[filter_law(s, i)] = modal->output_rows[i * modal->slots + slot];
}

/* The filter in modal form, and the law on its coordinates: a pair of coordinates after the other, each with its
   eigenvalue, its inputs and its part of the law. The filter's own matrix takes the place of a continuous one: a tick
   multiplies by its eigenvalues. An odd number of states gets one more, which stays 0. */
static bool open_filter(Batch *batch)
{
    const BatchController *const c = &batch->task->controller;
    const LoopSizes *const s = &batch->sizes;
    const size_t states = (size_t)c->states;
    const size_t even = 2 * s->filter_pairs;
    const size_t width = states + s->filter_inputs;
    const size_t rows = 2 * s->voltages;
    double *const A = batch->scratch;
    double *const B = A + even * even;
    double *const C = B + even * s->filter_inputs;
    double *const form = C + rows * even;
    const Modal modal = modal_in(form, even, s->filter_inputs, 0, rows);
    double *const scratch = form + modal_size(even, s->filter_inputs, 0, rows);
    memset(A, 0, (even * even + even * s->filter_inputs + rows * even) * sizeof *A);
    for (size_t i = 0; i < states; i++) {
        memcpy(A + i * even, c->filter + i * width, states * sizeof *A);
        memcpy(B + i * s->filter_inputs, c->filter + i * width + states, s->filter_inputs * sizeof *B);
    }
    for (size_t i = 0; i < rows; i++)
        memcpy(C + i * even, c->regulator + i * (states + s->voltages), states * sizeof *C);
    if (!(modal_build(&modal, A, B, C, scratch) <= LARGEST_CONDITION))
        return false;
    double *out = batch->filter;
    for (size_t p = 0; p < s->filter_pairs; p++, out += filter_stride(s))
        for (size_t member = 0; member < 2; member++)
            write_filter_member(batch, &modal, p, member, out + member);
    for (size_t i = 0; i < s->voltages; i++) /* G_0^+ D_pi */
        memcpy(out + i * s->voltages, c->regulator + (s->voltages + i) * (states + s->voltages) + states,
               s->voltages * sizeof *out);
    start_filter(batch, &modal, scratch);
    batch->direct = out;
    return true;
}

/* What the law takes of the reference: u_ff + K x_ref, then G_0^+ (H_pi x_ref + D_pi u_ff). */
static void fill_references(Batch *batch)
{
    const BatchController *const c = &batch->task->controller;
    const size_t voltages = batch->sizes.voltages;
    const size_t states = (size_t)c->states;
    const size_t reduced = (size_t)c->reduced_states;
    for (size_t k = 0; k <= (size_t)batch->task->steps; k++) {
        const double *const x = batch->task->x_ref + k * reduced;
        const double *const u = batch->task->u_ff + k * voltages;
        double *const to = batch->references + k * 2 * voltages;
        for (size_t i = 0; i < 2 * voltages; i++) {
            const double *const row = c->regulator + i * (states + voltages);
            double sum = 0.0;
            for (size_t j = 0; j < reduced; j++)
                sum += row[j] * x[j];
            for (size_t j = 0; j < voltages; j++)
                sum += row[states + j] * u[j];
            to[i] = i < voltages ? u[i] + sum : sum;
        }
    }
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
    free(batch->start);
    free(batch->windup);
    free(batch->references);
    free(batch->scratch);
    free(batch->raw_lanes);
    free(batch);
}

static void ignore_line(UnitInstance *unit, Severity severity, const char *line)
{
    (void)unit;
    (void)severity;
    (void)line;
}

/* One lane of the plant: its modal form for the values of a sample, and its state at rest; false where there is no such
   form. */
static bool set_plant(Batch *batch, size_t lane, double *values)
{
    const BatchTask *const task = batch->task;
    const LoopSizes *const s = &batch->sizes;
    const size_t n = 2 * batch->plant.coordinates;
    const size_t patches = batch->plant.patches;
    const size_t beams = batch->plant.beams;
    UnitInstance unit = {
        .data = &batch->plant, .variables = batch->variables, .values = values, .log = ignore_line, .step_size = 1.0};
    double *memory = batch->scratch;
    const Modal modal = modal_in(memory, n, patches, beams, s->outputs);
    memory += modal_size(n, patches, beams, s->outputs);
    const PlantMatrices matrices = plant_matrices_in(memory, &batch->plant);
    memory += plant_matrices_size(&batch->plant);
    double *const rest = memory;
    double *const scratch = rest + modal.slots * patches;
    if (!compute_plant_matrices(&unit, &matrices) ||
        !(modal_build(&modal, matrices.A, matrices.B, matrices.C, scratch) <= LARGEST_CONDITION) ||
        !modal_prepare(&modal, task->step, false))
        return false;
    modal_coordinates(&modal, patches, matrices.rest, rest, scratch);
    set_plant_lane(batch, lane, &modal, rest, values + task->plant.start_at_rest_under);
    return true;
}

void batch_run(Batch *batch, size_t count, const double *values, double *figures, int32_t *outcomes)
{
    const size_t width = (size_t)batch->task->plant.value_count;
    const size_t size = (size_t)batch->task->measure_count * BATCH_FIGURES;
    double *const own = calloc(width * LANES, sizeof *own);
    for (size_t first = 0; first < count; first += LANES) {
        int32_t group[LANES];
        const size_t filled = count - first < LANES ? count - first : LANES;
        for (size_t lane = 0; lane < LANES; lane++) { /* lanes that are left over repeat the last sample */
            const size_t sample = first + (lane < filled ? lane : filled - 1);
            group[lane] = BATCH_OUTSIDE;
            if (own == NULL)
                continue;
            memcpy(own + lane * width, values + sample * width, width * sizeof *own);
            group[lane] = set_plant(batch, lane, own + lane * width) ? BATCH_OK : BATCH_OUTSIDE;
            if (group[lane] != BATCH_OK)
                clear_plant_lane(batch, lane);
        }
        if (own != NULL)
            run_group(batch, own, group);
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
