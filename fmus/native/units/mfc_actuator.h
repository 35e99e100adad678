/* The tables of MfcActuator. */

#ifndef MFC_ACTUATOR_H
#define MFC_ACTUATOR_H

#include "mfc_channel.h"

typedef struct {
    MfcParameters parameters;
    /* value references of the first channel */
    unsigned u;
    unsigned u_eff;
    unsigned voltage;
    unsigned lag;
    unsigned slew_rate;
    unsigned resolution;
} MfcActuatorData;

SHARED const UnitHooks mfc_actuator_hooks;

#endif
