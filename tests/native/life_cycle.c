/* The whole life of a unit, misuse included; aborts where something is not as it should be. Runs under sanitizers and
   valgrind. */

#include <float.h>
#include <math.h>

#include "host.h"

#define STEPS 60

static fmi2Component instance;
static fmi2ValueReference reals[4096];
static fmi2ValueReference inputs[512];
static size_t real_count;
static size_t input_count;

/* The call is refused with one line and this status. */
#define REFUSED(status, call)                                                                                          \
    do {                                                                                                               \
        const unsigned before = line_count;                                                                            \
        CHECK((call) == (status));                                                                                     \
        CHECK(line_count == before + 1);                                                                               \
    } while (false)

/* The call works without a line. */
#define WORKS(call)                                                                                                    \
    do {                                                                                                               \
        const unsigned before = line_count;                                                                            \
        CHECK((call) == fmi2OK);                                                                                       \
        CHECK(line_count == before);                                                                                   \
    } while (false)

static void *no_memory(size_t count, size_t size)
{
    (void)count;
    (void)size;
    return NULL;
}

/* From a host that does not zero it. */
static void *used_memory(size_t count, size_t size)
{
    void *const block = allocate(count, size);
    if (block != NULL)
        memset(block, 0xa5, count * size);
    return block;
}

static void refuse_instances(void)
{
    const fmi2CallbackFunctions silent = {.allocateMemory = allocate, .freeMemory = release};
    fmi2CallbackFunctions poor = callbacks;
    poor.allocateMemory = no_memory;
    CHECK(fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, NULL, 0, 0) == NULL);
    CHECK(fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, &silent, 0, 0) == NULL);
    CHECK(line_count == 0);
    CHECK(fmi2Instantiate(NULL, fmi2CoSimulation, UNIT_GUID, NULL, &callbacks, 0, 0) == NULL);
    CHECK(fmi2Instantiate("", fmi2CoSimulation, UNIT_GUID, NULL, &callbacks, 0, 0) == NULL);
    CHECK(fmi2Instantiate("a", fmi2ModelExchange, UNIT_GUID, NULL, &callbacks, 0, 0) == NULL);
    CHECK(fmi2Instantiate("a", fmi2CoSimulation, "{other}", NULL, &callbacks, 0, 0) == NULL);
    CHECK(fmi2Instantiate("a", fmi2CoSimulation, NULL, NULL, &callbacks, 0, 0) == NULL);
    CHECK(line_count == 5);
    CHECK(fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, &poor, 0, 0) == NULL);
    CHECK(line_count == 6 && block_count == 0);
}

