/* A unit of the tests: y = gain weights u. */

#include "gain.h"

static bool gain_initialise(UnitInstance *unit)
{
    const GainData *const data = unit->data;
    for (size_t k = 0; k < data->width; k++)
        unit->values[data->y + k] = unit->values[data->gain] * (data->weights[k] * unit->values[data->u + k]);
    return true;
}

static bool gain_advance(UnitInstance *unit, double time, double step)
{
    (void)time;
    (void)step;
    return gain_initialise(unit);
}

SHARED_DATA const UnitHooks gain_hooks = {
    .initialise = gain_initialise,
    .advance = gain_advance,
};
