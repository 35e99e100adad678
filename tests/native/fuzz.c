/* libFuzzer: the bytes are a sequence of FMI calls and their arguments, on up to three instances of a unit.

   Build with clang -fsanitize=fuzzer,address,undefined and the sources of a unit of a small design, whose matrix
   exponentials cost little. */

#include <limits.h>
#include <math.h>
#include <stdint.h>

#include "host.h"

enum { INSTANCES = 3, MOST = 8 };

static const uint8_t *data;
static size_t left;

static unsigned byte(void)
{
    if (left == 0)
        return 0;
    left--;
    return *data++;
}

static uint64_t word(size_t size)
{
    uint64_t value = 0;
    for (size_t k = 0; k < size; k++)
        value = value << 8 | byte();
    return value;
}

static double real(void)
{
    static const double special[] = {0.0, -0.0, 1.0, -1.0, 1e-3, 1e3, 1e300, -1e300, 5e-324, 1e-300, 1e9, 0.5, 100.0};
    const unsigned choice = byte();
    if (choice < sizeof special / sizeof *special)
        return special[choice];
    if (choice < 20)
        return choice < 15 ? NAN : choice < 18 ? INFINITY : -INFINITY;
    if (choice < 60) {
        const uint64_t bits = word(8);
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }
    return (double)(int16_t)word(2) * (choice < 160 ? 1e-6 : 1e-1);
}

/* Lengths of a few samples, or what is refused: a long legal one keeps a sampled unit busy for seconds. */
static double step_size(void)
{
    const unsigned choice = byte();
    if (choice < 160)
        return described->step_size * (double)(1 + choice % 3);
    double step = choice < 200 ? described->step_size * (double)(choice - 159) : real();
    if (step > 50 * described->step_size && step <= 1e7 * described->step_size)
        step = 50 * described->step_size;
    return step;
}

static fmi2ValueReference reference(void)
{
    const unsigned choice = byte();
    if (choice < 250)
        return (fmi2ValueReference)(choice % (described->variable_count + 2));
    return (fmi2ValueReference)word(4);
}

static size_t length(void)
{
    const unsigned choice = byte();
    return choice < 250 ? choice % MOST : choice < 253 ? (size_t)-1 : described->variable_count + 1;
}

