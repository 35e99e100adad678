/* The plants of a group: their modal forms side by side, and a step of all of them. */
#include "batch_kernel.h"
#include "row_widths.h"

/* Of a pair, before its outputs. */
static size_t first_output(const LoopSizes *s)
{
    return 2 + s->voltages;
}

static size_t plant_stride(const LoopSizes *s)
{
    return first_output(s) + s->output_rows;
}

size_t padded_rows(size_t rows)
{
    return chunk_count(rows) * chunk_width(rows);
}

static size_t sum_rows(const LoopSizes *s)
{
    return s->output_rows > s->law_rows ? s->output_rows : s->law_rows;
}

/* Couples of numbers of each sample. */
static size_t couple_count(const LoopSizes *s)
{
    return s->plant_pairs * (plant_stride(s) + s->beams + 2) + s->filter_pairs + 2 * (s->filter_inputs + sum_rows(s));
}

size_t lanes_size(const LoopSizes *s, size_t measures)
{
    const size_t single =
        ROWS * (s->output_rows + s->voltages) + s->law_rows + 2 * s->voltages + measures * BATCH_FIGURES + 1;
    const size_t driven = (2 * s->plant_pairs * PART + LANES - 1) / LANES; /* of which other lanes follow */
    return LANES * (2 * couple_count(s) + single + driven);
}

void place_lanes(Batch *batch, double *memory)
{
    const LoopSizes *const s = &batch->sizes;
    LoopLanes *const at = &batch->at;
    at->plant = (Part *)memory;
    at->z = at->plant + PARTS * s->plant_pairs * plant_stride(s);
    at->halfway = at->z + PARTS * s->plant_pairs;
    at->filter_z = at->halfway + PARTS * s->plant_pairs;
    at->inputs = at->filter_z + PARTS * s->filter_pairs;
    at->sums = at->inputs + 2 * PARTS * s->filter_inputs;
    at->force = at->sums + 2 * PARTS * sum_rows(s);
    at->rows = (Lanes *)(at->force + PARTS * s->plant_pairs * s->beams);
    at->law = at->rows + ROWS * (s->output_rows + s->voltages);
    at->integral = at->law + s->law_rows;
    at->growth = at->integral + s->voltages;
    at->figures = at->growth + s->voltages;
    at->strain = at->figures + (size_t)batch->task->measure_count * BATCH_FIGURES;
    at->driven = (Part *)(at->strain + 1);
}

/* A number of a pair of the plant. */
static void set_plant_number(Batch *batch, size_t pair, size_t place, size_t lane, size_t member, double value)
{
    const LoopSizes *const s = &batch->sizes;
    set_member(batch->at.plant + tile_place(plant_stride(s), pair, place), s->plant_pairs * plant_stride(s), lane,
               member, value);
}

/* One member of a pair: growth by its own and the other coordinate, inputs, outputs. */
static void set_plant_member(Batch *batch, size_t lane, const Modal *modal, size_t pair, size_t member)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t slot = modal_slot(pair, member);
    const size_t other = member == 0 ? slot + MODAL_LANES : slot - MODAL_LANES;
    const size_t block = slot / MODAL_BLOCK;
    const double *const hold = modal->hold + block * MODAL_HOLD_ROWS * MODAL_BLOCK + slot % MODAL_BLOCK;
    Part *const force = batch->at.force + pair * s->beams;
    set_plant_number(batch, pair, 0, lane, member, hold[0]);
    set_plant_number(batch, pair, 1, lane, member, hold[MODAL_BLOCK]);
    for (size_t j = 0; j < s->voltages + s->beams; j++) {
        const bool is_held = j < s->voltages;
        const size_t n = is_held ? j : j - s->voltages;
        const double *const columns = is_held ? modal->held_inputs + (block * modal->held + n) * MODAL_BLOCK
                                              : modal->rare_inputs + (block * modal->rare + n) * MODAL_BLOCK;
        const double own = hold[2 * MODAL_BLOCK] * columns[slot % MODAL_BLOCK];
        const double sum = own + hold[3 * MODAL_BLOCK] * columns[other % MODAL_BLOCK];
        if (is_held)
            set_plant_number(batch, pair, 2 + n, lane, member, sum);
        else
            set_member(force + n, s->plant_pairs * s->beams, lane, member, sum);
    }
    for (size_t i = 0; i < s->outputs; i++)
        set_plant_number(batch, pair, first_output(s) + i, lane, member, modal->output_rows[i * modal->slots + slot]);
}

