/* MfcActuator: amplifier, hysteresis and creep, exact for commands that hold.

   While a command holds, the voltage v approaches it without turning: at the slew rate as long as the lag would be
   faster, then by v' = (command - v) / lag. h is piecewise linear in v, so that creep has a closed form between the
   voltages at which its slope changes, the bends. */

#include "mfc_actuator.h"

#include <math.h>

#include "ranges.h"

#define SAME 1e-12 /* voltages nearer than this, relative to the largest involved, are one */

static size_t mfc_actuator_state_size(const void *data)
{
    const MfcActuatorData *const actuator = data;
    return mfc_state_size(&actuator->parameters);
}

static void write_effective_voltages(UnitInstance *unit)
{
    const MfcActuatorData *const actuator = unit->data;
    for (size_t k = 0; k < actuator->parameters.channels; k++) {
        const MfcChannel channel = mfc_channel(unit, &actuator->parameters, k);
        unit->values[actuator->u_eff + k] = mfc_with_creep(&channel, mfc_hysteresis(&channel));
    }
}

static bool mfc_actuator_initialise(UnitInstance *unit)
{
    const MfcActuatorData *const actuator = unit->data;
    if (!mfc_start(unit, &actuator->parameters, unit->values + actuator->voltage))
        return false;
    write_effective_voltages(unit);
    return true;
}

static void mfc_actuator_differentiate(UnitInstance *unit)
{
    const MfcActuatorData *const actuator = unit->data;
    for (size_t k = 0; k < actuator->parameters.channels; k++)
        unit->changes[actuator->u_eff + k] = mfc_differentiate(unit, &actuator->parameters, k);
}

/* Keeps the bend that comes first in a direction. */
static void keep_nearest(double *bend, double candidate, double direction)
{
    if (direction * (candidate - *bend) < 0)
        *bend = candidate;
}

/* The voltage at which the slope of h over v changes next in a direction, and the slope up to there. */
static double next_bend(const MfcChannel *channel, double v, double direction, double *slope)
{
    const double z = mfc_superposition(channel);
    double bend = direction * HUGE_VAL;
    double gain = channel->linear_weight;
    double size = channel->linear_weight * fabs(v); /* of the terms of z, which may cancel */
    for (size_t i = 0; i < channel->plays; i++) {
        size += channel->play_weight[i] * fabs(channel->play[i]);
        const double contact = channel->play[i] + direction * channel->play_threshold[i];
        if (direction * (contact - v) > SAME * (fabs(contact) + fabs(v)))
            keep_nearest(&bend, contact, direction);
        else
            gain += channel->play_weight[i];
    }
    double sum = 0.0;
    for (size_t j = 0; j < channel->dead_zones; j++) {
        const double threshold = channel->dead_zone_threshold[j];
        const bool ahead = direction * (threshold - z) > SAME * (fabs(threshold) + size);
        if (ahead)
            keep_nearest(&bend, v + (threshold - z) / gain, direction);
        if (ahead != ((threshold >= 0.0) == (direction > 0.0)))
            sum += channel->dead_zone_slope[j];
    }
    *slope = gain * (1.0 + sum);
    return bend;
}

/* From v to the voltage `end` at a constant rate, V/s, for `duration` s. */
static void ramp(const MfcChannel *channel, double v, double end, double rate, double duration)
{
    while (duration > 0.0) {
        double slope;
        const double bend = next_bend(channel, v, rate > 0.0 ? 1.0 : -1.0, &slope);
        const bool last = (end - bend) * rate <= 0.0;
        const double time = last ? duration : fmin((bend - v) / rate, duration);
        const double h = mfc_hysteresis(channel);
        for (size_t i = 0; i < channel->creeps; i++) {
            const double tau = channel->creep_time[i];
            const double share = -expm1(-time / tau);
            channel->creep[i] += (h - channel->creep[i]) * share + slope * rate * (time - tau * share);
        }
        v = last ? end : bend;
        mfc_move(channel, v);
        duration = last ? 0.0 : duration - time;
    }
}