static uint32_t crc32(const unsigned char *bytes, size_t size)
{
    uint32_t crc = 0xffffffffu;
    for (size_t k = 0; k < size; k++) {
        crc ^= bytes[k];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

typedef struct {
    fmi2Component component;
    fmi2FMUstate state;
    double time;
} Subject;

static void release_subject(Subject *subject)
{
    if (subject->component != NULL)
        fmi2FreeFMUstate(subject->component, &subject->state);
    fmi2FreeInstance(subject->component);
    subject->component = NULL;
    subject->state = NULL;
    subject->time = 0.0;
}

/* Saves through bytes that were changed on the way, often with a matching checksum. */
static void spoil_state(Subject *subject)
{
    size_t size = 0;
    if (subject->state == NULL || fmi2SerializedFMUstateSize(subject->component, subject->state, &size) != fmi2OK)
        return;
    char *const bytes = malloc(size);
    if (bytes == NULL)
        return;
    fmi2SerializeFMUstate(subject->component, subject->state, bytes, byte() < 250 ? size : size / 2);
    size_t given = size;
    const unsigned changes = byte() % 6;
    for (unsigned k = 0; k < changes; k++) {
        const size_t index = (size_t)word(2) % size;
        if (byte() < 128 || index + 8 > size)
            bytes[index] = (char)byte();
        else {
            const double value = real();
            memcpy(bytes + index / 8 * 8, &value, sizeof value);
        }
    }
    const unsigned choice = byte();
    if (choice < 20)
        given = choice;
    else if (choice < 40)
        given = size - choice;
    else if (choice < 220) {
        const uint32_t crc = crc32((unsigned char *)bytes + 16, size - 16);
        for (int k = 0; k < 4; k++)
            bytes[12 + k] = (char)(crc >> 8 * k & 0xff);
    }
    fmi2DeSerializeFMUstate(subject->component, bytes, given, &subject->state);
    free(bytes);
}

static void note_time(Subject *subject)
{
    fmi2GetRealStatus(subject->component, fmi2LastSuccessfulTime, &subject->time);
}

/* Of a variable with respect to another one, mostly of outputs and inputs. */
static void derivative(fmi2Component component)
{
    fmi2ValueReference references[2 * MOST];
    double changes[MOST] = {0.0};
    double results[MOST];
    const size_t unknowns = length();
    const size_t knowns = length();
    for (size_t k = 0; k < MOST; k++) {
        references[k] = reference();
        references[MOST + k] = reference();
        changes[k] = real();
    }
    if ((unknowns > MOST && unknowns <= described->variable_count) ||
        (knowns > MOST && knowns <= described->variable_count))
        return;
    fmi2GetDirectionalDerivative(component, byte() < 8 ? NULL : references, unknowns, references + MOST, knowns,
                                 byte() < 8 ? NULL : changes, byte() < 8 ? NULL : results);
}

static void call(Subject *subject)
{
    fmi2ValueReference references[MOST];
    double reals[MOST];
    int wholes[MOST];
    fmi2String texts[MOST];
    size_t size;
    fmi2Status status;
    const fmi2Component c = subject->component;
    const unsigned function = byte();
    if (c == NULL || function == 0) {
        release_subject(subject);
        const char *const name = byte() < 8 ? "" : "a";
        const char *const guid = byte() < 8 ? "{}" : UNIT_GUID;
        const fmi2Type type = byte() < 8 ? fmi2ModelExchange : fmi2CoSimulation;
        subject->component = fmi2Instantiate(name, type, guid, NULL, byte() < 4 ? NULL : &callbacks, 0, byte() < 128);
        return;
    }
    const bool with_values = function % 32 >= 8 && function % 32 <= 16;
    size_t count = 0;
    if (with_values) {
        count = length();
        for (size_t k = 0; k < MOST && k < count; k++) {
            references[k] = reference();
            reals[k] = real();
            wholes[k] = (int)word(byte() < 200 ? 1 : 4);
            texts[k] = byte() < 200 ? "text%s" : NULL;
        }
        if (count <= described->variable_count && count > MOST)
            count = MOST;
    }
    const bool null = with_values && byte() < 6;
    switch (function % 32) {
    case 0:
    case 1:
    case 2:
    case 3:
    case 4:
        fmi2DoStep(c, byte() < 240 ? subject->time : real(), step_size(), 0);
        note_time(subject);
        break;
    case 5:
        fmi2SetupExperiment(c, 0, real(), real(), byte() < 128, real());
        note_time(subject);
        break;
    case 6:
        fmi2EnterInitializationMode(c);
        break;
    case 7:
        fmi2ExitInitializationMode(c);
        break;
    case 8:
    case 9:
        fmi2SetReal(c, null ? NULL : references, count, reals);
        break;
    case 10:
        fmi2GetReal(c, references, count, null ? NULL : reals);
        break;
    case 11:
        fmi2SetInteger(c, references, count, null ? NULL : wholes);
        break;
    case 12:
        fmi2SetBoolean(c, references, count, null ? NULL : wholes);
        break;
    case 13:
        fmi2SetString(c, references, count, null ? NULL : texts);
        break;
    case 14:
        fmi2GetInteger(c, references, count, wholes);
        fmi2GetBoolean(c, references, count, null ? NULL : wholes);
        fmi2GetString(c, null ? NULL : references, count, texts);
        break;
    case 15:
    case 16:
        for (size_t k = 0; k < MOST && k < count; k++)
            wholes[k] = wholes[k] % 8 == 0 ? 2 : 1;
        fmi2SetRealInputDerivatives(c, references, count, null ? NULL : wholes, reals);
        break;
    case 17:
        fmi2Terminate(c);
        break;
    case 18:
        fmi2Reset(c);
        note_time(subject);
        break;
    case 19:
        fmi2GetFMUstate(c, byte() < 4 ? NULL : &subject->state);
        break;
    case 20:
    case 21:
        fmi2SetFMUstate(c, subject->state);
        note_time(subject);
        break;
    case 22:
        fmi2FreeFMUstate(c, &subject->state);
        break;
    case 23:
    case 24:
        spoil_state(subject);
        break;
    case 25:
        texts[0] = byte() < 128 ? "logAll" : byte() < 128 ? "none" : NULL;
        fmi2SetDebugLogging(c, byte() < 128, byte() % 2, byte() < 8 ? NULL : texts);
        break;
    case 26:
        fmi2GetStatus(c, (fmi2StatusKind)(byte() % 4), byte() < 16 ? NULL : &status);
        fmi2GetIntegerStatus(c, (fmi2StatusKind)(byte() % 4), wholes);
        fmi2GetBooleanStatus(c, (fmi2StatusKind)(byte() % 4), wholes);
        fmi2GetStringStatus(c, (fmi2StatusKind)(byte() % 4), texts);
        fmi2GetRealStatus(c, (fmi2StatusKind)(byte() % 4), reals);
        break;
    case 27:
        fmi2CancelStep(c);
        fmi2GetRealOutputDerivatives(c, NULL, 1, NULL, NULL);
        break;
    case 29:
    case 30:
        derivative(c);
        break;
    case 28:
        fmi2SerializedFMUstateSize(c, subject->state, byte() < 128 ? &size : NULL);
        break;
    default: /* into the middle of things */
        fmi2Reset(c);
        fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
        fmi2EnterInitializationMode(c);
        fmi2ExitInitializationMode(c);
        note_time(subject);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    Subject subjects[INSTANCES] = {{.component = NULL}};
    if (described == NULL) {
        const fmi2Component first = fmi2Instantiate("a", fmi2CoSimulation, UNIT_GUID, NULL, &callbacks, 0, 0);
        describe(first);
        fmi2FreeInstance(first);
    }
    data = bytes;
    left = size;
    for (int k = 0; left > 0 && k < 200; k++)
        call(&subjects[byte() % INSTANCES]);
    for (int k = 0; k < INSTANCES; k++)
        release_subject(&subjects[k]);
    if (block_count != 0)
        abort();
    return 0;
}
