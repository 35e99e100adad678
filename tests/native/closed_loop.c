/* The closed loop of three units linked into one program, each with its function prefix: through the FMI functions and,
   on the same instances, with the bare arithmetic behind them. Prints seconds and the result of both as JSON.

   closed_loop STEPS TARGET...: the target deflections, reached from rest, then left again half-way. */

#define _POSIX_C_SOURCE 200809L

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define FMI2_FUNCTION_PREFIX BeamPlant_
#include "unit.h"

#define DECLARE(unit_name)                                                       \
    extern const size_t unit_name##_unit_variable_count;                         \
    extern const variable unit_name##_unit_variables[];                          \
    extern const char unit_name##_unit_guid[];                                   \
    extern const double unit_name##_unit_step_size;                              \
    bool unit_name##_unit_advance(unit *unit, double time, double step);         \
    fmi2InstantiateTYPE unit_name##_fmi2Instantiate;                             \
    fmi2FreeInstanceTYPE unit_name##_fmi2FreeInstance;                           \
    fmi2SetupExperimentTYPE unit_name##_fmi2SetupExperiment;                     \
    fmi2EnterInitializationModeTYPE unit_name##_fmi2EnterInitializationMode;     \
    fmi2ExitInitializationModeTYPE unit_name##_fmi2ExitInitializationMode;       \
    fmi2GetRealTYPE unit_name##_fmi2GetReal;                                     \
    fmi2SetRealTYPE unit_name##_fmi2SetReal;                                     \
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
} signal;

static signal find(const variable *variables, size_t count, const char *name)
{
    signal found = {0};
    const size_t length = strlen(name);
    for (size_t k = 0; k < count && found.count < MOST; k++)
        if (strncmp(variables[k].name, name, length) == 0 && variables[k].name[length] == '[')
            found.references[found.count++] = (fmi2ValueReference)k;
    return found;
}

#define SIGNAL(unit_name, name) find(unit_name##_unit_variables, unit_name##_unit_variable_count, name)

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
    if (status != fmi2OK)
        exit(1);
}

#define CREATE(unit_name) \
    unit_name##_fmi2Instantiate(#unit_name, fmi2CoSimulation, unit_name##_unit_guid, NULL, &callbacks, 0, 0)
#define INITIALISE(unit_name, instance)                                          \
    check(unit_name##_fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0));        \
    check(unit_name##_fmi2EnterInitializationMode(instance));                    \
    check(unit_name##_fmi2ExitInitializationMode(instance))
#define GET(unit_name, instance, from) \
    check(unit_name##_fmi2GetReal(instance, (from).references, (from).count, (from).values))
#define SET(unit_name, instance, to, data) \
    check(unit_name##_fmi2SetReal(instance, (to).references, (to).count, data))

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static int ascending(const void *one, const void *other)
{
    const int64_t a = *(const int64_t *)one, b = *(const int64_t *)other;
    return (a > b) - (a < b);
}

int main(int argc, char **argv)
{
    const size_t steps = argc > 1 ? (size_t)strtoul(argv[1], NULL, 10) : 25000;
    signal y_pm = SIGNAL(BeamPlant, "y_pm"), y_pi = SIGNAL(BeamPlant, "y_pi"), u_plant = SIGNAL(BeamPlant, "u");
    signal target = SIGNAL(FlatnessFeedforward, "y_target"), u_ff = SIGNAL(FlatnessFeedforward, "u_ff");
    signal x_ref = SIGNAL(FlatnessFeedforward, "x_ref"), u = SIGNAL(TrackingController, "u");
    signal y_pm_in = SIGNAL(TrackingController, "y_pm"), u_ff_in = SIGNAL(TrackingController, "u_ff");
    signal x_ref_in = SIGNAL(TrackingController, "x_ref");
    int64_t *const durations = calloc(steps, sizeof *durations);
    if (durations == NULL)
        return 1;
    const double h = BeamPlant_unit_step_size;
    double seconds[2], results[2];

    for (int bare = 0; bare < 2; bare++) {
        const fmi2Component plant = CREATE(BeamPlant), feedforward = CREATE(FlatnessFeedforward);
        const fmi2Component controller = CREATE(TrackingController);
        INITIALISE(BeamPlant, plant);
        INITIALISE(FlatnessFeedforward, feedforward);
        INITIALISE(TrackingController, controller);
        unit *const p = plant, *const f = feedforward, *const c = controller;  /* each instance starts with its unit */
        const int64_t begin = now();
        for (size_t k = 0; k < steps; k++) {
            const int64_t before = bare ? 0 : now();
            const double time = (double)k * h;
            if (k == 0 || k == steps / 2) {
                for (size_t i = 0; i < target.count; i++)
                    target.values[i] = k == 0 && (int)i + 2 < argc ? strtod(argv[i + 2], NULL) : 0.0;
                SET(FlatnessFeedforward, feedforward, target, target.values);
            }
            if (bare) {
                if (!BeamPlant_unit_advance(p, time, h) || !FlatnessFeedforward_unit_advance(f, time, h) ||
                    !TrackingController_unit_advance(c, time, h))
                    return 1;
                memcpy(p->values + u_plant.references[0], c->values + u.references[0], u.count * sizeof h);
                memcpy(c->values + y_pm_in.references[0], p->values + y_pm.references[0], y_pm.count * sizeof h);
                memcpy(c->values + u_ff_in.references[0], f->values + u_ff.references[0], u_ff.count * sizeof h);
                memcpy(c->values + x_ref_in.references[0], f->values + x_ref.references[0], x_ref.count * sizeof h);
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
