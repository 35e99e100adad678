#include "batch_kernel.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "normal_number.h"
#include "windup.h"

size_t padded_rows(size_t rows)
{
    const size_t chunks = (rows + CHUNK - 1) / CHUNK;
    return chunks == 0 ? 0 : (rows + chunks - 1) / chunks * chunks;
}

static size_t pair_lanes(const LoopSizes *s)
{
    return 2 + 2 * s->voltages + 2 * s->output_rows;
}

size_t lanes_size(const LoopSizes *s, size_t measures)
{
    return s->plant_pairs * (pair_lanes(s) + 2 + 2 * s->beams + 2) + 2 * s->filter_pairs + s->output_rows +
           s->law_rows + 2 * s->voltages + s->filter_inputs + measures * BATCH_FIGURES;
}

void place_lanes(Batch *batch, Lanes *memory)
{
    const LoopSizes *const s = &batch->sizes;
    LoopLanes *const at = &batch->at;
    at->plant = memory;
    at->z = at->plant + s->plant_pairs * pair_lanes(s);
    at->filter_z = at->z + 2 * s->plant_pairs;
    at->y = at->filter_z + 2 * s->filter_pairs;
    at->law = at->y + s->output_rows;
    at->u = at->law + s->law_rows;
    at->integral = at->u + s->voltages;
    at->inputs = at->integral + s->voltages;
    at->figures = at->inputs + s->filter_inputs;
    at->second = at->figures + (size_t)batch->task->measure_count * BATCH_FIGURES;
    at->force = at->second + 2 * s->plant_pairs;
}

static void set_lane(Lanes *lanes, size_t lane, double value)
{
    ((double *)lanes)[lane] = value;
}

static double get_lane(const Lanes *lanes, size_t lane)
{
    return ((const double *)lanes)[lane];
}

/* One member of a pair: growth by its own and the other coordinate, inputs, outputs. */
static void set_member(Batch *batch, size_t lane, const Modal *modal, size_t pair, size_t member)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t slot = pair / MODAL_LANES * MODAL_BLOCK + pair % MODAL_LANES + member * MODAL_LANES;
    const size_t other = member == 0 ? slot + MODAL_LANES : slot - MODAL_LANES;
    const size_t block = slot / MODAL_BLOCK;
    const double *const hold = modal->hold + block * MODAL_HOLD_ROWS * MODAL_BLOCK + slot % MODAL_BLOCK;
    Lanes *const plant = batch->at.plant + pair * pair_lanes(s);
    Lanes *const growth = member == 0 ? plant : batch->at.second + 2 * pair;
    set_lane(&growth[0], lane, hold[0]);
    set_lane(&growth[1], lane, hold[MODAL_BLOCK]);
    const double own = hold[2 * MODAL_BLOCK];
    const double crossed = hold[3 * MODAL_BLOCK];
    for (size_t j = 0; j < s->voltages + s->beams; j++) {
        const bool is_held = j < s->voltages;
        const size_t n = is_held ? j : j - s->voltages;
        const double *const columns = is_held ? modal->held_inputs + (block * modal->held + n) * MODAL_BLOCK
                                              : modal->rare_inputs + (block * modal->rare + n) * MODAL_BLOCK;
        Lanes *const to = is_held ? plant + 2 + 2 * n : batch->at.force + 2 * (pair * s->beams + n);
        const double first = own * columns[slot % MODAL_BLOCK];
        set_lane(&to[member], lane, first + crossed * columns[other % MODAL_BLOCK]);
    }
    Lanes *const output = plant + 2 + 2 * s->voltages + member * s->output_rows;
    for (size_t i = 0; i < s->outputs; i++)
        set_lane(&output[i], lane, modal->output_rows[i * modal->slots + slot]);
}

void set_plant_lane(Batch *batch, size_t lane, const Modal *modal)
{
    for (size_t pair = 0; pair < batch->sizes.plant_pairs; pair++) {
        set_member(batch, lane, modal, pair, 0);
        set_member(batch, lane, modal, pair, 1);
    }
    batch->complex_pairs[lane] = (size_t)modal->facts[0];
}

