#include "plant_matrices.h"

#include <string.h>

#include "linear_algebra.h"

static size_t input_count(const BeamPlantData *plant)
{
    return plant->patches + plant->beams;
}

static size_t row_count(const BeamPlantData *plant)
{
    return plant->points + plant->gauges + plant->stations;
}

size_t plant_matrices_size(const BeamPlantData *plant)
{
    const size_t n = plant->coordinates;
    const size_t results =
        4 * n + 2 * input_count(plant) + 2 * (plant->points + plant->gauges) + plant->stations + 2 * plant->patches + 2;
    const size_t assembly = 4 * n + plant->patches + 2 * row_count(plant);
    return n * (results + assembly);
}

PlantMatrices plant_matrices_in(double *memory, const BeamPlantData *plant)
{
    const size_t n = plant->coordinates;
    PlantMatrices matrices = {.A = memory};
    matrices.B = matrices.A + 4 * n * n;
    matrices.C = matrices.B + 2 * n * input_count(plant);
    matrices.stations = matrices.C + 2 * n * (plant->points + plant->gauges);
    matrices.rest = matrices.stations + n * plant->stations;
    matrices.blocks = matrices.rest + 2 * n * plant->patches;
    matrices.scratch = matrices.blocks + 2 * n;
    return matrices;
}

/* What compute_plant_matrices works in. */
typedef struct {
    double *R_M;      /* (n, n), first M */
    double *D;        /* (n, n) */
    double *R_K;      /* (n, n), first K */
    double *coupling; /* (n, n) */
    double *L;        /* (n, patches) */
    double *rows;     /* (2, row_count, n) */
} Assembly;

static Assembly assembly_in(double *memory, const BeamPlantData *plant)
{
    const size_t n = plant->coordinates;
    Assembly assembly = {.R_M = memory, .D = memory + n * n, .R_K = memory + 2 * n * n, .coupling = memory + 3 * n * n};
    assembly.L = assembly.coupling + n * n;
    assembly.rows = assembly.L + n * plant->patches;
    return assembly;
}

/* M, D, K (n, n) and L (n, patches) for the present parameters. */
static void assemble(const UnitInstance *unit, const Assembly *to)
{
    const BeamPlantData *const plant = unit->data;
    const size_t n = plant->coordinates;
    double *const matrices[] = {[MASS] = to->R_M, [DAMPING] = to->D, [STIFFNESS] = to->R_K};
    for (size_t k = 0; k < sizeof matrices / sizeof *matrices; k++)
        memset(matrices[k], 0, n * n * sizeof **matrices);
    memset(to->L, 0, n * plant->patches * sizeof *to->L);
    for (size_t k = 0; k < plant->term_count; k++) {
        const PlantTerm *const term = &plant->terms[k];
        const double value = unit->values[term->parameter];
        const unsigned *const rows = plant->rows + term->rows;
        const double *block = plant->blocks + term->block;
        for (size_t i = 0; i < term->size; i++) {
            if (term->matrix == INPUT_GAIN) {
                to->L[rows[i] * plant->patches + term->column] += value * *block++;
                continue;
            }
            double *const row = matrices[term->matrix] + rows[i] * n;
            for (size_t j = 0; j < term->size; j++)
                row[rows[j]] += value * *block++;
        }
    }
}

/* A = [0, C'; -C, -R_M^-1 D R_M^-T] with C = R_M^-1 R_K. */
static void compute_dynamics(size_t n, const Assembly *from, double *A)
{
    double *const coupling = from->coupling;
    memcpy(coupling, from->R_K, n * n * sizeof *coupling);
    solve_lower(n, n, from->R_M, coupling);
    memset(A, 0, 4 * n * n * sizeof *A);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            A[j * 2 * n + n + i] = coupling[i * n + j];
            A[(n + i) * 2 * n + j] = -coupling[i * n + j];
        }
    double *const damping = from->coupling;
    solve_lower(n, n, from->R_M, from->D);
    transpose(n, n, from->D, damping);
    solve_lower(n, n, from->R_M, damping);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            A[(n + i) * 2 * n + n + j] = -(damping[i * n + j] + damping[j * n + i]) / 2;
}

