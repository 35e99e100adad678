#include "mfc_channel.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <string.h>

#include "ranges.h"

size_t mfc_state_size(const MfcParameters *parameters)
{
    return parameters->channels * (1 + parameters->plays + parameters->creeps);
}

MfcChannel mfc_channel(const UnitInstance *unit, const MfcParameters *parameters, size_t k)
{
    const double *const values = unit->values;
    double *const state = unit->state + k * (1 + parameters->plays + parameters->creeps);
    const double supply = values[parameters->supply + k];
    const double above = values[parameters->face_maximum + k] - supply;
    const double below = supply - values[parameters->face_minimum + k];
    return (MfcChannel){
        .plays = parameters->plays,
        .dead_zones = parameters->dead_zones,
        .creeps = parameters->creeps,
        .linear_weight = values[parameters->linear_weight + k],
        .play_threshold = values + parameters->play_threshold + k * parameters->plays,
        .play_weight = values + parameters->play_weight + k * parameters->plays,
        .dead_zone_threshold = values + parameters->dead_zone_threshold + k * parameters->dead_zones,
        .dead_zone_slope = values + parameters->dead_zone_slope + k * parameters->dead_zones,
        .creep_time = values + parameters->creep_time + k * parameters->creeps,
        .creep_weight = values + parameters->creep_weight + k * parameters->creeps,
        .voltage = state,
        .play = state + 1,
        .creep = state + 1 + parameters->plays,
        .limit = above < below ? above : below,
    };
}

void mfc_move(const MfcChannel *channel, double voltage)
{
    *channel->voltage = voltage;
    for (size_t i = 0; i < channel->plays; i++) {
        const double high = voltage + channel->play_threshold[i];
        const double low = voltage - channel->play_threshold[i];
        const double play = channel->play[i] < high ? channel->play[i] : high;
        channel->play[i] = play > low ? play : low;
    }
}

double mfc_superposition(const MfcChannel *channel)
{
    double z = channel->linear_weight * *channel->voltage;
    for (size_t i = 0; i < channel->plays; i++)
        z += channel->play_weight[i] * channel->play[i];
    return z;
}

/* What exceeds a threshold >= 0 from above or one < 0 from below. */
static double one_sided(double threshold, double z)
{
    const double beyond = z - threshold;
    return (threshold >= 0.0) == (beyond > 0.0) ? beyond : 0.0;
}

double mfc_through_dead_zones(const MfcChannel *channel, double z)
{
    double h = 0.0;
    for (size_t j = 0; j < channel->dead_zones; j++)
        h += channel->dead_zone_slope[j] * one_sided(channel->dead_zone_threshold[j], z);
    return z + h;
}

double mfc_hysteresis(const MfcChannel *channel)
{
    return mfc_through_dead_zones(channel, mfc_superposition(channel));
}

double mfc_with_creep(const MfcChannel *channel, double hysteresis)
{
    double sum = 0.0;
    for (size_t i = 0; i < channel->creeps; i++)
        sum += channel->creep_weight[i] * channel->creep[i];
    return hysteresis + sum;
}

void mfc_relax(const MfcChannel *channel, double hysteresis, double step)
{
    for (size_t i = 0; i < channel->creeps; i++)
        channel->creep[i] += (hysteresis - channel->creep[i]) * -expm1(-step / channel->creep_time[i]);
}

/* Are the thresholds of a row ascending? */
static bool check_ascending(UnitInstance *unit, unsigned first, size_t count)
{
    const double *const thresholds = unit->values + first;
    for (unsigned j = 1; j < count; j++)
        if (thresholds[j] < thresholds[j - 1])
            return unit_refuse(unit, "%s must be >= %r, the threshold before, got %r", unit->variables[first + j].name,
                               thresholds[j - 1], thresholds[j]);
    return true;
}

/* Does the slope of h over z stay positive from z = 0 outwards, beyond each dead zone from `begin` on? `side` is +1 for
   thresholds >= 0, which ascend, and -1 for those below. */
static bool check_slopes(UnitInstance *unit, const MfcChannel *channel, unsigned first_slope, int side)
{
    double gain = 1.0;
    for (size_t n = 0; n < channel->dead_zones; n++) {
        const size_t j = side > 0 ? n : channel->dead_zones - 1 - n;
        if ((channel->dead_zone_threshold[j] >= 0.0) != (side > 0))
            continue;
        gain += channel->dead_zone_slope[j];
        if (!(gain > 0.0))
            return unit_refuse(unit,
                               "%s must leave the sum of slopes 1 + ... beyond its threshold > 0, else there is no "
                               "inverse, got a sum of %r",
                               unit->variables[first_slope + j].name, gain);
    }
    return true;
}

static bool check_channel(UnitInstance *unit, const MfcParameters *parameters, size_t k)
{
    const MfcChannel channel = mfc_channel(unit, parameters, k);
    const unsigned play = (unsigned)(k * parameters->plays);
    const unsigned zone = (unsigned)(k * parameters->dead_zones);
    if (!check_ascending(unit, parameters->play_threshold + play, parameters->plays) ||
        !check_ascending(unit, parameters->dead_zone_threshold + zone, parameters->dead_zones))
        return false;
    if (!check_slopes(unit, &channel, parameters->dead_zone_slope + zone, 1) ||
        !check_slopes(unit, &channel, parameters->dead_zone_slope + zone, -1))
        return false;
    return channel.limit > 0.0 ||
           unit_refuse(unit, "%s must be between the faces' limits %r and %r, got %r",
                       unit->variables[parameters->supply + k].name, unit->values[parameters->face_minimum + k],
                       unit->values[parameters->face_maximum + k], unit->values[parameters->supply + k]);
}

