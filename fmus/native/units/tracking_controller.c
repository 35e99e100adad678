/* TrackingController: Kalman filter (42), regulator (44) and integral action (45), on its own clock. */

#include "tracking_controller.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <string.h>

#include "linear_algebra.h"
#include "ranges.h"
#include "voltage_limits.h"
#include "windup.h"

/* State, doubles as all of it: integral (voltages,) V; ticks run since the start; strain samples of each gauge that
   were left out in a row (gauges,); lowest and highest voltages in force (voltages,) each, V; ticks with a voltage held
   at one of these. */
static double *integral_of(const UnitInstance *unit)
{
    return unit->state;
}

static double *tick_of(const UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    return unit->state + controller->voltages;
}

static double *rejected_in_a_row(const UnitInstance *unit)
{
    return tick_of(unit) + 1;
}

static VoltageRange limits_in_force(const UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    double *const lowest = rejected_in_a_row(unit) + controller->gauges;
    return (VoltageRange){.lowest = lowest, .highest = lowest + controller->voltages};
}

static double *saturated_ticks(const UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    return limits_in_force(unit).highest + controller->voltages;
}

static size_t tracking_controller_state_size(const void *data)
{
    const TrackingControllerData *const controller = data;
    return 3 * controller->voltages + 2 + controller->gauges;
}

/* A vector of states, voltages and gauges, then two of voltages and the scratch of hold_windup, or one of gauges. */
static size_t tracking_controller_workspace_size(const void *data)
{
    const TrackingControllerData *const controller = data;
    const size_t regulation = (3 + controller->voltages) * controller->voltages;
    return controller->states + controller->voltages + controller->gauges +
           (regulation > controller->gauges ? regulation : controller->gauges);
}

/* u = commanded within the limits in force, y_est = H_pi x_est + D_pi u. */
static void write_commands(UnitInstance *unit, const double *commanded)
{
    const TrackingControllerData *const controller = unit->data;
    const VoltageRange limits = limits_in_force(unit);
    double *const u = unit->values + controller->u;
    double *const state_and_input = unit->workspace;
    size_t beyond = 0;
    for (size_t k = 0; k < controller->voltages; k++) {
        u[k] = clamp(commanded[k], limits.lowest[k], limits.highest[k]);
        beyond += (size_t)(u[k] != commanded[k]);
    }
    unit->values[controller->saturated] = beyond > 0;
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
    join_limits(controller->voltages, unit->values[controller->voltage_limit], unit->values + controller->voltage_min,
                unit->values + controller->voltage_max, limits_in_force(unit));
    unit->values[controller->rejected_samples] = 0.0;
    unit->values[controller->saturation_share] = 0.0;
    write_commands(unit, unit->values + controller->u_ff);
    return true;
}

/* The change of a pair's voltage: a voltage within its limits follows the feedforward's, another one the limit that it
   is held at. */
static double change_of_voltage(const UnitInstance *unit, size_t pair)
{
    const TrackingControllerData *const controller = unit->data;
    const double *const values = unit->values;
    const double *const changes = unit->changes;
    const VoltageRange limits = limits_in_force(unit);
    const double wanted = values[controller->u_ff + pair];
    const double limit = values[controller->voltage_limit];
    if (wanted > limits.highest[pair])
        return values[controller->voltage_max + pair] < limit ? changes[controller->voltage_max + pair]
                                                              : changes[controller->voltage_limit];
    if (wanted < limits.lowest[pair])
        return values[controller->voltage_min + pair] > -limit ? changes[controller->voltage_min + pair]
                                                               : -changes[controller->voltage_limit];
    return changes[controller->u_ff + pair];
}

static void tracking_controller_differentiate(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    double *const changes = unit->changes;
    double *const state_and_input = unit->workspace;
    double *const voltages = state_and_input + controller->states;
    memset(state_and_input, 0, controller->states * sizeof *state_and_input);
    memcpy(state_and_input, changes + controller->x_ref, controller->reduced_states * sizeof *state_and_input);
    for (size_t k = 0; k < controller->voltages; k++)
        voltages[k] = change_of_voltage(unit, k);
    memcpy(changes + controller->u, voltages, controller->voltages * sizeof *voltages);
    multiply_panels(controller->points, controller->states + controller->voltages, controller->estimates,
                    state_and_input, false, changes + controller->y_est);
}

/* A strain sample is left out, the first one with a line; false after too many of one gauge in a row. */
static bool reject_sample(UnitInstance *unit, size_t gauge, double sample)
{
    const TrackingControllerData *const controller = unit->data;
    const char *const name = unit->variables[controller->y_pm + gauge].name;
    const double limit = unit->values[controller->strain_limit];
    const double time = unit->start + *tick_of(unit) * controller->sample_time;
    double *const count = &unit->values[controller->rejected_samples];
    double *const in_a_row = rejected_in_a_row(unit) + gauge;
    if (*count == 0.0)
        unit_warn(unit, "%s at %.6g s is left out of the estimate, as any sample beyond strain_limit %r, got %r", name,
                  time, limit, sample);
    if (*count < INT_MAX)
        *count += 1.0;
    *in_a_row += 1.0;
    return *in_a_row < unit->values[controller->rejected_limit] ||
           unit_refuse(unit, "%s has been beyond strain_limit %r for %d samples in a row (rejected_limit), got %r",
                       name, limit, (int)*in_a_row, sample);
}

/* In place of a strain sample beyond the limit, the one that estimate and voltages (state_and_input) predict: it leaves
   the estimate as it is. */
