/* BeamPlant: M q'' + D q' + K q = L u + F force, exact for inputs that are held or grow linearly over a step.

   State x = (R_K' q, R_M' q') with K = R_K R_K', M = R_M R_M': half its squared norm is the mechanical energy, and
   the system's matrix is skew-symmetric less the damping, so its exponential is a contraction. */

#include "beam_plant.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "linear_algebra.h"

#define KEPT_STEPS 4

/* Where things lie in the workspace, what a step multiplies by first. n coordinates, m inputs (voltages, then forces). */
typedef struct {
    size_t n, m;
    size_t transitions;  /* KEPT_STEPS times panels [A_d B_d] (2n, 2n + m) and panels of the slopes (2n, m) */
    size_t transition;   /* size of one of these */
    size_t shown;        /* panels (points + gauges, n) */
    size_t hidden;       /* panels (stations, n) */
    size_t driven;       /* (2n + m,) state and inputs; then (m,) growth of the inputs over the step */
    size_t steps, next;  /* (KEPT_STEPS,) known, s, 0 where free; place of the next one */
    size_t built;        /* (parameters,) that the matrices belong to; zero before the first time */
    size_t L, R_K;       /* (n, patches), (n, n) */
    size_t A, B;         /* (2n, 2n), (2n, m) */
    size_t scratch, size;
} layout;

static layout places(void)
{
    layout at = {.n = plant.coordinates, .m = plant.patches + plant.beams};
    const size_t n = at.n, m = at.m, whole = 2 * n + 2 * m;
    at.transition = panels_size(2 * n, 2 * n + m) + panels_size(2 * n, m);
    at.shown = at.transitions + KEPT_STEPS * at.transition;
    at.hidden = at.shown + panels_size(plant.points + plant.gauges, n);
    at.driven = at.hidden + panels_size(plant.stations, n);
    at.steps = at.driven + whole;
    at.next = at.steps + KEPT_STEPS;
    at.built = at.next + 1;
    at.L = at.built + plant.parameters;
    at.R_K = at.L + n * plant.patches;
    at.A = at.R_K + n * n;
    at.B = at.A + 4 * n * n;
    at.scratch = at.B + 2 * n * m;
    const size_t rows = plant.points + plant.gauges + plant.stations;
    const size_t building = 4 * n * n + n * rows, stepping = whole * whole + matrix_exponential_size(whole);
    at.size = at.scratch + (building > stepping ? building : stepping);
    return at;
}

size_t unit_state_size(void)
{
    return 2 * plant.coordinates;
}

size_t unit_workspace_size(void)
{
    return places().size;
}

/* M, D, K (n, n) and L (n, patches) for the present parameters. */
static void assemble(const unit *unit, const layout *at, double *M, double *D, double *K, double *L)
{
    const size_t n = at->n, patches = plant.patches;
    memset(M, 0, n * n * sizeof *M);
    memset(D, 0, n * n * sizeof *D);
    memset(K, 0, n * n * sizeof *K);
    memset(L, 0, n * patches * sizeof *L);
    for (size_t k = 0; k < plant.terms; k++) {
        const plant_term *const term = &plant_terms[k];
        const double value = unit->values[term->parameter];
        const double *block = plant_blocks + term->block;
        double *const matrix = term->matrix == 'M' ? M : term->matrix == 'D' ? D : K;
        for (size_t i = term->start; i < term->start + term->size; i++)
            if (term->matrix == 'L')
                L[i * patches + term->column] += value * *block++;
            else
                for (size_t j = term->start; j < term->start + term->size; j++)
                    matrix[i * n + j] += value * *block++;
    }
}

static void transpose(size_t rows, size_t columns, const double *A, double *transposed)
{
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < columns; j++)
            transposed[j * rows + i] = A[i * columns + j];
}

