/* The controller of a group: one filter and one law for all samples. */
#define NARROW_PARTS

#include <string.h>

#include "batch_kernel.h"
#include "row_widths.h"
#include "windup.h"

void start_controller(Batch *batch, Lanes *u)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t k = 0; k < PARTS * s->filter_pairs; k++)
        batch->at.filter_z[k] = part_of(batch->start[k % s->filter_pairs]);
    for (size_t i = 0; i < s->voltages; i++) {
        const double wanted = batch->task->u_ff[i];
        const double lowest = batch->task->controller.lowest[i];
        const double highest = batch->task->controller.highest[i];
        u[i] = lanes_of(wanted < lowest ? lowest : wanted > highest ? highest : wanted);
        batch->at.integral[i] = lanes_of(0.0);
    }
}

/* Parts that are taken at once, as all need the same numbers. */
#define ABREAST 2

INLINE void grow_filter(size_t inputs, const Batch *batch, const Part *input)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t part = 0; part < PARTS; part += ABREAST, input += ABREAST) {
        const Couple *filter = batch->filter;
        for (size_t pair = 0; pair < s->filter_pairs; pair += TILE, filter += filter_stride(s) * TILE) {
            const Couple *const columns = filter + 2 * TILE;
            Part *const z = batch->at.filter_z + part * s->filter_pairs + pair;
            Part driven[ABREAST][TILE];
            for (size_t q = 0; q < TILE; q++)
                for (size_t p = 0; p < ABREAST; p++)
                    driven[p][q] = part_multiply(part_of(columns[q]), input[p]);
            for (size_t j = 1; j < inputs; j++)
                for (size_t q = 0; q < TILE; q++) {
                    const Part column = part_of(columns[j * TILE + q]);
                    for (size_t p = 0; p < ABREAST; p++)
                        driven[p][q] = part_add_product(driven[p][q], column, input[j * PARTS + p]);
                }
            for (size_t q = 0; q < TILE; q++)
                for (size_t p = 0; p < ABREAST; p++) {
                    Part *const own = z + p * s->filter_pairs + q;
                    const Part growth = part_multiply(part_of(filter[q]), *own);
                    *own = part_add(part_add_product(growth, part_of(filter[TILE + q]), part_exchanged(*own)),
                                    driven[p][q]);
                }
        }
    }
}

/* `width` sums of the law from number `first` on. */
INLINE void sum_law(size_t width, const Batch *batch, size_t first)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t part = 0; part < PARTS; part += ABREAST) {
        const Part *z = batch->at.filter_z + part * s->filter_pairs;
        const Couple *rows = batch->filter + (2 + s->filter_inputs + first) * TILE;
        Part sums[COUNTS][ABREAST];
        for (size_t i = 0; i < width; i++)
            for (size_t p = 0; p < ABREAST; p++)
                sums[i][p] = NO_PART;
        for (size_t pair = 0; pair < s->filter_pairs; pair += TILE, rows += filter_stride(s) * TILE, z += TILE)
            for (size_t q = 0; q < TILE; q++)
                for (size_t i = 0; i < width; i++) {
                    const Part row = part_of(rows[i * TILE + q]);
                    for (size_t p = 0; p < ABREAST; p++)
                        sums[i][p] = part_add_product(sums[i][p], row, z[p * s->filter_pairs + q]);
                }
        for (size_t i = 0; i < width; i++)
            for (size_t p = 0; p < ABREAST; p++)
                batch->at.sums[(first + i) * PARTS + part + p] = sums[i][p];
    }
}

void step_filter(Batch *batch, size_t later)
{
    const size_t rows = 2 * batch->sizes.voltages;
    const size_t width = chunk_width(rows);
    AT_COUNT(batch->sizes.filter_inputs, grow_filter, batch, inputs_of(batch, later))
    for (size_t first = 0; first < rows; first += width)
        AT_COUNT(width, sum_law, batch, first)
    for (size_t i = 0; i < rows; i++)
        batch->at.law[i] = sum_couples(batch->at.sums + i * PARTS);
}

/* The growth of a lane's integrals, of which some would wind up. */
static void unwind(Batch *batch, size_t lane)
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
        own[i] = get_lane(&batch->at.growth[i], lane);
    }
    hold_windup(voltages, c->integral_range, commanded, (VoltageRange){.lowest = lowest, .highest = highest}, own,
                highest + voltages);
    for (size_t i = 0; i < voltages; i++)
        set_lane(&batch->at.growth[i], lane, own[i]);
}

/* Growth of the integral: gain (H_ref - law - direct u). */
INLINE void grow_integral(size_t voltages, const Batch *batch, const double *restrict reference,
                          const Lanes *restrict u, Lanes *restrict growth)
{
    const double *restrict direct = batch->direct;
    const Lanes *restrict law = batch->at.law + voltages;
    const Lanes gain = lanes_of(batch->task->controller.integral_gain);
    for (size_t i = 0; i < voltages; i++, direct += voltages) {
        Lanes sum = lanes_subtract(lanes_of(reference[voltages + i]), law[i]);
        for (size_t j = 0; j < voltages; j++)
            sum = lanes_subtract(sum, lanes_multiply(lanes_of(direct[j]), u[j]));
        growth[i] = lanes_multiply(sum, gain);
    }
}

void regulate(Batch *batch, const double *reference, const Lanes *u, Lanes *next)
{
    const LoopSizes *const s = &batch->sizes;
    const BatchController *const c = &batch->task->controller;
    Lanes *const law = batch->at.law;
    Lanes *const growth = batch->at.growth;
    const Lanes none = lanes_of(0.0);
    AT_COUNT(s->voltages, grow_integral, batch, reference, u, growth)
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
        next[i] = lanes_choose(lanes_above(lowest, under), lowest, under);
    }
    if (lanes_any(winding)) {
        const Lanes is_winding = lanes_choose(winding, lanes_of(1.0), none);
        for (size_t lane = 0; lane < LANES; lane++)
            if (get_lane(&is_winding, lane) != 0.0)
                unwind(batch, lane);
    }
    for (size_t i = 0; i < s->voltages; i++)
        batch->at.integral[i] = lanes_add(batch->at.integral[i], growth[i]);
}
