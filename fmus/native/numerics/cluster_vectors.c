/* With the couplings E of different clusters, those vectors X (n, s) which have the unit matrix at the s coordinates of
   a cluster and span what A maps onto itself satisfy

     A X = X M,  M = Lambda + N at the cluster,  N = E X there,
     X Lambda - Lambda X = E X - X N elsewhere,

   which is solved by repetition: eigenvalues of different clusters are far apart, measured by their couplings, so an
   error shrinks to a few per cent each time. M has the eigenvalues and tells the eigenvectors from X, however close
   they are. Left vectors are found as X of the transpose. */

#include "cluster_vectors.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "complex_number.h"
#include "modes.h"
#include "vectors.h"

#define FEW_SWEEPS 12
#define SETTLED (4 * DBL_EPSILON) /* change of X */
#define NEARLY_SETTLED 1e-12      /* the one before, as changes may be small now and then */
#define LARGEST_ENTRY 0.1         /* of X elsewhere */

/* y = E x, of a vector x of the cluster that begins at `own`. */
static void apply_couplings(const VectorSide *side, size_t own, const double *x, double *y, double *leaving)
{
    const ModeClusters *const clusters = side->clusters;
    const size_t n = side->blocks->n;
    const size_t links = side->blocks->links;
    double *const all = leaving;          /* along each link, from all clusters */
    double *const others = all + links;   /* from all but its own */
    double *const parts = others + links; /* from each cluster of several modes */
    for (size_t k = 0; k < links; k++) {
        const double *const from = side->from + k * n;
        const size_t first = clusters->alone[side->from_block[k]];
        const size_t count = clusters->alone[side->from_block[k] + 1] - first;
        double *part = parts + k;
        double own_part = 0.0;
        others[k] = vector_product(count, from + first, x + first);
        for (size_t i = 0; i < clusters->shared; i = clusters->end[i], part += links) {
            *part = vector_product(clusters->end[i] - i, from + i, x + i);
            if (i == own)
                own_part = *part;
            else
                others[k] += *part;
        }
        all[k] = others[k] + own_part;
    }
    memset(y, 0, n * sizeof *y);
    for (size_t k = 0; k < links; k++) {
        const double *const to = side->to + k * n;
        const size_t first = clusters->alone[side->to_block[k]];
        const size_t count = clusters->alone[side->to_block[k] + 1] - first;
        const double *part = parts + k;
        vector_add_scaled(count, all[k], to + first, y + first);
        for (size_t i = 0; i < clusters->shared; i = clusters->end[i], part += links)
            vector_add_scaled(clusters->end[i] - i, i == own ? others[k] : all[k] - *part, to + i, y + i);
    }
}

/* 1 / a, or a large number in place of one that is larger. */
static Complex inverse_of(Complex a)
{
    const double square = a.real * a.real + a.imaginary * a.imaginary;
    if (square < 1e-200)
        return (Complex){1e100, 0.0};
    return (Complex){a.real / square, -a.imaginary / square};
}

/* Of an eigenvalue the inverse distance to another one and the one to its conjugate stand in its two places. They are
   complex: for a pair of the cluster the real parts are in the first of its rows and the imaginary ones in the second.
   A real one has equal or conjugate distances, and a single row: real parts, imaginary ones. */
void fill_distances(const VectorSide *side, const ClusterVectors *cluster)
{
    const double *const real = side->clusters->real;
    const double *const imaginary = side->clusters->imaginary;
    const size_t n = side->blocks->n;
    for (size_t j = 0, width; j < cluster->size; j += width) {
        const size_t own = cluster->begin + j;
        width = mode_width(imaginary, own);
        double *const row = cluster->inverses + j * n;
        for (size_t i = 0, height; i < n; i += height) {
            height = mode_width(imaginary, i);
            const double distance = real[own] - real[i];
            const Complex near = inverse_of((Complex){distance, imaginary[own] - imaginary[i]});
            const Complex far = inverse_of((Complex){distance, imaginary[own] + imaginary[i]});
            row[i] = near.real;
            row[i + height - 1] = height == 1 ? near.real : width == 1 ? near.imaginary : far.real;
            row[i + (width - 1) * n] = width == 1 ? near.real : near.imaginary;
            if (width == 2 && height == 2)
                row[i + 1 + n] = far.imaginary;
        }
    }
}

typedef struct {
    double change;
    double size; /* of the entries now */
} Update;

/* The entries of a pair's two vectors for one other mode, from those of E X - X N there. A pair of entries has a part
   along (1, i) and one along (1, -i), eigenvectors of Lambda. */
