/* The tables of BeamPlant. */

#ifndef BEAM_PLANT_H
#define BEAM_PLANT_H

#include "unit.h"

typedef struct {
    unsigned reference; /* value reference */
    bool may_vanish;    /* 0 is possible */
} PlantParameter;

typedef enum { MASS, DAMPING, STIFFNESS, INPUT_GAIN } PlantMatrix;

/* parameter x block, added to a matrix at rows (and columns) from `start` on; the input gain has one column for each
   patch pair. */
typedef struct {
    unsigned parameter; /* value reference */
    PlantMatrix matrix;
    size_t start;
    size_t column;
    size_t size;
    size_t block; /* index in `blocks` of the (size, size) block, of the input gain's (size, 1) block */
} PlantTerm;

typedef struct {
    size_t coordinates; /* n */
    size_t patches;
    size_t beams;
    size_t points;
    size_t gauges;
    size_t stations;
    size_t parameter_count;
    size_t term_count;
    /* value references, of an array its first; behind y_pi come y_pm and w */
    unsigned u;
    unsigned force;
    unsigned y_pi;
    unsigned energy;
    unsigned start_at_rest_under;
    unsigned strain_noise_std;
    unsigned noise_seed;
    const PlantParameter *parameters; /* (parameter_count,) */
    const PlantTerm *terms;           /* (term_count,) */
    const double *blocks;
    const double *tips;    /* (beams, n): deflection of each tip */
    const double *outputs; /* (points + gauges + stations, n): y_pi, y_pm and w of q */
} BeamPlantData;

INTERNAL const UnitHooks beam_plant_hooks;

#endif