/* x (exp(-y) - exp(-x)) / (x - y): what a creep operator takes from an exponential; x is time / tau, y time / lag. */
static double lagged(double x, double y)
{
    const double size = fabs(x - y);
    const double ratio = size > 0.0 ? -expm1(-size) / size : 1.0;
    return x * exp(-fmin(x, y)) * ratio;
}

/* From v exponentially towards the command for `duration` s; returns the voltage at the end. */
static double approach(const MfcChannel *channel, double v, double command, double lag, double duration)
{
    const double end = command + (v - command) * exp(-duration / lag);
    while (duration > 0.0) {
        const double away = v - command;
        double slope;
        const double bend = next_bend(channel, v, away > 0.0 ? -1.0 : 1.0, &slope);
        const bool last = (end - bend) * away >= 0.0 || away == 0.0;
        const double time = last ? duration : fmin(lag * log(away / (bend - command)), duration);
        const double h = mfc_hysteresis(channel);
        for (size_t i = 0; i < channel->creeps; i++) {
            const double tau = channel->creep_time[i];
            channel->creep[i] += (h - slope * away - channel->creep[i]) * -expm1(-time / tau);
            channel->creep[i] += slope * away * lagged(time / tau, time / lag);
        }
        v = last ? end : bend;
        mfc_move(channel, v);
        duration = last ? 0.0 : duration - time;
    }
    return v;
}

/* The voltage behind the amplifier, and the channel's state, after `step` s under a held command. */
static double follow(const MfcChannel *channel, double v, double command, double lag, double slew_rate, double step)
{
    double left = step;
    if (slew_rate > 0.0 && fabs(command - v) > slew_rate * lag) {
        const double duration = (fabs(command - v) - slew_rate * lag) / slew_rate;
        const double rate = command > v ? slew_rate : -slew_rate;
        const bool arrives = duration < left;
        const double end = arrives ? command - rate * lag : v + rate * left;
        ramp(channel, v, end, rate, arrives ? duration : left);
        if (!arrives)
            return end;
        v = end;
        left -= duration;
    }
    if (lag > 0.0 && v != command)
        return approach(channel, v, command, lag, left);
    mfc_move(channel, command);
    mfc_relax(channel, mfc_hysteresis(channel), left);
    return command;
}

static bool mfc_actuator_advance(UnitInstance *unit, double time, double step)
{
    const MfcActuatorData *const actuator = unit->data;
    double *const values = unit->values;
    mfc_begin_count(unit, &actuator->parameters);
    for (size_t k = 0; k < actuator->parameters.channels; k++) {
        const MfcChannel channel = mfc_channel(unit, &actuator->parameters, k);
        const double u = values[actuator->u + k];
        const double resolution = values[actuator->resolution + k];
        const double rounded = resolution > 0.0 ? resolution * floor(u / resolution + 0.5) : u;
        if (fabs(u) > channel.limit)
            mfc_count_saturated(unit, &actuator->parameters, unit->variables[actuator->u + k].name, u, channel.limit,
                                time);
        values[actuator->voltage + k] =
            follow(&channel, values[actuator->voltage + k], clamp(rounded, -channel.limit, channel.limit),
                   values[actuator->lag + k], values[actuator->slew_rate + k], step);
    }
    write_effective_voltages(unit);
    return true;
}

static bool mfc_actuator_restore(UnitInstance *unit)
{
    const MfcActuatorData *const actuator = unit->data;
    return mfc_restore(unit, &actuator->parameters);
}

SHARED_DATA const UnitHooks mfc_actuator_hooks = {
    .state_size = mfc_actuator_state_size,
    .initialise = mfc_actuator_initialise,
    .differentiate = mfc_actuator_differentiate,
    .restore = mfc_actuator_restore,
    .advance = mfc_actuator_advance,
};