static Update update_pair(double sign, size_t height, const double *const inverses[2], const double *const y[2],
                          double *const x[2])
{
    const Complex near = {inverses[0][0], sign * inverses[1][0]};
    const Complex first = {y[0][0], y[1][0]};
    Complex values[2] = {complex_product(first, near), {0.0, 0.0}};
    if (height == 2) {
        const Complex second = {y[0][1], y[1][1]};
        const Complex far = {inverses[0][1], sign * inverses[1][1]};
        const Complex along = {(first.real + second.imaginary) / 2, (first.imaginary - second.real) / 2};
        const Complex against = {(first.real - second.imaginary) / 2, (first.imaginary + second.real) / 2};
        const Complex a = complex_product(along, near);
        const Complex b = complex_product(against, far);
        values[0] = (Complex){a.real + b.real, a.imaginary + b.imaginary};
        values[1] = (Complex){b.imaginary - a.imaginary, a.real - b.real};
    }
    Update update = {0.0, 0.0};
    for (size_t k = 0; k < height; k++) {
        update.change += fabs(values[k].real - x[0][k]) + fabs(values[k].imaginary - x[1][k]);
        update.size += fabs(values[k].real) + fabs(values[k].imaginary);
        x[0][k] = values[k].real;
        x[1][k] = values[k].imaginary;
    }
    return update;
}

/* The same of a real eigenvalue's vector. */
static Update update_real(double sign, size_t height, const double *inverses, const double *y, double *x)
{
    const Complex inverse = {inverses[0], height == 2 ? -sign * inverses[1] : 0.0};
    const Complex product = complex_product((Complex){y[0], height == 2 ? y[1] : 0.0}, inverse);
    const double values[2] = {product.real, product.imaginary};
    Update update = {0.0, 0.0};
    for (size_t k = 0; k < height; k++) {
        update.change += fabs(values[k] - x[k]);
        update.size += fabs(values[k]);
        x[k] = values[k];
    }
    return update;
}

/* X from E X - X N; how much it changes at most. Joins the cluster to those where X is large or changes by more than
   `most`; HUGE_VAL then. */
static double update_vectors(const VectorSide *side, const ClusterVectors *cluster, double most, double *X)
{
    const double *const imaginary = side->clusters->imaginary;
    const size_t n = side->blocks->n;
    double largest = 0.0;
    for (size_t j = 0, width; j < cluster->size; j += width) {
        width = mode_width(imaginary, cluster->begin + j);
        for (size_t i = 0, height; i < n; i += height) {
            height = i == cluster->begin ? cluster->size : mode_width(imaginary, i);
            if (i == cluster->begin)
                continue;
            const size_t at = j * n + i;
            const size_t second = at + (width - 1) * n; /* the same row where there is one only */
            const double *const inverses[2] = {cluster->inverses + at, cluster->inverses + second};
            const double *const y[2] = {cluster->Y + at, cluster->Y + second};
            double *const x[2] = {X + at, X + second};
            const Update update = width == 2 ? update_pair(side->sign, height, inverses, y, x)
                                             : update_real(side->sign, height, inverses[0], y[0], x[0]);
            const bool is_small = update.size <= LARGEST_ENTRY && update.change <= most; /* no NaN */
            if (!is_small)
                join_clusters(side->clusters, n, cluster->begin, i);
            largest = fmax(largest, is_small ? update.change : HUGE_VAL);
        }
    }
    return largest;
}

/* One repetition; how much X changes at most, HUGE_VAL as above. */
static double sweep_vectors(const VectorSide *side, const ClusterVectors *cluster, double most, double *X)
{
    const size_t n = side->blocks->n;
    const size_t size = cluster->size;
    for (size_t j = 0; j < size; j++)
        apply_couplings(side, cluster->begin, X + j * n, cluster->Y + j * n, cluster->leaving);
    for (size_t j = 0; j < size; j++)
        for (size_t i = 0; i < size; i++)
            cluster->N[i * size + j] = cluster->Y[j * n + cluster->begin + i];
    for (size_t j = 0; j < size; j++)
        for (size_t i = 0; i < size; i++)
            if (cluster->N[i * size + j] != 0.0)
                vector_add_scaled(n, -cluster->N[i * size + j], X + i * n, cluster->Y + j * n);
    return update_vectors(side, cluster, most, X);
}

/* X (size, n), vectors row by row; false where they do not settle. */
NOT_INLINED bool find_cluster_vectors(const VectorSide *side, const ClusterVectors *cluster, double *X)
{
    const size_t n = side->blocks->n;
    memset(X, 0, cluster->size * n * sizeof *X);
    for (size_t j = 0; j < cluster->size; j++)
        X[j * n + cluster->begin + j] = 1.0;
    double before = 1.0;
    double change = 1.0;
    for (size_t sweep = 0; !(change <= SETTLED && before <= NEARLY_SETTLED) && change < HUGE_VAL; sweep++) {
        const double most = sweep < FEW_SWEEPS ? HUGE_VAL : fmax(SETTLED, fmax(before, change) / 8);
        before = change;
        change = sweep_vectors(side, cluster, most, X);
    }
    return change <= SETTLED;
}