/* A = [0, C'; -C, -R_M^-1 D R_M^-T] with C = R_M^-1 R_K, and B = [0; R_M^-1 (L, F)]. */
static void energy_form(double *workspace, const layout *at, const double *R_M, double *D, double *scratch)
{
    const size_t n = at->n, m = at->m, patches = plant.patches;
    double *const A = workspace + at->A, *const B = workspace + at->B;
    double *const coupling = scratch;
    memcpy(coupling, workspace + at->R_K, n * n * sizeof *coupling);
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
        memcpy(row, workspace + at->L + i * patches, patches * sizeof *row);
        for (size_t j = 0; j < plant.beams; j++)
            row[patches + j] = plant_tips[j * n + i];
    }
    solve_lower(n, m, R_M, B + n * m);
}

/* y = outputs R_K^-T x, for the rows that are put out each step and the others. */
static void output_panels(double *workspace, const layout *at, double *scratch)
{
    const size_t n = at->n, each_step = plant.points + plant.gauges, rows = each_step + plant.stations;
    transpose(rows, n, plant_outputs, scratch);
    solve_lower(n, rows, workspace + at->R_K, scratch);
    double *const outputs = scratch + n * rows;
    transpose(n, rows, scratch, outputs);
    fill_panels(each_step, n, outputs, n, workspace + at->shown);
    fill_panels(plant.stations, n, outputs + each_step * n, n, workspace + at->hidden);
}

/* Matrices of the present parameters; nothing is done where these are the same as before. */
static bool build(unit *unit)
{
    const layout at = places();
    double *const workspace = unit->workspace, *const built = workspace + at.built;
    bool same = true;
    for (size_t k = 0; k < plant.parameters; k++) {
        const unsigned reference = plant_parameters[k].reference;
        const double value = unit->values[reference];
        if (!(value > 0.0) && !plant_parameters[k].may_vanish)
            return unit_refuse(unit, "%s must be finite and > 0, got %r", unit_variables[reference].name, value);
        same = same && value == built[k];
    }
    if (same)
        return true;
    memset(built, 0, plant.parameters * sizeof *built);
    const size_t n = at.n;
    double *const M = workspace + at.scratch, *const D = M + n * n, *const K = workspace + at.R_K;
    assemble(unit, &at, M, D, K, workspace + at.L);
    static const char refusal[] = "the %s matrix is not positive definite: check the structure's parameters";
    if (!cholesky(n, M))
        return unit_refuse(unit, refusal, "mass");
    if (!cholesky(n, K))
        return unit_refuse(unit, refusal, "stiffness");
    energy_form(workspace, &at, M, D, D + n * n);
    output_panels(workspace, &at, workspace + at.scratch);
    memset(workspace + at.steps, 0, (KEPT_STEPS + 1) * sizeof *workspace);
    for (size_t k = 0; k < plant.parameters; k++)
        built[k] = unit->values[plant_parameters[k].reference];
    return true;
}