void set_plant_lane(Batch *batch, size_t lane, const Modal *modal, const double *rest, const double *start)
{
    const size_t voltages = batch->sizes.voltages;
    for (size_t pair = 0; pair < batch->plant.coordinates; pair++)
        for (size_t member = 0; member < 2; member++) {
            const double *const row = rest + (modal_slot(pair, member)) * voltages;
            double sum = 0.0;
            for (size_t j = 0; j < voltages; j++)
                sum += row[j] * start[j];
            set_plant_member(batch, lane, modal, pair, member);
            set_member(&batch->at.z[pair], batch->sizes.plant_pairs, lane, member, sum);
        }
}

void clear_plant_lane(Batch *batch, size_t lane)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t pair = 0; pair < batch->plant.coordinates; pair++)
        for (size_t member = 0; member < 2; member++) {
            for (size_t k = 0; k < plant_stride(s); k++)
                set_plant_number(batch, pair, k, lane, member, 0.0);
            for (size_t k = 0; k < s->beams; k++)
                set_member(batch->at.force + pair * s->beams + k, s->plant_pairs * s->beams, lane, member, 0.0);
            set_member(&batch->at.z[pair], s->plant_pairs, lane, member, 0.0);
        }
}

/* What the voltages add to the pairs of a tile in this step, and in the next one where that is wanted too. */
INLINE void drive_tile(size_t voltages, const Part *inputs, const Part *u, const Part *next, Part *driven, Part *later)
{
    Part now[TILE];
    Part then[TILE];
    for (size_t q = 0; q < TILE; q++) {
        now[q] = part_multiply(inputs[q], u[0]);
        then[q] = next == NULL ? NO_PART : part_multiply(inputs[q], next[0]);
    }
    for (size_t j = 1; j < voltages; j++)
        for (size_t q = 0; q < TILE; q++) {
            const Part input = inputs[j * TILE + q];
            now[q] = part_add_product(now[q], input, u[j * PARTS]);
            if (next != NULL)
                then[q] = part_add_product(then[q], input, next[j * PARTS]);
        }
    for (size_t q = 0; q < TILE; q++) {
        driven[q] = now[q];
        if (next != NULL)
            later[q] = then[q];
    }
}

/* z of a tile after a step, which is left in `after` too. */
INLINE void grow_tile(const Part *plant, const Part *driven, Part z[TILE], Part *after)
{
    Part growth[TILE];
    for (size_t q = 0; q < TILE; q++)
        growth[q] = part_multiply(plant[q], z[q]);
    for (size_t q = 0; q < TILE; q++)
        growth[q] = part_add_product(growth[q], plant[TILE + q], part_exchanged(z[q]));
    for (size_t q = 0; q < TILE; q++)
        z[q] = part_add(part_add(z[q], driven[q]), growth[q]);
    for (size_t q = 0; q < TILE; q++)
        after[q] = z[q];
}

