/* Reduced normal equations of a block's photos and points; orip/prelim/refinement.py says what the arrays hold. */

#include "linear.h"
#include <stdlib.h>

typedef struct {
    const int64_t *photo, *start, *place;
    const double *vectors, *error, *rotations, *centres, *points, *factors;
    const uint8_t *is_free;
    int64_t count, point_count, size;
    double damping;
    double *photo_normals, *coupling, *inverse, *point_right, *band, *right;
} Network;

static void network_residuals(const Network *n, double *residual, uint8_t *in_front)
{
    for (int64_t point = 0; point < n->point_count; point++)
        for (int64_t row = n->start[point]; row < n->start[point + 1]; row++) {
            const int64_t photo = n->photo[row];
            in_front[row] = (uint8_t)project(n->rotations + 9 * photo, n->centres + 3 * photo, n->points + 3 * point,
                                             n->vectors + 3 * row, residual + 2 * row, NULL);
            residual[2 * row] /= n->error[row], residual[2 * row + 1] /= n->error[row];
        }
}

/* Enlarge the diagonal; what has no equations at all becomes regular. */
static void damp(double *normals, int size, double damping)
{
    double largest = 0.0;
    for (int i = 0; i < size; i++)
        largest = fmax(largest, normals[i * (size + 1)]);
    const double floor = largest > 0.0 ? 1e-12 * largest : 1.0;
    for (int i = 0; i < size; i++)
        normals[i * (size + 1)] += damping * normals[i * (size + 1)] + floor;
}

/* Subtract W V^-1 W^T of two rays of a point from the band; its rows are diagonals. */
static void subtract(Network *n, int64_t high, int64_t low, const double *product, const double *coupling)
{
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6 && 6 * high + i >= 6 * low + j; j++)
            n->band[(6 * (high - low) + i - j) * n->size + 6 * low + j] -= dot3(product + 3 * i, coupling + 3 * j);
}

static void eliminate_point(Network *n, int64_t point)
{
    double V[9] = {0.0}, g[3] = {0.0};
    const int64_t first = n->start[point], end = n->start[point + 1];
    for (int64_t row = first; row < end; row++) {
        const int64_t photo = n->photo[row], place = n->place[photo];
        double residual[2], partials[2][6], *W = n->coupling + 18 * row;
        memset(W, 0, 18 * sizeof(double));
        const int in_front = project(n->rotations + 9 * photo, n->centres + 3 * photo, n->points + 3 * point,
                                     n->vectors + 3 * row, residual, partials);
        const double weight = in_front ? n->factors[row] / (n->error[row] * n->error[row]) : 0.0;
        for (int r = 0; r < 2 && weight > 0.0; r++) {
            const double *p = partials[r], misclosure = weight * residual[r];
            const double by_point[3] = {-p[3], -p[4], -p[5]};
            for (int i = 0; i < 3; i++) {
                g[i] += by_point[i] * misclosure;
                for (int j = 0; j < 3; j++)
                    V[3 * i + j] += weight * by_point[i] * by_point[j];
            }
            if (place < 0)
                continue;
            for (int i = 0; i < 6; i++) {
                n->right[6 * place + i] += p[i] * misclosure;
                for (int j = 0; j < 6; j++)
                    n->photo_normals[36 * place + 6 * i + j] += weight * p[i] * p[j];
                for (int j = 0; j < 3; j++)
                    W[3 * i + j] += weight * p[i] * by_point[j];
            }
        }
    }
    double *inverse = n->inverse + 9 * point;
    memset(inverse, 0, 9 * sizeof(double));
    memcpy(n->point_right + 3 * point, g, sizeof(g));
    if (!n->is_free[point])
        return;
    damp(V, 3, n->damping);
    double minors[9];
    cross3(V + 3, V + 6, minors);
    cross3(V + 6, V, minors + 3);
    cross3(V, V + 3, minors + 6);
    const double determinant = dot3(V, minors);
    for (int k = 0; k < 9; k++)
        inverse[k] = minors[k] / determinant;
    for (int64_t row = first; row < end; row++) {
        const int64_t place = n->place[n->photo[row]];
        if (place < 0)
            continue;
        const double *W = n->coupling + 18 * row;
        double product[18];
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < 3; j++)
                product[3 * i + j] = dot3(W + 3 * i, inverse + 3 * j);
        for (int i = 0; i < 6; i++)
            n->right[6 * place + i] -= dot3(product + 3 * i, g);
        for (int64_t other = first; other < end; other++) {
            const int64_t low = n->place[n->photo[other]];
            if (low >= 0 && low <= place)
                subtract(n, place, low, product, n->coupling + 18 * other);
        }
    }
}

static void network_normals(Network *n)
{
    for (int64_t point = 0; point < n->point_count; point++)
        eliminate_point(n, point);
    for (int64_t place = 0; place < n->size / 6; place++) {
        double *normals = n->photo_normals + 36 * place;
        damp(normals, 6, n->damping);
        for (int i = 0; i < 6; i++)
            for (int j = 0; j <= i; j++)
                n->band[(i - j) * n->size + 6 * place + j] += normals[6 * i + j];
    }
}

/* Corrections of the points from those of the photos; the solution has the sign of the right-hand side. */
static void network_points(const Network *n, const double *solution, double *corrections)
{
    for (int64_t point = 0; point < n->point_count; point++) {
        double g[3];
        memcpy(g, n->point_right + 3 * point, sizeof(g));
        for (int64_t row = n->start[point]; row < n->start[point + 1]; row++) {
            const int64_t place = n->place[n->photo[row]];
            for (int i = 0; i < 6 && place >= 0; i++)
                for (int j = 0; j < 3; j++)
                    g[j] -= n->coupling[18 * row + 3 * i + j] * solution[6 * place + i];
        }
        for (int j = 0; j < 3; j++)
            corrections[3 * point + j] = -dot3(n->inverse + 9 * point + 3 * j, g);
    }
}
