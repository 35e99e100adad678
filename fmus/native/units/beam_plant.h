/* The tables of BeamPlant. */

#ifndef BEAM_PLANT_H
#define BEAM_PLANT_H

#include "unit.h"

typedef struct {
    unsigned reference; /* value reference */
    bool may_vanish;    /* 0 is possible */
} PlantParameter;

typedef enum { MASS, DAMPING, STIFFNESS, INPUT_GAIN } PlantMatrix;

/* parameter x block, added to some rows of a matrix and to the columns of the same numbers; of the input gain, which
   has a column for each patch pair, to one column. */
typedef struct {
    unsigned parameter; /* value reference */
    PlantMatrix matrix;
    size_t column;
    size_t size;
    size_t rows;  /* index in `rows` of the (size,) numbers of the rows */
    size_t block; /* index in `blocks` of the (size, size) block, of the input gain's (size, 1) block */
} PlantTerm;

/* Rows of which most entries are 0: row i has the `values` from starts[i] to starts[i + 1] in their `columns`. */
typedef struct {
    const unsigned *starts;
    const unsigned *columns;
    const double *values;
} SparseRows;

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
    const unsigned *rows;
    const double *blocks;
    SparseRows outputs; /* (points + gauges + stations + beams, n): y_pi, y_pm, w and the tips' deflections */
} BeamPlantData;

SHARED const UnitHooks beam_plant_hooks;

#endif
