/* A host that steps a FlatnessFeedforward through targets from the standard input, for whoever counts what a step does.

   Arguments: value reference of y_target[1], number of points, value reference and value of transition_time, steps from
   a target to the next, step in s. */

#include "host.h"

enum { MOST_POINTS = 64 };

int main(int argc, char **argv)
{
    CHECK(argc == 7);
    const fmi2ValueReference first = (fmi2ValueReference)strtoul(argv[1], NULL, 10);
    const size_t points = strtoul(argv[2], NULL, 10);
    const fmi2ValueReference time_reference = (fmi2ValueReference)strtoul(argv[3], NULL, 10);
    const double transition_time = strtod(argv[4], NULL);
    const unsigned long every = strtoul(argv[5], NULL, 10);
    const double step = strtod(argv[6], NULL);
    CHECK(points <= MOST_POINTS);
    fmi2Component unit = fmi2Instantiate("unit", fmi2CoSimulation, UNIT_GUID, NULL, &callbacks, fmi2False, fmi2False);
    CHECK(unit != NULL && fmi2SetupExperiment(unit, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK);
    CHECK(fmi2EnterInitializationMode(unit) == fmi2OK);
    CHECK(fmi2SetReal(unit, &time_reference, 1, &transition_time) == fmi2OK);
    CHECK(fmi2ExitInitializationMode(unit) == fmi2OK);
    fmi2ValueReference references[MOST_POINTS];
    double target[MOST_POINTS];
    for (size_t k = 0; k < points; k++)
        references[k] = first + (fmi2ValueReference)k;
    for (unsigned long count = 0; fread(target, sizeof *target, points, stdin) == points;) {
        CHECK(fmi2SetReal(unit, references, points, target) == fmi2OK);
        for (unsigned long k = 0; k < every; k++, count++)
            CHECK(fmi2DoStep(unit, (double)count * step, step, fmi2True) <= fmi2Warning);
    }
    fmi2FreeInstance(unit);
    return 0;
}