static bool screen_samples(UnitInstance *unit, const double *state_and_input, double *samples)
{
    const TrackingControllerData *const controller = unit->data;
    const double limit = unit->values[controller->strain_limit];
    double *const in_a_row = rejected_in_a_row(unit);
    if (all_within(controller->gauges, samples, -limit, limit)) {
        memset(in_a_row, 0, controller->gauges * sizeof *in_a_row);
        return true;
    }
    double *const predicted = samples + controller->gauges;
    multiply_panels(controller->gauges, controller->states + controller->voltages, controller->strains, state_and_input,
                    false, predicted);
    for (size_t k = 0; k < controller->gauges; k++)
        if (fabs(samples[k]) <= limit)
            in_a_row[k] = 0.0;
        else if (reject_sample(unit, k, samples[k]))
            samples[k] = predicted[k];
        else
            return false;
    return true;
}

/* x_est(k+1) = A_d x_est + B_d u + L (y_pm - H_pm x_est - D_pm u), from the last tick's measurement and voltage. With
   strain offsets d, which follow x_est: d(k+1) = d + l e, and their reference is zero. */
static bool estimate_state(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    const size_t states = controller->states;
    const size_t voltages = controller->voltages;
    const size_t gauges = controller->gauges;
    double *const stacked = unit->workspace;
    memcpy(stacked, unit->values + controller->x_est, states * sizeof *stacked);
    memcpy(stacked + states, unit->values + controller->u, voltages * sizeof *stacked);
    memcpy(stacked + states + voltages, unit->values + controller->y_pm, gauges * sizeof *stacked);
    if (!screen_samples(unit, stacked, stacked + states + voltages))
        return false;
    multiply_panels(states, states + voltages + gauges, controller->filter, stacked, false,
                    unit->values + controller->x_est);
    return true;
}

/* The limits in force follow the parameters: narrower ones at once, wider ones by so much in a sample. */
static void follow_limits(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    const double limit = unit->values[controller->voltage_limit];
    const double *const minimum = unit->values + controller->voltage_min;
    const double *const maximum = unit->values + controller->voltage_max;
    const VoltageRange limits = limits_in_force(unit);
    for (size_t k = 0; k < controller->voltages; k++) {
        const double lowest = minimum[k] > -limit ? minimum[k] : -limit;
        const double highest = maximum[k] < limit ? maximum[k] : limit;
        const double lower = limits.lowest[k] - controller->widening;
        const double higher = limits.highest[k] + controller->widening;
        limits.lowest[k] = lowest > lower ? lowest : lower;
        limits.highest[k] = highest < higher ? highest : higher;
    }
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
    for (size_t k = 0; k < voltages; k++) {
        commanded[k] = u_ff[k] + commanded[k] + integral[k];
        growth[k] *= unit->values[controller->integral_gain];
    }
    write_commands(unit, commanded);
    if (unit->values[controller->saturated] != 0.0)
        hold_windup(voltages, controller->integral_range, commanded, limits_in_force(unit), growth, growth + voltages);
    for (size_t k = 0; k < voltages; k++)
        integral[k] += growth[k];
}

static void count_saturation(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    double *const saturated = saturated_ticks(unit);
    *saturated += unit->values[controller->saturated];
    if (*saturated > 0.0)
        unit->values[controller->saturation_share] = *saturated / (*tick_of(unit) + 1.0);
}

static bool run_tick(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    if (!estimate_state(unit))
        return false;
    follow_limits(unit);
    if (unit->values[controller->feedback] != 0.0)
        regulate(unit);
    else {
        memset(integral_of(unit), 0, controller->voltages * sizeof(double));
        clear_offsets(unit);
        write_commands(unit, unit->values + controller->u_ff);
    }
    count_saturation(unit);
    return true;
}

/* Every tick inside [time, time + step), with the inputs held; an integer counts them. */
static bool tracking_controller_advance(UnitInstance *unit, double time, double step)
{
    const TrackingControllerData *const controller = unit->data;
    double *const tick = tick_of(unit);
    const double end = time + step;
    const double last = (end - clock_tolerance(unit, end, controller->sample_time)) / controller->sample_time;
    for (; *tick < last; *tick += 1.0)
        if (!run_tick(unit))
            return false;
    return true;
}

static bool all_counts(size_t n, const double *counts)
{
    bool all = all_within(n, counts, 0.0, INT_MAX);
    for (size_t k = 0; k < n; k++)
        all = all && floor(counts[k]) == counts[k];
    return all;
}

static bool are_limits(size_t voltages, VoltageRange limits)
{
    return all_within(voltages, limits.lowest, -DBL_MAX, 0.0) && all_within(voltages, limits.highest, 0.0, DBL_MAX);
}

/* A tick count that the clock cannot have, which no saved state has, would keep the next step busy for ever. */
static bool tracking_controller_restore(UnitInstance *unit)
{
    const TrackingControllerData *const controller = unit->data;
    const double tick = *tick_of(unit);
    const double saturated = *saturated_ticks(unit);
    const double behind = unit->elapsed / controller->sample_time - tick;
    if (floor(tick) == tick && fabs(behind) <= 2.0 + 4 * DBL_EPSILON * tick &&
        all_counts(controller->gauges, rejected_in_a_row(unit)) &&
        are_limits(controller->voltages, limits_in_force(unit)) && floor(saturated) == saturated && saturated >= 0.0 &&
        saturated <= tick)
        return true;
    return unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}

SHARED_DATA const UnitHooks tracking_controller_hooks = {
    .state_size = tracking_controller_state_size,
    .workspace_size = tracking_controller_workspace_size,
    .initialise = tracking_controller_initialise,
    .differentiate = tracking_controller_differentiate,
    .restore = tracking_controller_restore,
    .advance = tracking_controller_advance,
};
