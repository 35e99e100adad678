/* Channels of MfcActuator and MfcCompensator: hysteresis and creep of a pair of patches.

   z = w_0 v + sum_i w_i p_i is a superposition of play operators, h = z + sum_j s_j D_j(z) one of one-sided dead zones,
   u_eff = h + sum_i a_i c_i adds creep, c_i' = (h - c_i) / tau_i. */

#ifndef MFC_CHANNEL_H
#define MFC_CHANNEL_H

#include "unit.h"

typedef struct {
    size_t channels;
    size_t plays; /* operators of each channel */
    size_t dead_zones;
    size_t creeps;
    size_t extremes;        /* voltages of the history */
    unsigned linear_weight; /* value references, of (channels, operators) the first */
    unsigned play_threshold;
    unsigned play_weight;
    unsigned dead_zone_threshold;
    unsigned dead_zone_slope;
    unsigned creep_time;
    unsigned creep_weight;
    unsigned history;
    /* of (channels,) the first */
    unsigned face_minimum;
    unsigned face_maximum;
    unsigned supply;
    unsigned saturated;
    unsigned saturated_steps;
} MfcParameters;

/* One channel: its part of the values and of the state. */
typedef struct {
    size_t plays;
    size_t dead_zones;
    size_t creeps;
    double linear_weight;              /* w_0 */
    const double *play_threshold;      /* r, ascending, V */
    const double *play_weight;         /* w */
    const double *dead_zone_threshold; /* rho, ascending, V */
    const double *dead_zone_slope;     /* s */
    const double *creep_time;          /* tau, s */
    const double *creep_weight;        /* a */
    double *voltage;                   /* v, V */
    double *play;                      /* p, V */
    double *creep;                     /* c, V */
    double limit;                      /* largest voltage, V */
} MfcChannel;

/* Doubles of the state of all channels, which comes first in the state of a unit. */
INTERNAL size_t mfc_state_size(const MfcParameters *parameters);
INTERNAL MfcChannel mfc_channel(const UnitInstance *unit, const MfcParameters *parameters, size_t k);

/* Rest after the history: the last voltage of each channel into `voltages` (channels,); false where a parameter breaks
   a rule. */
INTERNAL bool mfc_start(UnitInstance *unit, const MfcParameters *parameters, double *voltages);
/* The change of the first u_eff of channel k for `changes` of the parameters, after mfc_start. */
INTERNAL double mfc_differentiate(const UnitInstance *unit, const MfcParameters *parameters, size_t k);
/* The voltage has changed to `voltage` without turning. */
INTERNAL void mfc_move(const MfcChannel *channel, double voltage);
INTERNAL double mfc_superposition(const MfcChannel *channel);                 /* z, V */
INTERNAL double mfc_through_dead_zones(const MfcChannel *channel, double z);  /* h, V */
INTERNAL double mfc_hysteresis(const MfcChannel *channel);                    /* h of the present plays, V */
INTERNAL double mfc_with_creep(const MfcChannel *channel, double hysteresis); /* u_eff, V */
/* Creep over `step` s while h holds. */
INTERNAL void mfc_relax(const MfcChannel *channel, double hysteresis, double step);

/* Counting of steps with a voltage beyond the limit: none yet in this step; one of channel k, that `asked` is beyond at
   `time` s since the start, the first with a line. */
INTERNAL void mfc_begin_count(UnitInstance *unit, const MfcParameters *parameters);
INTERNAL void mfc_count_saturated(UnitInstance *unit, const MfcParameters *parameters, const char *name, double asked,
                                  double limit, double time);
/* Are parameters and state what a saved state can have? */
INTERNAL bool mfc_restore(UnitInstance *unit, const MfcParameters *parameters);

#endif
