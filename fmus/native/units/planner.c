#include "planner.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "ranges.h"
#include "voltage_curves.h"

#define LONGEST_FACTOR 8.0  /* longest transition tried, as a multiple of the longest one tabulated or under way */
#define MOST_CANDIDATES 128 /* durations tried from the requested one to the longest */
#define LIMIT_ROUNDING 1e-9 /* of the largest limit: a voltage this far beyond its own is within */
#define NOT_BEGUN (-1.0)

/* The numbers of a search. Candidates are durations in ascending order; LOW is the longest that is known not to fit,
   -1 at first, HIGH the shortest that is known to fit, their count at first. */
enum {
    CANDIDATES, /* how many */
    SHORTEST,   /* the first, s; of tabulated ones its row */
    GROWTH,     /* ratio of neighbours */
    LOW,
    HIGH,
    CURVE,   /* transition at whose times the motion is looked at, NOT_BEGUN before a duration is used */
    SAMPLE,  /* the next of these times */
    SAMPLED, /* times looked at of this transition */
    PEAK,    /* of HIGH, or where that is none, of LOW, V */
    EXCESS,  /* the violation of LOW, or of the target where that is none */
    PAIR,
    VOLTAGE,
    IS_BELOW,
    SEARCH_NUMBERS
};

size_t search_size(const FlatnessFeedforwardData *data)
{
    return SEARCH_NUMBERS + 6 * data->flat.voltages;
}

size_t search_scratch(const FlatnessFeedforwardData *data)
{
    return (2 + LOOKS) * data->flat.voltages;
}

PlanSearch search_in(const FlatnessFeedforwardData *data, double *memory, double *scratch)
{
    const size_t voltages = data->flat.voltages;
    double *const arrays = memory + SEARCH_NUMBERS;
    return (PlanSearch){.numbers = memory,
                        .tolerated = {.lowest = arrays, .highest = arrays + voltages},
                        .range = {.lowest = arrays + 2 * voltages, .highest = arrays + 3 * voltages},
                        .latest = arrays + 4 * voltages,
                        .rows = scratch};
}

static Motion extended(const Motion *motion)
{
    Motion longer = *motion;
    longer.count++;
    return longer;
}

static double candidate(const FlatnessFeedforwardData *data, const double *numbers, double index)
{
    if (data->splines.durations > 0)
        return data->splines.times[(size_t)(numbers[SHORTEST] + index)];
    return numbers[SHORTEST] * pow(numbers[GROWTH], index);
}

/* The durations to choose from. */
static void set_candidates(const FlatnessFeedforwardData *data, const Motion *motion, double shortest, double *numbers)
{
    if (data->splines.durations > 0) {
        numbers[SHORTEST] = (double)spline_row(&data->splines, shortest);
        numbers[GROWTH] = 1.0;
        numbers[CANDIDATES] = (double)data->splines.durations - numbers[SHORTEST];
        return;
    }
    const double *const durations = data->curve_durations;
    const double first = fmax(shortest, durations[0]);
    double longest = fmax(durations[data->durations - 1], shortest);
    for (size_t k = 0; k < motion->count; k++)
        longest = fmax(longest, motion->durations[k]);
    const double range = longest * LONGEST_FACTOR / first;
    numbers[SHORTEST] = first;
    numbers[GROWTH] = durations[1] / durations[0];
    numbers[CANDIDATES] = floor(log(range) / log(numbers[GROWTH])) + 1;
    if (numbers[CANDIDATES] > MOST_CANDIDATES) {
        numbers[CANDIDATES] = MOST_CANDIDATES;
        numbers[GROWTH] = pow(range, 1.0 / (MOST_CANDIDATES - 1));
    }
}

static bool is_done(const double *numbers)
{
    return numbers[HIGH] - numbers[LOW] == 1.0;
}

/* The one to try: the first, then the last, then between the two that are known. */
static double next_candidate(const double *numbers)
{
    if (numbers[LOW] < 0.0)
        return 0.0;
    return numbers[HIGH] == numbers[CANDIDATES] ? numbers[CANDIDATES] - 1 : floor((numbers[LOW] + numbers[HIGH]) / 2);
}

/* Puts a duration into the slot of the new transition. */
static void use_candidate(const FlatnessFeedforwardData *data, const Motion *motion, const double *numbers,
                          double index)
{
    const size_t slot = motion->count;
    motion->durations[slot] = candidate(data, numbers, index);
    if (data->splines.durations > 0)
        begin_spline(&data->splines, (size_t)(numbers[SHORTEST] + index), motion->changes + slot * data->flat.voltages,
                     spline_of(&data->splines, motion, slot));
}

