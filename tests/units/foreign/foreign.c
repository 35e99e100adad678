/* A third-party unit of the tests: what it does is a list of rules in resources/rules.txt, one a line.
 * Value references count from 0 for each type, as FMI 2.0 allows.
 *   start R|I|B|S reference value     the start value
 *   map R|I|B output input gain       real: gain * input; integer: gain * input; Boolean: not input
 *   sum output input gain             adds gain * real input to a real output
 *   letters output input              integer output: characters of a string
 *   inverse output input              real 1 / input; setting the input to 0 or less is an error
 *   clock output                      real output: the time
 *   warn|error|fatal text             logs the text at each step, with status OK
 *   end time                          discards the step from that time on, as terminated
 *   finish time                       as end, after the step is done
 *   discard time                      discards the step from that time on
 *   crash|hang|exit when              instantiate or step
 */
#include "fmi2Functions.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VALUES = 64, RULES = 128, TEXT = 96 };

typedef struct {
    char verb[16];
    char type;
    unsigned output, input;
    double gain;
    char text[TEXT];
} Rule;

typedef struct {
    fmi2CallbackFunctions functions;
    char name[TEXT];
    double reals[VALUES];
    int integers[VALUES];
    int booleans[VALUES];
    char strings[VALUES][TEXT];
    Rule rules[RULES];
    size_t n_rules;
    double time;
    int ended;
} Unit;

static void misbehave(const Unit *unit, const char *when)
{
    for (size_t k = 0; k < unit->n_rules; k++) {
        const Rule *const rule = &unit->rules[k];
        if (strcmp(rule->text, when) != 0)
            continue;
        if (strcmp(rule->verb, "crash") == 0)
            abort();
        if (strcmp(rule->verb, "exit") == 0)
            exit(0);
        if (strcmp(rule->verb, "hang") == 0)
            for (volatile int forever = 1; forever;) {
            }
    }
}

static void start_values(Unit *unit)
{
    memset(unit->reals, 0, sizeof unit->reals);
    memset(unit->integers, 0, sizeof unit->integers);
    memset(unit->booleans, 0, sizeof unit->booleans);
    memset(unit->strings, 0, sizeof unit->strings);
    for (size_t k = 0; k < unit->n_rules; k++) {
        const Rule *const rule = &unit->rules[k];
        if (strcmp(rule->verb, "start") != 0)
            continue;
        if (rule->type == 'R')
            unit->reals[rule->output] = atof(rule->text);
        else if (rule->type == 'I')
            unit->integers[rule->output] = atoi(rule->text);
        else if (rule->type == 'B')
            unit->booleans[rule->output] = atoi(rule->text);
        else
            strcpy(unit->strings[rule->output], rule->text);
    }
}

static void read_rules(Unit *unit, const char *resources)
{
    char path[1024];
    char line[256];
    const char *folder = strncmp(resources, "file://", 7) == 0 ? resources + 7 : resources;
    snprintf(path, sizeof path, "%s/rules.txt", folder);
    FILE *const file = fopen(path, "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL && unit->n_rules < RULES) {
        Rule rule = {.gain = 1.0, .type = 'R'};
        sscanf(line, "%15s", rule.verb);
        if (strcmp(rule.verb, "start") == 0)
            sscanf(line, "%*s %c %u %95[^\n]", &rule.type, &rule.output, rule.text);
        else if (strcmp(rule.verb, "map") == 0)
            sscanf(line, "%*s %c %u %u %lf", &rule.type, &rule.output, &rule.input, &rule.gain);
        else if (strcmp(rule.verb, "end") == 0 || strcmp(rule.verb, "finish") == 0 || strcmp(rule.verb, "discard") == 0)
            sscanf(line, "%*s %lf", &rule.gain);
        else if (sscanf(line, "%*s %u %u %lf", &rule.output, &rule.input, &rule.gain) < 1)
            sscanf(line, "%*s %95[^\n]", rule.text);
        unit->rules[unit->n_rules++] = rule;
    }
    if (file != NULL)
        fclose(file);
}

static void evaluate(Unit *unit)
{
    for (size_t k = 0; k < unit->n_rules; k++) {
        const Rule *const rule = &unit->rules[k];
        if (strcmp(rule->verb, "map") == 0 && rule->type == 'R')
            unit->reals[rule->output] = rule->gain * unit->reals[rule->input];
        else if (strcmp(rule->verb, "map") == 0 && rule->type == 'I')
            unit->integers[rule->output] = (int)rule->gain * unit->integers[rule->input];
        else if (strcmp(rule->verb, "map") == 0)
            unit->booleans[rule->output] = !unit->booleans[rule->input];
        else if (strcmp(rule->verb, "sum") == 0)
            unit->reals[rule->output] += rule->gain * unit->reals[rule->input];
        else if (strcmp(rule->verb, "letters") == 0)
            unit->integers[rule->output] = (int)strlen(unit->strings[rule->input]);
        else if (strcmp(rule->verb, "inverse") == 0)
            unit->reals[rule->output] = 1.0 / unit->reals[rule->input];
        else if (strcmp(rule->verb, "clock") == 0)
            unit->reals[rule->output] = unit->time;
    }
}

