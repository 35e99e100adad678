/* What the search for the modes of a group works with; see batch_modes.c. */
#ifndef FLEXBEAMS_GROUP_MODES_H
#define FLEXBEAMS_GROUP_MODES_H

#include "beam_plant.h"
#include "complex_lanes.h"
#include "lanes.h"

/* What a group needs: n coordinates, `vectors` inputs and outputs. */
typedef struct {
    size_t n;
    size_t vectors;
    Lanes *U;         /* (n, n) column by column; first C */
    Lanes *damping;   /* (n, n): G, then U'GU */
    Lanes *product;   /* (n, n): G U, column by column */
    Lanes *rows;      /* (outputs, n): R */
    Lanes *columns;   /* (vectors, n): B and C R', then the same in terms of U */
    Lanes *squares;   /* (n,): S^2 */
    Complex *v;       /* (n,) */
    Complex *forces;  /* (n,): U'GU v */
    Complex *results; /* (n, 1 + vectors): of each mode eigenvalue, inputs and outputs */
    Lanes *is_found;  /* 1 where all modes were found, else 0 */
} Modes;

INLINE Lanes product_of(size_t n, const Lanes *a, const Lanes *b)
{
    Lanes sums[4] = {lanes_of(0.0), lanes_of(0.0), lanes_of(0.0), lanes_of(0.0)};
    size_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (size_t k = 0; k < 4; k++)
            sums[k] = lanes_add_product(sums[k], a[i + k], b[i + k]);
    for (; i < n; i++)
        sums[0] = lanes_add_product(sums[0], a[i], b[i]);
    return lanes_add(lanes_add(sums[0], sums[1]), lanes_add(sums[2], sums[3]));
}

/* Everything in terms of the undamped modes, and the lanes that have them. */
void find_undamped(const Modes *m, const BeamPlantData *plant);
/* The damped mode that belongs to an undamped one, and its results; the lanes that have none are left out. */
void find_damped(const Modes *m, const BeamPlantData *plant, size_t mode);

#endif
