/* No memory is allocated or freed between fmi2Instantiate and fmi2FreeInstance: the C library's allocator is replaced
   by one that counts (glibc). */

#include "host.h"

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *block, size_t size);
extern void __libc_free(void *block);

static unsigned long call_count;

void *malloc(size_t size)
{
    call_count++;
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    call_count++;
    return __libc_calloc(count, size);
}

void *realloc(void *block, size_t size)
{
    call_count++;
    return __libc_realloc(block, size);
}

void free(void *block)
{
    call_count++;
    __libc_free(block);
}

int main(void)
{
    const fmi2CallbackFunctions silent = {.logger = log_line};
    static fmi2ValueReference inputs[512];
    static fmi2ValueReference reals[4096];
    static double values[4096];
    const double endless = 1e300;
    const fmi2Component instance = fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, &silent, 0, 1);
    describe(instance);
    const size_t input_count = reals_of(INPUT, inputs);
    const size_t real_count = reals_of(LOCAL + 1, reals);
    CHECK(call_count > 0);
    const unsigned long before = call_count;
    for (int turn = 0; turn < 2; turn++) {
        CHECK(fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
        CHECK(fmi2EnterInitializationMode(instance) == fmi2OK);
        CHECK(fmi2ExitInitializationMode(instance) == fmi2OK);
        double time = 0.0;
        for (size_t k = 0; k < 400; k++) {
            const double step = described->step_size * (double)(1 + k % 7);
            for (size_t i = 0; i < input_count; i++)
                values[i] = 1e-4 * (double)((k / 50 + i) % 3);
            CHECK(fmi2SetReal(instance, inputs, input_count, values) == fmi2OK);
            CHECK(fmi2DoStep(instance, time, step, 0) == fmi2OK);
            CHECK(fmi2GetReal(instance, reals, real_count, values) == fmi2OK);
            time += step;
        }
        CHECK(fmi2SetReal(instance, inputs, 1, &endless) <= fmi2Error);
        CHECK(fmi2DoStep(instance, time, -1.0, 0) == fmi2Error);
        CHECK(fmi2Reset(instance) == fmi2OK);
    }
    const unsigned long after = call_count;
    fmi2FreeInstance(instance);
    CHECK(call_count == after + 1);
    CHECK(after == before);
    return 0;
}