static void refuse_null_components(void)
{
    fmi2FMUstate state = NULL;
    size_t size;
    fmi2Real real;
    fmi2Integer whole;
    fmi2Status status;
    fmi2String text;
    const unsigned before = line_count;
    CHECK(fmi2SetDebugLogging(NULL, 1, 0, NULL) == fmi2Error);
    CHECK(fmi2SetupExperiment(NULL, 0, 0, 0, 0, 0) == fmi2Error);
    CHECK(fmi2EnterInitializationMode(NULL) == fmi2Error && fmi2ExitInitializationMode(NULL) == fmi2Error);
    CHECK(fmi2Terminate(NULL) == fmi2Error && fmi2Reset(NULL) == fmi2Error);
    CHECK(fmi2GetReal(NULL, NULL, 0, NULL) == fmi2Error && fmi2SetReal(NULL, NULL, 0, NULL) == fmi2Error);
    CHECK(fmi2GetInteger(NULL, NULL, 0, NULL) == fmi2Error && fmi2SetInteger(NULL, NULL, 0, NULL) == fmi2Error);
    CHECK(fmi2GetBoolean(NULL, NULL, 0, NULL) == fmi2Error && fmi2SetBoolean(NULL, NULL, 0, NULL) == fmi2Error);
    CHECK(fmi2GetString(NULL, NULL, 0, NULL) == fmi2Error && fmi2SetString(NULL, NULL, 0, NULL) == fmi2Error);
    CHECK(fmi2GetFMUstate(NULL, &state) == fmi2Error && fmi2SetFMUstate(NULL, state) == fmi2Error);
    CHECK(fmi2FreeFMUstate(NULL, &state) == fmi2Error);
    CHECK(fmi2SerializedFMUstateSize(NULL, state, &size) == fmi2Error);
    CHECK(fmi2SerializeFMUstate(NULL, state, NULL, 0) == fmi2Error);
    CHECK(fmi2DeSerializeFMUstate(NULL, NULL, 0, &state) == fmi2Error);
    CHECK(fmi2GetDirectionalDerivative(NULL, NULL, 0, NULL, 0, NULL, NULL) == fmi2Error);
    CHECK(fmi2SetRealInputDerivatives(NULL, NULL, 0, NULL, NULL) == fmi2Error);
    CHECK(fmi2GetRealOutputDerivatives(NULL, NULL, 0, NULL, NULL) == fmi2Error);
    CHECK(fmi2DoStep(NULL, 0, 1, 0) == fmi2Error && fmi2CancelStep(NULL) == fmi2Error);
    CHECK(fmi2GetStatus(NULL, fmi2DoStepStatus, &status) == fmi2Error);
    CHECK(fmi2GetRealStatus(NULL, fmi2LastSuccessfulTime, &real) == fmi2Error);
    CHECK(fmi2GetIntegerStatus(NULL, fmi2DoStepStatus, &whole) == fmi2Error);
    CHECK(fmi2GetBooleanStatus(NULL, fmi2Terminated, &whole) == fmi2Error);
    CHECK(fmi2GetStringStatus(NULL, fmi2PendingStatus, &text) == fmi2Error);
    CHECK(fmi2EnterEventMode(NULL) == fmi2Error && fmi2NewDiscreteStates(NULL, NULL) == fmi2Error);
    CHECK(fmi2EnterContinuousTimeMode(NULL) == fmi2Error && fmi2SetTime(NULL, 0) == fmi2Error);
    CHECK(fmi2CompletedIntegratorStep(NULL, 0, NULL, NULL) == fmi2Error);
    CHECK(fmi2SetContinuousStates(NULL, NULL, 0) == fmi2Error && fmi2GetDerivatives(NULL, NULL, 0) == fmi2Error);
    CHECK(fmi2GetEventIndicators(NULL, NULL, 0) == fmi2Error && fmi2GetContinuousStates(NULL, NULL, 0) == fmi2Error);
    CHECK(fmi2GetNominalsOfContinuousStates(NULL, NULL, 0) == fmi2Error);
    fmi2FreeInstance(NULL);
    CHECK(line_count == before && state == NULL);
}

static void start(double time)
{
    WORKS(fmi2SetupExperiment(instance, fmi2False, 0.0, time, fmi2True, time + 10.0));
    WORKS(fmi2EnterInitializationMode(instance));
    WORKS(fmi2ExitInitializationMode(instance));
}

/* Steps from `first` on with inputs that depend on the step; returns a sum over all values along the way. */
static double run(double time, size_t first, size_t last)
{
    double values[4096];
    double sum = 0.0;
    for (size_t k = first; k < last; k++) {
        double level[512];
        for (size_t i = 0; i < input_count; i++)
            level[i] = 1e-4 * sin(0.3 * (double)(k / 20 + 1) * (double)(i + 1));
        WORKS(fmi2SetReal(instance, inputs, input_count, level));
        WORKS(fmi2DoStep(instance, time + (double)k * described->step_size, described->step_size, fmi2True));
        WORKS(fmi2GetReal(instance, reals, real_count, values));
        for (size_t i = 0; i < real_count; i++) {
            CHECK(isfinite(values[i]));
            sum += values[i] * (double)(i + k);
        }
    }
    return sum;
}

