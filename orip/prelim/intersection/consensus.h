/* Positions of points where most of their rays meet, one point after the other, as in orip/geometry/rays.py; lengths of
 * the residuals of rays, as in misplaced_photos.py.
 */

#include "../compiled/linear.h"
#include <string.h>

/* All rays of a block, and which photos are oriented; `point` says of each ray which point it is of, or of each point
 * where its rays begin.
 */
typedef struct {
    const int64_t *photo, *point;
    const double *vectors, *error, *rotations, *centres;
    const uint8_t *oriented;
    int64_t count, points;
} OrientedRays;

/* As in orip/geometry/rays.py: rays of a point that are compared, and where two rays do not meet. */
enum { FEWEST_COMPARED = 3, MOST_COMPARED = 10 };
#define PARALLEL 5e-11

typedef struct {
    const double *centre, *R, *vector;
    double error, direction[3];
} PhotoRay;

static void direct(PhotoRay *ray)
{
    double d[3];
    times3(ray->R, ray->vector, d);
    const double length = sqrt(dot3(d, d));
    for (int i = 0; i < 3; i++)
        ray->direction[i] = d[i] / length;
}

/* The squared residual of a ray at a point; infinite where that is not in front, NaN where it is not known. */
static double square_at(const PhotoRay *ray, const double *X)
{
    const double d[3] = {X[0] - ray->centre[0], X[1] - ray->centre[1], X[2] - ray->centre[2]};
    double u[3];
    transposed_times3(ray->R, d, u);
    if (!(u[2] < 0.0))
        return isnan(u[2]) ? NAN : INFINITY;
    const double scale = ray->vector[2] / u[2];
    const double x = u[0] * scale - ray->vector[0], y = u[1] * scale - ray->vector[1];
    return x * x + y * y;
}

/* That in units of its variance; infinite where it is not known, too. */
static double standard_square_at(const PhotoRay *ray, const double *X)
{
    const double square = square_at(ray, X);
    return isnan(square) ? INFINITY : square / (ray->error * ray->error);
}

/* The sum of squared standard residuals, none larger than `most`. */
static double cost_at(const PhotoRay *rays, int count, const double *X, double most)
{
    double cost = 0.0;
    for (int k = 0; k < count; k++)
        cost += fmin(standard_square_at(rays + k, X), most);
    return cost;
}

/* Where the chosen rays meet; whether they do. */
static int meet_chosen(const PhotoRay *rays, int count, const uint8_t *chosen, double *X)
{
    double a = 0.0, b = 0.0, c = 0.0, f = 0.0, g = 0.0, h = 0.0, p = 0.0, q = 0.0, r = 0.0;
    const double *base = rays[0].centre;
    for (int k = 0; k < count; k++) {
        if (!chosen[k])
            continue;
        const double *d = rays[k].direction, *centre = rays[k].centre;
        const double o[3] = {centre[0] - base[0], centre[1] - base[1], centre[2] - base[2]}, along = dot3(d, o);
        /* squares of two components, as they are exact where rays are parallel to an axis */
        a += d[1] * d[1] + d[2] * d[2], b += d[0] * d[0] + d[2] * d[2], c += d[0] * d[0] + d[1] * d[1];
        f -= d[1] * d[2], g -= d[0] * d[2], h -= d[0] * d[1];
        p += o[0] - d[0] * along, q += o[1] - d[1] * along, r += o[2] - d[2] * along;
    }
    const double aa = b * c - f * f, bb = a * c - g * g, cc = a * b - h * h;
    const double ff = g * h - a * f, gg = h * f - b * g, hh = f * g - c * h;
    const double determinant = a * aa + h * hh + g * gg;
    X[0] = (aa * p + hh * q + gg * r) / determinant + base[0];
    X[1] = (hh * p + bb * q + ff * r) / determinant + base[1];
    X[2] = (gg * p + ff * q + cc * r) / determinant + base[2];
    return determinant > PARALLEL * (aa + bb + cc) * (a + b + c);
}

static void take_if_better(const PhotoRay *rays, int count, const uint8_t *chosen, double most, double *best,
                           double *least)
{
    double tried[3];
    if (!meet_chosen(rays, count, chosen, tried))
        return;
    const double cost = cost_at(rays, count, tried, most);
    if (cost < *least) {
        *least = cost;
        for (int i = 0; i < 3; i++)
            best[i] = tried[i];
    }
}

/* Move a point to where most of its rays meet, unless as many meet where it is, or nearly so. */
static void move_to_consensus(const PhotoRay *rays, int count, double most, double *X)
{
    double best[3] = {X[0], X[1], X[2]}, least = cost_at(rays, count, X, most) - 0.5 * most;
    const double unmoved = least;
    uint8_t chosen[MOST_COMPARED];
    for (int one = 0; one < count; one++)
        for (int other = one + 1; other < count; other++) {
            for (int k = 0; k < count; k++)
                chosen[k] = k == one || k == other;
            take_if_better(rays, count, chosen, most, best, &least);
        }
    if (!(least < unmoved))
        return;
    /* all that fit tell the position better than the two */
    for (int k = 0; k < count; k++)
        chosen[k] = standard_square_at(rays + k, best) <= most;
    take_if_better(rays, count, chosen, most, best, &least);
    for (int i = 0; i < 3; i++)
        X[i] = best[i];
}

/* Move the doubtful points; rays of photos that are not oriented do not count. `most` is the largest squared standard
 * residual that counts, and `scale` that of the a-priori errors. */
static void find_consensus(const OrientedRays *rays, const uint8_t *doubtful, double scale, double most, double *points)
{
    for (int64_t point = 0; point < rays->points; point++) {
        PhotoRay seen[MOST_COMPARED];
        int64_t count = 0;
        for (int64_t row = rays->point[point]; doubtful[point] && row < rays->point[point + 1]; row++) {
            const int64_t photo = rays->photo[row];
            if (!rays->oriented[photo])
                continue;
            if (count < MOST_COMPARED) {
                const PhotoRay ray = {rays->centres + 3 * photo, rays->rotations + 9 * photo, rays->vectors + 3 * row,
                                      scale * rays->error[row], {0.0}};
                seen[count] = ray;
                direct(seen + count);
            }
            count++;
        }
        if (count >= FEWEST_COMPARED && count <= MOST_COMPARED)
            move_to_consensus(seen, (int)count, most, points + 3 * point);
    }
}

/* `together` has room for a number of each point: how many oriented photos see it. What is not oriented or not known is
 * NaN.
 */
static void residual_lengths(const OrientedRays *b, const double *points, int64_t *together, double *lengths)
{
    memset(together, 0, (size_t)b->points * sizeof(int64_t));
    for (int64_t row = 0; row < b->count; row++)
        together[b->point[row]] += isfinite(b->centres[3 * b->photo[row]]) != 0;
    for (int64_t row = 0; row < b->count; row++) {
        const int64_t point = b->point[row], photo = b->photo[row];
        const PhotoRay ray = {b->centres + 3 * photo, b->rotations + 9 * photo, b->vectors + 3 * row, 0.0, {0.0}};
        const int is_lost = isfinite(ray.centre[0]) && together[point] > 1 && !isfinite(points[3 * point]);
        lengths[row] = is_lost ? INFINITY : sqrt(square_at(&ray, points + 3 * point)) / b->error[row];
    }
}
