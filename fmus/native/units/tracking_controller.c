/* TrackingController: Kalman filter (42), regulator (44) and integral action (45), on its own clock. */

#include "tracking_controller.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "linear_algebra.h"

/* State: integral (voltages,) V; ticks run since the start, a double as all of the state. */
static double *integral_of(const UnitInstance *unit)
{
    return unit->state;
}

static double *tick_of(const UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    return unit->state + controller->voltages;
}

static size_t tracking_controller_state_size(const void *data)
{
    const TrackingControllerData *const controller = data;
    return controller->voltages + 1;
}

/* A vector of states, voltages and gauges, then two of voltages. */
static size_t tracking_controller_workspace_size(const void *data)
{
    const TrackingControllerData *const controller = data;
    return controller->states + controller->gauges + 3 * controller->voltages;
}

/* u = commanded within the limit, y_est = H_pi x_est + D_pi u. */
static void write_commands(UnitInstance *unit, const double *commanded)
{
    const TrackingControllerData *const controller = unit->data;
    const double limit = unit->values[controller->voltage_limit];
    double *const u = unit->values + controller->u;
    double *const state_and_input = unit->workspace;
    bool saturated = false;
    for (size_t k = 0; k < controller->voltages; k++) {
        u[k] = fmin(fmax(commanded[k], -limit), limit);
        saturated = saturated || fabs(commanded[k]) > limit;
    }
    unit->values[controller->saturated] = saturated;
    memcpy(state_and_input, unit->values + controller->x_est, controller->states * sizeof *state_and_input);
    memcpy(state_and_input + controller->states, u, controller->voltages * sizeof *state_and_input);
    multiply_panels(controller->points, controller->states + controller->voltages, controller->estimates,
                    state_and_input, false, unit->values + controller->y_est);
}

static void clear_offsets(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    for (size_t k = controller->reduced_states; k < controller->states; k++)
        unit->values[controller->x_est + k] = 0.0;
}

/* The estimate starts on the reference, the voltages on the feedforward's. */
static bool tracking_controller_initialise(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    memcpy(unit->values + controller->x_est, unit->values + controller->x_ref,
           controller->reduced_states * sizeof *unit->values);
    clear_offsets(unit);
    memset(unit->state, 0, tracking_controller_state_size(controller) * sizeof *unit->state);
    write_commands(unit, unit->values + controller->u_ff);
    return true;
}

/* x_est(k+1) = A_d x_est + B_d u + L (y_pm - H_pm x_est - D_pm u), from the last tick's measurement and voltage. With
   strain offsets d, which follow x_est: d(k+1) = d + l e, and their reference is zero. */
static void estimate_state(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    const size_t states = controller->states;
    const size_t voltages = controller->voltages;
    const size_t gauges = controller->gauges;
    double *const stacked = unit->workspace;
    memcpy(stacked, unit->values + controller->x_est, states * sizeof *stacked);
    memcpy(stacked + states, unit->values + controller->u, voltages * sizeof *stacked);
    memcpy(stacked + states + voltages, unit->values + controller->y_pm, gauges * sizeof *stacked);
    multiply_panels(states, states + voltages + gauges, controller->filter, stacked, false,
                    unit->values + controller->x_est);
}

/* u = u_ff + K (x_ref - x_est) + integral; the integral grows by k_I G_0^+ of the estimated deviation, but not further
   into a limit. (45) needs the pseudo-inverse: the DC gain is negative, a positive scalar would destabilise. */
static void regulate(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    const size_t states = controller->states;
    const size_t voltages = controller->voltages;
    const double *const x_ref = unit->values + controller->x_ref;
    const double *const x_est = unit->values + controller->x_est;
    const double *const u_ff = unit->values + controller->u_ff;
    const double *const u = unit->values + controller->u;
    double *const integral = integral_of(unit);
    double *const error = unit->workspace;
    double *const commanded = error + states + voltages + controller->gauges;
    double *const growth = commanded + voltages;
    for (size_t k = 0; k < controller->reduced_states; k++)
        error[k] = x_ref[k] - x_est[k];
    for (size_t k = controller->reduced_states; k < states; k++)
        error[k] = -x_est[k];
    for (size_t k = 0; k < voltages; k++)
        error[states + k] = u_ff[k] - u[k];
    multiply_panels(2 * voltages, states + voltages, controller->regulator, error, false, commanded);
    const double gain = unit->values[controller->integral_gain];
    const double limit = unit->values[controller->voltage_limit];
    for (size_t k = 0; k < voltages; k++) {
        commanded[k] = u_ff[k] + commanded[k] + integral[k];
        growth[k] *= gain;
        const bool winding_up = fabs(commanded[k]) > limit && commanded[k] * growth[k] > 0;
        if (!winding_up)
            integral[k] += growth[k];
    }
    write_commands(unit, commanded);
}

static void run_tick(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    estimate_state(unit);
    if (unit->values[controller->feedback] != 0.0) {
        regulate(unit);
        return;
    }
    memset(integral_of(unit), 0, controller->voltages * sizeof(double));
    clear_offsets(unit);
    write_commands(unit, unit->values + controller->u_ff);
}

/* Every tick inside [time, time + step), with the inputs held; an integer counts them. */
static bool tracking_controller_advance(UnitInstance *unit, double time, double step)
{
    const TrackingControllerData *const controller = unit->data;
    double *const tick = tick_of(unit);
    const double end = time + step;
    const double last = (end - clock_tolerance(unit, end, controller->sample_time)) / controller->sample_time;
    for (; *tick < last; *tick += 1.0)
        run_tick(unit);
    return true;
}

/* A tick count that the clock cannot have, which no saved state has, would keep the next step busy for ever. */
static bool tracking_controller_restore(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    const double tick = *tick_of(unit);
    const double behind = unit->elapsed / controller->sample_time - tick;
    if (floor(tick) == tick && fabs(behind) <= 2.0 + 4 * DBL_EPSILON * tick)
        return true;
    return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

INTERNAL_DATA const UnitHooks tracking_controller_hooks = {
    .state_size = tracking_controller_state_size,
    .workspace_size = tracking_controller_workspace_size,
    .initialise = tracking_controller_initialise,
    .restore = tracking_controller_restore,
    .advance = tracking_controller_advance,
};
