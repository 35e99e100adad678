/* The controller of a group: one filter and one law for all samples. */
#include <string.h>

#include "batch_kernel.h"
#include "row_widths.h"
#include "windup.h"

void start_controller(Batch *batch, Lanes *u)
{
    const LoopSizes *const s = &batch->sizes;
    for (size_t pair = 0; pair < s->filter_pairs; pair++)
        batch->at.filter_z[pair] = pairs_of(batch->start + 2 * pair);
    for (size_t i = 0; i < s->voltages; i++) {
        const double wanted = batch->task->u_ff[i];
        const double lowest = batch->task->controller.lowest[i];
        const double highest = batch->task->controller.highest[i];
        u[i] = lanes_of(wanted < lowest ? lowest : wanted > highest ? highest : wanted);
        batch->at.integral[i] = lanes_of(0.0);
    }
}

INLINE void grow_filter(size_t inputs, const Batch *batch, PairLanes *restrict z, const PairLanes *restrict input)
{
    const LoopSizes *const s = &batch->sizes;
    const double *restrict row = batch->filter;
    for (size_t pair = 0; pair < s->filter_pairs; pair++, row += filter_stride(s)) {
        PairLanes growth = pairs_multiply(pairs_of(row), z[pair]);
        growth = pairs_add_product(growth, pairs_of(row + 2), pairs_exchanged(z[pair]));
        PairLanes driven = pairs_multiply(pairs_of(row + filter_input(0)), input[0]);
        for (size_t j = 1; j < inputs; j++)
            driven = pairs_add_product(driven, pairs_of(row + filter_input(j)), input[j]);
        z[pair] = pairs_add(growth, driven);
    }
}

/* `width` sums of the law from number `first` on. */
INLINE void sum_law(size_t width, const Batch *batch, size_t first)
{
    const LoopSizes *const s = &batch->sizes;
    const double *row = batch->filter + filter_law(s, first);
    PairLanes sum[COUNTS];
    for (size_t i = 0; i < width; i++)
        sum[i] = NO_PAIRS;
    for (size_t pair = 0; pair < s->filter_pairs; pair++, row += filter_stride(s))
        for (size_t i = 0; i < width; i++)
            sum[i] = pairs_add_product(sum[i], pairs_of(row + 2 * i), batch->at.filter_z[pair]);
    for (size_t i = 0; i < width; i++)
        batch->at.law[first + i] = sums_of_pairs(sum[i]);
}

void step_filter(Batch *batch)
{
    const size_t rows = 2 * batch->sizes.voltages;
    const size_t width = chunk_width(rows);
    AT_COUNT(batch->sizes.filter_inputs, grow_filter, batch, batch->at.filter_z, batch->at.inputs)
    for (size_t first = 0; first < rows; first += width)
        AT_COUNT(width, sum_law, batch, first)
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
    const Lanes is_winding = lanes_choose(winding, lanes_of(1.0), none);
    for (size_t lane = 0; lane < LANES; lane++)
        if (get_lane(&is_winding, lane) != 0.0)
            unwind(batch, lane);
    for (size_t i = 0; i < s->voltages; i++)
        batch->at.integral[i] = lanes_add(batch->at.integral[i], growth[i]);
}