/* x(t + h) from x(t), v(t) and h v': exp of [A h, B h, 0; 0, 0, I; 0, 0, 0], its first rows in panels. */
static bool discretise(double *workspace, const layout *at, double step, double *transition)
{
    const size_t n = 2 * at->n, m = at->m, whole = n + 2 * m;
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
static const double *transition_over(unit *unit, const layout *at, double time, double step)
{
    double *const steps = unit->workspace + at->steps, *const next = unit->workspace + at->next;
    double *const transitions = unit->workspace + at->transitions;
    for (size_t k = 0; k < KEPT_STEPS; k++)
        if (steps[k] == step)
            return transitions + k * at->transition;
    for (size_t k = 0; k < KEPT_STEPS; k++)
        if (fabs(steps[k] - step) <= 4 * DBL_EPSILON * (fabs(time) + step))
            return transitions + k * at->transition;
    const size_t place = (size_t)*next;
    double *const transition = transitions + place * at->transition;
    steps[place] = 0.0;
    if (!discretise(unit->workspace, at, step, transition)) {
        unit_refuse(unit, "the discretisation over %r s overflows: check the structure's parameters", step);
        return NULL;
    }
    steps[place] = step;
    *next = (double)((place + 1) % KEPT_STEPS);
    return transition;
}

/* The 64-bit finaliser of SplitMix64 (Steele, Lea and Flood 2014). */
static uint64_t mixed(uint64_t key)
{
    key = (key ^ key >> 30) * 0xbf58476d1ce4e5b9u;
    key = (key ^ key >> 27) * 0x94d049bb133111ebu;
    return key ^ key >> 31;
}

/* A standard normal number for a seed, sample and channel: order and step size do not matter (Box-Muller). */
static double normal_number(uint64_t seed, uint64_t tick, uint64_t channel)
{
    static const double pi = 0x1.921fb54442d18p+1;
    const uint64_t golden = 0x9e3779b97f4a7c15u;
    const uint64_t key = mixed(mixed(mixed(seed + golden) + tick) + channel);
    const double first = ((double)(key >> 11) + 0.5) / 0x1p53;
    const double second = (double)(mixed(key + golden) >> 11) / 0x1p53;
    return sqrt(-2 * log(first)) * cos(2 * pi * second);
}

static void put_out(unit *unit, const layout *at, double time)
{
    double *const y_pi = unit->values + plant.y_pi, *const y_pm = y_pi + plant.points;
    multiply_panels(plant.points + plant.gauges, at->n, unit->workspace + at->shown, unit->state, false, y_pi);
    const double deviation = unit->values[plant.strain_noise_std];
    if (!(deviation > 0.0))
        return;
    const double tick = floor(time / unit_step_size + 1e-6);
    if (!(fabs(tick) < 0x1p63))
        return;
    const uint64_t seed = (uint64_t)unit->values[plant.noise_seed];
    for (size_t k = 0; k < plant.gauges; k++)
        y_pm[k] += deviation * normal_number(seed, (uint64_t)(int64_t)tick, k);
}

/* At rest under the given voltages: R_K' q = R_K^-1 L u. */
bool unit_initialise(unit *unit)
{
    if (!build(unit))
        return false;
    const layout at = places();
    const double *const L = unit->workspace + at.L, *const u = unit->values + plant.start_at_rest_under;
    memset(unit->state, 0, 2 * at.n * sizeof *unit->state);
    multiply_matrices(at.n, plant.patches, 1, L, u, unit->state);
    solve_lower(at.n, 1, unit->workspace + at.R_K, unit->state);
    put_out(unit, &at, unit->values[0]);
    return true;
}

bool unit_prepare(unit *unit, double step)
{
    const layout at = places();
    return transition_over(unit, &at, 0.0, step) != NULL;
}

bool unit_restore(unit *unit)
{
    return build(unit);
}

/* x(t + h) = A_d x + B_d v + B_s h v', v = (u, force). */
bool unit_advance(unit *unit, double time, double step)
{
    const layout at = places();
    const double *const transition = transition_over(unit, &at, time, step);
    if (transition == NULL)
        return false;
    const size_t states = 2 * at.n;
    double *const driven = unit->workspace + at.driven, *const v = driven + states;
    memcpy(driven, unit->state, states * sizeof *driven);
    memcpy(v, unit->values + plant.u, plant.patches * sizeof *v);
    memcpy(v + plant.patches, unit->values + plant.force, plant.beams * sizeof *v);
    multiply_panels(states, states + at.m, transition, driven, false, unit->state);
    if (unit->slopes != NULL) {
        double *const growth = v + at.m;
        for (size_t k = 0; k < plant.patches; k++)
            growth[k] = step * unit->slopes[plant.u + k];
        for (size_t k = 0; k < plant.beams; k++)
            growth[plant.patches + k] = step * unit->slopes[plant.force + k];
        multiply_panels(states, at.m, transition + panels_size(states, states + at.m), growth, true, unit->state);
    }
    put_out(unit, &at, time + step);
    return true;
}

/* Stations along the beams, behind y_pi and y_pm, and the energy. */
void unit_complete(unit *unit)
{
    const layout at = places();
    double *const w = unit->values + plant.y_pi + plant.points + plant.gauges;
    multiply_panels(plant.stations, at.n, unit->workspace + at.hidden, unit->state, false, w);
    double sum = 0.0;
    for (size_t k = 0; k < 2 * at.n; k++)
        sum += unit->state[k] * unit->state[k];
    unit->values[plant.energy] = sum / 2;
}
