/* BeamPlant: M q'' + D q' + K q = L u + F force, exact for inputs that are held or grow linearly over a step.

   The state has the coordinates z in which a step is quick and, behind them, x in energy coordinates as the deferred
   variables were computed from it last. Another machine may find other coordinates z for the same parameters, up to
   rounding or between eigenvalues that coincide: there z follows from x. */

#include "beam_plant.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "linear_algebra.h"
#include "linear_system.h"
#include "normal_number.h"
#include "plant_matrices.h"
#include "ranges.h"

#define SAME_STATE 1e-9 /* of the largest entry of x */

/* Positions in the workspace; the system comes first, what a step multiplies by. */
typedef struct {
    size_t states; /* 2n */
    size_t outputs;
    size_t slots;
    size_t station_panels; /* panels (stations, n) */
    size_t rest;           /* (slots, patches): z at rest under u */
    size_t inputs;         /* (2, patches + beams): inputs and what they grow by */
    size_t built;          /* (parameters,) that the system belongs to; zero before the first time */
    size_t x;              /* (2n,) */
    size_t scratch;        /* of the system */
    size_t matrices;
    size_t size;
} PlantLayout;

static PlantLayout plant_layout(const BeamPlantData *plant)
{
    PlantLayout at = {.states = 2 * plant->coordinates, .outputs = plant->points + plant->gauges};
    at.slots = (at.states + MODAL_BLOCK - 1) / MODAL_BLOCK * MODAL_BLOCK;
    at.station_panels = linear_system_size(at.states, plant->patches, plant->beams, at.outputs);
    at.rest = at.station_panels + panels_size(plant->stations, plant->coordinates);
    at.inputs = at.rest + at.slots * plant->patches;
    at.built = at.inputs + 2 * (plant->patches + plant->beams);
    at.x = at.built + plant->parameter_count;
    at.scratch = at.x + at.states;
    at.matrices = at.scratch + linear_system_scratch_size(at.states, plant->patches, plant->beams);
    at.size = at.matrices + plant_matrices_size(plant);
    return at;
}

static LinearSystem system_of(const UnitInstance *unit, const PlantLayout *at)
{
    const BeamPlantData *const plant = unit->data;
    return linear_system_in(unit->workspace, unit->workspace + at->scratch, at->states, plant->patches, plant->beams,
                            at->outputs);
}

static size_t beam_plant_state_size(const void *data)
{
    const PlantLayout at = plant_layout(data);
    return at.slots + at.states;
}

static size_t beam_plant_workspace_size(const void *data)
{
    return plant_layout(data).size;
}

/* Does the system belong to the present parameters? */
static bool is_built(const UnitInstance *unit, const double *built)
{
    const BeamPlantData *const plant = unit->data;
    for (size_t k = 0; k < plant->parameter_count; k++)
        if (unit->values[plant->parameters[k].reference] != built[k])
            return false;
    return true;
}

/* The system of the present parameters; nothing is done where these are the same as before. */
static bool build_plant(UnitInstance *unit)
{
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    double *const built = unit->workspace + at.built;
    if (is_built(unit, built))
        return true;
    memset(built, 0, plant->parameter_count * sizeof *built);
    const PlantMatrices matrices = plant_matrices_in(unit->workspace + at.matrices, plant);
    if (!compute_plant_matrices(unit, &matrices))
        return false;
    const LinearSystem system = system_of(unit, &at);
    linear_system_build(&system, matrices.A, matrices.blocks, matrices.B, matrices.C);
    linear_system_coordinates(&system, plant->patches, matrices.rest, unit->workspace + at.rest);
    fill_panels(plant->stations, plant->coordinates, matrices.stations, plant->coordinates,
                unit->workspace + at.station_panels);
    for (size_t k = 0; k < plant->parameter_count; k++)
        built[k] = unit->values[plant->parameters[k].reference];
    return true;
}

/* Adds the noise of the sample at `time` (s since the start) to the strains y_pm (gauges,). */
static void add_noise(const UnitInstance *unit, double deviation, double time, double *y_pm)
{
    const BeamPlantData *const plant = unit->data;
    const double tick = floor((time + clock_tolerance(unit, time, unit->step_size)) / unit->step_size);
    const uint64_t seed = (uint64_t)unit->values[plant->noise_seed];
    for (size_t k = 0; k < plant->gauges; k++)
        y_pm[k] += deviation * normal_number(seed, (uint64_t)tick, k);
}

/* y_pi and y_pm, with the noise of the sample at `time` (s since the start). */
static void write_plant_outputs(UnitInstance *unit, const LinearSystem *system, double time)
{
    const BeamPlantData *const plant = unit->data;
    double *const y_pi = unit->values + plant->y_pi;
    const double deviation = unit->values[plant->strain_noise_std];
    linear_system_outputs(system, unit->state, y_pi);
    if (deviation > 0.0)
        add_noise(unit, deviation, time, y_pi + plant->points);
}