static void no_step_follows(void)
{
    REFUSED(fmi2Error, fmi2DoStep(instance, 0.0, described->step_size, fmi2True));
    CHECK(strstr(last_line, "refused until fmi2Reset") != NULL);
    WORKS(fmi2Reset(instance));
}

/* Each call breaks one rule. The unit logs it once; it goes on after a call that gets or sets variables, else it steps
   no more until fmi2Reset. */
static void misuse(void)
{
    const fmi2ValueReference beyond = (fmi2ValueReference)described->variable_count;
    const fmi2ValueReference time = 0;
    const fmi2ValueReference input = inputs[0];
    const double nan_value = NAN;
    const double infinite = INFINITY;
    const double one = 1.0;
    const fmi2Integer order = 1;
    double real;
    int whole;
    fmi2String text = "a%sb";

#define MISUSE(call)                                                                                                   \
    start(0.0);                                                                                                        \
    REFUSED(fmi2Error, call);                                                                                          \
    no_step_follows()
#define HARMLESS(call)                                                                                                 \
    start(0.0);                                                                                                        \
    REFUSED(fmi2Error, call);                                                                                          \
    WORKS(fmi2DoStep(instance, 0.0, described->step_size, fmi2True));                                                  \
    WORKS(fmi2Reset(instance))
    HARMLESS(fmi2GetReal(instance, NULL, 1, &real));
    HARMLESS(fmi2GetReal(instance, &time, 1, NULL));
    HARMLESS(fmi2GetReal(instance, &beyond, 1, &real));
    HARMLESS(fmi2GetReal(instance, &time, (size_t)-1, &real));
    HARMLESS(fmi2GetInteger(instance, &time, 1, &whole));
    HARMLESS(fmi2GetBoolean(instance, &time, 1, &whole));
    HARMLESS(fmi2GetString(instance, &time, 1, &text));
    HARMLESS(fmi2SetReal(instance, NULL, 1, &one));
    HARMLESS(fmi2SetReal(instance, &input, 1, NULL));
    HARMLESS(fmi2SetReal(instance, &time, 1, &one));
    HARMLESS(fmi2SetReal(instance, &beyond, 1, &one));
    HARMLESS(fmi2SetReal(instance, &input, 1, &nan_value));
    HARMLESS(fmi2SetReal(instance, &input, 1, &infinite));
    HARMLESS(fmi2SetInteger(instance, &input, 1, &order));
    HARMLESS(fmi2SetBoolean(instance, &input, 1, &order));
    HARMLESS(fmi2SetString(instance, &input, 1, &text));
    MISUSE(fmi2DoStep(instance, 0.0, 0.0, fmi2True));
    MISUSE(fmi2DoStep(instance, 0.0, -1.0, fmi2True));
    MISUSE(fmi2DoStep(instance, 0.0, nan_value, fmi2True));
    MISUSE(fmi2DoStep(instance, 0.0, DBL_MAX, fmi2True));
    MISUSE(fmi2DoStep(instance, nan_value, described->step_size, fmi2True));
    MISUSE(fmi2DoStep(instance, 1.0, described->step_size, fmi2True));
    MISUSE(fmi2SetupExperiment(instance, 0, 0, 0, 0, 0));
    MISUSE(fmi2EnterInitializationMode(instance));
    MISUSE(fmi2ExitInitializationMode(instance));
    MISUSE(fmi2GetFMUstate(instance, NULL));
    MISUSE(fmi2SetFMUstate(instance, NULL));
    MISUSE(fmi2SerializedFMUstateSize(instance, NULL, NULL));
    MISUSE(fmi2SerializeFMUstate(instance, NULL, NULL, 0));
    MISUSE(fmi2DeSerializeFMUstate(instance, NULL, 0, NULL));
    if (described->interpolates_inputs) {
        const fmi2Integer second = 2;
        HARMLESS(fmi2SetRealInputDerivatives(instance, &input, 1, &second, &one));
        HARMLESS(fmi2SetRealInputDerivatives(instance, &input, 1, NULL, &one));
        HARMLESS(fmi2SetRealInputDerivatives(instance, &input, 1, &order, &nan_value));
        HARMLESS(fmi2SetRealInputDerivatives(instance, &time, 1, &order, &one));
    }
    for (size_t k = 0; k < described->variable_count; k++)
        if (type_of(k) == STRING) {
            const fmi2ValueReference reference = (fmi2ValueReference)k;
            HARMLESS(fmi2SetString(instance, &reference, 1, &text));
            WORKS(fmi2GetString(instance, &reference, 1, &text));
            CHECK(strlen(text) > 8);
            text = NULL;
            HARMLESS(fmi2SetString(instance, &reference, 1, &text));
            text = "x";
        }
    REFUSED(fmi2Error, fmi2Terminate(instance));
    WORKS(fmi2Reset(instance));
    REFUSED(fmi2Error, fmi2SetupExperiment(instance, 0, 0, nan_value, 0, 0));
    WORKS(fmi2Reset(instance));
    REFUSED(fmi2Error, fmi2SetupExperiment(instance, 0, 0, 1.0, fmi2True, 1.0));
    WORKS(fmi2Reset(instance));
    start(0.0);
    WORKS(fmi2Terminate(instance));
    REFUSED(fmi2Error, fmi2SetReal(instance, &input, 1, &one));
    REFUSED(fmi2Error, fmi2DoStep(instance, 0.0, described->step_size, fmi2True));
    no_step_follows();
}

