#include "windup.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "vectors.h"

#define DEPENDENT 1e-8 /* square of what is left of a unit vector that others imply */

/* Is a voltage beyond its limit, and its integral to grow further out? */
static bool winds_up(double commanded, double lowest, double highest, double growth)
{
    return (commanded > highest && growth > 0.0) || (commanded < lowest && growth < 0.0);
}

void hold_windup(size_t voltages, const double *integral_range, const double *commanded, VoltageRange limits,
                 double *growth, double *scratch)
{
    double *const held = scratch;
    double *const directions = scratch + voltages; /* orthonormal, `count` of them */
    size_t count = 0;
    memset(held, 0, voltages * sizeof *held);
    size_t k = 0;
    while (k < voltages) {
        if (held[k] != 0.0 || !winds_up(commanded[k], limits.lowest[k], limits.highest[k], growth[k])) {
            k++;
            continue;
        }
        double *const direction = directions + count * voltages;
        memcpy(direction, integral_range + k * voltages, voltages * sizeof *direction);
        for (size_t i = 0; i < count; i++) {
            const double *const other = directions + i * voltages;
            vector_add_scaled(voltages, -vector_product(voltages, other, direction), other, direction);
        }
        const double square = vector_product(voltages, direction, direction);
        if (square > DEPENDENT) {
            vector_add_scaled(voltages, -vector_product(voltages, direction, growth) / square, direction, growth);
            const double length = sqrt(square);
            for (size_t j = 0; j < voltages; j++)
                direction[j] /= length;
            count++;
        }
        growth[k] = 0.0;
        held[k] = 1.0;
        k = 0;
    }
}
