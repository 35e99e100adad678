/* The closed loop of three units linked into one program: through the FMI functions under their prefixes and, on the
   same instances, with the bare arithmetic behind them. Prints seconds and the result of both as JSON.

   closed_loop STEPS PLANT_GUID FEEDFORWARD_GUID CONTROLLER_GUID TARGET...: the target deflections, reached from rest,
   then left again half-way. */

#define _POSIX_C_SOURCE 200809L

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "instance.h"

#define DECLARE(unit_name)                                                                                             \
    fmi2InstantiateTYPE unit_name##_fmi2Instantiate;                                                                   \
    fmi2FreeInstanceTYPE unit_name##_fmi2FreeInstance;                                                                 \
    fmi2SetupExperimentTYPE unit_name##_fmi2SetupExperiment;                                                           \
    fmi2EnterInitializationModeTYPE unit_name##_fmi2EnterInitializationMode;                                           \
    fmi2ExitInitializationModeTYPE unit_name##_fmi2ExitInitializationMode;                                             \
    fmi2GetRealTYPE unit_name##_fmi2GetReal;                                                                           \
    fmi2SetRealTYPE unit_name##_fmi2SetReal;                                                                           \
    fmi2DoStepTYPE unit_name##_fmi2DoStep;

DECLARE(BeamPlant)
DECLARE(FlatnessFeedforward)
DECLARE(TrackingController)

enum { MOST = 512 };

/* An array variable: its references, which follow each other, and its last values. */
typedef struct {
    size_t count;
    fmi2ValueReference references[MOST];
    double values[MOST];
} Signal;

static Signal find(fmi2Component component, const char *name)
{
    const UnitDescription *const unit = ((const Instance *)component)->description;
    Signal found = {0};
    const size_t length = strlen(name);
    for (size_t k = 0; k < unit->variable_count && found.count < MOST; k++)
        if (strncmp(unit->variables[k].name, name, length) == 0 && unit->variables[k].name[length] == '[')
            found.references[found.count++] = (fmi2ValueReference)k;
    return found;
}

static void log_line(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                     fmi2String message, ...)
{
    (void)environment;
    (void)status;
    fprintf(stderr, "%s: %s: %s\n", name, category, message);
}

static const fmi2CallbackFunctions callbacks = {.logger = log_line};

static void check(fmi2Status status)
{
    if (status > fmi2Warning)
        exit(1);
}

