#include "voltage_curves.h"

#include <string.h>

#include "ranges.h"

static double progress(const VoltageCurve *curve, double time)
{
    return clamp((time - curve->start) * curve->rate, 0.0, 1.0);
}

/* Index of the interval of an ascending grid (count + 1,) that holds a value, the last one for its end. */
static size_t interval_of(const double *grid, size_t count, double value)
{
    size_t low = 0;
    size_t high = count;
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (grid[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

void curves_of(const FlatnessFeedforwardData *data, const Motion *motion, double time, VoltageCurve *curves)
{
    const double *const durations = data->curve_durations;
    for (size_t k = 0; k < motion->count; k++) {
        const double duration = motion->durations[k];
        VoltageCurve curve = {.start = motion->starts[k], .rate = 1.0 / duration};
        if (data->splines.durations > 0) {
            curve.spline = motion->splines + k * spline_size(&data->splines);
        } else {
            const size_t low = interval_of(durations, data->durations - 1, duration);
            const double share = (duration - durations[low]) / (durations[low + 1] - durations[low]);
            curve.shorter = data->curves + low * (data->intervals + 1);
            curve.longer = curve.shorter + data->intervals + 1;
            curve.share = clamp(share, 0.0, 1.0);
            curve.index = interval_of(data->curve_grid, data->intervals, progress(&curve, time));
        }
        curves[k] = curve;
    }
}

/* The curve at tau within [0, 1], linear on each interval. */
static double curve_at(const FlatnessFeedforwardData *data, VoltageCurve *curve, double tau)
{
    const double *const grid = data->curve_grid;
    size_t index = curve->index;
    while (index + 1 < data->intervals && grid[index + 1] <= tau)
        index++;
    curve->index = index;
    const double left = (1 - curve->share) * curve->shorter[index] + curve->share * curve->longer[index];
    const double right = (1 - curve->share) * curve->shorter[index + 1] + curve->share * curve->longer[index + 1];
    return left + (right - left) * ((tau - grid[index]) * data->curve_rates[index]);
}

void voltages_at(const FlatnessFeedforwardData *data, const Motion *motion, VoltageCurve *curves, double time,
                 double *u)
{
    const size_t voltages = data->flat.voltages;
    memcpy(u, motion->offset, voltages * sizeof *u);
    for (size_t k = 0; k < motion->count; k++) {
        const double tau = progress(&curves[k], time);
        if (curves[k].spline != NULL) {
            add_spline_voltages(&data->splines, curves[k].spline, tau, u);
            continue;
        }
        const double height = curve_at(data, &curves[k], tau);
        for (size_t j = 0; j < voltages; j++)
            u[j] += height * motion->changes[k * voltages + j];
    }
}
