/* Loads a unit's library as an importer does, on any platform, and prints the values of a run with all digits.

   run_library LIBRARY GUID STEPS STEP INPUTS REALS: value references with commas between them */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#endif

#include "fmi2Functions.h"

enum { MOST = 4096 };

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

static void log_line(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                     fmi2String message, ...)
{
    (void)environment;
    (void)status;
    fprintf(stderr, "%s: %s: %s\n", name, category, message);
}

static void check(fmi2Status status)
{
    if (status != fmi2OK)
        exit(3);
}

static size_t read_references(char *text, fmi2ValueReference *references)
{
    size_t count = 0;
    for (char *word = strtok(text, ","); word != NULL && count < MOST; word = strtok(NULL, ","))
        references[count++] = (fmi2ValueReference)strtoul(word, NULL, 10);
    return count;
}

int main(int argc, char **argv)
{
    static fmi2ValueReference inputs[MOST];
    static fmi2ValueReference reals[MOST];
    static double values[MOST];
    if (argc != 7)
        return 1;
    const fmi2CallbackFunctions callbacks = {.logger = log_line};
    const size_t steps = strtoul(argv[3], NULL, 10);
    const double step = strtod(argv[4], NULL);
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
    /* through memory: ISO C has no conversion from object to function pointers */
#define LOAD(function, name)                                                                                           \
    do {                                                                                                               \
        void *const address = find(argv[1], name);                                                                     \
        memcpy(&function, &address, sizeof address);                                                                   \
    } while (0)
    LOAD(instantiate, "fmi2Instantiate");
    LOAD(setup, "fmi2SetupExperiment");
    LOAD(enter, "fmi2EnterInitializationMode");
    LOAD(leave, "fmi2ExitInitializationMode");
    LOAD(set, "fmi2SetReal");
    LOAD(get, "fmi2GetReal");
    LOAD(advance, "fmi2DoStep");
    LOAD(release, "fmi2FreeInstance");
    const fmi2Component instance = instantiate("a", fmi2CoSimulation, argv[2], NULL, &callbacks, 0, 0);
    if (instance == NULL)
        return 4;
    check(setup(instance, 0, 0.0, 0.0, 0, 0.0));
    check(enter(instance));
    check(leave(instance));
    for (size_t k = 0; k < steps; k++) {
        for (size_t i = 0; i < input_count; i++)
            values[i] = 1e-4 * (double)((int)((k / 100 + 2 * i) % 5) - 2);
        check(set(instance, inputs, input_count, values));
        check(advance(instance, (double)k * step, step, 0));
        check(get(instance, reals, real_count, values));
        if (k % 50 == 49)
            for (size_t i = 0; i < real_count; i++)
                printf("%.17g%c", values[i], i + 1 < real_count ? ' ' : '\n');
    }
    release(instance);
    return 0;
}