#define CREATE(unit_name, guid) unit_name##_fmi2Instantiate(#unit_name, fmi2CoSimulation, guid, NULL, &callbacks, 0, 0)
#define INITIALISE(unit_name, instance)                                                                                \
    check(unit_name##_fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0));                                             \
    check(unit_name##_fmi2EnterInitializationMode(instance));                                                          \
    check(unit_name##_fmi2ExitInitializationMode(instance))
#define GET(unit_name, instance, from)                                                                                 \
    check(unit_name##_fmi2GetReal(instance, (from).references, (from).count, (from).values))
#define SET(unit_name, instance, to, data) check(unit_name##_fmi2SetReal(instance, (to).references, (to).count, data))

static bool advance(UnitInstance *unit, double time, double step)
{
    return unit->hooks->advance(unit, time, step);
}

/* Values of one instance into those of another. */
static void copy(UnitInstance *to, const Signal *input, const UnitInstance *from, const Signal *output)
{
    memcpy(to->values + input->references[0], from->values + output->references[0], output->count * sizeof(double));
}

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static int ascending(const void *one, const void *other)
{
    const int64_t a = *(const int64_t *)one;
    const int64_t b = *(const int64_t *)other;
    return (a > b) - (a < b);
}

int main(int argc, char **argv)
{
    if (argc < 5)
        return 2;
    const size_t steps = (size_t)strtoul(argv[1], NULL, 10);
    int64_t *const durations = calloc(steps, sizeof *durations);
    if (durations == NULL)
        return 1;
    double seconds[2];
    double results[2];

    for (int bare = 0; bare < 2; bare++) {
        const fmi2Component plant = CREATE(BeamPlant, argv[2]);
        const fmi2Component feedforward = CREATE(FlatnessFeedforward, argv[3]);
        const fmi2Component controller = CREATE(TrackingController, argv[4]);
        INITIALISE(BeamPlant, plant);
        INITIALISE(FlatnessFeedforward, feedforward);
        INITIALISE(TrackingController, controller);
        UnitInstance *const p = plant; /* each instance starts with its unit */
        UnitInstance *const f = feedforward;
        UnitInstance *const c = controller;
        Signal y_pm = find(plant, "y_pm");
        Signal y_pi = find(plant, "y_pi");
        Signal target = find(feedforward, "y_target");
        Signal u_ff = find(feedforward, "u_ff");
        Signal x_ref = find(feedforward, "x_ref");
        Signal u = find(controller, "u");
        const Signal u_plant = find(plant, "u");
        const Signal y_pm_in = find(controller, "y_pm");
        const Signal u_ff_in = find(controller, "u_ff");
        const Signal x_ref_in = find(controller, "x_ref");
        const double h = p->step_size;
        const int64_t begin = now();
        for (size_t k = 0; k < steps; k++) {
            const int64_t before = bare ? 0 : now();
            const double time = (double)k * h;
            if (k == 0 || k == steps / 2) {
                for (size_t i = 0; i < target.count; i++)
                    target.values[i] = k == 0 && (int)i + 5 < argc ? strtod(argv[i + 5], NULL) : 0.0;
                SET(FlatnessFeedforward, feedforward, target, target.values);
            }
            if (bare) {
                if (!advance(p, time, h) || !advance(f, time, h) || !advance(c, time, h))
                    return 1;
                copy(p, &u_plant, c, &u);
                copy(c, &y_pm_in, p, &y_pm);
                copy(c, &u_ff_in, f, &u_ff);
                copy(c, &x_ref_in, f, &x_ref);
                continue;
            }
            check(BeamPlant_fmi2DoStep(plant, time, h, 1));
            check(FlatnessFeedforward_fmi2DoStep(feedforward, time, h, 1));
            check(TrackingController_fmi2DoStep(controller, time, h, 1));
            GET(BeamPlant, plant, y_pm);
            GET(FlatnessFeedforward, feedforward, u_ff);
            GET(FlatnessFeedforward, feedforward, x_ref);
            GET(TrackingController, controller, u);
            SET(BeamPlant, plant, u_plant, u.values);
            SET(TrackingController, controller, y_pm_in, y_pm.values);
            SET(TrackingController, controller, u_ff_in, u_ff.values);
            SET(TrackingController, controller, x_ref_in, x_ref.values);
            durations[k] = now() - before;
        }
        seconds[bare] = 1e-9 * (double)(now() - begin);
        GET(BeamPlant, plant, y_pi);
        results[bare] = 0.0;
        for (size_t i = 0; i < y_pi.count; i++)
            results[bare] += y_pi.values[i] * (double)(i + 1);
        BeamPlant_fmi2FreeInstance(plant);
        FlatnessFeedforward_fmi2FreeInstance(feedforward);
        TrackingController_fmi2FreeInstance(controller);
    }
    qsort(durations, steps, sizeof *durations, ascending);
    printf("{\"steps\": %lu, \"fmi_s\": %.6f, \"bare_s\": %.6f, \"fmi_result\": %.17g, \"bare_result\": %.17g, "
           "\"median_us\": %.3f, \"p99_us\": %.3f, \"p9999_us\": %.3f, \"max_us\": %.3f}\n",
           (unsigned long)steps, seconds[0], seconds[1], results[0], results[1], 1e-3 * (double)durations[steps / 2],
           1e-3 * (double)durations[steps - 1 - steps / 100], 1e-3 * (double)durations[steps - 1 - steps / 10000],
           1e-3 * (double)durations[steps - 1]);
    free(durations);
    return 0;
}
