/* Instances of a unit, each with a thread of its own: nothing is shared but constants. For ThreadSanitizer. Aborts
   where their values differ. */

#include <pthread.h>

#include "host.h"

enum { THREADS = 4, STEPS = 300, MOST_REALS = 4096 };

static void log_nothing(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    (void)message;
}

typedef struct {
    fmi2Component instance;
    double sum;
} Task;

static fmi2ValueReference inputs[MOST_REALS];
static fmi2ValueReference reals[MOST_REALS];
static size_t input_count;
static size_t real_count;

/* A life with a reset, a saved state and refusals in between; its sum over all values at every step. */
static void *live(void *argument)
{
    Task *const task = argument;
    const fmi2Component instance = task->instance;
    double values[MOST_REALS];
    fmi2FMUstate state = NULL;
    for (int life = 0; life < 2; life++) {
        CHECK(fmi2Reset(instance) == fmi2OK);
        CHECK(fmi2SetupExperiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK);
        CHECK(fmi2EnterInitializationMode(instance) == fmi2OK && fmi2ExitInitializationMode(instance) == fmi2OK);
        for (int k = 0; k < STEPS; k++) {
            for (size_t i = 0; i < input_count; i++)
                values[i] = 1e-4 * (double)((k / 50 + (int)i) % 3 - 1);
            CHECK(fmi2SetReal(instance, inputs, input_count, values) == fmi2OK);
            CHECK(fmi2DoStep(instance, k * described->step_size, described->step_size, fmi2True) <= fmi2Warning);
            CHECK(fmi2GetReal(instance, reals, real_count, values) == fmi2OK);
            CHECK(fmi2GetReal(instance, NULL, 1, values) == fmi2Error);
            for (size_t i = 0; i < real_count; i++)
                task->sum += values[i];
            if (k == STEPS / 2)
                CHECK(fmi2GetFMUstate(instance, &state) == fmi2OK);
        }
    }
    CHECK(fmi2FreeFMUstate(instance, &state) == fmi2OK);
    return NULL;
}

int main(void)
{
    const fmi2CallbackFunctions silent = {.logger = log_nothing};
    Task tasks[THREADS] = {{0}};
    pthread_t threads[THREADS];
    for (int k = 0; k < THREADS; k++) {
        tasks[k].instance = fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, &silent, fmi2False, fmi2True);
        describe(tasks[k].instance);
    }
    input_count = reals_of(INPUT, inputs);
    real_count = reals_of(LOCAL + 1, reals);
    for (int k = 0; k < THREADS; k++)
        CHECK(pthread_create(&threads[k], NULL, live, &tasks[k]) == 0);
    for (int k = 0; k < THREADS; k++)
        CHECK(pthread_join(threads[k], NULL) == 0);
    for (int k = 0; k < THREADS; k++) {
        CHECK(memcmp(&tasks[k].sum, &tasks[0].sum, sizeof tasks[k].sum) == 0);
        fmi2FreeInstance(tasks[k].instance);
    }
    printf("equal\n");
    return 0;
}
