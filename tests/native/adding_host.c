/* Two instances of BeamClosedLoop in step: the host of one multiplies its step, that of the other adds it up. Aborts
   where an output differs in a bit. Arguments: number of steps, value references of y_target[1] and y_pi[1]. */

#include <time.h>

#include "host.h"

enum { POINTS = 4 };

static double seconds(void)
{
    return (double)clock() / CLOCKS_PER_SEC;
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
    double spent[2] = {0.0, 0.0};
    for (unsigned long begin = 0; begin < steps; begin += 1000) {
        double seen[2][1000][POINTS];
        const double before = sum;
        for (int i = 0; i < 2; i++) {
            const double from = seconds();
            CHECK(fmi2SetReal(hosts[i], targets, POINTS, begin / 20000 % 2 == 1 ? reached : rest) == fmi2OK);
            sum = before;
            for (unsigned long k = 0; k < 1000; k++) {
                CHECK(fmi2DoStep(hosts[i], i == 0 ? (double)(begin + k) * step : sum, step, fmi2True) == fmi2OK);
                CHECK(fmi2GetReal(hosts[i], outputs, POINTS, seen[i][k]) == fmi2OK);
                sum += step;
            }
            spent[i] += seconds() - from;
        }
        CHECK(memcmp(seen[0], seen[1], sizeof seen[0]) == 0);
    }
    printf("equal; us a step: %.3f by k h, %.3f by t += h; clocks %g s apart\n", 1e6 * spent[0] / (double)steps,
           1e6 * spent[1] / (double)steps, sum - (double)steps * step);
    fmi2FreeInstance(hosts[0]);
    fmi2FreeInstance(hosts[1]);
    return 0;
}