void clear_plant_lane(Batch *batch, size_t lane)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t k = 0; k < s->plant_pairs * (pair_lanes(s) + 2); k++) /* plant and z follow one another */
        set_lane(&batch->at.plant[k], lane, 0.0);
    for (size_t k = 0; k < s->plant_pairs * (2 + 2 * s->beams); k++)
        set_lane(&batch->at.second[k], lane, 0.0);
    batch->complex_pairs[lane] = s->plant_pairs;
}

/* The widths written out: a loop of a width that the compiler knows keeps its sums in registers. */
#define WIDTH(wide, function, ...)                                                                                     \
    case wide:                                                                                                         \
        function(wide, __VA_ARGS__);                                                                                   \
        break;
#define ALL_WIDTHS(function, ...)                                                                                      \
    switch (width) {                                                                                                   \
        WIDTH(1, function, __VA_ARGS__)                                                                                \
        WIDTH(2, function, __VA_ARGS__)                                                                                \
        WIDTH(3, function, __VA_ARGS__)                                                                                \
        WIDTH(4, function, __VA_ARGS__)                                                                                \
        WIDTH(5, function, __VA_ARGS__)                                                                                \
        WIDTH(6, function, __VA_ARGS__)                                                                                \
        WIDTH(7, function, __VA_ARGS__)                                                                                \
        WIDTH(8, function, __VA_ARGS__)                                                                                \
        WIDTH(9, function, __VA_ARGS__)                                                                                \
        WIDTH(10, function, __VA_ARGS__)                                                                               \
        WIDTH(11, function, __VA_ARGS__)                                                                               \
    default:                                                                                                           \
        function(CHUNK, __VA_ARGS__);                                                                                  \
        break;                                                                                                         \
    }

/* Growth of a pair of coordinates by themselves and by the voltages, and by forces (beams,) where there are any. */
INLINE void grow_pair(const Batch *batch, size_t pair, bool is_complex, const double *force, Lanes *z)
{
    const LoopSizes *const s = &batch->sizes;
    const Lanes *const plant = batch->at.plant + pair * pair_lanes(s);
    const Lanes *const second = batch->at.second + 2 * pair;
    const Lanes *const u = batch->at.u;
    Lanes one = lanes_multiply(plant[0], z[0]);
    Lanes other = lanes_multiply(is_complex ? plant[0] : second[0], z[1]);
    one = lanes_add_product(one, plant[1], z[1]);
    if (is_complex)
        other = lanes_subtract(other, lanes_multiply(plant[1], z[0]));
    else
        other = lanes_add_product(other, second[1], z[0]);
    const Lanes *input = plant + 2;
    for (size_t j = 0; j < s->voltages; j++, input += 2) {
        one = lanes_add_product(one, input[0], u[j]);
        other = lanes_add_product(other, input[1], u[j]);
    }
    input = batch->at.force + 2 * pair * s->beams;
    for (size_t j = 0; force != NULL && j < s->beams; j++, input += 2) {
        one = lanes_add_product(one, input[0], lanes_of(force[j]));
        other = lanes_add_product(other, input[1], lanes_of(force[j]));
    }
    z[0] = lanes_add(z[0], one);
    z[1] = lanes_add(z[1], other);
}

/* `width` outputs from number `first` on. */
INLINE void sum_outputs(size_t width, Batch *batch, size_t first)
{
    const LoopSizes *const s = &batch->sizes;
    const Lanes *rows = batch->at.plant + 2 + 2 * s->voltages + first;
    const Lanes *z = batch->at.z;
    Lanes sum[CHUNK];
    for (size_t i = 0; i < width; i++)
        sum[i] = lanes_of(0.0);
    for (size_t pair = 0; pair < s->plant_pairs; pair++, rows += pair_lanes(s), z += 2) {
        for (size_t i = 0; i < width; i++)
            sum[i] = lanes_add_product(sum[i], rows[i], z[0]);
        for (size_t i = 0; i < width; i++)
            sum[i] = lanes_add_product(sum[i], rows[s->output_rows + i], z[1]);
    }
    for (size_t i = 0; i < width; i++)
        batch->at.y[first + i] = sum[i];
}

