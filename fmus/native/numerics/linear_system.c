#include "linear_system.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "matrix_exponential.h"
#include "modal_build.h"

/* Condition number of an eigenvalue above which a system is dense. The modal form loses as many digits: it agrees with
   the exponential to 1e-13 at 42, to 1e-11 at 423, to 2e-2 where eigenvectors coincide. */

enum { IS_DENSE, PREPARED_STEP, PREPARED_GROWTH, FACT_COUNT = 8 }; /* whole cache lines */

static size_t dense_size(size_t states, size_t inputs, size_t outputs)
{
    return states * (states + inputs) + panels_size(states, states + inputs) + panels_size(states, inputs) +
           panels_size(outputs, states);
}

size_t linear_system_size(size_t states, size_t held, size_t rare, size_t outputs)
{
    const size_t dense = dense_size(states, held + rare, outputs);
    const size_t modal = modal_size(states, held, rare, outputs);
    return FACT_COUNT + (dense > modal ? dense : modal);
}

size_t linear_system_scratch_size(size_t states, size_t held, size_t rare)
{
    const size_t whole = states + 2 * (held + rare);
    const size_t dense = whole * whole + matrix_exponential_size(whole);
    const size_t modal = states * states + modal_scratch_size(states);
    return dense > modal ? dense : modal;
}

LinearSystem linear_system_in(double *memory, double *scratch, size_t states, size_t held, size_t rare, size_t outputs)
{
    LinearSystem system = {.states = states, .inputs = held + rare, .outputs = outputs, .scratch = scratch};
    system.facts = memory;
    system.modal = modal_in(memory + FACT_COUNT, states, held, rare, outputs);
    system.slots = system.modal.slots;
    system.transition = memory + FACT_COUNT;
    system.C = system.transition + panels_size(states, states + system.inputs) + panels_size(states, system.inputs);
    system.A = system.C + panels_size(outputs, states);
    system.B = system.A + states * states;
    return system;
}

NOT_INLINED void linear_system_build(const LinearSystem *system, const double *A, const double *blocks, const double *B,
                                     const double *C)
{
    const size_t n = system->states;
    double *const copy = system->scratch;
    memcpy(copy, A, n * n * sizeof *A);
    const bool is_dense = !(modal_build(&system->modal, copy, blocks, B, C, copy + n * n) <= LARGEST_CONDITION);
    system->facts[IS_DENSE] = is_dense;
    system->facts[PREPARED_STEP] = 0.0;
    if (!is_dense)
        return;
    memcpy(system->A, A, n * n * sizeof *A);
    memcpy(system->B, B, n * system->inputs * sizeof *B);
    fill_panels(system->outputs, n, C, n, system->C);
}

void linear_system_coordinates(const LinearSystem *system, size_t columns, const double *X, double *z)
{
    const size_t n = system->states;
    if (system->facts[IS_DENSE] == 0.0) {
        modal_coordinates(&system->modal, columns, X, z, system->scratch + n * n);
        return;
    }
    memcpy(z, X, n * columns * sizeof *z);
    memset(z + n * columns, 0, (system->slots - n) * columns * sizeof *z);
}

/* exp of [A h, B h, 0; 0, 0, I; 0, 0, 0], of which the first rows go into panels: x(t + h) from x(t), v(t) and h v'. */
NOT_INLINED static bool discretise(const LinearSystem *system, double step)
{
    const size_t n = system->states;
    const size_t m = system->inputs;
    const size_t whole = n + 2 * m;
    double *const exponent = system->scratch;
    memset(exponent, 0, whole * whole * sizeof *exponent);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            exponent[i * whole + j] = system->A[i * n + j] * step;
        for (size_t j = 0; j < m; j++)
            exponent[i * whole + n + j] = system->B[i * m + j] * step;
    }
    for (size_t i = 0; i < m; i++)
        exponent[(n + i) * whole + n + m + i] = 1.0;
    if (!matrix_exponential(whole, exponent, exponent + whole * whole))
        return false;
    for (size_t k = 0; k < n * whole; k++)
        if (!isfinite(exponent[k]))
            return false;
    fill_panels(n, n + m, exponent, whole, system->transition);
    fill_panels(n, m, exponent + n + m, whole, system->transition + panels_size(n, n + m));
    return true;
}

bool linear_system_prepare(const LinearSystem *system, double step, bool grows)
{
    if (step == system->facts[PREPARED_STEP] && (!grows || system->facts[PREPARED_GROWTH] != 0.0))
        return true;
    const bool is_dense = system->facts[IS_DENSE] != 0.0;
    system->facts[PREPARED_STEP] = 0.0;
    if (!(is_dense ? discretise(system, step) : modal_prepare(&system->modal, step, grows)))
        return false;
    system->facts[PREPARED_STEP] = step;
    system->facts[PREPARED_GROWTH] = is_dense || grows;
    return true;
}

void linear_system_step(const LinearSystem *system, const double *v, const double *growth, double *z)
{
    if (system->facts[IS_DENSE] == 0.0) {
        modal_step(&system->modal, v, growth, z);
        return;
    }
    const size_t n = system->states;
    const size_t m = system->inputs;
    double *const state_and_input = system->scratch;
    memcpy(state_and_input, z, n * sizeof *z);
    memcpy(state_and_input + n, v, m * sizeof *v);
    multiply_panels(n, n + m, system->transition, state_and_input, false, z);
    if (growth != NULL)
        multiply_panels(n, m, system->transition + panels_size(n, n + m), growth, true, z);
}

void linear_system_outputs(const LinearSystem *system, const double *z, double *y)
{
    if (system->facts[IS_DENSE] == 0.0)
        modal_outputs(&system->modal, z, y);
    else
        multiply_panels(system->outputs, system->states, system->C, z, false, y);
}

void linear_system_state(const LinearSystem *system, const double *z, double *x)
{
    if (system->facts[IS_DENSE] == 0.0)
        modal_state(&system->modal, z, x);
    else
        memcpy(x, z, system->states * sizeof *x);
}