/* First what the voltages add to all pairs, then growth: in turn for each tile, growth would wait for the sums. */
INLINE void grow_pairs(size_t voltages, const Batch *batch, bool twice)
{
    const LoopSizes *const s = &batch->sizes;
    const size_t stride = plant_stride(s) * TILE;
    Part *const driven = batch->at.driven;
    Part *const later = driven + s->plant_pairs;
    for (size_t part = 0; part < PARTS; part++) {
        const Part *const u = batch->at.inputs + part;
        const Part *const next = twice ? u + s->filter_inputs * PARTS : NULL;
        const Part *plant = batch->at.plant + part * s->plant_pairs * plant_stride(s);
        for (size_t pair = 0; pair < s->plant_pairs; pair += TILE)
            drive_tile(voltages, plant + pair / TILE * stride + 2 * TILE, u, next, driven + pair, later + pair);
        for (size_t pair = 0; pair < s->plant_pairs; pair += TILE, plant += stride) {
            Part *const z = batch->at.z + part * s->plant_pairs + pair;
            Part own[TILE];
            for (size_t q = 0; q < TILE; q++)
                own[q] = z[q];
            grow_tile(plant, driven + pair, own, twice ? batch->at.halfway + part * s->plant_pairs + pair : z);
            if (twice)
                grow_tile(plant, later + pair, own, z);
        }
    }
}

void step_plant(Batch *batch)
{
    AT_COUNT(batch->sizes.voltages, grow_pairs, batch, false)
}

void step_plant_twice(Batch *batch)
{
    AT_COUNT(batch->sizes.voltages, grow_pairs, batch, true)
}

void push_plant(Batch *batch, const double *force)
{
    const Part *input = batch->at.force;
    for (size_t pair = 0; pair < PARTS * batch->sizes.plant_pairs; pair++)
        for (size_t j = 0; j < batch->sizes.beams; j++) {
            const Couple couple = {{force[j], force[j]}};
            batch->at.z[pair] = part_add_product(batch->at.z[pair], *input++, part_of(couple));
        }
}

/* `width` outputs from number `first` on, of z and, where they are wanted too, halfway, behind them. */
INLINE void sum_outputs(size_t width, const Batch *batch, size_t first, bool twice)
{
    const LoopSizes *const s = &batch->sizes;
    const Part *rows = batch->at.plant + (first_output(s) + first) * TILE;
    const Part *z = batch->at.z;
    const Part *halfway = batch->at.halfway;
    for (size_t part = 0; part < PARTS; part++) {
        Part sums[COUNTS];
        Part earlier[COUNTS];
        for (size_t i = 0; i < width; i++)
            sums[i] = earlier[i] = NO_PART;
        for (size_t pair = 0; pair < s->plant_pairs; pair += TILE) {
            for (size_t q = 0; q < TILE; q++)
                for (size_t i = 0; i < width; i++) {
                    sums[i] = part_add_product(sums[i], rows[i * TILE + q], z[q]);
                    if (twice)
                        earlier[i] = part_add_product(earlier[i], rows[i * TILE + q], halfway[q]);
                }
            rows += plant_stride(s) * TILE;
            z += TILE;
            halfway += TILE;
        }
        Part *const to = batch->at.sums + first * PARTS + part;
        for (size_t i = 0; i < width; i++) {
            to[i * PARTS] = sums[i];
            if (twice)
                to[(s->output_rows + i) * PARTS] = earlier[i];
        }
    }
}

static void read_sums(const Batch *batch, size_t first, Lanes *y)
{
    const size_t rows = batch->sizes.output_rows;
    for (size_t i = 0; i < rows; i++)
        y[i] = sum_couples(batch->at.sums + (first + i) * PARTS);
}

void write_outputs(Batch *batch, Lanes *y)
{
    const size_t width = chunk_width(batch->sizes.outputs);
    for (size_t first = 0; first < batch->sizes.outputs; first += width)
        AT_COUNT(width, sum_outputs, batch, first, false)
    read_sums(batch, 0, y);
}

void write_outputs_twice(Batch *batch, Lanes *halfway, Lanes *y)
{
    const size_t width = chunk_width(batch->sizes.outputs);
    for (size_t first = 0; first < batch->sizes.outputs; first += width)
        AT_COUNT(width, sum_outputs, batch, first, true)
    read_sums(batch, 0, y);
    read_sums(batch, batch->sizes.output_rows, halfway);
}
