/* FMI 2.0 for co-simulation: the life of an instance, its steps and its log. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

#define CACHE_LINE 64    /* bytes */
#define PAGE 4096        /* bytes */
#define LONGEST_STEP 1e6 /* sample times; a longer step would keep a sampled unit busy for seconds */

/* Statuses whose lines are logged, as bits. */
#define NOTHING 0u
#define FAULTS (1u << fmi2Warning | 1u << fmi2Discard | 1u << fmi2Error | 1u << fmi2Fatal)
#define EVERYTHING (~0u)

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* Times of the experiment, s. */
static void set_start(Instance *instance, double start, double stop)
{
    instance->now.clock = clock_from(start, stop);
    instance->unit.start = start;
    instance->unit.elapsed = 0.0;
}

/* Start values, zero state, just instantiated. */
static void start_over(Instance *instance)
{
    const UnitDescription *const description = instance->description;
    memset(&instance->now, 0, sizeof instance->now);
    set_start(instance, 0.0, DBL_MAX);
    memset(instance->memory, 0, instance->saved_count * sizeof *instance->memory);
    for (size_t k = 0; k < description->variable_count; k++)
        instance->unit.values[k] = description->variables[k].start;
    instance->stale = true;
    instance->incomplete = false;
}

/* Why an instance cannot be made; NULL where it can. */
static const char *instantiate_error(const UnitDescription *description, fmi2String name, fmi2Type type,
                                     fmi2String guid)
{
    if (name == NULL || *name == '\0')
        return "fmi2Instantiate: instanceName must not be empty";
    if (type != fmi2CoSimulation)
        return "fmi2Instantiate: fmuType must be fmi2CoSimulation";
    if (guid == NULL || strcmp(guid, description->guid) != 0)
        return "fmi2Instantiate: fmuGUID must be the guid in modelDescription.xml of this unit";
    return NULL;
}

/* The first address from here on where a cache line begins: what units multiply by is read by whole lines. */
static double *align_to_line(double *memory)
{
    return memory + (CACHE_LINE - (uintptr_t)memory % CACHE_LINE) % CACHE_LINE / sizeof *memory;
}

/* Zeroes a host's memory. The standard asks the host for zeros: what is zero already is read only, so that pages that
   no step has used yet take no memory and no time. */
static void clear_memory(void *memory, size_t size)
{
    unsigned char *bytes = memory;
    while (size > 0) {
        const size_t count = size < PAGE ? size : PAGE;
        if (bytes[0] != 0 || memcmp(bytes, bytes + 1, count - 1) != 0)
            memset(bytes, 0, count);
        bytes += count;
        size -= count;
    }
}

static size_t count_results(const UnitDescription *description)
{
    size_t count = 0;
    for (size_t k = 0; k < description->result_count; k++)
        count += description->results[k].count;
    return count;
}

/* Memory for an instance of a unit, in one block; NULL where there is not enough. */
static Instance *allocate_instance(const UnitDescription *description, fmi2String name,
                                   const fmi2CallbackFunctions *functions)
{
    const UnitHooks *const hooks = description->hooks;
    const size_t count = description->variable_count;
    const size_t saved = 2 * count + unit_state_size(hooks, description->data);
    const size_t before_kept = saved + CACHE_LINE / sizeof(double) + unit_workspace_size(hooks, description->data);
    const size_t before_changes = before_kept + count_results(description);
    const size_t doubles = before_changes + count;
    const size_t size = sizeof(Instance) + doubles * sizeof(double) + strlen(name) + 1;
    const bool own = functions->allocateMemory == NULL || functions->freeMemory == NULL;
    Instance *const instance = own ? calloc(1, size) : functions->allocateMemory(1, size);
    if (instance == NULL)
        return NULL;
    if (!own)
        clear_memory(instance, size);
    double *const memory = instance->memory;
    instance->saved_count = saved;
    instance->unit = (UnitInstance){
        .hooks = hooks,
        .data = description->data,
        .variables = description->variables,
        .step_size = description->step_size,
        .values = memory,
        .state = memory + 2 * count,
        .workspace = align_to_line(memory + saved),
        .changes = memory + before_changes,
        .log = log_of_unit,
    };
    instance->kept = memory + before_kept;
    instance->description = description;
    instance->callbacks = *functions;
    instance->name = strcpy((char *)(memory + doubles), name);
    return instance;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging_on)
{
    (void)resources;
    (void)visible;
    if (functions == NULL || functions->logger == NULL)
        return NULL;
    const char *error = instantiate_error(&this_unit, name, type, guid);
    Instance *instance = NULL;
    if (error == NULL) {
        instance = allocate_instance(&this_unit, name, functions);
        error = instance == NULL ? "fmi2Instantiate: there is not enough memory" : NULL;
    }
    if (error != NULL) {
        functions->logger(functions->componentEnvironment, name == NULL ? "" : name, fmi2Error, "logStatusError",
                          error);
        return NULL;
    }
    instance->function = "fmi2Instantiate";
    instance->logged = logging_on ? EVERYTHING : FAULTS;
    start_over(instance);
    return instance;
}

void fmi2FreeInstance(fmi2Component component)
{
    Instance *const instance = component;
    if (instance == NULL)
        return;
    if (instance->callbacks.allocateMemory == NULL || instance->callbacks.freeMemory == NULL)
        free(instance);
    else
        instance->callbacks.freeMemory(instance);
}

