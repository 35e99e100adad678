/* MfcCompensator: the exact inverse of hysteresis and creep in closed form (K. Kuhnen, European Journal of Control 9,
   2003). Its state is the one that its own commands leave in the patches. */

#include "mfc_compensator.h"

#include <math.h>
#include <string.h>

#include "ranges.h"

static size_t mfc_compensator_state_size(const void *data)
{
    const MfcCompensatorData *const compensator = data;
    return mfc_state_size(&compensator->parameters);
}

/* Images of the dead zones' thresholds, and the slopes that the inverse dead zones add to 1; both (channels, zones). */
static size_t mfc_compensator_workspace_size(const void *data)
{
    const MfcCompensatorData *const compensator = data;
    return 2 * compensator->parameters.channels * compensator->parameters.dead_zones;
}

/* The inverse dead zones of one side, from z = 0 outwards: 1 / S_j - 1 / S_{j-1} with S_j = 1 + s_1 + ... + s_j. */
static void invert_side(const MfcChannel *channel, int side, double *slopes)
{
    double gain = 1.0;
    for (size_t n = 0; n < channel->dead_zones; n++) {
        const size_t j = side > 0 ? n : channel->dead_zones - 1 - n;
        if ((channel->dead_zone_threshold[j] >= 0.0) != (side > 0))
            continue;
        const double inner = 1.0 / gain;
        gain += channel->dead_zone_slope[j];
        slopes[j] = 1.0 / gain - inner;
    }
}

static void invert_dead_zones(UnitInstance *unit)
{
    const MfcCompensatorData *const compensator = unit->data;
    for (size_t k = 0; k < compensator->parameters.channels; k++) {
        const MfcChannel channel = mfc_channel(unit, &compensator->parameters, k);
        double *const images = unit->workspace + 2 * k * channel.dead_zones;
        for (size_t j = 0; j < channel.dead_zones; j++)
            images[j] = mfc_through_dead_zones(&channel, channel.dead_zone_threshold[j]);
        invert_side(&channel, 1, images + channel.dead_zones);
        invert_side(&channel, -1, images + channel.dead_zones);
    }
}

static bool mfc_compensator_initialise(UnitInstance *unit)
{
    const MfcCompensatorData *const compensator = unit->data;
    if (!mfc_start(unit, &compensator->parameters, unit->values + compensator->u))
        return false;
    invert_dead_zones(unit);
    return true;
}

/* The first commands are the last voltages of the history. */
static void mfc_compensator_differentiate(UnitInstance *unit)
{
    const MfcCompensatorData *const compensator = unit->data;
    const MfcParameters *const parameters = &compensator->parameters;
    for (size_t k = 0; k < parameters->channels; k++)
        unit->changes[compensator->u + k] = unit->changes[parameters->history + (k + 1) * parameters->extremes - 1];
}

/* z that the dead zones, inverted as `images` and slopes behind them, map to h. */
static double superposition_for(const MfcChannel *channel, const double *images, double h)
{
    const double *const slopes = images + channel->dead_zones;
    double z = 0.0;
    for (size_t j = 0; j < channel->dead_zones; j++) {
        const double beyond = h - images[j];
        if ((channel->dead_zone_threshold[j] >= 0.0) == (beyond > 0.0))
            z += slopes[j] * beyond;
    }
    return h + z;
}

/* The voltage that brings the play operators to the superposition z: play operators with the thresholds
   sum_{j <= i} w_j (r_i - r_j), the weights 1 / W_i - 1 / W_{i-1} and the states W_i p_i + sum_{j > i} w_j p_j. */
static double voltage_for(const MfcChannel *channel, double z)
{
    double outer = mfc_superposition(channel) - channel->linear_weight * *channel->voltage; /* sum_{j > i} w_j p_j */
    double sum = channel->linear_weight;                                                    /* W_i = sum_{j <= i} w_j */
    double moment = 0.0;                                                                    /* sum_{j <= i} w_j r_j */
    double inner = 1.0 / sum;                                                               /* 1 / W_{i-1} */
    double voltage = inner * z; /* of the linear part, whose threshold is 0 */
    for (size_t i = 0; i < channel->plays; i++) {
        const double weight = channel->play_weight[i];
        const double threshold = channel->play_threshold[i];
        sum += weight;
        moment += weight * threshold;
        outer -= weight * channel->play[i];
        const double image = sum * threshold - moment;
        const double state = clamp(sum * channel->play[i] + outer, z - image, z + image);
        voltage += (1.0 / sum - inner) * state;
        inner = 1.0 / sum;
    }
    return voltage;
}

/* h that, held for a step, gives the effective voltage at its end. */
static double hysteresis_for(const MfcChannel *channel, double effective, double step)
{
    double carried = 0.0;
    double gained = 0.0;
    for (size_t i = 0; i < channel->creeps; i++) {
        const double share = -expm1(-step / channel->creep_time[i]);
        carried += channel->creep_weight[i] * (1.0 - share) * channel->creep[i];
        gained += channel->creep_weight[i] * share;
    }
    return (effective - carried) / (1.0 + gained);
}

/* The last commands held for the step, then the next ones, for another step of its size. */
static bool mfc_compensator_advance(UnitInstance *unit, double time, double step)
{
    const MfcCompensatorData *const compensator = unit->data;
    double *const u = unit->values + compensator->u;
    mfc_begin_count(unit, &compensator->parameters);
    for (size_t k = 0; k < compensator->parameters.channels; k++) {
        const MfcChannel channel = mfc_channel(unit, &compensator->parameters, k);
        const double *const images = unit->workspace + 2 * k * channel.dead_zones;
        mfc_relax(&channel, mfc_hysteresis(&channel), step);
        const double h = hysteresis_for(&channel, unit->values[compensator->u_eff + k], step);
        const double asked = voltage_for(&channel, superposition_for(&channel, images, h));
        if (fabs(asked) > channel.limit)
            mfc_count_saturated(unit, &compensator->parameters, unit->variables[compensator->u + k].name, asked,
                                channel.limit, time + step);
        u[k] = clamp(asked, -channel.limit, channel.limit);
        mfc_move(&channel, u[k]);
    }
    return true;
}

static bool mfc_compensator_restore(UnitInstance *unit)
{
    const MfcCompensatorData *const compensator = unit->data;
    if (!mfc_restore(unit, &compensator->parameters))
        return false;
    invert_dead_zones(unit);
    return true;
}

SHARED_DATA const UnitHooks mfc_compensator_hooks = {
    .state_size = mfc_compensator_state_size,
    .workspace_size = mfc_compensator_workspace_size,
    .initialise = mfc_compensator_initialise,
    .differentiate = mfc_compensator_differentiate,
    .restore = mfc_compensator_restore,
    .advance = mfc_compensator_advance,
};
