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

/* From step `number` to the next. */
static void step(Batch *batch, int64_t number)
{
    const LoopSizes *const s = &batch->sizes;
    const Lanes *const y = row_of(batch, number);
    const Lanes *const u = voltages_of(batch, number);
    for (size_t i = 0; i < s->voltages; i++)
        batch->at.inputs[i] = pairs_of_lanes(u[i]);
    for (size_t k = 0; k < s->gauges; k++)
        batch->at.inputs[s->voltages + k] = pairs_of_lanes(y[s->points + k]);
    step_plant(batch);
    if (s->beams > 0 && is_any_nonzero(s->beams, batch->task->force + (size_t)number * s->beams))
        push_plant(batch, batch->task->force + (size_t)number * s->beams);
    write_outputs(batch, row_of(batch, number + 1));
    step_filter(batch);
    regulate(batch, batch->references + (size_t)number * 2 * s->voltages, u, voltages_of(batch, number + 1));
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
    const bool noisy = is_any_noisy(batch, values);
    *batch->at.strain = lanes_of(0.0);
    start_controller(batch, voltages_of(batch, 0));
    write_outputs(batch, row_of(batch, 0));
    for (int64_t number = 0; number <= steps; number++) {
        if (noisy)
            add_noise(batch, number, values);
        if (number % ROWS == ROWS - 1 || number == steps)
            measure(batch, number - number % ROWS, number);
        if (number < steps)
            step(batch, number);
    }
    for (size_t lane = 0; lane < LANES; lane++)
        if (!is_covered(batch, lane))
            outcomes[lane] = BATCH_OUTSIDE;
}
