/* Figures of measured elements, taken some steps at a time. */
#include "batch_kernel.h"

/* The place of an element in the rows of y and u. */
static size_t element_place(const LoopSizes *s, int64_t signal, size_t element)
{
    return element + (signal == BATCH_STRAINS ? s->points : signal == BATCH_VOLTAGES ? s->output_rows : 0);
}

INLINE void start_figures(Lanes value, Lanes *figures)
{
    figures[BATCH_SMALLEST] = figures[BATCH_LARGEST] = figures[BATCH_FIRST] = figures[BATCH_LAST] = value;
    figures[BATCH_CHANGE] = lanes_of(0.0);
    figures[BATCH_OUT] = lanes_of(-1.0);
}

/* The values of an element from step `first` to `last`. */
static void take_values(const Batch *batch, size_t place, int64_t first, int64_t last, Lanes *figures)
{
    Lanes smallest = figures[BATCH_SMALLEST];
    Lanes largest = figures[BATCH_LARGEST];
    for (int64_t number = first; number <= last; number++) {
        const Lanes value = row_of(batch, number)[place];
        smallest = lanes_smaller(value, smallest);
        largest = lanes_larger(value, largest);
    }
    figures[BATCH_SMALLEST] = smallest;
    figures[BATCH_LARGEST] = largest;
}

static void take_changes(const Batch *batch, size_t place, int64_t first, int64_t last, Lanes *figures)
{
    Lanes before = figures[BATCH_LAST];
    for (int64_t number = first; number <= last; number++) {
        const Lanes value = row_of(batch, number)[place];
        const Lanes change = lanes_magnitude(lanes_subtract(value, before));
        figures[BATCH_CHANGE] = lanes_larger(change, figures[BATCH_CHANGE]);
        before = value;
    }
}

/* band: middle and half width */
static void take_band(const Batch *batch, size_t place, int64_t first, int64_t last, const double *band, Lanes *figures)
{
    for (int64_t number = first; number <= last; number++) {
        const Lanes gap = lanes_magnitude(lanes_subtract(row_of(batch, number)[place], lanes_of(band[0])));
        const LaneMask out = lanes_above(gap, lanes_of(band[1]));
        figures[BATCH_OUT] = lanes_choose(out, lanes_of((double)number), figures[BATCH_OUT]);
    }
}

/* The largest strain, which has to be within the limit of the controller: it would leave others out. It reads none of
   the last step. */
static void find_strain(Batch *batch, int64_t first, int64_t last)
{
    const LoopSizes *const s = &batch->sizes;
    Lanes largest = *batch->at.strain;
    for (int64_t number = first; number <= last && number < batch->task->steps; number++)
        for (size_t k = s->points; k < s->outputs; k++)
            largest = lanes_larger(lanes_magnitude(row_of(batch, number)[k]), largest);
    *batch->at.strain = largest;
}

void measure(Batch *batch, int64_t first, int64_t last)
{
    const BatchTask *const task = batch->task;
    find_strain(batch, first, last);
    for (size_t m = 0; m < (size_t)task->measure_count; m++) {
        const int64_t *const row = task->measures + BATCH_MEASURE * m;
        const int64_t begin = first > row[2] ? first : row[2];
        const int64_t end = last < row[3] ? last : row[3];
        if (begin > end)
            continue;
        const size_t place = element_place(&batch->sizes, row[0], (size_t)row[1]);
        Lanes *const figures = batch->at.figures + m * BATCH_FIGURES;
        if (begin == row[2])
            start_figures(row_of(batch, begin)[place], figures);
        take_values(batch, place, begin, end, figures);
        if (row[4] != 0)
            take_changes(batch, place, begin, end, figures);
        if (row[5] != 0)
            take_band(batch, place, begin, end, task->bands + 2 * m, figures);
        figures[BATCH_LAST] = row_of(batch, end)[place];
    }
}

void read_figures(const Batch *batch, size_t lane, double *figures)
{
    for (size_t k = 0; k < (size_t)batch->task->measure_count * BATCH_FIGURES; k++)
        figures[k] = get_lane(&batch->at.figures[k], lane);
}