/* All outputs. */
static void write_outputs(Batch *batch)
{
    const size_t chunks = (batch->sizes.outputs + CHUNK - 1) / CHUNK;
    const size_t width = chunks == 0 ? 0 : batch->sizes.output_rows / chunks;
    for (size_t chunk = 0; chunk < chunks; chunk++)
        ALL_WIDTHS(sum_outputs, batch, chunk * width)
}

/* z of the plant after a step with the present voltages and a force (beams,), NULL for none. */
static void step_plant(Batch *batch, const double *force)
{
    const size_t pairs = batch->sizes.plant_pairs;
    size_t complex_pairs = pairs; /* in all lanes */
    for (size_t lane = 0; lane < LANES; lane++)
        if (batch->complex_pairs[lane] < complex_pairs)
            complex_pairs = batch->complex_pairs[lane];
    for (size_t pair = 0; pair < complex_pairs; pair++)
        grow_pair(batch, pair, true, force, batch->at.z + 2 * pair);
    for (size_t pair = complex_pairs; pair < pairs; pair++)
        grow_pair(batch, pair, false, force, batch->at.z + 2 * pair);
}

/* The filter's z after a tick with the inputs (voltages, strains), and the law's sums of it. */
INLINE void step_filter(size_t width, Batch *batch, size_t chunk)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t stride = 2 + 2 * s->filter_inputs + 2 * s->law_rows;
    const double *row = batch->filter;
    Lanes sum[CHUNK];
    for (size_t i = 0; i < width; i++)
        sum[i] = lanes_of(0.0);
    for (size_t pair = 0; pair < s->filter_pairs; pair++, row += stride) {
        Lanes *const z = batch->at.filter_z + 2 * pair;
        Lanes first = z[0];
        Lanes second = z[1];
        if (chunk == 0) {
            const bool is_complex = pair < batch->complex_filter_pairs;
            const Lanes real = lanes_of(row[0]);
            const Lanes rest = lanes_of(row[1]);
            first = lanes_multiply(real, z[0]);
            second = lanes_multiply(is_complex ? real : rest, z[1]);
            if (is_complex) {
                first = lanes_add_product(first, rest, z[1]);
                second = lanes_subtract(second, lanes_multiply(rest, z[0]));
            }
            const double *input = row + 2;
            for (size_t j = 0; j < s->filter_inputs; j++, input += 2) {
                first = lanes_add_product(first, lanes_of(input[0]), batch->at.inputs[j]);
                second = lanes_add_product(second, lanes_of(input[1]), batch->at.inputs[j]);
            }
            z[0] = first;
            z[1] = second;
        }
        const double *const law = row + 2 + 2 * s->filter_inputs + chunk * width;
        for (size_t i = 0; i < width; i++)
            sum[i] = lanes_add_product(sum[i], lanes_of(law[i]), first);
        for (size_t i = 0; i < width; i++)
            sum[i] = lanes_add_product(sum[i], lanes_of(law[s->law_rows + i]), second);
    }
    for (size_t i = 0; i < width; i++)
        batch->at.law[chunk * width + i] = sum[i];
}

static void tick(Batch *batch)
{
    const size_t rows = 2 * batch->sizes.voltages;
    const size_t chunks = (rows + CHUNK - 1) / CHUNK;
    const size_t width = batch->sizes.law_rows / chunks;
    for (size_t chunk = 0; chunk < chunks; chunk++)
        ALL_WIDTHS(step_filter, batch, chunk)
}

/* The growth of a lane's integrals, of which some would wind up. */
static void unwind(Batch *batch, size_t lane, Lanes *growth)
{
    const BatchController *const c = &batch->task->controller;
    const size_t voltages = batch->sizes.voltages;
    double *const commanded = batch->windup;
    double *const own = commanded + voltages;
    double *const lowest = own + voltages;
    double *const highest = lowest + voltages;
    memcpy(lowest, c->lowest, voltages * sizeof *lowest);
    memcpy(highest, c->highest, voltages * sizeof *highest);
    for (size_t i = 0; i < voltages; i++) {
        commanded[i] = get_lane(&batch->at.law[i], lane);
        own[i] = get_lane(&growth[i], lane);
    }
    hold_windup(voltages, c->integral_range, commanded, (VoltageRange){.lowest = lowest, .highest = highest}, own,
                highest + voltages);
    for (size_t i = 0; i < voltages; i++)
        set_lane(&growth[i], lane, own[i]);
}

