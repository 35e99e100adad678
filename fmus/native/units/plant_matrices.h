/* The matrices of BeamPlant for the present parameters, M q'' + D q' + K q = L u + F force, in energy coordinates
   x = (R_K' q, R_M' q') with K = R_K R_K', M = R_M R_M': half the squared norm of x is the mechanical energy, and A is
   skew-symmetric less the damping. */

#ifndef PLANT_MATRICES_H
#define PLANT_MATRICES_H

#include "beam_plant.h"

/* x' = A x + B (u, force), y = C x. n coordinates, m inputs. */
typedef struct {
    double *A;        /* (2n, 2n) */
    double *B;        /* (2n, m) */
    double *C;        /* (points + gauges, 2n) */
    double *stations; /* (stations, n): w of x's first half */
    double *rest;     /* (2n, patches): x at rest under u */
    double *blocks;   /* (2n,): number of the block of M, a beam, that each state belongs to */
    double *scratch;
} PlantMatrices;

/* Doubles that the matrices take. */
INTERNAL size_t plant_matrices_size(const BeamPlantData *plant);
/* The matrices in `memory`. */
INTERNAL PlantMatrices plant_matrices_in(double *memory, const BeamPlantData *plant);
/* Computes them; false, with a line in the log, for parameters that no structure has. */
INTERNAL bool compute_plant_matrices(UnitInstance *unit, const PlantMatrices *matrices);
/* Changes of y (points + gauges,) at rest for those of parameters and voltages, unit->changes. With the matrices of the
   present parameters, whose A is lost. */
INTERNAL void differentiate_rest(const UnitInstance *unit, const PlantMatrices *matrices, double *y);

#endif
