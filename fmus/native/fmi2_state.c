/* FMI 2.0: saving and restoring the state of an instance, in memory and as bytes.

   The bytes, little-endian on every machine: magic (8), version (4), CRC-32 of all that follows it (4), length (8),
   digest of the unit (32), phase (8), time (8), sloped (8), failure (TEXT_SIZE), then values, slopes and state as
   doubles (8 each). */

#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

enum { VERSION = 1, CHECKED_FROM = 16, HEADER_SIZE = 80 + TEXT_SIZE };

static const char magic[8] = {'f', 'l', 'x', 'b', 'e', 'a', 'm', 's'};

typedef struct {
    char magic[8];
    condition then;
    double contents[];
} saved_state;

static saved_state *recognised(instance *instance, fmi2FMUstate state)
{
    saved_state *const saved = state;
    if (saved != NULL && memcmp(saved->magic, magic, sizeof magic) == 0)
        return saved;
    refuse(instance, "FMU state must be one that this unit saved, got %s", saved == NULL ? "NULL" : "something else");
    return NULL;
}

/* Memory for a state where *state is NULL, else the one there. */
static saved_state *provided(instance *instance, fmi2FMUstate *state)
{
    if (state == NULL) {
        refuse_null(instance, "FMUstate");
        return NULL;
    }
    if (*state != NULL)
        return recognised(instance, *state);
    const size_t size = sizeof(saved_state) + saved_count() * sizeof(double);
    const fmi2CallbackFunctions *const callbacks = &instance->callbacks;
    const bool own = callbacks->allocateMemory == NULL || callbacks->freeMemory == NULL;
    saved_state *const saved = own ? calloc(1, size) : callbacks->allocateMemory(1, size);
    if (saved == NULL) {
        refuse(instance, "there is not enough memory");
        return NULL;
    }
    memcpy(saved->magic, magic, sizeof magic);
    *state = saved;
    return saved;
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    instance *const instance = entered(component, "fmi2GetFMUstate");
    if (instance == NULL)
        return fmi2Error;
    saved_state *const saved = provided(instance, state);
    if (saved == NULL)
        return fmi2Error;
    if (instance->now.phase >= STEPPING)
        complete(instance);
    saved->then = instance->now;
    memcpy(saved->contents, instance->memory, saved_count() * sizeof *saved->contents);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    instance *const instance = entered(component, "fmi2SetFMUstate");
    if (instance == NULL)
        return fmi2Error;
    const saved_state *const saved = recognised(instance, state);
    if (saved == NULL)
        return fmi2Error;
    instance->now = saved->then;
    memcpy(instance->memory, saved->contents, saved_count() * sizeof *saved->contents);
    instance->stale = true;
    instance->incomplete = false;
    return instance->now.phase < STEPPING || unit_restore(&instance->unit) ? fmi2OK : fmi2Error;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    instance *const instance = entered(component, "fmi2FreeFMUstate");
    if (instance == NULL)
        return fmi2Error;
    if (state == NULL || *state == NULL)
        return fmi2OK;
    saved_state *const saved = recognised(instance, *state);
    if (saved == NULL)
        return fmi2Error;
    memset(saved->magic, 0, sizeof magic);
    if (instance->callbacks.allocateMemory == NULL || instance->callbacks.freeMemory == NULL)
        free(saved);
    else
        instance->callbacks.freeMemory(saved);
    *state = NULL;
    return fmi2OK;
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

static void write_integer(unsigned char *bytes, size_t size, uint64_t value)
{
    for (size_t k = 0; k < size; k++)
        bytes[k] = (unsigned char)(value >> 8 * k & 0xff);
}

static uint64_t read_integer(const unsigned char *bytes, size_t size)
{
    uint64_t value = 0;
    for (size_t k = 0; k < size; k++)
        value |= (uint64_t)bytes[k] << 8 * k;
    return value;
}

static void write_real(unsigned char *bytes, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    write_integer(bytes, sizeof bits, bits);
}

static double read_real(const unsigned char *bytes)
{
    const uint64_t bits = read_integer(bytes, sizeof bits);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static size_t byte_count(void)
{
    return HEADER_SIZE + 8 * saved_count();
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    instance *const instance = entered(component, "fmi2SerializedFMUstateSize");
    if (instance == NULL || recognised(instance, state) == NULL)
        return fmi2Error;
    if (size == NULL)
        return refuse_null(instance, "size");
    *size = byte_count();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte serialised[], size_t size)
{
    instance *const instance = entered(component, "fmi2SerializeFMUstate");
    if (instance == NULL)
        return fmi2Error;
    const saved_state *const saved = recognised(instance, state);
    if (saved == NULL)
        return fmi2Error;
    if (serialised == NULL)
        return refuse_null(instance, "serializedState");
    if (size < byte_count())
        return refuse(instance, "size must be >= %z, got %z", byte_count(), size);
    unsigned char *const bytes = (unsigned char *)serialised;
    const condition *const then = &saved->then;
    memcpy(bytes, magic, sizeof magic);
    write_integer(bytes + 8, 4, VERSION);
    write_integer(bytes + 16, 8, byte_count());
    memcpy(bytes + 24, unit_digest, DIGEST_SIZE);
    write_integer(bytes + 56, 8, then->phase);
    write_real(bytes + 64, then->time);
    write_integer(bytes + 72, 8, then->sloped);
    memcpy(bytes + 80, then->failure, TEXT_SIZE);
    for (size_t k = 0; k < saved_count(); k++)
        write_real(bytes + HEADER_SIZE + 8 * k, saved->contents[k]);
    write_integer(bytes + 12, 4, crc32(bytes + CHECKED_FROM, byte_count() - CHECKED_FROM));
    return fmi2OK;
}

/* Can a unit have saved these bytes? Its clock and the variable time agree, whatever could be set must be within its
   bounds, integers convert. */
static bool plausible(const unsigned char *bytes)
{
    const double time = read_real(bytes + 64);
    bool all = read_integer(bytes + 56, 8) <= TERMINATED && isfinite(time) && time == read_real(bytes + HEADER_SIZE) &&
               memchr(bytes + 80, '\0', TEXT_SIZE) != NULL;
    for (size_t k = 0; k < unit_variable_count; k++) {
        const double value = read_real(bytes + HEADER_SIZE + 8 * k);
        const unsigned causality = unit_kinds[k] >> CAUSALITY_SHIFT & CAUSALITY_MASK;
        if ((unit_kinds[k] & TYPE_MASK) == INTEGER)
            all = all && fabs(value) <= INT_MAX;
        if (causality == INPUT || causality == PARAMETER)
            all = all && isfinite(value);
        if (causality == PARAMETER)
            all = all && value >= unit_variables[k].minimum && value <= unit_variables[k].maximum;
    }
    return all;
}

/* Are these the bytes of a state of this unit, and may they be used? */
static bool intact(instance *instance, const unsigned char *bytes, size_t size)
{
    if (size < HEADER_SIZE || memcmp(bytes, magic, sizeof magic) != 0)
        refuse(instance, "FMU state must be one that this unit saved, got something else");
    else if (read_integer(bytes + 8, 4) != VERSION)
        refuse(instance, "FMU state must have version %d, got %d", VERSION, (int)read_integer(bytes + 8, 4));
    else if (read_integer(bytes + 16, 8) != size ||
             read_integer(bytes + 12, 4) != crc32(bytes + CHECKED_FROM, size - CHECKED_FROM))
        refuse(instance, "FMU state must be complete and unchanged, got %z damaged bytes", size);
    else if (memcmp(bytes + 24, unit_digest, DIGEST_SIZE) != 0)
        refuse(instance, "FMU state must be of the same unit and design, got that of another");
    else if (size != byte_count() || !plausible(bytes))
        refuse(instance, "FMU state must have contents that this unit can have saved");
    else
        return true;
    return false;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte serialised[], size_t size,
                                   fmi2FMUstate *state)
{
    instance *const instance = entered(component, "fmi2DeSerializeFMUstate");
    if (instance == NULL)
        return fmi2Error;
    if (serialised == NULL)
        return refuse_null(instance, "serializedState");
    const unsigned char *const bytes = (const unsigned char *)serialised;
    if (!intact(instance, bytes, size))
        return fmi2Error;
    saved_state *const saved = provided(instance, state);
    if (saved == NULL)
        return fmi2Error;
    saved->then.phase = (enum phase)read_integer(bytes + 56, 8);
    saved->then.time = read_real(bytes + 64);
    saved->then.sloped = read_integer(bytes + 72, 8) != 0;
    memcpy(saved->then.failure, bytes + 80, TEXT_SIZE);
    for (size_t k = 0; k < saved_count(); k++)
        saved->contents[k] = read_real(bytes + HEADER_SIZE + 8 * k);
    return fmi2OK;
}
