/* Lengths of the residuals of a block's rays, as in misplaced_photos.py. */

#include "../compiled/linear.h"
#include <string.h>

/* All rays of a block, in any order, and its photos and points; NaN where they are not oriented or not known. */
typedef struct {
    const int64_t *photo, *point;
    const double *vectors, *error, *rotations, *centres, *points;
    int64_t count, point_count;
} RaysOfBlock;

static double residual_length(const RaysOfBlock *b, int64_t row)
{
    const double *X = b->points + 3 * b->point[row], *O = b->centres + 3 * b->photo[row];
    const double *R = b->rotations + 9 * b->photo[row], *v = b->vectors + 3 * row;
    const double d[3] = {X[0] - O[0], X[1] - O[1], X[2] - O[2]};
    double u[3];
    for (int i = 0; i < 3; i++)
        u[i] = d[0] * R[i] + d[1] * R[3 + i] + d[2] * R[6 + i];
    if (!(u[2] < 0.0))
        return isnan(u[2]) ? NAN : INFINITY;
    const double scale = v[2] / u[2], x = u[0] * scale - v[0], y = u[1] * scale - v[1];
    return sqrt(x * x + y * y) / b->error[row];
}

/* `together` has room for a number of each point: how many oriented photos see it. */
static void residual_lengths(const RaysOfBlock *b, int64_t *together, double *lengths)
{
    memset(together, 0, (size_t)b->point_count * sizeof(int64_t));
    for (int64_t row = 0; row < b->count; row++)
        together[b->point[row]] += isfinite(b->centres[3 * b->photo[row]]) != 0;
    for (int64_t row = 0; row < b->count; row++) {
        const int64_t point = b->point[row];
        const int is_lost = isfinite(b->centres[3 * b->photo[row]]) && together[point] > 1 && !isfinite(b->points[3 * point]);
        lengths[row] = is_lost ? INFINITY : residual_length(b, row);
    }
}
