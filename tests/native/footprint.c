/* What a unit takes of memory: prints the bytes that it allocates and the deepest stack of its calls.

   The stack below main is painted before a call and searched for what the call wrote. */

#include <stdint.h>

#include "host.h"

enum { PAINTED = 65536 };
#define PAINT 0xa5

static size_t allocated;

static void *count_bytes(size_t count, size_t size)
{
    allocated += count * size;
    return allocate(count, size);
}

static uintptr_t top; /* an address within the frame of main */
static size_t deepest;

/* Bytes from `top` down to the deepest that was written since the stack was painted; paints it again, from below this
   function's own frame. */
static void __attribute__((noinline)) note_stack(void)
{
    const volatile unsigned char own = PAINT;
    volatile unsigned char *const end = (volatile unsigned char *)((uintptr_t)&own - 128);
    volatile unsigned char *lowest = (volatile unsigned char *)(top - PAINTED);
    while (lowest < end && *lowest == PAINT)
        lowest++;
    const size_t used = top - (uintptr_t)lowest;
    if (used > deepest)
        deepest = used;
    for (; lowest < end; lowest++)
        *lowest = PAINT;
}

#define NOTED(call)                                                                                                    \
    do {                                                                                                               \
        CHECK((call) == fmi2OK);                                                                                       \
        note_stack();                                                                                                  \
    } while (false)

int main(void)
{
    static fmi2ValueReference inputs[512];
    static fmi2ValueReference reals[4096];
    static double values[4096];
    fmi2CallbackFunctions counting = callbacks;
    counting.allocateMemory = count_bytes;
    const fmi2Component instance = fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, &counting, 0, 0);
    describe(instance);
    const size_t input_count = reals_of(INPUT, inputs);
    const size_t real_count = reals_of(LOCAL + 1, reals);
    top = (uintptr_t)&counting;
    note_stack(); /* paints it */
    deepest = 0;
    NOTED(fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0));
    NOTED(fmi2EnterInitializationMode(instance));
    NOTED(fmi2ExitInitializationMode(instance));
    for (size_t k = 0; k < 200; k++) {
        for (size_t i = 0; i < input_count; i++)
            values[i] = 1e-4 * (double)((k / 50 + i) % 3);
        NOTED(fmi2SetReal(instance, inputs, input_count, values));
        NOTED(fmi2DoStep(instance, (double)k * described->step_size, described->step_size, 0));
        NOTED(fmi2GetReal(instance, reals, real_count, values));
    }
    const size_t usual = deepest;
    deepest = 0;
    const double infinite = 1e300 * 1e10;
    CHECK(fmi2SetReal(instance, inputs, 1, &infinite) == fmi2Error); /* a line with numbers for the log */
    note_stack();
    fmi2FreeInstance(instance);
    printf("{\"heap\": %lu, \"stack\": %lu, \"stack_of_log\": %lu}\n", (unsigned long)allocated, (unsigned long)usual,
           (unsigned long)deepest);
    return 0;
}
