/* FMI 2.0: saving and restoring the state of an instance, in memory and as bytes.

   The bytes, little-endian on every machine: magic (8), version (4), CRC-32 of all that follows it (4), length (8),
   digest of the unit (32), phase (8), clock (7 times 8), sloped (8), failure (TEXT_SIZE), then values, slopes and state
   as doubles (8 each). */

#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

enum {
    VERSION = 2,
    CHECKED_FROM = 16,
    DIGEST_AT = 24,
    PHASE_AT = DIGEST_AT + DIGEST_SIZE,
    CLOCK_AT = PHASE_AT + 8,
    SLOPED_AT = CLOCK_AT + 8 * CLOCK_FIELDS,
    FAILURE_AT = SLOPED_AT + 8,
    HEADER_SIZE = FAILURE_AT + TEXT_SIZE
};

static const char state_magic[8] = {'f', 'l', 'x', 'b', 'e', 'a', 'm', 's'};

typedef struct {
    char magic[8];
    unsigned char digest[DIGEST_SIZE]; /* of the unit that it belongs to */
    Condition then;
    double contents[];
} SavedState;

static SavedState *as_saved_state(Instance *instance, fmi2FMUstate state)
{
    SavedState *const saved = state;
    const bool is_state = saved != NULL && memcmp(saved->magic, state_magic, sizeof state_magic) == 0;
    if (is_state && memcmp(saved->digest, instance->description->digest, DIGEST_SIZE) == 0)
        return saved;
    if (is_state) {
        refuse(instance, "FMU state must be of the same unit and design, got that of another");
        return NULL;
    }
    refuse(instance, "FMU state must be one that this unit saved, got %s", saved == NULL ? "NULL" : "something else");
    return NULL;
}

