/* The generated tables of BeamPlant. */

#ifndef BEAM_PLANT_H
#define BEAM_PLANT_H

#include "unit.h"

#define plant fmi2FullName(plant)
#define plant_parameters fmi2FullName(plant_parameters)
#define plant_terms fmi2FullName(plant_terms)
#define plant_blocks fmi2FullName(plant_blocks)
#define plant_tips fmi2FullName(plant_tips)
#define plant_outputs fmi2FullName(plant_outputs)

typedef struct {
    size_t coordinates;  /* n */
    size_t patches, beams, points, gauges, stations, parameters, terms;
    /* value references, of an array its first */
    unsigned u, force, y_pi, energy, start_at_rest_under, strain_noise_std, noise_seed;
} plant_table;

typedef struct {
    unsigned reference;
    bool may_vanish;  /* 0 is possible */
} plant_parameter;

/* parameter x block, added to a matrix at rows (and columns) from `start` on; L has one column for each pair. */
typedef struct {
    unsigned parameter;  /* value reference */
    char matrix;         /* M, D, K or L */
    size_t start, column, size;
    size_t block;        /* position in plant_blocks of the (size, size) or, for L, (size, 1) block */
} plant_term;

SHARED const plant_table plant;
SHARED const plant_parameter plant_parameters[];
SHARED const plant_term plant_terms[];
SHARED const double plant_blocks[];
SHARED const double plant_tips[];     /* (beams, n): deflection of each tip */
SHARED const double plant_outputs[];  /* (points + gauges + stations, n): y_pi, y_pm and w of q */

#endif
