/* The planner in portions: random motions of up to seven transitions and changes near the limit.

   Prints how many plans there were, how many of them are longer than asked for or refused, how many searches were not
   done after planning_ticks portions, how many plans differ from those of a search at one go, and the most times that a
   portion looked at, times transitions, over its size. Portions of a single time count them: they lead to the same
   numbers. */

#include <stdio.h>
#include <string.h>

#include "FlatnessFeedforward.c"

#define PLANS 300
#define MOST_VOLTAGES 64
#define LIMIT 1000.0

static unsigned long long seed = 12345;

static double uniform(double low, double high)
{
    seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return low + (high - low) * (double)(seed >> 11) / 9007199254740992.0;
}

int main(void)
{
    const FlatnessFeedforwardData *const data = &unit_data;
    const size_t voltages = data->flat.voltages;
    const bool tabulated = data->splines.durations > 0;
    static double offset[MOST_VOLTAGES];
    static double changes[SLOTS * MOST_VOLTAGES];
    static double starts[SLOTS];
    static double durations[SLOTS];
    static double memory[2][32 + 7 * MOST_VOLTAGES];
    static double rows[(2 + LOOKS) * MOST_VOLTAGES];
    FlatnessFeedforwardData looking = *data;
    looking.planning_portion = 1.0;
    double *const splines = calloc(SLOTS * (tabulated ? spline_size(&data->splines) : 1), sizeof *splines);
    if (splines == NULL || voltages > MOST_VOLTAGES)
        return 1;
    Motion motion = {
        .offset = offset, .starts = starts, .durations = durations, .changes = changes, .splines = splines};
    double lowest[MOST_VOLTAGES];
    double highest[MOST_VOLTAGES];
    double change[MOST_VOLTAGES];
    const VoltageRange limits = {.lowest = lowest, .highest = highest};
    unsigned plans = 0;
    unsigned unfinished = 0;
    unsigned different = 0;
    unsigned stretched = 0;
    double fullest = 0.0;
    for (unsigned n = 0; n < PLANS; n++) {
        motion.count = (size_t)uniform(0.0, SLOTS);
        double goals[MOST_VOLTAGES];
        for (size_t j = 0; j < voltages; j++) {
            lowest[j] = -LIMIT;
            highest[j] = LIMIT;
            offset[j] = goals[j] = uniform(-LIMIT, LIMIT);
        }
        for (size_t k = 0; k <= motion.count; k++) {
            const size_t row = (size_t)uniform(0.0, (double)data->durations);
            double *const step = k < motion.count ? changes + k * voltages : change;
            for (size_t j = 0; j < voltages; j++) {
                const double goal = uniform(-LIMIT, LIMIT);
                step[j] = goal - goals[j];
                goals[j] = goal;
            }
            if (k == motion.count)
                break;
            starts[k] = uniform(-0.3, 0.0);
            durations[k] = tabulated ? data->splines.times[row] : data->curve_durations[row];
            if (tabulated)
                begin_spline(&data->splines, row, step, splines + k * spline_size(&data->splines));
        }
        const double shortest = uniform(0.001, 0.5);
        TransitionPlan plan;
        const PlanSearch search = search_in(data, memory[0], rows);
        const PlanSearch slow = search_in(data, memory[1], rows);
        if (!begin_search(data, &motion, search, 0.0, change, shortest, limits, &plan))
            continue;
        plans++;
        begin_search(data, &motion, slow, 0.0, change, shortest, limits, &plan);
        for (unsigned tick = 0; tick < (unsigned)data->planning_ticks; tick++) {
            unsigned looks = 0;
            continue_search(data, &motion, search);
            for (; memcmp(search.numbers, slow.numbers, SEARCH_NUMBERS * sizeof(double)) != 0; looks++) {
                restore_search(data, &motion, slow);
                continue_search(&looking, &motion, slow);
            }
            restore_search(data, &motion, search);
            fullest = fmax(fullest, looks * (data->look_work + (double)motion.count + 1.0) / data->planning_portion);
        }
        unfinished += !is_done(search.numbers);
        plan = conclude_search(data, &motion, search);
        const double found = durations[motion.count];
        TransitionPlan other;
        begin_search(data, &motion, slow, 0.0, change, shortest, limits, &other);
        other = conclude_search(data, &motion, slow);
        stretched += !(search.numbers[HIGH] == 0.0);
        different += plan.duration != other.duration || plan.peak != other.peak ||
                     (plan.duration > 0.0 && found != durations[motion.count]) ||
                     plan.violation.excess != other.violation.excess;
    }
    free(splines);
    printf("%u %u %u %u %.4f\n", plans, stretched, unfinished, different, fullest);
    return 0;
}
