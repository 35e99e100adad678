/* BeamPlant: M q'' + D q' + K q = L u + F force, exact for inputs that are held or grow linearly over a step.

   State x = (R_K' q, R_M' q') with K = R_K R_K', M = R_M R_M': half its squared norm is the mechanical energy, and
   the system's matrix is skew-symmetric less the damping, so its exponential is a contraction. */

#include "beam_plant.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "linear_algebra.h"
#include "matrix_exponential.h"
#include "normal_number.h"

#define KEPT_STEPS 4

/* Positions in the workspace, what a step multiplies by first. n coordinates, m inputs (voltages, then forces). */
typedef struct {
    size_t n;
    size_t m;
    size_t transitions;     /* KEPT_STEPS times panels [A_d B_d] (2n, 2n + m) and panels of the slopes (2n, m) */
    size_t transition_size; /* of one of these */
    size_t output_panels;   /* panels (points + gauges, n) */
    size_t station_panels;  /* panels (stations, n) */
    size_t driven;          /* (2n + m,) state and inputs; then (m,) growth of the inputs over the step */
    size_t steps;           /* (KEPT_STEPS,) steps of the transitions, s, 0 where there is none */
    size_t next;            /* index of the transition that the next new step replaces */
    size_t built;           /* (parameters,) that the matrices belong to; zero before the first time */
    size_t L;               /* (n, patches) */
    size_t R_K;             /* (n, n) */
    size_t A;               /* (2n, 2n) */
    size_t B;               /* (2n, m) */
    size_t scratch;
    size_t size;
} PlantLayout;

static PlantLayout plant_layout(const BeamPlantData *data)
{
    PlantLayout at = {.n = data->coordinates, .m = data->patches + data->beams};
    const size_t n = at.n;
    const size_t m = at.m;
    const size_t whole = 2 * n + 2 * m;
    at.transition_size = panels_size(2 * n, 2 * n + m) + panels_size(2 * n, m);
    at.output_panels = at.transitions + KEPT_STEPS * at.transition_size;
    at.station_panels = at.output_panels + panels_size(data->points + data->gauges, n);
    at.driven = at.station_panels + panels_size(data->stations, n);
    at.steps = at.driven + whole;
    at.next = at.steps + KEPT_STEPS;
    at.built = at.next + 1;
    at.L = at.built + data->parameter_count;
    at.R_K = at.L + n * data->patches;
    at.A = at.R_K + n * n;
    at.B = at.A + 4 * n * n;
    at.scratch = at.B + 2 * n * m;
    const size_t rows = data->points + data->gauges + data->stations;
    const size_t building = 4 * n * n + n * rows;
    const size_t stepping = whole * whole + matrix_exponential_size(whole);
    at.size = at.scratch + (building > stepping ? building : stepping);
    return at;
}

static size_t beam_plant_state_size(const void *data)
{
    const BeamPlantData *const plant = data;
    return 2 * plant->coordinates;
}

static size_t beam_plant_workspace_size(const void *data)
{
    return plant_layout(data).size;
}

/* M, D, K (n, n) and L (n, patches) for the present parameters. */
static void assemble(const UnitInstance *unit, double *M, double *D, double *K, double *L)
{
    const BeamPlantData *const plant = unit->data;
    const size_t n = plant->coordinates;
    double *const matrices[] = {[MASS] = M, [DAMPING] = D, [STIFFNESS] = K};
    memset(M, 0, n * n * sizeof *M);
    memset(D, 0, n * n * sizeof *D);
    memset(K, 0, n * n * sizeof *K);
    memset(L, 0, n * plant->patches * sizeof *L);
    for (size_t k = 0; k < plant->term_count; k++) {
        const PlantTerm *const term = &plant->terms[k];
        const double value = unit->values[term->parameter];
        const double *block = plant->blocks + term->block;
        for (size_t i = term->start; i < term->start + term->size; i++) {
            if (term->matrix == INPUT_GAIN) {
                L[i * plant->patches + term->column] += value * *block++;
                continue;
            }
            double *const row = matrices[term->matrix] + i * n;
            for (size_t j = term->start; j < term->start + term->size; j++)
                row[j] += value * *block++;
        }
    }
}