/* Rest under the last voltage of the history, from the demagnetised state on. */
static bool start_channel(UnitInstance *unit, const MfcParameters *parameters, size_t k, double *voltage)
{
    const MfcChannel channel = mfc_channel(unit, parameters, k);
    const size_t last = parameters->history + (k + 1) * parameters->extremes - 1;
    memset(channel.play, 0, channel.plays * sizeof *channel.play);
    *channel.voltage = 0.0;
    for (size_t i = last + 1 - parameters->extremes; i <= last; i++)
        mfc_move(&channel, unit->values[i]);
    const double h = mfc_hysteresis(&channel);
    for (size_t i = 0; i < channel.creeps; i++)
        channel.creep[i] = h;
    *voltage = unit->values[last];
    return fabs(*voltage) <= channel.limit || unit_refuse(unit, "%s must be within the amplifier's limit %r, got %r",
                                                          unit->variables[last].name, channel.limit, *voltage);
}

bool mfc_start(UnitInstance *unit, const MfcParameters *parameters, double *voltages)
{
    for (size_t k = 0; k < parameters->channels; k++)
        if (!check_channel(unit, parameters, k) || !start_channel(unit, parameters, k, voltages + k))
            return false;
    unit->values[parameters->saturated] = 0.0;
    unit->values[parameters->saturated_steps] = 0.0;
    return true;
}

/* A play operator after the history: its state, and the change of it into `change`. */
static double play_with_change(const UnitInstance *unit, const MfcParameters *parameters, size_t k, size_t i,
                               double *change)
{
    const size_t first = parameters->history + k * parameters->extremes;
    const size_t threshold = parameters->play_threshold + k * parameters->plays + i;
    double play = 0.0;
    *change = 0.0;
    for (size_t e = first; e < first + parameters->extremes; e++) {
        const double high = unit->values[e] + unit->values[threshold];
        const double low = unit->values[e] - unit->values[threshold];
        if (play > high) {
            play = high;
            *change = unit->changes[e] + unit->changes[threshold];
        }
        if (play < low) {
            play = low;
            *change = unit->changes[e] - unit->changes[threshold];
        }
    }
    return play;
}

double mfc_differentiate(const UnitInstance *unit, const MfcParameters *parameters, size_t k)
{
    const MfcChannel channel = mfc_channel(unit, parameters, k);
    const double *const changes = unit->changes;
    const double *const weights = changes + parameters->play_weight + k * parameters->plays;
    const double *const thresholds = changes + parameters->dead_zone_threshold + k * parameters->dead_zones;
    const double *const slopes = changes + parameters->dead_zone_slope + k * parameters->dead_zones;
    const double *const creep = changes + parameters->creep_weight + k * parameters->creeps;
    const double last = changes[parameters->history + (k + 1) * parameters->extremes - 1];
    double z = changes[parameters->linear_weight + k] * *channel.voltage + channel.linear_weight * last;
    for (size_t i = 0; i < channel.plays; i++) {
        double moved;
        const double play = play_with_change(unit, parameters, k, i, &moved);
        z += weights[i] * play + channel.play_weight[i] * moved;
    }
    double h = z;
    for (size_t j = 0; j < channel.dead_zones; j++) {
        const double beyond = one_sided(channel.dead_zone_threshold[j], mfc_superposition(&channel));
        h += slopes[j] * beyond + (beyond != 0.0 ? channel.dead_zone_slope[j] * (z - thresholds[j]) : 0.0);
    }
    double u_eff = h;
    for (size_t i = 0; i < channel.creeps; i++)
        u_eff += creep[i] * channel.creep[i] + channel.creep_weight[i] * h;
    return u_eff;
}

void mfc_begin_count(UnitInstance *unit, const MfcParameters *parameters)
{
    unit->values[parameters->saturated] = 0.0;
}

void mfc_count_saturated(UnitInstance *unit, const MfcParameters *parameters, const char *name, double asked,
                         double limit, double time)
{
    double *const count = &unit->values[parameters->saturated_steps];
    if (unit->values[parameters->saturated] != 0.0)
        return;
    unit->values[parameters->saturated] = 1.0;
    if (*count == 0.0)
        unit_warn(unit, "%s at %.6g s is held at the amplifier's limit %r, asked for %r", name, unit->start + time,
                  limit, asked);
    if (*count < INT_MAX)
        *count += 1.0;
}

bool mfc_restore(UnitInstance *unit, const MfcParameters *parameters)
{
    for (size_t k = 0; k < parameters->channels; k++)
        if (!check_channel(unit, parameters, k))
            return false;
    return all_within(mfc_state_size(parameters), unit->state, -DBL_MAX, DBL_MAX) ||
           unit_refuse(unit, "FMU state must have contents that this unit can have saved");
}