/* Begins to look at the next duration. */
static void begin_candidate(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    use_candidate(data, motion, search.numbers, next_candidate(search.numbers));
    search.numbers[CURVE] = search.numbers[SAMPLE] = search.numbers[SAMPLED] = 0.0;
    for (size_t j = 0; j < data->flat.voltages; j++) {
        search.range.lowest[j] = DBL_MAX;
        search.range.highest[j] = -DBL_MAX;
    }
}

static void note_violation(double *numbers, Violation violation)
{
    numbers[EXCESS] = violation.excess;
    numbers[PAIR] = (double)violation.pair;
    numbers[VOLTAGE] = violation.voltage;
    numbers[IS_BELOW] = violation.is_below;
}

/* Takes what was seen of a duration into account. After the last one the transition is that of the plan. */
static void end_candidate(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    const size_t voltages = data->flat.voltages;
    double *const numbers = search.numbers;
    const double index = next_candidate(numbers);
    const Violation violation = furthest_beyond(voltages, search.range, search.tolerated);
    const double allowed = (LIMIT_ROUNDING + data->planned_excess) * largest_magnitude(voltages, search.tolerated);
    const double peak = largest_magnitude(voltages, search.range);
    if (violation.excess <= allowed) {
        numbers[HIGH] = index;
        numbers[PEAK] = peak;
    } else {
        numbers[LOW] = index;
        note_violation(numbers, violation);
        if (numbers[HIGH] == numbers[CANDIDATES])
            numbers[PEAK] = peak;
    }
    if (!is_done(numbers))
        numbers[CURVE] = NOT_BEGUN;
    else if (numbers[HIGH] < numbers[CANDIDATES] && numbers[HIGH] != index)
        use_candidate(data, motion, numbers, numbers[HIGH]);
}

static void include(VoltageRange range, size_t pair, double voltage)
{
    range.lowest[pair] = smaller(voltage, range.lowest[pair]);
    range.highest[pair] = larger(voltage, range.highest[pair]);
}

/* Includes the peaks of the parabolas through three rows (3, voltages) where they turn. */
static void include_peaks(size_t voltages, const double *rows, VoltageRange range)
{
    for (size_t j = 0; j < voltages; j++) {
        const double before = rows[j];
        const double here = rows[voltages + j];
        const double after = rows[2 * voltages + j];
        if ((here - before) * (after - here) < 0.0)
            include(range, j, here - (after - before) * (after - before) / (8 * (before - 2 * here + after)));
    }
}

/* Planned voltages at ascending times, and those between each one and the two before. */
static void look_at(const FlatnessFeedforwardData *data, const Motion *longer, VoltageCurve *curves, size_t count,
                    const double *times, PlanSearch search)
{
    const size_t voltages = data->flat.voltages;
    const double *row = search.rows;
    memcpy(search.rows, search.latest, 2 * voltages * sizeof *row);
    voltages_at(data, longer, curves, count, times, search.rows + 2 * voltages);
    for (size_t i = 0; i < count; i++, row += voltages) {
        search.numbers[SAMPLED] += 1.0;
        for (size_t j = 0; j < voltages; j++)
            include(search.range, j, row[2 * voltages + j]);
        if (search.numbers[SAMPLED] >= 3.0)
            include_peaks(voltages, row, search.range);
    }
    memcpy(search.latest, row, 2 * voltages * sizeof *row);
}

