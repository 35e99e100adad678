/* The modal forms of eight plants side by side. In energy coordinates x = (x_1, x_2) a plant is x_1' = C' x_2,
   x_2' = -C x_1 - G x_2 + B v, y = R x_1 with a symmetric G, see plant_matrices.h. The singular values and vectors
   C = U S V' are its undamped modes (one-sided Jacobi method); from each of them the damped mode s, v of
   s^2 v + s U'GU v + S^2 v = 0 follows by a fixed-point iteration. Left vectors are the right ones with the sign of x_2
   changed.

   A lane that has converged stays as it is, however long those beside it take. One that does not converge, as with real
   eigenvalues, is left to modal_build. */
#include "batch_modes.h"

#include <string.h>

#include "group_modes.h"
#include "modal_build.h"

static size_t vector_count(const BeamPlantData *plant)
{
    return plant->patches + plant->beams + plant->points + plant->gauges;
}

size_t modes_size(const BeamPlantData *plant)
{
    const size_t n = plant->coordinates;
    const size_t vectors = vector_count(plant);
    return LANES * (3 * n * n + n * (plant->points + plant->gauges + vectors + 1) + 2 * n * (3 + vectors) + 1);
}

static Modes modes_in(double *memory, const BeamPlantData *plant)
{
    const size_t n = plant->coordinates;
    Modes modes = {.n = n, .vectors = vector_count(plant), .U = (Lanes *)memory};
    modes.damping = modes.U + n * n;
    modes.product = modes.damping + n * n;
    modes.rows = modes.product + n * n;
    modes.columns = modes.rows + n * (plant->points + plant->gauges);
    modes.squares = modes.columns + n * modes.vectors;
    modes.v = (Complex *)(modes.squares + n);
    modes.forces = modes.v + n;
    modes.results = modes.forces + n;
    modes.is_found = (Lanes *)(modes.results + n * (1 + modes.vectors));
    return modes;
}

void set_modes_lane(double *memory, const BeamPlantData *plant, size_t lane, const PlantMatrices *matrices)
{
    const Modes to = modes_in(memory, plant);
    const size_t n = to.n;
    const size_t inputs = plant->patches + plant->beams;
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) {
            set_lane(&to.U[j * n + i], lane, matrices->A[j * 2 * n + n + i]);
            set_lane(&to.damping[j * n + i], lane, -matrices->A[(n + j) * 2 * n + n + i]);
        }
    for (size_t j = 0; j < inputs; j++)
        for (size_t i = 0; i < n; i++)
            set_lane(&to.columns[j * n + i], lane, matrices->B[(n + i) * inputs + j]);
    for (size_t k = 0; k < plant->points + plant->gauges; k++)
        for (size_t i = 0; i < n; i++)
            set_lane(&to.rows[k * n + i], lane, matrices->C[k * 2 * n + i]);
}

void find_modes(double *memory, const BeamPlantData *plant)
{
    const Modes m = modes_in(memory, plant);
    find_undamped(&m, plant);
    for (size_t mode = 0; mode < m.n; mode++)
        find_damped(&m, plant, mode);
}

static double lane_of(const Complex *from, size_t lane, size_t member)
{
    return get_lane(member == 0 ? &from->real : &from->imaginary, lane);
}

/* A mode of a lane as a pair of real coordinates: x = Re(r (z_1 - i z_2)). */
static void read_mode(const Modes *m, const BeamPlantData *plant, size_t lane, size_t mode, const Modal *to,
                      double *rest)
{
    const Complex *const from = m->results + mode * (1 + m->vectors);
    const double real = lane_of(from, lane, 0);
    const double imaginary = lane_of(from, lane, 1);
    for (size_t member = 0; member < 2; member++) {
        const size_t slot = modal_slot(mode, member);
        const size_t block = slot / MODAL_BLOCK;
        const double sign = member == 0 ? 1.0 : -1.0;
        const Complex *column = from + 1;
        modal_set_eigenvalue(to, slot, real, imaginary);
        for (size_t j = 0; j < to->held + to->rare; j++, column++)
            *(j < to->held ? &to->held_inputs[(block * to->held + j) * MODAL_BLOCK + slot % MODAL_BLOCK]
                           : &to->rare_inputs[(block * to->rare + j - to->held) * MODAL_BLOCK + slot % MODAL_BLOCK]) =
                sign * lane_of(column, lane, member);
        for (size_t k = 0; k < to->outputs; k++, column++)
            to->output_rows[k * to->slots + slot] = lane_of(column, lane, member);
    }
    const size_t first = modal_slot(mode, 0);
    const size_t second = modal_slot(mode, 1);
    const double inverse_real = to->inverse[first];
    const double inverse_imaginary = to->inverse[to->slots + first];
    for (size_t j = 0; j < plant->patches; j++) { /* -input / s */
        const double a = lane_of(from + 1 + j, lane, 0);
        const double b = lane_of(from + 1 + j, lane, 1);
        rest[first * plant->patches + j] = b * inverse_imaginary - a * inverse_real;
        rest[second * plant->patches + j] = a * inverse_imaginary + b * inverse_real;
    }
}

bool read_modes(double *memory, const BeamPlantData *plant, size_t lane, const Modal *to, double *rest)
{
    const Modes m = modes_in(memory, plant);
    if (get_lane(m.is_found, lane) == 0.0)
        return false;
    memset(to->real, 0, 4 * to->slots * sizeof *to->real);
    memset(to->held_inputs, 0, to->held * to->slots * sizeof *to->held_inputs);
    memset(to->rare_inputs, 0, to->rare * to->slots * sizeof *to->rare_inputs);
    memset(to->output_rows, 0, to->outputs * to->slots * sizeof *to->output_rows);
    memset(rest, 0, plant->patches * to->slots * sizeof *rest);
    to->facts[0] = (double)m.n;
    to->facts[1] = 0.0;
    for (size_t mode = 0; mode < m.n; mode++)
        read_mode(&m, plant, lane, mode, to, rest);
    return true;
}