/* The statuses whose lines a category stands for, as bits; 0 where there is none of that name. */
static unsigned statuses_of(fmi2String category)
{
    static const char names[][20] = {
        [fmi2OK] = "logAll",
        [fmi2Warning] = "logStatusWarning",
        [fmi2Discard] = "logStatusDiscard",
        [fmi2Error] = "logStatusError",
        [fmi2Fatal] = "logStatusFatal",
    };
    for (unsigned status = fmi2OK; status <= fmi2Fatal; status++)
        if (strcmp(category, names[status]) == 0)
            return 1u << status;
    return 0;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    Instance *const instance = begin_call(component, "fmi2SetDebugLogging");
    if (instance == NULL)
        return fmi2Error;
    if (count > 0 && categories == NULL)
        return decline(instance, "categories must not be NULL");
    unsigned named = count > 0 ? NOTHING : EVERYTHING;
    for (size_t k = 0; k < count; k++) {
        const unsigned statuses = categories[k] == NULL ? 0 : statuses_of(categories[k]);
        if (statuses == 0)
            return decline(instance, "categories must be among LogCategories of modelDescription.xml, got %q",
                           categories[k] == NULL ? "NULL" : categories[k]);
        named |= statuses;
    }
    instance->logged = on ? named : count > 0 ? instance->logged & ~named : NOTHING;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    Instance *const instance = begin_call(component, "fmi2SetupExperiment");
    if (instance == NULL || !require(instance, INSTANTIATED))
        return fmi2Error;
    if (!isfinite(start))
        return refuse(instance, "startTime must be finite, got %r", start);
    if (stop_defined && !(stop > start))
        return refuse(instance, "stopTime must be > startTime %r, got %r", start, stop);
    set_start(instance, start, stop_defined ? stop : DBL_MAX);
    instance->unit.values[0] = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    Instance *const instance = begin_call(component, "fmi2EnterInitializationMode");
    if (instance == NULL || !require(instance, INSTANTIATED))
        return fmi2Error;
    instance->now.phase = INITIALISING;
    return fmi2OK;
}

/* Has no call failed? If one has, this one is refused. */
static bool require_sound(Instance *instance)
{
    if (instance->now.failure[0] == '\0')
        return true;
    refuse(instance, "%s is refused until fmi2Reset or fmi2SetFMUstate, the instance failed: %s", instance->function,
           instance->now.failure);
    return false;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    Instance *const instance = begin_call(component, "fmi2ExitInitializationMode");
    if (instance == NULL || !require(instance, INITIALISING) || !require_sound(instance) || !refresh(instance) ||
        !unit_prepare(&instance->unit, instance->unit.step_size))
        return fmi2Error;
    instance->now.phase = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    Instance *const instance = begin_call(component, "fmi2Terminate");
    if (instance == NULL || !require(instance, STEPPING))
        return fmi2Error;
    instance->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    Instance *const instance = begin_call(component, "fmi2Reset");
    if (instance == NULL)
        return fmi2Error;
    start_over(instance);
    return fmi2OK;
}

/* May a step of `step` s from `time` s be done? If not, it is refused. A step below the resolution of the host's clock
   could not be told from one that is repeated or left out. */
static bool check_step(Instance *instance, double time, double step)
{
    const Clock *const clock = &instance->now.clock;
    const double longest = LONGEST_STEP * instance->unit.step_size;
    const double resolution = clock_resolution(clock->time);
    if (!(step > 0.0 && isfinite(step)))
        refuse(instance, "communicationStepSize must be finite and > 0, got %r", step);
    else if (step > longest)
        refuse(instance, "communicationStepSize must be <= %r, got %r", longest, step);
    else if (!(step > resolution))
        refuse(instance, "communicationStepSize must be > %r, the resolution of the clock at %r s, got %r", resolution,
               clock->time, step);
    else if (!(fabs(time - clock->time) <= 1e-6 * step + resolution))
        refuse(instance, "currentCommunicationPoint must be %r, the end of the last step, got %r", clock->time, time);
    else if (fmin(clock->start + instance->unit.elapsed, clock->time) + step > clock->stop + 1e-3 * step + resolution)
        refuse(instance, "communicationStepSize must end by stopTime %r, got %r from %r on", clock->stop, step, time);
    else
        return true;
    return false;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean no_rollback)
{
    (void)no_rollback;
    Instance *const instance = begin_call(component, "fmi2DoStep");
    if (instance == NULL)
        return fmi2Error;
    Condition *const now = &instance->now;
    UnitInstance *const unit = &instance->unit;
    if (!require_sound(instance) || !require(instance, STEPPING) || !check_step(instance, time, step))
        return fmi2Error;
    const size_t count = instance->description->variable_count;
    double *const slopes = unit->values + count;
    unit->slopes = now->sloped ? slopes : NULL;
    keep_results(instance);
    instance->warned = false;
    if (!unit->hooks->advance(unit, unit->elapsed, step) || !check_results(instance)) {
        take_back_results(instance);
        return fmi2Error;
    }
    if (now->sloped)
        memset(slopes, 0, count * sizeof *slopes);
    now->sloped = false;
    clock_advance(&now->clock, time, step);
    unit->elapsed = clock_elapsed(&now->clock);
    unit->values[0] = unit->start + unit->elapsed;
    instance->incomplete = true;
    return instance->warned ? fmi2Warning : fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    Instance *const instance = begin_call(component, "fmi2CancelStep");
    if (instance == NULL)
        return fmi2Error;
    return decline(instance, "no step is under way, steps of this unit are done when fmi2DoStep returns");
}

/* Answers for questions about a step that is still under way: here there is never one. */
static fmi2Status no_status(fmi2Component component, const char *function, fmi2StatusKind kind, const void *value)
{
    Instance *const instance = begin_call(component, function);
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
    *value = ((Instance *)component)->now.clock.time;
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
