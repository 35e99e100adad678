/* The plants of a group: their modal forms side by side, and a step of all of them. */
#include "batch_kernel.h"
#include "row_widths.h"

/* Of a pair, before its outputs. */
static size_t first_output(const LoopSizes *s)
{
    return 2 + s->voltages;
}

static size_t pair_lanes(const LoopSizes *s)
{
    return first_output(s) + s->output_rows;
}

size_t padded_rows(size_t rows)
{
    return chunk_count(rows) * chunk_width(rows);
}

static size_t wide_count(const LoopSizes *s)
{
    return s->plant_pairs * (pair_lanes(s) + s->beams + 1) + s->filter_pairs + s->filter_inputs;
}

size_t lanes_size(const LoopSizes *s, size_t measures)
{
    const size_t narrow =
        ROWS * (s->output_rows + s->voltages) + s->law_rows + 2 * s->voltages + measures * BATCH_FIGURES + 1;
    return LANES * (2 * wide_count(s) + narrow);
}

void place_lanes(Batch *batch, double *memory)
{
    const LoopSizes *const s = &batch->sizes;
    LoopLanes *const at = &batch->at;
    at->plant = (PairLanes *)memory;
    at->z = at->plant + s->plant_pairs * pair_lanes(s);
    at->filter_z = at->z + s->plant_pairs;
    at->inputs = at->filter_z + s->filter_pairs;
    at->force = at->inputs + s->filter_inputs;
    at->rows = (Lanes *)(memory + 2 * LANES * wide_count(s));
    at->law = at->rows + ROWS * (s->output_rows + s->voltages);
    at->integral = at->law + s->law_rows;
    at->growth = at->integral + s->voltages;
    at->figures = at->growth + s->voltages;
    at->strain = at->figures + (size_t)batch->task->measure_count * BATCH_FIGURES;
}

/* One member of a pair: growth by its own and the other coordinate, inputs, outputs. */
static void set_member(Batch *batch, size_t lane, const Modal *modal, size_t pair, size_t member)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t slot = slot_of_pair(pair) + member * MODAL_LANES;
    const size_t other = member == 0 ? slot + MODAL_LANES : slot - MODAL_LANES;
    const size_t block = slot / MODAL_BLOCK;
    const double *const hold = modal->hold + block * MODAL_HOLD_ROWS * MODAL_BLOCK + slot % MODAL_BLOCK;
    PairLanes *const plant = batch->at.plant + pair * pair_lanes(s);
    PairLanes *const force = batch->at.force + pair * s->beams;
    set_pair_lane(&plant[0], lane, member, hold[0]);
    set_pair_lane(&plant[1], lane, member, hold[MODAL_BLOCK]);
    for (size_t j = 0; j < s->voltages + s->beams; j++) {
        const bool is_held = j < s->voltages;
        const size_t n = is_held ? j : j - s->voltages;
        const double *const columns = is_held ? modal->held_inputs + (block * modal->held + n) * MODAL_BLOCK
                                              : modal->rare_inputs + (block * modal->rare + n) * MODAL_BLOCK;
        const double own = hold[2 * MODAL_BLOCK] * columns[slot % MODAL_BLOCK];
        const double sum = own + hold[3 * MODAL_BLOCK] * columns[other % MODAL_BLOCK];
        set_pair_lane(is_held ? &plant[2 + n] : &force[n], lane, member, sum);
    }
    for (size_t i = 0; i < s->outputs; i++)
        set_pair_lane(&plant[first_output(s) + i], lane, member, modal->output_rows[i * modal->slots + slot]);
}

void set_plant_lane(Batch *batch, size_t lane, const Modal *modal, const double *rest, const double *start)
{
    const size_t voltages = batch->sizes.voltages;
    for (size_t pair = 0; pair < batch->sizes.plant_pairs; pair++)
        for (size_t member = 0; member < 2; member++) {
            const double *const row = rest + (slot_of_pair(pair) + member * MODAL_LANES) * voltages;
            double sum = 0.0;
            for (size_t j = 0; j < voltages; j++)
                sum += row[j] * start[j];
            set_member(batch, lane, modal, pair, member);
            set_pair_lane(&batch->at.z[pair], lane, member, sum);
        }
}

void clear_plant_lane(Batch *batch, size_t lane)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t member = 0; member < 2; member++) {
        for (size_t k = 0; k < s->plant_pairs * (pair_lanes(s) + 1); k++) /* z is behind the pairs */
            set_pair_lane(&batch->at.plant[k], lane, member, 0.0);
        for (size_t k = 0; k < s->plant_pairs * s->beams; k++)
            set_pair_lane(&batch->at.force[k], lane, member, 0.0);
    }
}

/* z after a step with the voltages u. What they add is summed apart: the sums of a pair do not wait for one another. */
INLINE void grow_pairs(size_t voltages, const Batch *batch, PairLanes *restrict z, const PairLanes *restrict u)
{
    const LoopSizes *const s = &batch->sizes;
    const PairLanes *restrict plant = batch->at.plant;
    for (size_t pair = 0; pair < s->plant_pairs; pair++, plant += pair_lanes(s)) {
        PairLanes growth = pairs_multiply(plant[0], z[pair]);
        growth = pairs_add_product(growth, plant[1], pairs_exchanged(z[pair]));
        PairLanes driven = pairs_multiply(plant[2], u[0]);
        for (size_t j = 1; j < voltages; j++)
            driven = pairs_add_product(driven, plant[2 + j], u[j]);
        z[pair] = pairs_add(pairs_add(z[pair], growth), driven);
    }
}

void step_plant(Batch *batch)
{
    AT_COUNT(batch->sizes.voltages, grow_pairs, batch, batch->at.z, batch->at.inputs)
}

void push_plant(Batch *batch, const double *force)
{
    const PairLanes *input = batch->at.force;
    for (size_t pair = 0; pair < batch->sizes.plant_pairs; pair++)
        for (size_t j = 0; j < batch->sizes.beams; j++) {
            const double twice[2] = {force[j], force[j]};
            batch->at.z[pair] = pairs_add_product(batch->at.z[pair], *input++, pairs_of(twice));
        }
}

/* `width` outputs from number `first` on. */
INLINE void sum_outputs(size_t width, const Batch *batch, size_t first, Lanes *y)
{
    const LoopSizes *const s = &batch->sizes;
    const PairLanes *rows = batch->at.plant + first_output(s) + first;
    PairLanes sum[COUNTS];
    for (size_t i = 0; i < width; i++)
        sum[i] = NO_PAIRS;
    for (size_t pair = 0; pair < s->plant_pairs; pair++, rows += pair_lanes(s))
        for (size_t i = 0; i < width; i++)
            sum[i] = pairs_add_product(sum[i], rows[i], batch->at.z[pair]);
    for (size_t i = 0; i < width; i++)
        y[first + i] = sums_of_pairs(sum[i]);
}

void write_outputs(Batch *batch, Lanes *y)
{
    const size_t outputs = batch->sizes.outputs;
    const size_t width = chunk_width(outputs);
    for (size_t first = 0; first < outputs; first += width)
        AT_COUNT(width, sum_outputs, batch, first, y)
}