/* u = u_ff + K (x_ref - x_est) + integral within the limits; see regulate in tracking_controller.c. */
static void regulate(Batch *batch, const double *reference)
{
    const LoopSizes *const s = &batch->sizes;
    const BatchController *const c = &batch->task->controller;
    Lanes *const law = batch->at.law;
    const Lanes gain = lanes_of(c->integral_gain);
    const Lanes none = lanes_of(0.0);
    Lanes *const growth = batch->at.inputs; /* the filter has used them */
    for (size_t i = 0; i < s->voltages; i++) {
        Lanes sum = lanes_subtract(lanes_of(reference[s->voltages + i]), law[s->voltages + i]);
        for (size_t j = 0; j < s->voltages; j++)
            sum = lanes_subtract(sum, lanes_multiply(lanes_of(batch->direct[i * s->voltages + j]), batch->at.u[j]));
        growth[i] = lanes_multiply(sum, gain);
    }
    LaneMask winding = lanes_above(none, none);
    for (size_t i = 0; i < s->voltages; i++) {
        const Lanes lowest = lanes_of(c->lowest[i]);
        const Lanes highest = lanes_of(c->highest[i]);
        const Lanes commanded = lanes_add(lanes_subtract(lanes_of(reference[i]), law[i]), batch->at.integral[i]);
        const LaneMask above = lanes_both(lanes_above(commanded, highest), lanes_above(growth[i], none));
        const LaneMask below = lanes_both(lanes_above(lowest, commanded), lanes_above(none, growth[i]));
        winding = lanes_either(winding, lanes_either(above, below));
        law[i] = commanded;
        const Lanes under = lanes_choose(lanes_above(commanded, highest), highest, commanded);
        batch->at.u[i] = lanes_choose(lanes_above(lowest, under), lowest, under);
    }
    const Lanes is_winding = lanes_choose(winding, lanes_of(1.0), none);
    for (size_t lane = 0; lane < LANES; lane++)
        if (get_lane(&is_winding, lane) != 0.0)
            unwind(batch, lane, growth);
    for (size_t i = 0; i < s->voltages; i++)
        batch->at.integral[i] = lanes_add(batch->at.integral[i], growth[i]);
}

/* The filter starts at the reference, the voltages at the feedforward's. */
static void start_controller(Batch *batch)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t k = 0; k < 2 * s->filter_pairs; k++)
        batch->at.filter_z[k] = lanes_of(batch->start[k]);
    for (size_t i = 0; i < s->voltages; i++) {
        const double u = batch->task->u_ff[i];
        const double lowest = batch->task->controller.lowest[i];
        const double highest = batch->task->controller.highest[i];
        batch->at.u[i] = lanes_of(u < lowest ? lowest : u > highest ? highest : u);
        batch->at.integral[i] = lanes_of(0.0);
    }
}

/* Noise on the strains of the lanes that have any. */
static void add_noise(Batch *batch, int64_t number, const double *values)
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
            Lanes *const y = &batch->at.y[s->points + k];
            set_lane(y, lane, get_lane(y, lane) + deviation * normal_number(seed, (uint64_t)number, k));
        }
    }
}