/* A = [0, C'; -C, -R_M^-1 D R_M^-T] with C = R_M^-1 R_K, and B = [0; R_M^-1 (L, F)]. */
static void energy_form(const BeamPlantData *plant, double *workspace, const double *R_M, double *D, double *scratch)
{
    const PlantLayout at = plant_layout(plant);
    const size_t n = at.n;
    const size_t m = at.m;
    double *const A = workspace + at.A;
    double *const B = workspace + at.B;
    double *const coupling = scratch;
    memcpy(coupling, workspace + at.R_K, n * n * sizeof *coupling);
    solve_lower(n, n, R_M, coupling);
    memset(A, 0, 4 * n * n * sizeof *A);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            A[j * 2 * n + n + i] = coupling[i * n + j];
            A[(n + i) * 2 * n + j] = -coupling[i * n + j];
        }
    double *const damping = scratch;
    solve_lower(n, n, R_M, D);
    transpose(n, n, D, damping);
    solve_lower(n, n, R_M, damping);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            A[(n + i) * 2 * n + n + j] = -(damping[i * n + j] + damping[j * n + i]) / 2;
    memset(B, 0, n * m * sizeof *B);
    for (size_t i = 0; i < n; i++) {
        double *const row = B + (n + i) * m;
        memcpy(row, workspace + at.L + i * plant->patches, plant->patches * sizeof *row);
        for (size_t j = 0; j < plant->beams; j++)
            row[plant->patches + j] = plant->tips[j * n + i];
    }
    solve_lower(n, m, R_M, B + n * m);
}

/* y = outputs R_K^-T x, for y_pi and y_pm, which are written each step, and for the stations. */
static void fill_output_panels(const BeamPlantData *plant, double *workspace, double *scratch)
{
    const PlantLayout at = plant_layout(plant);
    const size_t n = at.n;
    const size_t each_step = plant->points + plant->gauges;
    const size_t rows = each_step + plant->stations;
    transpose(rows, n, plant->outputs, scratch);
    solve_lower(n, rows, workspace + at.R_K, scratch);
    double *const outputs = scratch + n * rows;
    transpose(n, rows, scratch, outputs);
    fill_panels(each_step, n, outputs, n, workspace + at.output_panels);
    fill_panels(plant->stations, n, outputs + each_step * n, n, workspace + at.station_panels);
}

static bool check_parameters(UnitInstance *unit)
{
    const BeamPlantData *const plant = unit->data;
    for (size_t k = 0; k < plant->parameter_count; k++) {
        const PlantParameter *const parameter = &plant->parameters[k];
        const double value = unit->values[parameter->reference];
        if (!(value > 0.0) && !parameter->may_vanish)
            return unit_refuse(unit, "%s must be finite and > 0, got %r", unit->variables[parameter->reference].name,
                               value);
    }
    return true;
}

/* Do the matrices belong to the present parameters? */
static bool is_built(const UnitInstance *unit, const double *built)
{
    const BeamPlantData *const plant = unit->data;
    for (size_t k = 0; k < plant->parameter_count; k++)
        if (unit->values[plant->parameters[k].reference] != built[k])
            return false;
    return true;
}

/* Matrices of the present parameters; nothing is done where these are the same as before. */
static bool build_matrices(UnitInstance *unit)
{
    static const char refusal[] = "the %s matrix is not positive definite: check the structure's parameters";
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    double *const workspace = unit->workspace;
    double *const built = workspace + at.built;
    if (!check_parameters(unit))
        return false;
    if (is_built(unit, built))
        return true;
    memset(built, 0, plant->parameter_count * sizeof *built);
    double *const M = workspace + at.scratch;
    double *const D = M + at.n * at.n;
    double *const K = workspace + at.R_K;
    assemble(unit, M, D, K, workspace + at.L);
    if (!cholesky(at.n, M))
        return unit_refuse(unit, refusal, "mass");
    if (!cholesky(at.n, K))
        return unit_refuse(unit, refusal, "stiffness");
    energy_form(plant, workspace, M, D, D + at.n * at.n);
    fill_output_panels(plant, workspace, workspace + at.scratch);
    memset(workspace + at.steps, 0, (KEPT_STEPS + 1) * sizeof *workspace);
    for (size_t k = 0; k < plant->parameter_count; k++)
        built[k] = unit->values[plant->parameters[k].reference];
    return true;
}

/* x(t + h) from x(t), v(t) and h v': exp of [A h, B h, 0; 0, 0, I; 0, 0, 0], its first rows in panels. */
static bool discretise(double *workspace, const PlantLayout *at, double step, double *transition)
{
    const size_t n = 2 * at->n;
    const size_t m = at->m;
    const size_t whole = n + 2 * m;
    double *const exponent = workspace + at->scratch;
    memset(exponent, 0, whole * whole * sizeof *exponent);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            exponent[i * whole + j] = workspace[at->A + i * n + j] * step;
        for (size_t j = 0; j < m; j++)
            exponent[i * whole + n + j] = workspace[at->B + i * m + j] * step;
    }
    for (size_t i = 0; i < m; i++)
        exponent[(n + i) * whole + n + m + i] = 1.0;
    if (!matrix_exponential(whole, exponent, exponent + whole * whole))
        return false;
    for (size_t k = 0; k < n * whole; k++)
        if (!isfinite(exponent[k]))
            return false;
    fill_panels(n, n + m, exponent, whole, transition);
    fill_panels(n, m, exponent + n + m, whole, transition + panels_size(n, n + m));
    return true;
}

/* The transition over a step, of those kept or a new one. Steps that differ by the rounding of the clock are one
   step: hosts that subtract times would otherwise ask for ever new ones. NULL where there is none. */
