/* The tables of MfcCompensator. */

#ifndef MFC_COMPENSATOR_H
#define MFC_COMPENSATOR_H

#include "mfc_channel.h"

typedef struct {
    MfcParameters parameters;
    unsigned u_eff; /* value references of the first channel */
    unsigned u;
} MfcCompensatorData;

SHARED const UnitHooks mfc_compensator_hooks;

#endif
