/* The modal forms of a group's plants, found side by side. */
#ifndef FLEXBEAMS_BATCH_MODES_H
#define FLEXBEAMS_BATCH_MODES_H

#include <stdbool.h>
#include <stddef.h>

#include "beam_plant.h"
#include "lanes.h"
#include "modal.h"
#include "plant_matrices.h"

/* Doubles of memory that this takes, aligned for lanes. */
size_t modes_size(const BeamPlantData *plant);
/* The plant of one lane. */
void set_modes_lane(double *memory, const BeamPlantData *plant, size_t lane, const PlantMatrices *matrices);
/* The modes of all lanes. */
void find_modes(double *memory, const BeamPlantData *plant);
/* The modal form of one lane, and its coordinates at rest (slots, patches); false where its modes were not found. */
bool read_modes(double *memory, const BeamPlantData *plant, size_t lane, const Modal *to, double *rest);

#endif
