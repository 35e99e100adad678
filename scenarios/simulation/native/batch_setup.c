/* The plants of a group: from the values of samples to modal forms. */
#include "batch_kernel.h"
#include "modal_build.h"

static void ignore_line(UnitInstance *unit, Severity severity, const char *line)
{
    (void)unit;
    (void)severity;
    (void)line;
}

/* Where the parts of the plant's data are in the scratch memory. */
typedef struct {
    Modal modal;
    PlantMatrices matrices;
    double *rest; /* (slots, patches) */
    double *scratch;
} PlantScratch;

static PlantScratch plant_scratch(const Batch *batch)
{
    const BeamPlantData *const plant = &batch->plant;
    const size_t n = 2 * plant->coordinates;
    const size_t outputs = batch->sizes.outputs;
    PlantScratch at = {.modal = modal_in(batch->scratch, n, plant->patches, plant->beams, outputs)};
    double *const memory = batch->scratch + modal_size(n, plant->patches, plant->beams, outputs);
    at.matrices = plant_matrices_in(memory, plant);
    at.rest = memory + plant_matrices_size(plant);
    at.scratch = at.rest + at.modal.slots * plant->patches;
    return at;
}

static bool compute_matrices(Batch *batch, double *values, const PlantMatrices *matrices)
{
    UnitInstance unit = {
        .data = &batch->plant, .variables = batch->variables, .values = values, .log = ignore_line, .step_size = 1.0};
    return compute_plant_matrices(&unit, matrices);
}

/* One lane of the plant: its modal form for the values of a sample, and its state at rest; false where there is no such
   form. The lane's own method is taken where the group's does not find the modes. */
static bool set_plant(Batch *batch, size_t lane, double *values)
{
    const PlantScratch at = plant_scratch(batch);
    if (!read_modes(batch->modes, &batch->plant, lane, &at.modal, at.rest)) {
        const PlantMatrices *const m = &at.matrices;
        if (!compute_matrices(batch, values, m) ||
            !(modal_build(&at.modal, m->A, m->blocks, m->B, m->C, at.scratch) <= LARGEST_CONDITION))
            return false;
        modal_coordinates(&at.modal, batch->plant.patches, m->rest, at.rest, at.scratch);
    }
    if (!modal_prepare(&at.modal, batch->task->step, false))
        return false;
    set_plant_lane(batch, lane, &at.modal, at.rest, values + batch->task->plant.start_at_rest_under);
    return true;
}

void set_plants(Batch *batch, double *values, int32_t outcomes[LANES])
{
    const size_t width = (size_t)batch->task->plant.value_count;
    const PlantScratch at = plant_scratch(batch);
    for (size_t lane = 0; lane < LANES; lane++) {
        outcomes[lane] = compute_matrices(batch, values + lane * width, &at.matrices) ? BATCH_OK : BATCH_OUTSIDE;
        if (outcomes[lane] == BATCH_OK)
            set_modes_lane(batch->modes, &batch->plant, lane, &at.matrices);
    }
    find_modes(batch->modes, &batch->plant);
    for (size_t lane = 0; lane < LANES; lane++) {
        if (outcomes[lane] == BATCH_OK && !set_plant(batch, lane, values + lane * width))
            outcomes[lane] = BATCH_OUTSIDE;
        if (outcomes[lane] != BATCH_OK)
            clear_plant_lane(batch, lane);
    }
}
