/* Loads a unit's library as an importer does, on any platform, and prints the values of a run with all digits.

   run_library LIBRARY GUID STEPS LENGTHS INPUTS REALS START FILE [load]: value references, and lengths of steps that
   take turns, with commas between them. Halfway the state is written to FILE; with `load` the run begins there instead,
   with the state in FILE. With -DLINKED the unit is linked into the program, LIBRARY is not used. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef LINKED
#elif defined(_WIN32)
#include <windows.h>
#else
#include <dlfcn.h>
#endif

#include "fmi2Functions.h"

enum { MOST = 4096 };

#ifndef LINKED
static void *find(const char *library, const char *name)
{
#ifdef _WIN32
    static HMODULE module;
    if (module == NULL)
        module = LoadLibraryA(library);
    void *const found = module == NULL ? NULL : (void *)GetProcAddress(module, name);
#else
    static void *module;
    if (module == NULL)
        module = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    void *const found = module == NULL ? NULL : dlsym(module, name);
#endif
    if (found == NULL) {
        fprintf(stderr, "%s: no %s\n", library, name);
        exit(2);
    }
    return found;
}
#endif

static void log_line(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                     fmi2String message, ...)
{
    (void)environment;
    (void)status;
    fprintf(stderr, "%s: %s: %s\n", name, category, message);
}

static void check(fmi2Status status)
{
    if (status > fmi2Warning)
        exit(3);
}

static fmi2GetFMUstateTYPE *get_state;
static fmi2SetFMUstateTYPE *set_state;
static fmi2FreeFMUstateTYPE *free_state;
static fmi2SerializedFMUstateSizeTYPE *state_size;
static fmi2SerializeFMUstateTYPE *serialise;
static fmi2DeSerializeFMUstateTYPE *deserialise;

static void save_state(fmi2Component instance, const char *name)
{
    static fmi2Byte bytes[MOST * 64];
    fmi2FMUstate state = NULL;
    size_t size;
    check(get_state(instance, &state));
    check(state_size(instance, state, &size));
    FILE *const file = fopen(name, "wb");
    if (file == NULL || size > sizeof bytes)
        exit(5);
    check(serialise(instance, state, bytes, size));
    check(free_state(instance, &state));
    if (fwrite(bytes, 1, size, file) != size || fclose(file) != 0)
        exit(5);
}

static void load_state(fmi2Component instance, const char *name)
{
    static fmi2Byte bytes[MOST * 64];
    fmi2FMUstate state = NULL;
    FILE *const file = fopen(name, "rb");
    if (file == NULL)
        exit(5);
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    check(deserialise(instance, bytes, size, &state));
    check(set_state(instance, state));
    check(free_state(instance, &state));
}

static size_t read_references(char *text, fmi2ValueReference *references)
{
    size_t count = 0;
    for (char *word = strtok(text, ","); word != NULL && count < MOST; word = strtok(NULL, ","))
        references[count++] = (fmi2ValueReference)strtoul(word, NULL, 10);
    return count;
}

static size_t read_lengths(char *text, double *lengths)
{
    size_t count = 0;
    for (char *word = strtok(text, ","); word != NULL && count < MOST; word = strtok(NULL, ","))
        lengths[count++] = strtod(word, NULL);
    return count;
}

int main(int argc, char **argv)
{
    static double lengths[MOST];
    static fmi2ValueReference inputs[MOST];
    static fmi2ValueReference reals[MOST];
    static double values[MOST];
    if (argc != 9 && argc != 10)
        return 1;
    const fmi2CallbackFunctions callbacks = {.logger = log_line};
    const size_t steps = strtoul(argv[3], NULL, 10);
    const size_t length_count = read_lengths(argv[4], lengths);
    const size_t input_count = read_references(argv[5], inputs);
    const size_t real_count = read_references(argv[6], reals);
    fmi2InstantiateTYPE *instantiate;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    fmi2SetRealTYPE *set;
    fmi2GetRealTYPE *get;
    fmi2DoStepTYPE *advance;
    fmi2FreeInstanceTYPE *release;
#ifdef LINKED
#define LOAD(function, name) function = name
#else
    /* through memory: ISO C has no conversion from object to function pointers */
#define LOAD(function, name)                                                                                           \
    do {                                                                                                               \
        void *const address = find(argv[1], #name);                                                                    \
        memcpy(&function, &address, sizeof address);                                                                   \
    } while (0)
#endif
    LOAD(instantiate, fmi2Instantiate);
    LOAD(setup, fmi2SetupExperiment);
    LOAD(enter, fmi2EnterInitializationMode);
    LOAD(leave, fmi2ExitInitializationMode);
    LOAD(set, fmi2SetReal);
    LOAD(get, fmi2GetReal);
    LOAD(advance, fmi2DoStep);
    LOAD(release, fmi2FreeInstance);
    LOAD(get_state, fmi2GetFMUstate);
    LOAD(set_state, fmi2SetFMUstate);
    LOAD(free_state, fmi2FreeFMUstate);
    LOAD(state_size, fmi2SerializedFMUstateSize);
    LOAD(serialise, fmi2SerializeFMUstate);
    LOAD(deserialise, fmi2DeSerializeFMUstate);
    const fmi2Component instance = instantiate("a", fmi2CoSimulation, argv[2], NULL, &callbacks, 0, 0);
    if (instance == NULL)
        return 4;
    double time = strtod(argv[7], NULL);
    check(setup(instance, 0, 0.0, time, 0, 0.0));
    check(enter(instance));
    check(leave(instance));
    const size_t first = argc == 10 ? steps / 2 : 0;
    if (first > 0)
        load_state(instance, argv[8]);
    for (size_t k = 0; k < first; k++)
        time += lengths[k % length_count];
    for (size_t k = first; k < steps; k++) {
        if (first == 0 && k == steps / 2)
            save_state(instance, argv[8]);
        for (size_t i = 0; i < input_count; i++)
            values[i] = 1e-4 * (double)((int)((k / 100 + 2 * i) % 5) - 2);
        check(set(instance, inputs, input_count, values));
        check(advance(instance, time, lengths[k % length_count], 0));
        time += lengths[k % length_count];
        check(get(instance, reals, real_count, values));
        if (k % 50 == 49)
            for (size_t i = 0; i < real_count; i++)
                printf("%.17g%c", values[i], i + 1 < real_count ? ' ' : '\n');
    }
    release(instance);
    return 0;
}