/* B = [0; R_M^-1 (L, F)], and at rest x = [R_K^-1 L; 0] u. */
static void compute_inputs(const BeamPlantData *plant, const Assembly *from, double *B, double *rest)
{
    const size_t n = plant->coordinates;
    const size_t m = input_count(plant);
    const SparseRows *const outputs = &plant->outputs;
    memset(B, 0, 2 * n * m * sizeof *B);
    for (size_t i = 0; i < n; i++)
        memcpy(B + (n + i) * m, from->L + i * plant->patches, plant->patches * sizeof *B);
    for (size_t j = 0; j < plant->beams; j++) {
        const size_t tip = row_count(plant) + j;
        for (size_t k = outputs->starts[tip]; k < outputs->starts[tip + 1]; k++)
            B[(n + outputs->columns[k]) * m + plant->patches + j] = outputs->values[k];
    }
    solve_lower(n, m, from->R_M, B + n * m);
    memcpy(rest, from->L, n * plant->patches * sizeof *rest);
    solve_lower(n, plant->patches, from->R_K, rest);
    memset(rest + n * plant->patches, 0, n * plant->patches * sizeof *rest);
}

/* y = outputs R_K^-T x, for y_pi and y_pm, which are written each step, and for the stations. */
static void compute_outputs(const BeamPlantData *plant, const Assembly *from, const PlantMatrices *to)
{
    const size_t n = plant->coordinates;
    const size_t each_step = plant->points + plant->gauges;
    const size_t count = row_count(plant);
    const SparseRows *const outputs = &plant->outputs;
    double *const transposed = from->rows;
    double *const rows = transposed + n * count;
    memset(transposed, 0, n * count * sizeof *transposed);
    for (size_t i = 0; i < count; i++)
        for (size_t k = outputs->starts[i]; k < outputs->starts[i + 1]; k++)
            transposed[outputs->columns[k] * count + i] = outputs->values[k];
    solve_lower(n, count, from->R_K, transposed);
    transpose(n, count, transposed, rows);
    memset(to->C, 0, 2 * n * each_step * sizeof *to->C);
    for (size_t i = 0; i < each_step; i++)
        memcpy(to->C + i * 2 * n, rows + i * n, n * sizeof *rows);
    memcpy(to->stations, rows + each_step * n, n * plant->stations * sizeof *rows);
}

/* K q = L u at rest, hence K dq = dL u + L du - dK q; y = outputs q. */
void differentiate_rest(const UnitInstance *unit, const PlantMatrices *matrices, double *y)
{
    const BeamPlantData *const plant = unit->data;
    const size_t n = plant->coordinates;
    const Assembly from = assembly_in(matrices->scratch, plant);
    const double *const u = unit->values + plant->start_at_rest_under;
    double *const q = matrices->A;
    double *const load = q + n;
    multiply_matrices(n, plant->patches, 1, matrices->rest, u, q);
    solve_lower_transposed(n, from.R_K, q);
    multiply_matrices(n, plant->patches, 1, from.L, unit->changes + plant->start_at_rest_under, load);
    for (size_t k = 0; k < plant->term_count; k++) {
        const PlantTerm *const term = &plant->terms[k];
        const double change = unit->changes[term->parameter];
        const unsigned *const rows = plant->rows + term->rows;
        const double *block = plant->blocks + term->block;
        if (term->matrix == INPUT_GAIN)
            for (size_t i = 0; i < term->size; i++)
                load[rows[i]] += change * *block++ * u[term->column];
        if (term->matrix == STIFFNESS)
            for (size_t i = 0; i < term->size; i++)
                for (size_t j = 0; j < term->size; j++)
                    load[rows[i]] -= change * *block++ * q[rows[j]];
    }
    solve_lower(n, 1, from.R_K, load);
    multiply_matrices(plant->points + plant->gauges, n, 1, from.rows + n * row_count(plant), load, y);
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

NOT_INLINED bool compute_plant_matrices(UnitInstance *unit, const PlantMatrices *matrices)
{
    static const char refusal[] = "the %s matrix is not positive definite: check the structure's parameters";
    const BeamPlantData *const plant = unit->data;
    const size_t n = plant->coordinates;
    const Assembly assembly = assembly_in(matrices->scratch, plant);
    if (!check_parameters(unit))
        return false;
    assemble(unit, &assembly);
    if (!cholesky(n, assembly.R_M))
        return unit_refuse(unit, refusal, "mass");
    if (!cholesky(n, assembly.R_K))
        return unit_refuse(unit, refusal, "stiffness");
    number_blocks(n, assembly.R_M, matrices->blocks);
    memcpy(matrices->blocks + n, matrices->blocks, n * sizeof *matrices->blocks);
    compute_dynamics(n, &assembly, matrices->A);
    compute_inputs(plant, &assembly, matrices->B, matrices->rest);
    compute_outputs(plant, &assembly, matrices);
    return true;
}
