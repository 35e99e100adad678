/* Bare loops: the arithmetic of the units and of the closed loop, with no FMI and no checks, to measure units by.

   The one file of a FlatnessFeedforward comes first: its linear algebra, its transition and the tables of its design
   are used here. */

#include "FlatnessFeedforward.c"

#include "bench.h"

static const FlatnessFeedforwardData *const tables = &unit_data;

/* [x, u, force], from which the next state follows. */
static void gather_inputs(BarePlant *p, const double *inputs)
{
    memcpy(p->driven, p->x, p->states * sizeof *p->driven);
    memcpy(p->driven + p->states, inputs, p->inputs * sizeof *p->driven);
}

static void step_bare_plant(BarePlant *p)
{
    multiply_panels(p->states, p->states + p->inputs, p->transition, p->driven, false, p->x);
    multiply_panels(p->output_count, p->states / 2, p->outputs, p->x, false, p->y);
}

void bare_plant_loop(BarePlant *p, size_t count, const double *rows)
{
    for (size_t k = 0; k < count; k++) {
        gather_inputs(p, rows + k * p->inputs);
        step_bare_plant(p);
    }
}

static void step_bare_controller(BareController *c, const double *u_ff, const double *x_ref, const double *y_pm)
{
    const size_t states = c->states;
    const size_t voltages = c->voltages;
    double *const stacked = c->scratch;
    double *const commanded = stacked + states + voltages + c->gauges;
    double *const growth = commanded + voltages;
    memcpy(stacked, c->x_est, states * sizeof *stacked);
    memcpy(stacked + states, c->u, voltages * sizeof *stacked);
    memcpy(stacked + states + voltages, y_pm, c->gauges * sizeof *stacked);
    multiply_panels(states, states + voltages + c->gauges, c->filter, stacked, false, c->x_est);
    for (size_t k = 0; k < states; k++)
        stacked[k] = x_ref[k] - c->x_est[k];
    for (size_t k = 0; k < voltages; k++)
        stacked[states + k] = u_ff[k] - c->u[k];
    multiply_panels(2 * voltages, states + voltages, c->regulator, stacked, false, commanded);
    for (size_t k = 0; k < voltages; k++) {
        const double value = u_ff[k] + commanded[k] + c->integral[k];
        const double more = c->integral_gain * growth[k];
        if (!(fabs(value) > c->limit && value * more > 0))
            c->integral[k] += more;
        c->u[k] = fmin(fmax(value, -c->limit), c->limit);
    }
    memcpy(stacked, c->x_est, states * sizeof *stacked);
    memcpy(stacked + states, c->u, voltages * sizeof *stacked);
    multiply_panels(c->points, states + voltages, c->estimates, stacked, false, c->y_est);
}

void bare_controller_loop(BareController *c, size_t count, const double *rows)
{
    const size_t width = c->voltages + c->states + c->gauges;
    for (size_t k = 0; k < count; k++) {
        const double *const row = rows + k * width;
        step_bare_controller(c, row, row + c->voltages, row + c->voltages + c->states);
    }
}

/* u_ff, x_ref and y_ref at `time`, of the transitions begun and not ended. */
static void evaluate_bare_feedforward(BareFeedforward *f, double time)
{
    const FlatOutput *const flat = &tables->flat;
    const size_t voltages = flat->voltages;
    const size_t states = flat->states;
    double *const state_and_input = f->scratch;
    for (; f->ended < f->begun && time >= f->starts[f->ended] + f->durations[f->ended]; f->ended++)
        for (size_t j = 0; j < voltages; j++)
            f->offset[j] += f->changes[f->ended * voltages + j];
    const Motion motion = {.count = f->begun - f->ended,
                           .offset = f->offset,
                           .starts = f->starts + f->ended,
                           .durations = f->durations + f->ended,
                           .changes = f->changes + f->ended * voltages};
    evaluate_flat_output(flat, &motion, time, f->u_ff, f->x_ref, f->scratch);
    memcpy(state_and_input, f->x_ref, states * sizeof *state_and_input);
    memcpy(state_and_input + states, f->u_ff, voltages * sizeof *state_and_input);
    multiply_panels(tables->points, states + voltages, tables->reference_outputs, state_and_input, false, f->y_ref);
}

/* Step number `number`, from number * step on; at rest nothing is to do. */
static void step_bare_feedforward(BareFeedforward *f, int64_t number, double step)
{
    while (f->begun < f->count && f->begins[f->begun] <= number)
        f->begun++;
    if (f->ended < f->begun)
        evaluate_bare_feedforward(f, (double)number * step + step + f->preview);
}

void bare_feedforward_loop(BareFeedforward *f, int64_t first, size_t count, double step)
{
    for (size_t k = 0; k < count; k++)
        step_bare_feedforward(f, first + (int64_t)k, step);
}

size_t bare_feedforward_scratch(void)
{
    const size_t evaluation = flat_output_scratch(&tables->flat);
    const size_t arguments = tables->flat.states + tables->flat.voltages;
    return evaluation > arguments ? evaluation : arguments;
}

size_t step_lengths(fmi2DoStepTYPE *do_step, fmi2Component component, double time, size_t count, const double *lengths)
{
    for (size_t k = 0; k < count; time += lengths[k++])
        if (do_step(component, time, lengths[k], fmi2True) > fmi2Warning)
            return k;
    return count;
}

/* Jacobi: all take the values at the start of the step. */
void bare_loop(BarePlant *p, BareController *c, BareFeedforward *f, size_t count, double step)
{
    for (size_t k = 0; k < count; k++) {
        memcpy(p->held, c->u, c->voltages * sizeof *p->held);
        gather_inputs(p, p->held);
        step_bare_controller(c, f->u_ff, f->x_ref, p->y + c->points);
        step_bare_feedforward(f, (int64_t)k, step);
        step_bare_plant(p);
    }
}
