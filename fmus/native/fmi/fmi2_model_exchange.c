/* The functions of FMI 2.0 for model exchange: present, and refused. */

#include "instance.h"

static fmi2Status refuse_model_exchange(fmi2Component component, const char *function)
{
    Instance *const instance = begin_call(component, function);
    if (instance == NULL)
        return fmi2Error;
    return decline(instance, "is for model exchange, this unit is for co-simulation");
}

fmi2Status fmi2EnterEventMode(fmi2Component component)
{
    return refuse_model_exchange(component, "fmi2EnterEventMode");
}

fmi2Status fmi2NewDiscreteStates(fmi2Component component, fmi2EventInfo *event_info)
{
    (void)event_info;
    return refuse_model_exchange(component, "fmi2NewDiscreteStates");
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component component)
{
    return refuse_model_exchange(component, "fmi2EnterContinuousTimeMode");
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component component, fmi2Boolean no_rollback, fmi2Boolean *event_mode,
                                       fmi2Boolean *terminate)
{
    (void)no_rollback;
    (void)event_mode;
    (void)terminate;
    return refuse_model_exchange(component, "fmi2CompletedIntegratorStep");
}

fmi2Status fmi2SetTime(fmi2Component component, fmi2Real time)
{
    (void)time;
    return refuse_model_exchange(component, "fmi2SetTime");
}

fmi2Status fmi2SetContinuousStates(fmi2Component component, const fmi2Real states[], size_t count)
{
    (void)states;
    (void)count;
    return refuse_model_exchange(component, "fmi2SetContinuousStates");
}

fmi2Status fmi2GetDerivatives(fmi2Component component, fmi2Real derivatives[], size_t count)
{
    (void)derivatives;
    (void)count;
    return refuse_model_exchange(component, "fmi2GetDerivatives");
}

fmi2Status fmi2GetEventIndicators(fmi2Component component, fmi2Real indicators[], size_t count)
{
    (void)indicators;
    (void)count;
    return refuse_model_exchange(component, "fmi2GetEventIndicators");
}

fmi2Status fmi2GetContinuousStates(fmi2Component component, fmi2Real states[], size_t count)
{
    (void)states;
    (void)count;
    return refuse_model_exchange(component, "fmi2GetContinuousStates");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component component, fmi2Real nominals[], size_t count)
{
    (void)nominals;
    (void)count;
    return refuse_model_exchange(component, "fmi2GetNominalsOfContinuousStates");
}