/* At rest under the given voltages. */
static bool beam_plant_initialise(UnitInstance *unit)
{
    if (!build_plant(unit))
        return false;
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    const LinearSystem system = system_of(unit, &at);
    multiply_matrices(at.slots, plant->patches, 1, unit->workspace + at.rest, unit->values + plant->start_at_rest_under,
                      unit->state);
    write_plant_outputs(unit, &system, 0.0);
    return true;
}

static void beam_plant_differentiate(UnitInstance *unit)
{
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    const PlantMatrices matrices = plant_matrices_in(unit->workspace + at.matrices, plant);
    double *const y_pi = unit->changes + plant->y_pi;
    differentiate_rest(unit, &matrices, y_pi);
    add_noise(unit, unit->changes[plant->strain_noise_std], 0.0, y_pi + plant->points);
}

static bool beam_plant_prepare(UnitInstance *unit, double step)
{
    const PlantLayout at = plant_layout(unit->data);
    const LinearSystem system = system_of(unit, &at);
    return linear_system_prepare(&system, step, unit->slopes != NULL) ||
           unit_refuse(unit, "the discretisation over %r s overflows: check the structure's parameters", step);
}

static bool beam_plant_restore(UnitInstance *unit)
{
    if (!build_plant(unit))
        return false;
    const PlantLayout at = plant_layout(unit->data);
    const LinearSystem system = system_of(unit, &at);
    double *const own = unit->workspace + at.x;
    double *const saved = unit->state + at.slots;
    linear_system_state(&system, unit->state, own);
    double largest = 0.0;
    double difference = 0.0;
    for (size_t k = 0; k < at.states; k++) {
        largest = larger(largest, fabs(saved[k]));
        difference = larger(difference, fabs(own[k] - saved[k]));
    }
    if (difference <= SAME_STATE * largest)
        return true;
    unit->workspace[at.built] = NAN; /* for coordinates the system must have been built just now */
    if (!build_plant(unit))
        return false;
    linear_system_coordinates(&system, 1, saved, unit->state);
    return true;
}

/* Inputs, and what they grow by over the step: voltages, then forces. */
static void copy_inputs(const BeamPlantData *plant, const double *from, double factor, double *to)
{
    for (size_t k = 0; k < plant->patches; k++)
        to[k] = factor * from[plant->u + k];
    for (size_t k = 0; k < plant->beams; k++)
        to[plant->patches + k] = factor * from[plant->force + k];
}

/* Do inputs that grow end within their bounds? */
static bool check_growth(UnitInstance *unit, unsigned first, size_t count, double step)
{
    for (unsigned k = first; k < first + count; k++) {
        const double end = unit->values[k] + unit->slopes[k] * step;
        const Variable *const input = &unit->variables[k];
        if (!(end >= input->minimum && end <= input->maximum))
            return unit_refuse(unit, "%s must be within %r..%r at the end of the step, its derivative %r gives %r",
                               input->name, input->minimum, input->maximum, unit->slopes[k], end);
    }
    return true;
}

static bool beam_plant_advance(UnitInstance *unit, double time, double step)
{
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    const LinearSystem system = system_of(unit, &at);
    if (!beam_plant_prepare(unit, step))
        return false;
    if (unit->slopes != NULL &&
        !(check_growth(unit, plant->u, plant->patches, step) && check_growth(unit, plant->force, plant->beams, step)))
        return false;
    double *const v = unit->workspace + at.inputs;
    double *const growth = v + system.inputs;
    copy_inputs(plant, unit->values, 1.0, v);
    if (unit->slopes != NULL)
        copy_inputs(plant, unit->slopes, step, growth);
    linear_system_step(&system, v, unit->slopes == NULL ? NULL : growth, unit->state);
    write_plant_outputs(unit, &system, time + step);
    return true;
}

/* x, the stations along the beams, behind y_pi and y_pm, and the energy. */
static void beam_plant_complete(UnitInstance *unit)
{
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    const LinearSystem system = system_of(unit, &at);
    double *const x = unit->state + at.slots;
    linear_system_state(&system, unit->state, x);
    multiply_panels(plant->stations, plant->coordinates, unit->workspace + at.station_panels, x, false,
                    unit->values + plant->y_pi + at.outputs);
    double sum = 0.0;
    for (size_t k = 0; k < at.states; k++)
        sum += x[k] * x[k];
    unit->values[plant->energy] = sum / 2;
}

SHARED_DATA const UnitHooks beam_plant_hooks = {
    .state_size = beam_plant_state_size,
    .workspace_size = beam_plant_workspace_size,
    .initialise = beam_plant_initialise,
    .differentiate = beam_plant_differentiate,
    .prepare = beam_plant_prepare,
    .restore = beam_plant_restore,
    .advance = beam_plant_advance,
    .complete = beam_plant_complete,
};
