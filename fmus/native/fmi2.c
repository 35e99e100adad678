/* FMI 2.0 for co-simulation: the life of an instance, its steps and its log. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

#define LINE 64           /* bytes of a cache line */
#define LONGEST_STEP 1e7  /* sample times; a longer step would keep a sampled unit busy for minutes */

/* Statuses whose lines are logged, as bits. */
static const unsigned nothing = 0, faults = 1u << fmi2Warning | 1u << fmi2Discard | 1u << fmi2Error | 1u << fmi2Fatal,
                      everything = ~0u;

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* Start values, zero state, just instantiated. */
static void start_over(instance *instance)
{
    memset(&instance->now, 0, sizeof instance->now);
    memset(instance->memory, 0, saved_count() * sizeof *instance->memory);
    for (size_t k = 0; k < unit_variable_count; k++)
        instance->unit.values[k] = unit_variables[k].start;
    instance->stale = true;
    instance->incomplete = false;
}

/* Why an instance cannot be made; NULL where it can. */
static const char *fault(fmi2Type type, fmi2String guid)
{
    if (type != fmi2CoSimulation)
        return "fmi2Instantiate: fmuType must be fmi2CoSimulation";
    if (guid == NULL || strcmp(guid, unit_guid) != 0)
        return "fmi2Instantiate: fmuGUID must be the guid in modelDescription.xml of this unit";
    return NULL;
}

/* The first place from here on where a cache line begins: what units multiply by is read by whole lines. */
static double *aligned(double *memory)
{
    return memory + (LINE - (uintptr_t)memory % LINE) % LINE / sizeof *memory;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging_on)
{
    (void)resources;
    (void)visible;
    if (functions == NULL || functions->logger == NULL)
        return NULL;
    const bool named = name != NULL && *name != '\0';
    const char *text = named ? fault(type, guid) : "fmi2Instantiate: instanceName must not be empty";
    const size_t saved = saved_count(), doubles = saved + LINE / sizeof(double) + unit_workspace_size();
    instance *instance = NULL;
    if (text == NULL) {
        const size_t size = sizeof *instance + doubles * sizeof *instance->memory + strlen(name) + 1;
        const bool own = functions->allocateMemory == NULL || functions->freeMemory == NULL;
        instance = own ? calloc(1, size) : functions->allocateMemory(1, size);
        if (instance == NULL)
            text = "fmi2Instantiate: there is not enough memory";
        else
            memset(instance, 0, size);
    }
    if (text != NULL) {
        functions->logger(functions->componentEnvironment, named ? name : "", fmi2Error, "logStatusError", text);
        return NULL;
    }
    instance->function = "fmi2Instantiate";
    instance->callbacks = *functions;
    instance->logged = logging_on ? everything : faults;
    double *const memory = instance->memory;
    instance->unit.values = memory;
    instance->unit.state = memory + 2 * unit_variable_count;
    instance->unit.workspace = aligned(memory + saved);
    instance->name = (char *)(memory + doubles);
    strcpy(instance->name, name);
    start_over(instance);
    return instance;
}

void fmi2FreeInstance(fmi2Component component)
{
    instance *const instance = component;
    if (instance == NULL)
        return;
    if (instance->callbacks.allocateMemory == NULL || instance->callbacks.freeMemory == NULL)
        free(instance);
    else
        instance->callbacks.freeMemory(instance);
}