static void measure(Batch *batch, int64_t number)
{
    const BatchTask *const task = batch->task;
    for (size_t m = 0; m < (size_t)task->measure_count; m++) {
        const int64_t *const row = task->measures + BATCH_MEASURE * m;
        if (number < row[2] || number > row[3])
            continue;
        const size_t element = (size_t)row[1];
        const Lanes y = row[0] == BATCH_VOLTAGES
                            ? batch->at.u[element]
                            : batch->at.y[element + (row[0] == BATCH_STRAINS ? batch->sizes.points : 0)];
        Lanes *const figures = batch->at.figures + m * BATCH_FIGURES;
        if (number == row[2]) {
            figures[BATCH_SMALLEST] = figures[BATCH_LARGEST] = figures[BATCH_FIRST] = figures[BATCH_LAST] = y;
            figures[BATCH_CHANGE] = lanes_of(0.0);
            figures[BATCH_OUT] = lanes_of(-1.0);
        }
        figures[BATCH_SMALLEST] = lanes_smaller(y, figures[BATCH_SMALLEST]);
        figures[BATCH_LARGEST] = lanes_larger(y, figures[BATCH_LARGEST]);
        if (row[4] != 0) {
            const Lanes change = lanes_subtract(y, figures[BATCH_LAST]);
            const Lanes size = lanes_larger(change, lanes_subtract(lanes_of(0.0), change));
            figures[BATCH_CHANGE] = lanes_larger(size, figures[BATCH_CHANGE]);
        }
        if (row[5] != 0) {
            const Lanes gap = lanes_subtract(y, lanes_of(task->bands[2 * m]));
            const Lanes size = lanes_larger(gap, lanes_subtract(lanes_of(0.0), gap));
            const LaneMask out = lanes_above(size, lanes_of(task->bands[2 * m + 1]));
            figures[BATCH_OUT] = lanes_choose(out, lanes_of((double)number), figures[BATCH_OUT]);
        }
        figures[BATCH_LAST] = y;
    }
}

/* Samples with a strain that is not within the limit of the controller: it would leave them out. */
static void find_outside(Batch *batch, Lanes *largest)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t k = s->points; k < s->outputs; k++) {
        const Lanes y = batch->at.y[k];
        *largest = lanes_larger(*largest, lanes_larger(y, lanes_subtract(lanes_of(0.0), y)));
    }
}

static bool is_any_nonzero(size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0.0)
            return true;
    return false;
}

void run_group(Batch *batch, const double *values, int32_t outcomes[LANES])
{
    const BatchTask *const task = batch->task;
    const LoopSizes *const s = &batch->sizes;
    bool noisy = false;
    for (size_t lane = 0; lane < LANES; lane++)
        noisy = noisy || values[lane * (size_t)task->plant.value_count + (size_t)task->plant.strain_noise_std] > 0.0;
    Lanes largest = lanes_of(0.0);
    start_controller(batch);
    write_outputs(batch);
    for (int64_t number = 0; number <= task->steps; number++) {
        if (noisy)
            add_noise(batch, number, values);
        measure(batch, number);
        if (number == task->steps)
            break;
        find_outside(batch, &largest);
        const double *force = NULL;
        if (s->beams > 0 && is_any_nonzero(s->beams, task->force + (size_t)number * s->beams))
            force = task->force + (size_t)number * s->beams;
        memcpy(batch->at.inputs, batch->at.u, s->voltages * sizeof *batch->at.u);
        memcpy(batch->at.inputs + s->voltages, batch->at.y + s->points, s->gauges * sizeof *batch->at.y);
        step_plant(batch, force);
        write_outputs(batch);
        tick(batch);
        regulate(batch, batch->references + (size_t)number * 2 * s->voltages);
    }
    for (size_t lane = 0; lane < LANES; lane++) {
        double sum = 0.0; /* not a number where one of them is not */
        for (size_t k = 0; k < s->outputs; k++)
            sum += get_lane(&batch->at.y[k], lane);
        for (size_t k = 0; k < s->voltages; k++)
            sum += get_lane(&batch->at.u[k], lane);
        if (!(get_lane(&largest, lane) <= task->controller.strain_limit) || !(fabs(sum) <= 1e300))
            outcomes[lane] = BATCH_OUTSIDE;
    }
}

void read_figures(const Batch *batch, size_t lane, double *figures)
{
    for (size_t k = 0; k < (size_t)batch->task->measure_count * BATCH_FIGURES; k++)
        figures[k] = get_lane(&batch->at.figures[k], lane);
}
