/* TrackingController: Kalman filter (42), regulator (44) and integral action (45), on its own clock. */

#include "tracking_controller.h"

#include <math.h>
#include <string.h>

#include "linear_algebra.h"

/* State: integral (voltages,) V, ticks run since the start, start time s. */
static double *integral_of(const unit *unit) { return unit->state; }
static double *tick_of(const unit *unit) { return unit->state + controller.voltages; }
static double *start_of(const unit *unit) { return unit->state + controller.voltages + 1; }

size_t unit_state_size(void)
{
    return controller.voltages + 2;
}

/* A vector of states, voltages and gauges, then two of voltages. */
size_t unit_workspace_size(void)
{
    return controller.states + controller.gauges + 3 * controller.voltages;
}

/* u = wanted within the limit, y_est = H_pi x_est + D_pi u. */
static void put_out(unit *unit, const double *wanted)
{
    const double limit = unit->values[controller.voltage_limit];
    double *const u = unit->values + controller.u, *const both = unit->workspace;
    bool saturated = false;
    for (size_t k = 0; k < controller.voltages; k++) {
        u[k] = fmin(fmax(wanted[k], -limit), limit);
        saturated = saturated || fabs(wanted[k]) > limit;
    }
    unit->values[controller.saturated] = saturated;
    memcpy(both, unit->values + controller.x_est, controller.states * sizeof *both);
    memcpy(both + controller.states, u, controller.voltages * sizeof *both);
    multiply_panels(controller.points, controller.states + controller.voltages, controller_estimates, both, false,
                    unit->values + controller.y_est);
}

/* The estimate starts on the reference, the voltages on the feedforward's. */
bool unit_initialise(unit *unit)
{
    memcpy(unit->values + controller.x_est, unit->values + controller.x_ref,
           controller.states * sizeof *unit->values);
    memset(unit->state, 0, unit_state_size() * sizeof *unit->state);
    *start_of(unit) = unit->values[0];
    put_out(unit, unit->values + controller.u_ff);
    return true;
}

/* x_est(k+1) = A_d x_est + B_d u + L (y_pm - H_pm x_est - D_pm u), from the last tick's measurement and voltage. */
static void estimate(unit *unit)
{
    const size_t states = controller.states, voltages = controller.voltages, gauges = controller.gauges;
    double *const known = unit->workspace;
    memcpy(known, unit->values + controller.x_est, states * sizeof *known);
    memcpy(known + states, unit->values + controller.u, voltages * sizeof *known);
    memcpy(known + states + voltages, unit->values + controller.y_pm, gauges * sizeof *known);
    multiply_panels(states, states + voltages + gauges, controller_filter, known, false,
                    unit->values + controller.x_est);
}

/* u = u_ff + K (x_ref - x_est) + integral; the integral grows by k_I G_0^+ of the estimated deviation, but not further
   into a limit. (45) needs the pseudo-inverse: the DC gain is negative, a positive scalar would destabilise. */
static void control(unit *unit)
{
    const size_t states = controller.states, voltages = controller.voltages;
    const double *const x_ref = unit->values + controller.x_ref, *const x_est = unit->values + controller.x_est;
    const double *const u_ff = unit->values + controller.u_ff, *const u = unit->values + controller.u;
    double *const integral = integral_of(unit);
    double *const error = unit->workspace, *const wanted = error + states + voltages + controller.gauges;
    double *const growth = wanted + voltages;
    for (size_t k = 0; k < states; k++)
        error[k] = x_ref[k] - x_est[k];
    for (size_t k = 0; k < voltages; k++)
        error[states + k] = u_ff[k] - u[k];
    multiply_panels(2 * voltages, states + voltages, controller_regulator, error, false, wanted);
    const double gain = unit->values[controller.integral_gain], limit = unit->values[controller.voltage_limit];
    for (size_t k = 0; k < voltages; k++) {
        wanted[k] = u_ff[k] + wanted[k] + integral[k];
        growth[k] *= gain;
        const bool winding_up = fabs(wanted[k]) > limit && wanted[k] * growth[k] > 0;
        if (!winding_up)
            integral[k] += growth[k];
    }
    put_out(unit, wanted);
}

static void run_tick(unit *unit)
{
    estimate(unit);
    if (unit->values[controller.feedback] != 0.0) {
        control(unit);
        return;
    }
    memset(integral_of(unit), 0, controller.voltages * sizeof(double));
    put_out(unit, unit->values + controller.u_ff);
}

/* Every tick inside [time, time + step), with the inputs held; an integer counts them. */
bool unit_advance(unit *unit, double time, double step)
{
    double *const tick = tick_of(unit);
    const double last = (time + step - *start_of(unit)) / controller.sample_time - 1e-6;
    for (; *tick < last; *tick += 1.0)
        run_tick(unit);
    return true;
}

/* A tick count far behind the clock, which no saved state has, would keep the next step busy for ever. */
bool unit_restore(unit *unit)
{
    const double behind = (unit->values[0] - *start_of(unit)) / controller.sample_time - *tick_of(unit);
    if (fabs(behind) <= 2.0 + 1e-9 * fabs(*tick_of(unit)))
        return true;
    return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

bool unit_prepare(unit *unit, double step)
{
    (void)unit;
    (void)step;
    return true;
}

void unit_complete(unit *unit)
{
    (void)unit;
}