/* The statuses whose lines a category stands for, as bits; 0 where there is none of that name. */
static unsigned statuses(fmi2String category)
{
    static const char names[][20] = {
        [fmi2OK] = "logAll", [fmi2Warning] = "logStatusWarning", [fmi2Discard] = "logStatusDiscard",
        [fmi2Error] = "logStatusError", [fmi2Fatal] = "logStatusFatal",
    };
    for (unsigned status = fmi2OK; status <= fmi2Fatal; status++)
        if (strcmp(category, names[status]) == 0)
            return 1u << status;
    return 0;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    instance *const instance = entered(component, "fmi2SetDebugLogging");
    if (instance == NULL)
        return fmi2Error;
    if (count > 0 && categories == NULL)
        return decline(instance, "categories must not be NULL");
    unsigned named = count > 0 ? nothing : everything;
    for (size_t k = 0; k < count; k++) {
        const unsigned found = categories[k] == NULL ? 0 : statuses(categories[k]);
        if (found == 0)
            return decline(instance, "categories must be among LogCategories of modelDescription.xml, got %q",
                           categories[k] == NULL ? "NULL" : categories[k]);
        named |= found;
    }
    instance->logged = on ? named : count > 0 ? instance->logged & ~named : nothing;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    instance *const instance = entered(component, "fmi2SetupExperiment");
    if (instance == NULL || !require(instance, INSTANTIATED))
        return fmi2Error;
    if (!isfinite(start))
        return refuse(instance, "startTime must be finite, got %r", start);
    if (stop_defined && !(stop > start))
        return refuse(instance, "stopTime must be > startTime %r, got %r", start, stop);
    instance->now.time = instance->unit.values[0] = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    instance *const instance = entered(component, "fmi2EnterInitializationMode");
    if (instance == NULL || !require(instance, INSTANTIATED))
        return fmi2Error;
    instance->now.phase = INITIALISING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    instance *const instance = entered(component, "fmi2ExitInitializationMode");
    if (instance == NULL || !require(instance, INITIALISING) || !refresh(instance) ||
        !unit_prepare(&instance->unit, unit_step_size))
        return fmi2Error;
    instance->now.phase = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    instance *const instance = entered(component, "fmi2Terminate");
    if (instance == NULL || !require(instance, STEPPING))
        return fmi2Error;
    instance->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    instance *const instance = entered(component, "fmi2Reset");
    if (instance == NULL)
        return fmi2Error;
    start_over(instance);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean no_rollback)
{
    (void)no_rollback;
    instance *const instance = entered(component, "fmi2DoStep");
    if (instance == NULL)
        return fmi2Error;
    condition *const now = &instance->now;
    unit *const unit = &instance->unit;
    if (now->failure[0] != '\0')
        return refuse(instance, "fmi2DoStep is refused until fmi2Reset, the instance failed: %s", now->failure);
    if (!require(instance, STEPPING))
        return fmi2Error;
    if (!(step > 0.0 && isfinite(step)))
        return refuse(instance, "communicationStepSize must be finite and > 0, got %r", step);
    if (step > LONGEST_STEP * unit_step_size)
        return refuse(instance, "communicationStepSize must be <= %r, got %r", LONGEST_STEP * unit_step_size, step);
    if (!(fabs(time - now->time) <= 1e-6 * step + 1e-9 * fabs(now->time)))
        return refuse(instance, "currentCommunicationPoint must be %r, the end of the last step, got %r", now->time,
                      time);
    double *const slopes = unit->values + unit_variable_count;
    unit->slopes = now->sloped ? slopes : NULL;
    if (!unit_advance(unit, time, step))
        return fmi2Error;
    if (now->sloped)
        memset(slopes, 0, unit_variable_count * sizeof *slopes);
    now->sloped = false;
    now->time = unit->values[0] = time + step;
    instance->incomplete = true;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    instance *const instance = entered(component, "fmi2CancelStep");
    if (instance == NULL)
        return fmi2Error;
    return decline(instance, "no step is under way, steps of this unit are done when fmi2DoStep returns");
}

/* Answers for questions about a step that is still under way: here there is never one. */
static fmi2Status no_status(fmi2Component component, const char *function, fmi2StatusKind kind, const void *value)
{
    instance *const instance = entered(component, function);
    if (instance == NULL)
        return fmi2Error;
    if (value == NULL)
        return decline(instance, "value must not be NULL");
    return discard(instance, "status %d is not known, no step is under way", (int)kind);
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value)
{
    return no_status(component, "fmi2GetStatus", kind, value);
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    if (component == NULL || value == NULL || kind != fmi2LastSuccessfulTime)
        return no_status(component, "fmi2GetRealStatus", kind, value);
    *value = ((instance *)component)->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Integer *value)
{
    return no_status(component, "fmi2GetIntegerStatus", kind, value);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (component == NULL || value == NULL || kind != fmi2Terminated)
        return no_status(component, "fmi2GetBooleanStatus", kind, value);
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind, fmi2String *value)
{
    return no_status(component, "fmi2GetStringStatus", kind, value);
}
