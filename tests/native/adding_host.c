/* Two instances of BeamClosedLoop in step: the host of one multiplies its step, that of the other adds it up. Aborts
   where an output differs in a bit; prints mean and 99.99 % of the processor time of a step. Arguments: number of
   steps, value references of y_target[1] and y_pi[1]. */

#define _POSIX_C_SOURCE 200809L
#include <time.h>

#include "host.h"

enum { POINTS = 4, BINS = 100000 };
#define BIN 10.0 /* ns */

/* Processor time of steps. */
typedef struct {
    double sum; /* ns */
    unsigned long bins[BINS];
} Times;

static double nanoseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

static void note(Times *times, double spent)
{
    const double bin = spent / BIN;
    times->sum += spent;
    times->bins[bin < BINS - 1 ? (size_t)bin : BINS - 1]++;
}

/* The time, us, that a share of the steps takes at most. */
static double quantile(const Times *times, double share, unsigned long steps)
{
    unsigned long count = 0;
    size_t bin = 0;
    while (bin < BINS - 1 && (double)(count += times->bins[bin]) < share * (double)steps)
        bin++;
    return 1e-3 * BIN * (double)(bin + 1);
}

int main(int argc, char **argv)
{
    static const double reached[POINTS] = {-1e-3, 1e-4, 5e-4, -7e-4}; /* m */
    static const double rest[POINTS];
    const double step = 2e-4; /* s */
    CHECK(argc == 4);
    const unsigned long steps = strtoul(argv[1], NULL, 10);
    fmi2ValueReference targets[POINTS];
    fmi2ValueReference outputs[POINTS];
    for (unsigned k = 0; k < POINTS; k++) {
        targets[k] = (fmi2ValueReference)strtoul(argv[2], NULL, 10) + k;
        outputs[k] = (fmi2ValueReference)strtoul(argv[3], NULL, 10) + k;
    }
    fmi2Component hosts[2];
    for (int i = 0; i < 2; i++) {
        hosts[i] = fmi2Instantiate("loop", fmi2CoSimulation, UNIT_GUID, NULL, &callbacks, fmi2False, fmi2False);
        CHECK(hosts[i] != NULL);
        CHECK(fmi2SetupExperiment(hosts[i], fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK);
        CHECK(fmi2EnterInitializationMode(hosts[i]) == fmi2OK && fmi2ExitInitializationMode(hosts[i]) == fmi2OK);
    }
    double sum = 0.0;
    static Times times[2];
    for (unsigned long begin = 0; begin < steps; begin += 1000) {
        double seen[2][1000][POINTS];
        const double before = sum;
        for (int i = 0; i < 2; i++) {
            CHECK(fmi2SetReal(hosts[i], targets, POINTS, begin / 20000 % 2 == 1 ? reached : rest) == fmi2OK);
            sum = before;
            for (unsigned long k = 0; k < 1000; k++) {
                const double time = i == 0 ? (double)(begin + k) * step : sum;
                const double from = nanoseconds();
                CHECK(fmi2DoStep(hosts[i], time, step, fmi2True) == fmi2OK);
                note(&times[i], nanoseconds() - from);
                CHECK(fmi2GetReal(hosts[i], outputs, POINTS, seen[i][k]) == fmi2OK);
                sum += step;
            }
        }
        CHECK(memcmp(seen[0], seen[1], sizeof seen[0]) == 0);
    }
    printf("equal; clocks %g s apart\n", sum - (double)steps * step);
    for (int i = 0; i < 2; i++)
        printf("us a step by %s: mean %.3f, 99.99 %% %.2f\n", i == 0 ? "k h" : "t += h",
               1e-3 * times[i].sum / (double)steps, quantile(&times[i], 0.9999, steps));
    fmi2FreeInstance(hosts[0]);
    fmi2FreeInstance(hosts[1]);
    return 0;
}