/* Index of the first of a transition's times that is later than `now`; intervals + 1 where none is. */
static size_t first_after(const FlatnessFeedforwardData *data, double start, double duration, double now)
{
    size_t low = 0;
    size_t high = data->intervals + 1;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (start + duration * data->curve_grid[middle] > now)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* Looks at a duration until it is known or `work` is done, in units of one transition at one time; returns what is
   left. */
static double look_at_candidate(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search,
                                double work)
{
    if (search.numbers[CURVE] == NOT_BEGUN) {
        begin_candidate(data, motion, search);
        work -= data->candidate_work;
    }
    const Motion longer = extended(motion);
    const size_t last = motion->count;
    const double now = motion->starts[last];
    size_t k = (size_t)search.numbers[CURVE];
    size_t i = (size_t)search.numbers[SAMPLE];
    for (; k <= last && work > 0.0; k++, i = 0) {
        const double start = motion->starts[k];
        const double duration = motion->durations[k];
        if (i == 0)
            search.numbers[SAMPLED] = 0.0;
        if (i == 0 && k < last)
            i = first_after(data, start, duration, now);
        VoltageCurve curves[SLOTS];
        if (i <= data->intervals)
            curves_of(data, &longer, start + duration * data->curve_grid[i], curves);
        while (i <= data->intervals && work > 0.0) {
            double times[LOOKS];
            size_t count = 0;
            for (; count < LOOKS && i <= data->intervals && work > 0.0; i++) {
                times[count++] = start + duration * data->curve_grid[i];
                work -= data->look_work + (double)longer.count;
            }
            look_at(data, &longer, curves, count, times, search);
        }
        if (i <= data->intervals)
            break;
    }
    search.numbers[CURVE] = (double)k;
    search.numbers[SAMPLE] = (double)i;
    if (k > last)
        end_candidate(data, motion, search);
    return work;
}

bool begin_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search, double now,
                  const double *change, double shortest, VoltageRange limits, TransitionPlan *plan)
{
    const size_t voltages = data->flat.voltages;
    const size_t slot = motion->count;
    motion->starts[slot] = now;
    memcpy(motion->changes + slot * voltages, change, voltages * sizeof *change);
    const VoltageRange goal = {.lowest = search.rows, .highest = search.rows};
    for (size_t j = 0; j < voltages; j++) {
        goal.lowest[j] = motion->offset[j] + change[j];
        for (size_t k = 0; k < slot; k++)
            goal.lowest[j] += motion->changes[k * voltages + j];
    }
    *plan = (TransitionPlan){.peak = largest_magnitude(voltages, goal),
                             .violation = furthest_beyond(voltages, goal, limits)};
    plan->at_rest = !(plan->violation.excess <= LIMIT_ROUNDING * largest_magnitude(voltages, limits));
    if (plan->at_rest)
        return false;
    note_violation(search.numbers, plan->violation);
    VoltageCurve curves[SLOTS];
    curves_of(data, motion, now, curves);
    voltages_at(data, motion, curves, 1, &now, search.rows);
    for (size_t j = 0; j < voltages; j++) {
        search.tolerated.lowest[j] = smaller(search.rows[j], limits.lowest[j]);
        search.tolerated.highest[j] = larger(search.rows[j], limits.highest[j]);
    }
    set_candidates(data, motion, shortest, search.numbers);
    search.numbers[LOW] = -1.0;
    search.numbers[HIGH] = search.numbers[CANDIDATES];
    search.numbers[PEAK] = plan->peak;
    search.numbers[CURVE] = NOT_BEGUN;
    return true;
}

bool first_fits(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    look_at_candidate(data, motion, search, HUGE_VAL);
    return search.numbers[HIGH] == 0.0;
}

void continue_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    double work = data->planning_portion;
    while (work > 0.0 && !is_done(search.numbers))
        work = look_at_candidate(data, motion, search, work);
}

TransitionPlan conclude_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    const double *const numbers = search.numbers;
    while (!is_done(numbers))
        look_at_candidate(data, motion, search, HUGE_VAL);
    TransitionPlan plan = {.peak = numbers[PEAK],
                           .violation = {.excess = numbers[EXCESS],
                                         .pair = (size_t)numbers[PAIR],
                                         .voltage = numbers[VOLTAGE],
                                         .is_below = numbers[IS_BELOW] != 0.0}};
    if (numbers[HIGH] < numbers[CANDIDATES])
        plan.duration = motion->durations[motion->count];
    return plan;
}

static bool is_index(double value, double lowest, double highest)
{
    return value >= lowest && value <= highest && floor(value) == value;
}

bool search_is_valid(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    const double *const numbers = search.numbers;
    const double count = numbers[CANDIDATES];
    const bool is_tabulated = data->splines.durations > 0;
    const double most = is_tabulated ? (double)data->splines.durations - numbers[SHORTEST] : MOST_CANDIDATES;
    const bool has_candidates = is_tabulated ? is_index(numbers[SHORTEST], 0.0, (double)data->splines.durations - 1)
                                             : numbers[SHORTEST] > 0.0 && numbers[SHORTEST] < 1e12 &&
                                                   numbers[GROWTH] > 1.0 && numbers[GROWTH] < 1e12;
    return has_candidates && is_index(count, 1.0, most) && is_index(numbers[LOW], -1.0, count - 1) &&
           is_index(numbers[HIGH], numbers[LOW] + 1, count) &&
           is_index(numbers[CURVE], NOT_BEGUN, (double)motion->count + 1) &&
           is_index(numbers[SAMPLE], 0.0, (double)data->intervals) &&
           is_index(numbers[SAMPLED], 0.0, (double)data->intervals + 1) &&
           is_index(numbers[PAIR], 0.0, (double)data->flat.voltages - 1) && motion->count < SLOTS &&
           isfinite(motion->starts[motion->count]);
}

void restore_search(const FlatnessFeedforwardData *data, const Motion *motion, PlanSearch search)
{
    const double *const numbers = search.numbers;
    if (!is_done(numbers) && numbers[CURVE] != NOT_BEGUN)
        use_candidate(data, motion, numbers, next_candidate(numbers));
    else if (is_done(numbers) && numbers[HIGH] < numbers[CANDIDATES])
        use_candidate(data, motion, numbers, numbers[HIGH]);
}
