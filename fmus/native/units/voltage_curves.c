#include "voltage_curves.h"

#include "pair.h"
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
            curve.spline = spline_of(&data->splines, motion, k);
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

/* The curve's values at ascending times (count,), linear on each interval of the grid. */
static void follow_curve(const FlatnessFeedforwardData *data, VoltageCurve *curve, size_t count, const double *times,
                         double *values)
{
    const VoltageCurve own = *curve;
    const double *const grid = data->curve_grid;
    const double *const rates = data->curve_rates;
    const size_t last = data->intervals - 1;
    size_t index = own.index;
    double left = 0.0;
    double rise = 0.0;
    bool is_new = true;
    for (size_t i = 0; i < count; i++) {
        const double tau = progress(&own, times[i]);
        for (; index < last && grid[index + 1] <= tau; index++)
            is_new = true;
        if (is_new) {
            left = (1 - own.share) * own.shorter[index] + own.share * own.longer[index];
            rise = (1 - own.share) * own.shorter[index + 1] + own.share * own.longer[index + 1] - left;
            is_new = false;
        }
        values[i] = left + rise * ((tau - grid[index]) * rates[index]);
    }
    curve->index = index;
}

/* u (looks, voltages) = offset + heights' changes; offset (voltages,), heights (count, LOOKS), changes (count,
 * voltages).
 */
static void superpose(const Motion *motion, size_t voltages, const double *heights, size_t looks, double *u)
{
    size_t j = 0;
    for (; j + 4 <= voltages; j += 4)
        for (size_t i = 0; i < looks; i++) {
            Pair low = pair_load(motion->offset + j);
            Pair high = pair_load(motion->offset + j + 2);
            const double *change = motion->changes + j;
            for (size_t k = 0; k < motion->count; k++, change += voltages) {
                const Pair height = pair_of(heights[k * LOOKS + i]);
                low = pair_add_product(low, height, pair_load(change));
                high = pair_add_product(high, height, pair_load(change + 2));
            }
            pair_store(u + i * voltages + j, low);
            pair_store(u + i * voltages + j + 2, high);
        }
    for (; j < voltages; j++)
        for (size_t i = 0; i < looks; i++) {
            double sum = motion->offset[j];
            for (size_t k = 0; k < motion->count; k++)
                sum += heights[k * LOOKS + i] * motion->changes[k * voltages + j];
            u[i * voltages + j] = sum;
        }
}

void voltages_at(const FlatnessFeedforwardData *data, const Motion *motion, VoltageCurve *curves, size_t count,
                 const double *times, double *u)
{
    const size_t voltages = data->flat.voltages;
    if (data->splines.durations == 0) {
        double heights[SLOTS * LOOKS];
        for (size_t k = 0; k < motion->count; k++)
            follow_curve(data, &curves[k], count, times, heights + k * LOOKS);
        superpose(motion, voltages, heights, count, u);
        return;
    }
    for (size_t i = 0; i < count; i++, u += voltages) {
        for (size_t j = 0; j < voltages; j++)
            u[j] = motion->offset[j];
        for (size_t k = 0; k < motion->count; k++)
            add_spline_voltages(&data->splines, curves[k].spline, progress(&curves[k], times[i]), u);
    }
}
