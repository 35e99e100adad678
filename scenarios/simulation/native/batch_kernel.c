#include "batch_kernel.h"

#include <math.h>

#include "normal_number.h"

/* Noise on the strains of the lanes that have any. */
static void add_noise(const Batch *batch, int64_t number, const double *values)
{
    const LoopSizes *const s = &batch->sizes;
    const BatchPlant *const plant = &batch->task->plant;
    for (size_t lane = 0; lane < LANES; lane++) {
        const double *const own = values + lane * (size_t)plant->value_count;
        const double deviation = own[plant->strain_noise_std];
        if (!(deviation > 0.0))
            continue;
        const uint64_t seed = (uint64_t)own[plant->noise_seed];
        for (size_t k = 0; k < s->gauges; k++) {
            Lanes *const y = row_of(batch, number) + s->points + k;
            set_lane(y, lane, get_lane(y, lane) + deviation * normal_number(seed, (uint64_t)number, k));
        }
    }
}

static bool is_any_nonzero(size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0.0)
            return true;
    return false;
}

static bool is_any_noisy(const Batch *batch, const double *values)
{
    const BatchPlant *const plant = &batch->task->plant;
    for (size_t lane = 0; lane < LANES; lane++)
        if (values[lane * (size_t)plant->value_count + (size_t)plant->strain_noise_std] > 0.0)
            return true;
    return false;
}

/* The tick at step `number`, which gives the voltages of the next one. */
static void tick(Batch *batch, int64_t number, size_t later)
{
    const LoopSizes *const s = &batch->sizes;
    const Lanes *const y = row_of(batch, number);
    const Lanes *const u = voltages_of(batch, number);
    Part *const inputs = inputs_of(batch, later);
    for (size_t i = 0; i < s->voltages; i++)
        spread_lanes(u[i], inputs + i * PARTS);
    for (size_t k = 0; k < s->gauges; k++)
        spread_lanes(y[s->points + k], inputs + (s->voltages + k) * PARTS);
    step_filter(batch, later);
    regulate(batch, batch->references + (size_t)number * 2 * s->voltages, u, voltages_of(batch, number + 1));
}

static bool is_pushed(const Batch *batch, int64_t number)
{
    const size_t beams = batch->sizes.beams;
    return beams > 0 && is_any_nonzero(beams, batch->task->force + (size_t)number * beams);
}

/* From step `number` to the next. */
static void step(Batch *batch, int64_t number, const double *noisy)
{
    tick(batch, number, 0);
    step_plant(batch);
    if (is_pushed(batch, number))
        push_plant(batch, batch->task->force + (size_t)number * batch->sizes.beams);
    write_outputs(batch, row_of(batch, number + 1));
    if (noisy != NULL)
        add_noise(batch, number + 1, noisy);
}

/* From step `number` to the next but one: the plant's data are read once for both. The voltages of the next step follow
   from what is known at this one. */
static void step_twice(Batch *batch, int64_t number, const double *noisy)
{
    const LoopSizes *const s = &batch->sizes;
    tick(batch, number, 0);
    const Lanes *const u = voltages_of(batch, number + 1);
    for (size_t i = 0; i < s->voltages; i++)
        spread_lanes(u[i], inputs_of(batch, 1) + i * PARTS);
    step_plant_twice(batch);
    write_outputs_twice(batch, row_of(batch, number + 1), row_of(batch, number + 2));
    if (noisy != NULL)
        add_noise(batch, number + 1, noisy);
    tick(batch, number + 1, 1);
    if (noisy != NULL)
        add_noise(batch, number + 2, noisy);
}

/* Does the loop cover a lane's run? Its strains were within the limit, and its last values are finite. */
static bool is_covered(const Batch *batch, size_t lane)
{
    const LoopSizes *const s = &batch->sizes;
    const Lanes *const row = row_of(batch, batch->task->steps);
    double sum = 0.0; /* not a number where one of them is not */
    for (size_t k = 0; k < s->output_rows + s->voltages; k++)
        sum += get_lane(&row[k], lane);
    return get_lane(batch->at.strain, lane) <= batch->task->controller.strain_limit && fabs(sum) <= 1e300;
}

void run_group(Batch *batch, const double *values, int32_t outcomes[LANES])
{
    const int64_t steps = batch->task->steps;
    const double *const noisy = is_any_noisy(batch, values) ? values : NULL;
    *batch->at.strain = lanes_of(0.0);
    start_controller(batch, voltages_of(batch, 0));
    write_outputs(batch, row_of(batch, 0));
    if (noisy != NULL)
        add_noise(batch, 0, noisy);
    int64_t measured = 0;
    for (int64_t number = 0; number < steps;) {
        if (number + 2 - measured >= ROWS) { /* the next two rows have no room beside those to be measured */
            measure(batch, measured, number);
            measured = number + 1;
        }
        const bool twice = number + 2 <= steps && !is_pushed(batch, number) && !is_pushed(batch, number + 1);
        if (twice)
            step_twice(batch, number, noisy);
        else
            step(batch, number, noisy);
        number += twice ? 2 : 1;
    }
    measure(batch, measured, steps);
    for (size_t lane = 0; lane < LANES; lane++)
        if (!is_covered(batch, lane))
            outcomes[lane] = BATCH_OUTSIDE;
}