static const double *transition_over(UnitInstance *unit, const PlantLayout *at, double time, double step)
{
    double *const steps = unit->workspace + at->steps;
    double *const next = unit->workspace + at->next; /* a double, as all of the workspace */
    double *const transitions = unit->workspace + at->transitions;
    for (size_t k = 0; k < KEPT_STEPS; k++)
        if (steps[k] == step)
            return transitions + k * at->transition_size;
    for (size_t k = 0; k < KEPT_STEPS; k++)
        if (fabs(steps[k] - step) <= 4 * DBL_EPSILON * (fabs(time) + step))
            return transitions + k * at->transition_size;
    const size_t index = (size_t)*next;
    double *const transition = transitions + index * at->transition_size;
    steps[index] = 0.0;
    if (!discretise(unit->workspace, at, step, transition)) {
        unit_refuse(unit, "the discretisation over %r s overflows: check the structure's parameters", step);
        return NULL;
    }
    steps[index] = step;
    *next = (double)((index + 1) % KEPT_STEPS);
    return transition;
}

/* y_pi and y_pm, with the noise of the sample at `time` (s since the start). */
static void write_plant_outputs(UnitInstance *unit, const PlantLayout *at, double time)
{
    const BeamPlantData *const plant = unit->data;
    double *const y_pi = unit->values + plant->y_pi;
    double *const y_pm = y_pi + plant->points;
    multiply_panels(plant->points + plant->gauges, at->n, unit->workspace + at->output_panels, unit->state, false,
                    y_pi);
    const double deviation = unit->values[plant->strain_noise_std];
    if (!(deviation > 0.0))
        return;
    const double tick = floor((time + clock_tolerance(unit, time, unit->step_size)) / unit->step_size);
    const uint64_t seed = (uint64_t)unit->values[plant->noise_seed];
    for (size_t k = 0; k < plant->gauges; k++)
        y_pm[k] += deviation * normal_number(seed, (uint64_t)tick, k);
}

/* At rest under the given voltages: R_K' q = R_K^-1 L u. */
static bool beam_plant_initialise(UnitInstance *unit)
{
    if (!build_matrices(unit))
        return false;
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    const double *const L = unit->workspace + at.L;
    const double *const u = unit->values + plant->start_at_rest_under;
    memset(unit->state, 0, 2 * at.n * sizeof *unit->state);
    multiply_matrices(at.n, plant->patches, 1, L, u, unit->state);
    solve_lower(at.n, 1, unit->workspace + at.R_K, unit->state);
    write_plant_outputs(unit, &at, 0.0);
    return true;
}

static bool beam_plant_prepare(UnitInstance *unit, double step)
{
    const PlantLayout at = plant_layout(unit->data);
    return transition_over(unit, &at, 0.0, step) != NULL;
}

/* x(t + h) = A_d x + B_d v + B_s h v', v = (u, force). */
static bool beam_plant_advance(UnitInstance *unit, double time, double step)
{
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    const double *const transition = transition_over(unit, &at, time, step);
    if (transition == NULL)
        return false;
    const size_t states = 2 * at.n;
    double *const driven = unit->workspace + at.driven;
    double *const v = driven + states;
    memcpy(driven, unit->state, states * sizeof *driven);
    memcpy(v, unit->values + plant->u, plant->patches * sizeof *v);
    memcpy(v + plant->patches, unit->values + plant->force, plant->beams * sizeof *v);
    multiply_panels(states, states + at.m, transition, driven, false, unit->state);
    if (unit->slopes != NULL) {
        double *const growth = v + at.m;
        for (size_t k = 0; k < plant->patches; k++)
            growth[k] = step * unit->slopes[plant->u + k];
        for (size_t k = 0; k < plant->beams; k++)
            growth[plant->patches + k] = step * unit->slopes[plant->force + k];
        multiply_panels(states, at.m, transition + panels_size(states, states + at.m), growth, true, unit->state);
    }
    write_plant_outputs(unit, &at, time + step);
    return true;
}

/* Stations along the beams, behind y_pi and y_pm, and the energy. */
static void beam_plant_complete(UnitInstance *unit)
{
    const BeamPlantData *const plant = unit->data;
    const PlantLayout at = plant_layout(plant);
    double *const w = unit->values + plant->y_pi + plant->points + plant->gauges;
    multiply_panels(plant->stations, at.n, unit->workspace + at.station_panels, unit->state, false, w);
    double sum = 0.0;
    for (size_t k = 0; k < 2 * at.n; k++)
        sum += unit->state[k] * unit->state[k];
    unit->values[plant->energy] = sum / 2;
}

INTERNAL_DATA const UnitHooks beam_plant_hooks = {
    .state_size = beam_plant_state_size,
    .workspace_size = beam_plant_workspace_size,
    .initialise = beam_plant_initialise,
    .prepare = beam_plant_prepare,
    .restore = build_matrices,
    .advance = beam_plant_advance,
    .complete = beam_plant_complete,
};
