/* Bare loops: the arithmetic of the units and of the closed loop, with no FMI and no checks, to measure units by.

   Compiled with the units' linear_algebra.c and transition.c and the tables of a FlatnessFeedforward. */

#include "bench.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "transition.h"

/* [x, u, force], from which the next state follows. */
static void gather(bare_plant *p, const double *inputs)
{
    memcpy(p->driven, p->x, p->states * sizeof *p->driven);
    memcpy(p->driven + p->states, inputs, p->inputs * sizeof *p->driven);
}

static void step_plant(bare_plant *p)
{
    multiply_panels(p->states, p->states + p->inputs, p->transition, p->driven, false, p->x);
    multiply_panels(p->shown, p->states / 2, p->outputs, p->x, false, p->y);
}

void bare_plant_loop(bare_plant *p, size_t count, const double *rows)
{
    for (size_t k = 0; k < count; k++) {
        gather(p, rows + k * p->inputs);
        step_plant(p);
    }
}

static void step_controller(bare_controller *c, const double *u_ff, const double *x_ref, const double *y_pm)
{
    const size_t states = c->states, voltages = c->voltages;
    double *const known = c->scratch, *const wanted = known + states + voltages + c->gauges;
    double *const growth = wanted + voltages;
    memcpy(known, c->x_est, states * sizeof *known);
    memcpy(known + states, c->u, voltages * sizeof *known);
    memcpy(known + states + voltages, y_pm, c->gauges * sizeof *known);
    multiply_panels(states, states + voltages + c->gauges, c->filter, known, false, c->x_est);
    for (size_t k = 0; k < states; k++)
        known[k] = x_ref[k] - c->x_est[k];
    for (size_t k = 0; k < voltages; k++)
        known[states + k] = u_ff[k] - c->u[k];
    multiply_panels(2 * voltages, states + voltages, c->regulator, known, false, wanted);
    for (size_t k = 0; k < voltages; k++) {
        const double value = u_ff[k] + wanted[k] + c->integral[k], more = c->integral_gain * growth[k];
        if (!(fabs(value) > c->limit && value * more > 0))
            c->integral[k] += more;
        c->u[k] = fmin(fmax(value, -c->limit), c->limit);
    }
    memcpy(known, c->x_est, states * sizeof *known);
    memcpy(known + states, c->u, voltages * sizeof *known);
    multiply_panels(c->points, states + voltages, c->estimates, known, false, c->y_est);
}

void bare_controller_loop(bare_controller *c, size_t count, const double *rows)
{
    const size_t width = c->voltages + c->states + c->gauges;
    for (size_t k = 0; k < count; k++) {
        const double *const row = rows + k * width;
        step_controller(c, row, row + c->voltages, row + c->voltages + c->states);
    }
}

/* u_ff, x_ref and y_ref at `time`, of the transitions begun and not ended. */
static void evaluate(bare_feedforward *f, double time)
{
    const size_t voltages = feedforward.voltages, states = feedforward.states, degree = feedforward.degree;
    double *const xi = f->scratch, *const theta = xi + (degree + 1) * voltages;
    double *const series = theta + transition_terms(degree) + 1, *const both = series + 2 * transition_terms(degree);
    for (; f->ended < f->begun && time >= f->starts[f->ended] + f->durations[f->ended]; f->ended++)
        for (size_t j = 0; j < voltages; j++)
            f->offset[j] += f->steps[f->ended * voltages + j];
    memset(xi, 0, (degree + 1) * voltages * sizeof *xi);
    memcpy(xi, f->offset, voltages * sizeof *xi);
    for (size_t k = f->ended; k < f->begun; k++) {
        transition_series((time - f->starts[k]) / f->durations[k], degree, theta, series);
        double scale = 1.0;  /* i! / T^i */
        for (size_t i = 0; i <= degree; i++) {
            for (size_t j = 0; j < voltages; j++)
                xi[i * voltages + j] += theta[i] * scale * f->steps[k * voltages + j];
            scale *= (double)(i + 1) / f->durations[k];
        }
    }
    for (size_t j = 0; j < voltages; j++) {
        double sum = 0.0;
        for (size_t i = 0; i <= degree; i++)
            sum += input_series[i] * xi[i * voltages + j];
        f->u_ff[j] = sum;
    }
    multiply_panels(states, degree * voltages, state_series, xi, false, f->x_ref);
    memcpy(both, f->x_ref, states * sizeof *both);
    memcpy(both + states, f->u_ff, voltages * sizeof *both);
    multiply_panels(feedforward.points, states + voltages, reference_outputs, both, false, f->y_ref);
}

/* Step number `number`, from number * step on; at rest nothing is to do. */
static void step_feedforward(bare_feedforward *f, int64_t number, double step)
{
    while (f->begun < f->count && f->begins[f->begun] <= number)
        f->begun++;
    if (f->ended < f->begun)
        evaluate(f, (double)number * step + step + f->preview);
}

void bare_feedforward_loop(bare_feedforward *f, int64_t first, size_t count, double step)
{
    for (size_t k = 0; k < count; k++)
        step_feedforward(f, first + (int64_t)k, step);
}

size_t bare_feedforward_scratch(void)
{
    const size_t terms = transition_terms(feedforward.degree), degree = feedforward.degree;
    return (degree + 1) * feedforward.voltages + 3 * terms + 1 + feedforward.states + feedforward.voltages;
}

/* Jacobi: all take the values at the start of the step. */
void bare_loop(bare_plant *p, bare_controller *c, bare_feedforward *f, size_t count, double step)
{
    for (size_t k = 0; k < count; k++) {
        memcpy(p->held, c->u, c->voltages * sizeof *p->held);
        gather(p, p->held);
        step_controller(c, f->u_ff, f->x_ref, p->y + c->points);
        step_feedforward(f, (int64_t)k, step);
        step_plant(p);
    }
}