/* Calls a unit without these abilities declines, and steps on. */
static void declined(void)
{
    fmi2Status status;
    fmi2Real real;
    fmi2Integer whole;
    fmi2String text;
    const fmi2String unknown[] = {"logNothing"};
    const fmi2String null[] = {NULL};
    start(0.0);
    REFUSED(fmi2Error, fmi2CancelStep(instance));
    REFUSED(fmi2Discard, fmi2GetStatus(instance, fmi2DoStepStatus, &status));
    REFUSED(fmi2Discard, fmi2GetRealStatus(instance, fmi2PendingStatus, &real));
    REFUSED(fmi2Discard, fmi2GetIntegerStatus(instance, fmi2DoStepStatus, &whole));
    REFUSED(fmi2Discard, fmi2GetBooleanStatus(instance, fmi2PendingStatus, &whole));
    REFUSED(fmi2Discard, fmi2GetStringStatus(instance, fmi2PendingStatus, &text));
    REFUSED(fmi2Error, fmi2GetStringStatus(instance, fmi2PendingStatus, NULL));
    WORKS(fmi2GetRealStatus(instance, fmi2LastSuccessfulTime, &real));
    WORKS(fmi2GetBooleanStatus(instance, fmi2Terminated, &whole));
    CHECK(real == 0.0 && whole == fmi2False);
    REFUSED(fmi2Error, fmi2GetRealOutputDerivatives(instance, NULL, 0, NULL, NULL));
    if (!described->interpolates_inputs)
        REFUSED(fmi2Error, fmi2SetRealInputDerivatives(instance, NULL, 0, NULL, NULL));
    REFUSED(fmi2Error, fmi2EnterEventMode(instance));
    REFUSED(fmi2Error, fmi2NewDiscreteStates(instance, NULL));
    REFUSED(fmi2Error, fmi2EnterContinuousTimeMode(instance));
    REFUSED(fmi2Error, fmi2CompletedIntegratorStep(instance, 0, NULL, NULL));
    REFUSED(fmi2Error, fmi2SetTime(instance, 0.0));
    REFUSED(fmi2Error, fmi2SetContinuousStates(instance, NULL, 0));
    REFUSED(fmi2Error, fmi2GetDerivatives(instance, NULL, 0));
    REFUSED(fmi2Error, fmi2GetEventIndicators(instance, NULL, 0));
    REFUSED(fmi2Error, fmi2GetContinuousStates(instance, NULL, 0));
    REFUSED(fmi2Error, fmi2GetNominalsOfContinuousStates(instance, NULL, 0));
    REFUSED(fmi2Error, fmi2SetDebugLogging(instance, fmi2True, 1, unknown));
    REFUSED(fmi2Error, fmi2SetDebugLogging(instance, fmi2True, 1, null));
    REFUSED(fmi2Error, fmi2SetDebugLogging(instance, fmi2True, 1, NULL));
    run(0.0, 0, 2);
    WORKS(fmi2Reset(instance));
}

