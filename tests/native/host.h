/* A host for the harnesses: counts what a unit logs and allocates. Linked with the one file of a unit; UNIT_GUID is its
   GUID. */

#ifndef HOST_H
#define HOST_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

/* Stop the program, also with NDEBUG. */
#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #condition);                                    \
            fprintf(stderr, "last line in the log: %s\n", last_line);                                                  \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (false)

static unsigned line_count;
static long block_count; /* blocks that are not freed */
static char last_line[512];

static void log_line(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                     fmi2String message, ...)
{
    (void)environment;
    (void)status;
    line_count++;
    snprintf(last_line, sizeof last_line, "%s %s", category, message);
    if (*name == '\0' && strstr(message, "instanceName") == NULL)
        abort();
    if (strpbrk(message, "\r\n%") != NULL || strlen(message) < 10)
        abort();
}

static void *allocate(size_t count, size_t size)
{
    void *const block = calloc(count, size);
    block_count += block != NULL;
    return block;
}

static void release(void *block)
{
    block_count -= block != NULL;
    free(block);
}

static const fmi2CallbackFunctions callbacks = {
    .logger = log_line,
    .allocateMemory = allocate,
    .freeMemory = release,
};

static const UnitDescription *described; /* the unit, once there is an instance */

/* Makes an instance known to the functions below. */
static inline void describe(fmi2Component component)
{
    const Instance *const instance = component;
    CHECK(instance != NULL);
    described = instance->description;
}

static inline VariableType type_of(size_t reference)
{
    return described->kinds[reference] & TYPE_MASK;
}

static inline Causality causality_of(size_t reference)
{
    return described->kinds[reference] >> CAUSALITY_SHIFT & CAUSALITY_MASK;
}

/* Value references of the Real variables of a causality, or of all with causality LOCAL + 1. */
static inline size_t reals_of(Causality causality, fmi2ValueReference *references)
{
    size_t count = 0;
    for (size_t k = 0; k < described->variable_count; k++)
        if (type_of(k) == REAL && (causality > LOCAL || causality_of(k) == causality))
            references[count++] = (fmi2ValueReference)k;
    return count;
}

#endif