/* Memory for a state where *state is NULL, else the one there. */
static SavedState *state_memory(Instance *instance, fmi2FMUstate *state)
{
    if (state == NULL) {
        refuse_null(instance, "FMUstate");
        return NULL;
    }
    if (*state != NULL)
        return as_saved_state(instance, *state);
    const size_t size = sizeof(SavedState) + instance->saved_count * sizeof(double);
    const fmi2CallbackFunctions *const callbacks = &instance->callbacks;
    const bool own = callbacks->allocateMemory == NULL || callbacks->freeMemory == NULL;
    SavedState *const saved = own ? calloc(1, size) : callbacks->allocateMemory(1, size);
    if (saved == NULL) {
        refuse(instance, "there is not enough memory");
        return NULL;
    }
    memcpy(saved->magic, state_magic, sizeof state_magic);
    memcpy(saved->digest, instance->description->digest, DIGEST_SIZE);
    *state = saved;
    return saved;
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    Instance *const instance = begin_call(component, "fmi2GetFMUstate");
    if (instance == NULL)
        return fmi2Error;
    SavedState *const saved = state_memory(instance, state);
    if (saved == NULL)
        return fmi2Error;
    if (instance->now.phase >= STEPPING)
        complete(instance);
    saved->then = instance->now;
    memcpy(saved->contents, instance->memory, instance->saved_count * sizeof *saved->contents);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    Instance *const instance = begin_call(component, "fmi2SetFMUstate");
    if (instance == NULL)
        return fmi2Error;
    const SavedState *const saved = as_saved_state(instance, state);
    if (saved == NULL)
        return fmi2Error;
    instance->now = saved->then;
    instance->unit.start = instance->now.clock.start;
    instance->unit.elapsed = clock_elapsed(&instance->now.clock);
    memcpy(instance->memory, saved->contents, instance->saved_count * sizeof *saved->contents);
    instance->stale = true;
    instance->incomplete = false;
    return instance->now.phase < STEPPING || unit_restore(&instance->unit) ? fmi2OK : fmi2Error;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    Instance *const instance = begin_call(component, "fmi2FreeFMUstate");
    if (instance == NULL)
        return fmi2Error;
    if (state == NULL || *state == NULL)
        return fmi2OK;
    SavedState *const saved = as_saved_state(instance, *state);
    if (saved == NULL)
        return fmi2Error;
    memset(saved->magic, 0, sizeof saved->magic);
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

static size_t byte_count(const Instance *instance)
{
    return HEADER_SIZE + 8 * instance->saved_count;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    Instance *const instance = begin_call(component, "fmi2SerializedFMUstateSize");
    if (instance == NULL || as_saved_state(instance, state) == NULL)
        return fmi2Error;
    if (size == NULL)
        return refuse_null(instance, "size");
    *size = byte_count(instance);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte serialised[], size_t size)
{
    Instance *const instance = begin_call(component, "fmi2SerializeFMUstate");
    if (instance == NULL)
        return fmi2Error;
    const SavedState *const saved = as_saved_state(instance, state);
    if (saved == NULL)
        return fmi2Error;
    if (serialised == NULL)
        return refuse_null(instance, "serializedState");
    if (size < byte_count(instance))
        return refuse(instance, "size must be >= %zu, got %zu", byte_count(instance), size);
    unsigned char *const bytes = (unsigned char *)serialised;
    const Condition *const then = &saved->then;
    memcpy(bytes, state_magic, sizeof state_magic);
    write_integer(bytes + 8, 4, VERSION);
    write_integer(bytes + 16, 8, byte_count(instance));
    memcpy(bytes + DIGEST_AT, instance->description->digest, DIGEST_SIZE);
    write_integer(bytes + PHASE_AT, 8, then->phase);
    double clock[CLOCK_FIELDS];
    memcpy(clock, &then->clock, sizeof clock);
    for (size_t k = 0; k < CLOCK_FIELDS; k++)
        write_real(bytes + CLOCK_AT + 8 * k, clock[k]);
    write_integer(bytes + SLOPED_AT, 8, then->sloped);
    memcpy(bytes + FAILURE_AT, then->failure, TEXT_SIZE);
    for (size_t k = 0; k < instance->saved_count; k++)
        write_real(bytes + HEADER_SIZE + 8 * k, saved->contents[k]);
    write_integer(bytes + 12, 4, crc32(bytes + CHECKED_FROM, byte_count(instance) - CHECKED_FROM));
    return fmi2OK;
}

static Clock read_clock(const unsigned char *bytes)
{
    double fields[CLOCK_FIELDS];
    Clock clock;
    for (size_t k = 0; k < CLOCK_FIELDS; k++)
        fields[k] = read_real(bytes + CLOCK_AT + 8 * k);
    memcpy(&clock, fields, sizeof clock);
    return clock;
}

/* Can a unit have saved these bytes? Its clock and the variable time agree, whatever could be set must be within its
   bounds, Integers and Booleans are such; all is finite unless a step failed. */
static bool is_plausible(const UnitDescription *unit, const unsigned char *bytes, size_t saved_count)
{
    const Clock clock = read_clock(bytes);
    bool all = read_integer(bytes + PHASE_AT, 8) <= TERMINATED && clock_is_valid(&clock) &&
               read_real(bytes + HEADER_SIZE) == clock.start + clock_elapsed(&clock) &&
               memchr(bytes + FAILURE_AT, '\0', TEXT_SIZE) != NULL;
    for (size_t k = 0; k < unit->variable_count; k++) {
        const double value = read_real(bytes + HEADER_SIZE + 8 * k);
        const unsigned type = unit->kinds[k] & TYPE_MASK;
        const unsigned causality = unit->kinds[k] >> CAUSALITY_SHIFT & CAUSALITY_MASK;
        if (type == INTEGER)
            all = all && fabs(value) <= INT_MAX && floor(value) == value;
        if (type == BOOLEAN)
            all = all && (value == 0.0 || value == 1.0);
        if (causality == INPUT || causality == PARAMETER)
            all = all && value >= unit->variables[k].minimum && value <= unit->variables[k].maximum;
    }
    for (size_t k = 0; bytes[FAILURE_AT] == '\0' && k < saved_count; k++)
        all = all && isfinite(read_real(bytes + HEADER_SIZE + 8 * k));
    return all;
}

/* Are these the bytes of a state of this unit, and may they be used? */
static bool is_intact(Instance *instance, const unsigned char *bytes, size_t size)
{
    if (size < HEADER_SIZE || memcmp(bytes, state_magic, sizeof state_magic) != 0)
        refuse(instance, "FMU state must be one that this unit saved, got something else");
    else if (read_integer(bytes + 8, 4) != VERSION)
        refuse(instance, "FMU state must have version %d, got %d", VERSION, (int)read_integer(bytes + 8, 4));
    else if (read_integer(bytes + 16, 8) != size ||
             read_integer(bytes + 12, 4) != crc32(bytes + CHECKED_FROM, size - CHECKED_FROM))
        refuse(instance, "FMU state must be complete and unchanged, got %zu damaged bytes", size);
    else if (memcmp(bytes + DIGEST_AT, instance->description->digest, DIGEST_SIZE) != 0)
        refuse(instance, "FMU state must be of the same unit and design, got that of another");
    else if (size != byte_count(instance) || !is_plausible(instance->description, bytes, instance->saved_count))
        refuse(instance, "FMU state must have contents that this unit can have saved");
    else
        return true;
    return false;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte serialised[], size_t size,
                                   fmi2FMUstate *state)
{
    Instance *const instance = begin_call(component, "fmi2DeSerializeFMUstate");
    if (instance == NULL)
        return fmi2Error;
    if (serialised == NULL)
        return refuse_null(instance, "serializedState");
    const unsigned char *const bytes = (const unsigned char *)serialised;
    if (!is_intact(instance, bytes, size))
        return fmi2Error;
    SavedState *const saved = state_memory(instance, state);
    if (saved == NULL)
        return fmi2Error;
    saved->then.phase = (Phase)read_integer(bytes + PHASE_AT, 8);
    saved->then.clock = read_clock(bytes);
    saved->then.sloped = read_integer(bytes + SLOPED_AT, 8) != 0;
    memcpy(saved->then.failure, bytes + FAILURE_AT, TEXT_SIZE);
    for (size_t k = 0; k < instance->saved_count; k++)
        saved->contents[k] = read_real(bytes + HEADER_SIZE + 8 * k);
    return fmi2OK;
}