/* Directional derivatives: refused before initialization mode, defined in it, zero behind it. */
static void derivatives(void)
{
    static fmi2ValueReference outputs[512];
    static fmi2Real changes[512];
    static fmi2Real results[512];
    const size_t count = reals_of(OUTPUT, outputs);
    for (size_t k = 0; k < input_count; k++)
        changes[k] = 1e-3;
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, outputs, count, inputs, input_count, changes, results));
    if (!described->provides_derivatives)
        return;
    WORKS(fmi2SetupExperiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0));
    WORKS(fmi2EnterInitializationMode(instance));
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, NULL, 1, inputs, input_count, changes, results));
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, outputs, count, NULL, 1, changes, results));
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, outputs, count, inputs, input_count, NULL, results));
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, outputs, count, inputs, input_count, changes, NULL));
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, inputs, 1, inputs, input_count, changes, results));
    REFUSED(fmi2Error, fmi2GetDirectionalDerivative(instance, outputs, count, outputs, 1, changes, results));
    WORKS(fmi2GetDirectionalDerivative(instance, NULL, 0, NULL, 0, NULL, NULL));
    WORKS(fmi2GetDirectionalDerivative(instance, outputs, count, inputs, input_count, changes, results));
    for (size_t k = 0; k < count; k++)
        CHECK(isfinite(results[k]));
    WORKS(fmi2ExitInitializationMode(instance));
    WORKS(fmi2GetDirectionalDerivative(instance, outputs, count, inputs, input_count, changes, results));
    for (size_t k = 0; k < count; k++)
        CHECK(results[k] == 0.0);
    run(0.0, 0, 2);
    WORKS(fmi2Reset(instance));
}

static void log_what_is_wanted(void)
{
    const fmi2String errors[] = {"logStatusError"};
    const fmi2String discards[] = {"logStatusDiscard"};
    const unsigned lines = line_count;
    fmi2Status status;
    WORKS(fmi2SetDebugLogging(instance, fmi2True, 1, discards));
    CHECK(fmi2CancelStep(instance) == fmi2Error && line_count == lines);
    REFUSED(fmi2Discard, fmi2GetStatus(instance, fmi2DoStepStatus, &status));
    WORKS(fmi2SetDebugLogging(instance, fmi2True, 1, errors));
    CHECK(fmi2GetStatus(instance, fmi2DoStepStatus, &status) == fmi2Discard && line_count == lines + 1);
    REFUSED(fmi2Error, fmi2CancelStep(instance));
    WORKS(fmi2SetDebugLogging(instance, fmi2False, 0, NULL));
    CHECK(fmi2CancelStep(instance) == fmi2Error && line_count == lines + 2);
    WORKS(fmi2SetDebugLogging(instance, fmi2True, 0, NULL));
}