const char *fmi2GetTypesPlatform(void)
{
    return "default";
}
const char *fmi2GetVersion(void)
{
    return "2.0";
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)type, (void)guid, (void)visible, (void)logging;
    Unit *const unit = calloc(1, sizeof *unit);
    unit->functions = *functions;
    snprintf(unit->name, sizeof unit->name, "%s", name);
    read_rules(unit, resources);
    misbehave(unit, "instantiate");
    start_values(unit);
    return unit;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop)
{
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    ((Unit *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return c == NULL ? fmi2Error : fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return c == NULL ? fmi2Error : fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c)
{
    return c == NULL ? fmi2Error : fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    start_values(c);
    ((Unit *)c)->ended = 0;
    return fmi2OK;
}

#define GETTER(Name, Type, field)                                                                                      \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference r[], size_t n, Type values[])                   \
    {                                                                                                                  \
        evaluate(c);                                                                                                   \
        for (size_t k = 0; k < n; k++)                                                                                 \
            values[k] = ((Unit *)c)->field[r[k]];                                                                      \
        return fmi2OK;                                                                                                 \
    }
#define SETTER(Name, Type, field)                                                                                      \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference r[], size_t n, const Type values[])             \
    {                                                                                                                  \
        for (size_t k = 0; k < n; k++)                                                                                 \
            ((Unit *)c)->field[r[k]] = values[k];                                                                      \
        return fmi2OK;                                                                                                 \
    }
GETTER(Real, fmi2Real, reals)
GETTER(Integer, fmi2Integer, integers)
GETTER(Boolean, fmi2Boolean, booleans)
GETTER(String, fmi2String, strings)
SETTER(Integer, fmi2Integer, integers)
SETTER(Boolean, fmi2Boolean, booleans)

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[])
{
    Unit *const unit = c;
    for (size_t k = 0; k < n; k++) {
        for (size_t j = 0; j < unit->n_rules; j++)
            if (strcmp(unit->rules[j].verb, "inverse") == 0 && unit->rules[j].input == r[k] && !(values[k] > 0))
                return fmi2Error;
        unit->reals[r[k]] = values[k];
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String values[])
{
    for (size_t k = 0; k < n; k++)
        snprintf(((Unit *)c)->strings[r[k]], TEXT, "%s", values[k]);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_restore)
{
    (void)no_restore;
    Unit *const unit = c;
    misbehave(unit, "step");
    for (size_t k = 0; k < unit->n_rules; k++) {
        const Rule *const rule = &unit->rules[k];
        const fmi2Status status = strcmp(rule->verb, "warn") == 0    ? fmi2Warning
                                  : strcmp(rule->verb, "error") == 0 ? fmi2Error
                                  : strcmp(rule->verb, "fatal") == 0 ? fmi2Fatal
                                                                     : fmi2OK;
        if (status != fmi2OK)
            unit->functions.logger(NULL, "any", status, NULL, "%s at %g", rule->text, time);
        if (strcmp(rule->verb, "finish") == 0 && time >= rule->gain) {
            unit->ended = 1;
            unit->time = time + step;
            return fmi2Discard;
        }
        const int ends = strcmp(rule->verb, "end") == 0;
        if ((ends || strcmp(rule->verb, "discard") == 0) && time >= rule->gain) {
            unit->ended = ends;
            return fmi2Discard;
        }
    }
    unit->time = time + step;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated)
        return fmi2Discard;
    *value = ((Unit *)c)->ended;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    *value = ((Unit *)c)->time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

#define REFUSED(Name, ...)                                                                                             \
    fmi2Status fmi2##Name(__VA_ARGS__);                                                                                \
    fmi2Status fmi2##Name(__VA_ARGS__)                                                                                 \
    {                                                                                                                  \
        return fmi2Error;                                                                                              \
    }
REFUSED(GetFMUstate, fmi2Component c, fmi2FMUstate *s)
REFUSED(SetFMUstate, fmi2Component c, fmi2FMUstate s)
REFUSED(FreeFMUstate, fmi2Component c, fmi2FMUstate *s)
REFUSED(SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n)
REFUSED(SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n)
REFUSED(DeSerializeFMUstate, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
REFUSED(GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference u[], size_t nu,
        const fmi2ValueReference k[], size_t nk, const fmi2Real d[], fmi2Real v[])
REFUSED(SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer o[],
        const fmi2Real v[])
REFUSED(GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer o[],
        fmi2Real v[])
REFUSED(CancelStep, fmi2Component c)
REFUSED(GetStatus, fmi2Component c, const fmi2StatusKind k, fmi2Status *s)
REFUSED(GetIntegerStatus, fmi2Component c, const fmi2StatusKind k, fmi2Integer *s)
REFUSED(GetStringStatus, fmi2Component c, const fmi2StatusKind k, fmi2String *s)