/* Continues equally from a state in memory, from its bytes, and in another instance; damaged bytes are refused. */
static void save_and_restore(void)
{
    fmi2FMUstate state = NULL;
    fmi2FMUstate copy = NULL;
    size_t size = 0;
    start(0.5);
    run(0.5, 0, STEPS / 2);
    WORKS(fmi2GetFMUstate(instance, &state));
    const double expected = run(0.5, STEPS / 2, STEPS);
    WORKS(fmi2SerializedFMUstateSize(instance, state, &size));
    char *const bytes = malloc(size);
    char *const again = malloc(size);
    CHECK(bytes != NULL && again != NULL);
    WORKS(fmi2SerializeFMUstate(instance, state, bytes, size));
    WORKS(fmi2SetFMUstate(instance, state));
    CHECK(run(0.5, STEPS / 2, STEPS) == expected);
    WORKS(fmi2GetFMUstate(instance, &state)); /* into the same memory */
    WORKS(fmi2Terminate(instance));

    const fmi2Component first = instance;
    instance = fmi2Instantiate("second", fmi2CoSimulation, UNIT_GUID, NULL, &callbacks, fmi2False, fmi2True);
    CHECK(instance != NULL);
    WORKS(fmi2DeSerializeFMUstate(instance, bytes, size, &copy));
    WORKS(fmi2SetFMUstate(instance, copy));
    CHECK(run(0.5, STEPS / 2, STEPS) == expected);
    WORKS(fmi2SerializeFMUstate(instance, copy, again, size));
    CHECK(memcmp(bytes, again, size) == 0);
    for (size_t k = 0; k < size; k += 1 + size / 200) {
        bytes[k] = (char)(bytes[k] ^ 4);
        REFUSED(fmi2Error, fmi2DeSerializeFMUstate(instance, bytes, size, &copy));
        bytes[k] = again[k];
        REFUSED(fmi2Error, fmi2DeSerializeFMUstate(instance, bytes, k, &copy));
    }
    REFUSED(fmi2Error, fmi2SerializeFMUstate(instance, copy, again, size - 1));
    char junk[64] = {0};
    REFUSED(fmi2Error, fmi2SetFMUstate(instance, junk));
    REFUSED(fmi2Error, fmi2DoStep(instance, 0.0, described->step_size, fmi2True));
    WORKS(fmi2SetFMUstate(instance, copy)); /* the state was saved before all that failed */
    CHECK(run(0.5, STEPS / 2, STEPS) == expected);
    WORKS(fmi2FreeFMUstate(instance, &copy));
    CHECK(copy == NULL);
    WORKS(fmi2FreeFMUstate(instance, &copy));
    WORKS(fmi2FreeFMUstate(instance, NULL));
    fmi2FreeInstance(instance);
    instance = first;
    WORKS(fmi2FreeFMUstate(instance, &state));
    free(bytes);
    free(again);
    WORKS(fmi2Reset(instance));
}

int main(void)
{
    refuse_instances();
    refuse_null_components();
    CHECK(strcmp(fmi2GetVersion(), "2.0") == 0 && strcmp(fmi2GetTypesPlatform(), "default") == 0);
    instance = fmi2Instantiate("one", fmi2CoSimulation, UNIT_GUID, "file:///", &callbacks, fmi2False, fmi2True);
    describe(instance);
    CHECK(block_count == 1);
    real_count = reals_of(LOCAL + 1, reals);
    input_count = reals_of(INPUT, inputs);
    start(0.0);
    const double expected = run(0.0, 0, STEPS);
    WORKS(fmi2Terminate(instance));
    WORKS(fmi2Reset(instance));
    misuse();
    declined();
    derivatives();
    log_what_is_wanted();
    CHECK(block_count == 1);
    save_and_restore();
    start(0.0);
    CHECK(run(0.0, 0, STEPS) == expected);
    CHECK(block_count == 1);
    fmi2FreeInstance(instance);
    CHECK(block_count == 0);

    fmi2CallbackFunctions careless = callbacks;
    careless.allocateMemory = used_memory;
    instance = fmi2Instantiate("three", fmi2CoSimulation, UNIT_GUID, NULL, &careless, fmi2False, fmi2False);
    start(0.0);
    CHECK(run(0.0, 0, STEPS) == expected);
    fmi2FreeInstance(instance);

    const fmi2CallbackFunctions own_memory = {.logger = log_line};
    instance = fmi2Instantiate("two", fmi2CoSimulation, UNIT_GUID, NULL, &own_memory, fmi2False, fmi2False);
    CHECK(instance != NULL && block_count == 0);
    start(0.0);
    CHECK(run(0.0, 0, STEPS) == expected);
    fmi2FreeInstance(instance);
    printf("%u lines logged\n", line_count);
    return 0;
}
