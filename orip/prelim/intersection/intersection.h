/* Points from rays, one point after the other;
 * prelim_references/intersection.py does the same for all side by side.
 */

#include "consensus.h"

typedef struct {
    const double *origins, *directions, *error;
    int64_t count;
} Rays;

/* Inverse of a symmetric matrix; NaN of a singular one: 1e-5 rad between rays are parallel to working precision. */
static void inverse3(const double *N, double *inverse)
{
    double minors[9];
    const double determinant = minors3(N, minors), trace = N[0] + N[4] + N[8];
    const int regular = determinant > 1e-11 * trace * trace * trace;
    for (int k = 0; k < 9; k++)
        inverse[k] = regular ? minors[k] / determinant : NAN;
}

static void meet(const Rays *rays, const double *weights, double *point, double *inverse)
{
    double xx = 0.0, xy = 0.0, xz = 0.0, yy = 0.0, yz = 0.0, zz = 0.0, x = 0.0, y = 0.0, z = 0.0;
    for (int64_t row = 0; row < rays->count; row++) {
        const double *d = rays->directions + 3 * row, *o = rays->origins + 3 * row, w = weights[row];
        const double wd[3] = {w * d[0], w * d[1], w * d[2]}, along = dot3(d, o);
        xx += w - wd[0] * d[0], yy += w - wd[1] * d[1], zz += w - wd[2] * d[2];
        xy -= wd[0] * d[1], xz -= wd[0] * d[2], yz -= wd[1] * d[2];
        x += w * o[0] - wd[0] * along, y += w * o[1] - wd[1] * along, z += w * o[2] - wd[2] * along;
    }
    const double N[9] = {xx, xy, xz, xy, yy, yz, xz, yz, zz}, right[3] = {x, y, z};
    inverse3(N, inverse);
    times3(inverse, right, point);
}

static void ahead(const Rays *rays, int64_t row, const double *point, double *along, double *across)
{
    const double *d = rays->directions + 3 * row, *o = rays->origins + 3 * row;
    const double offset[3] = {point[0] - o[0], point[1] - o[1], point[2] - o[2]};
    *along = dot3(offset, d);
    const double side[3] = {offset[0] - *along * d[0], offset[1] - *along * d[1], offset[2] - *along * d[2]};
    *across = sqrt(dot3(side, side));
}

static double angular_weight(const Rays *rays, int64_t row, const double *point)
{
    const double *o = rays->origins + 3 * row, offset[3] = {point[0] - o[0], point[1] - o[1], point[2] - o[2]};
    const double square = dot3(offset, offset), error = rays->error[row];
    return 1.0 / (error * error * (isfinite(square) && square > 0.0 ? square : 1.0));
}

static double residual_at(const Rays *rays, int64_t row, const double *point)
{
    double along, across;
    ahead(rays, row, point, &along, &across);
    return along > 0.0 ? across / along / rays->error[row] : along * 0.0 + INFINITY;
}

/* Intersect with the weights that the angles have at a position, times factors. */
static void meet_again(const Rays *rays, const double *factors, const double *at, double *point, double *inverse,
                       double *scratch)
{
    for (int64_t row = 0; row < rays->count; row++)
        scratch[row] = factors[row] * angular_weight(rays, row, at);
    meet(rays, scratch, point, inverse);
}

static int is_doubtful(const Rays *rays, const double *factors, const double *point, double limit)
{
    for (int64_t row = 0; row < rays->count; row++)
        if (!(residual_at(rays, row, point) <= limit || factors[row] == 0.0))
            return 1;
    return 0;
}

/* Leave out one ray where the others fit without it, and only without it. */
static void without_one(const Rays *rays, double limit, double *point, double *factors, double *scratch)
{
    double best[3] = {0.0}, inverse[9];
    int64_t fitting = 0, left_out = -1;
    for (int64_t turn = 0; turn < rays->count && rays->count >= 3; turn++) {
        double tried[3];
        for (int64_t row = 0; row < rays->count; row++)
            factors[row] = row != turn;
        meet(rays, factors, tried, inverse);
        meet_again(rays, factors, tried, tried, inverse, scratch);
        if (!is_doubtful(rays, factors, tried, limit)) {
            fitting++, left_out = turn;
            for (int i = 0; i < 3; i++)
                best[i] = tried[i];
        }
    }
    for (int64_t row = 0; row < rays->count; row++)
        factors[row] = !(fitting == 1 && row == left_out);
    if (fitting == 1)
        for (int i = 0; i < 3; i++)
            point[i] = best[i];
}

typedef struct {
    double s0, limit, danish_limit, danish_floor, kept;
    int64_t many, absolute, danish;
} Robust;

static void reweighted(const Rays *rays, const Robust *r, double *point, double *factors, double *scratch)
{
    double inverse[9];
    for (int64_t iteration = 0; iteration < r->absolute + r->danish; iteration++) {
        for (int64_t row = 0; row < rays->count; row++) {
            double u = residual_at(rays, row, point);
            u = (isfinite(u) ? u : 1e6) / r->s0;
            factors[row] = iteration < r->absolute ? 1.0 / fmax(u, 1.0)
                                                   : danish_weight(u, r->danish_limit, r->danish_floor);
        }
        meet_again(rays, factors, point, point, inverse, scratch);
    }
}

/* The kept ray farthest from a direction; zero without any. */
static void farthest(const Rays *rays, const double *factors, double kept, const double *from, double *found)
{
    double least = INFINITY;
    found[0] = found[1] = found[2] = 0.0;
    for (int64_t row = 0; row < rays->count; row++) {
        const double *d = rays->directions + 3 * row, cosine = dot3(d, from);
        if (factors[row] >= kept && cosine < least) {
            least = cosine;
            found[0] = d[0], found[1] = d[1], found[2] = d[2];
        }
    }
}

static double largest_angle(const Rays *rays, const double *factors, double kept)
{
    double mean[3] = {0.0}, first[3], second[3], normal[3];
    for (int64_t row = 0; row < rays->count; row++)
        for (int i = 0; i < 3 && factors[row] >= kept; i++)
            mean[i] += rays->directions[3 * row + i];
    farthest(rays, factors, kept, mean, first);
    farthest(rays, factors, kept, first, second);
    cross3(first, second, normal);
    return atan2(sqrt(dot3(normal, normal)), dot3(first, second));
}

/* The first position of a point and its residuals. */
static void first_meeting(const Rays *rays, double *point, double *residual, double *scratch)
{
    double inverse[9];
    for (int64_t row = 0; row < rays->count; row++)
        residual[row] = 1.0;
    meet(rays, residual, point, inverse);
    meet_again(rays, residual, point, point, inverse, scratch);
    for (int64_t row = 0; row < rays->count; row++)
        residual[row] = residual_at(rays, row, point);
}

/* The final position of a point, weight factors, variances without s0 and the largest angle of its rays. */
static void robust_meeting(const Rays *rays, const Robust *r, double *point, double *factors, double *variance,
                           double *angle, double *scratch)
{
    double inverse[9], unused[3];
    for (int64_t row = 0; row < rays->count; row++)
        factors[row] = 1.0;
    if (rays->count <= r->many && is_doubtful(rays, factors, point, r->limit))
        without_one(rays, r->limit, point, factors, scratch);
    if (is_doubtful(rays, factors, point, r->limit))
        reweighted(rays, r, point, factors, scratch);
    for (int64_t row = 0; row < rays->count; row++) {
        double along, across;
        ahead(rays, row, point, &along, &across);
        if (!(along > 0.0))
            factors[row] = 0.0;
    }
    *angle = largest_angle(rays, factors, r->kept);
    meet_again(rays, factors, point, unused, inverse, scratch);
    for (int i = 0; i < 3; i++)
        variance[i] = inverse[4 * i];
}

/* The rays of oriented photos, from an origin in their middle: the row of each ray, and where those of a point begin. */
typedef struct {
    double base[3], *origins, *directions, *error, *residual, *scratch;
    int64_t *row, *start;
} Bundle;

/* Numbers of a ray, and bytes of all rays, that a bundle needs. */
#define NUMBERS_OF_A_RAY 9

static size_t bundle_space(int64_t count, int64_t points)
{
    return (size_t)(NUMBERS_OF_A_RAY * count) * sizeof(double) + (size_t)(count + points + 1) * sizeof(int64_t);
}

/* Sort the rays of oriented photos by point, and return how many they are. */
static int64_t sort_by_point(const OrientedRays *a, int64_t *row, int64_t *start)
{
    memset(start, 0, (size_t)(a->points + 1) * sizeof(int64_t));
    for (int64_t k = 0; k < a->count; k++)
        start[a->point[k]] += a->oriented[a->photo[k]] != 0;
    int64_t used = 0;
    for (int64_t point = 0; point <= a->points; point++) {
        const int64_t number = start[point];
        start[point] = used, used += number;
    }
    for (int64_t k = 0; k < a->count; k++)
        if (a->oriented[a->photo[k]])
            row[start[a->point[k]]++] = k;
    /* each has moved on to where the next one begins */
    for (int64_t point = a->points; point > 0; point--)
        start[point] = start[point - 1];
    start[0] = 0;
    return used;
}

static Bundle bundle_in(const OrientedRays *a, void *space)
{
    const int64_t n = a->count;
    double *numbers = space;
    int64_t *indices = (int64_t *)(numbers + NUMBERS_OF_A_RAY * n);
    Bundle b = {{0.0}, numbers, numbers + 3 * n, numbers + 6 * n, numbers + 7 * n, numbers + 8 * n, indices, indices + n};
    const int64_t used = sort_by_point(a, b.row, b.start);
    for (int64_t k = 0; k < used; k++)
        for (int i = 0; i < 3; i++)
            b.base[i] += a->centres[3 * a->photo[b.row[k]] + i];
    for (int i = 0; i < 3 && used > 0; i++)
        b.base[i] /= (double)used;
    for (int64_t k = 0; k < used; k++) {
        const int64_t row = b.row[k], photo = a->photo[row];
        const double *R = a->rotations + 9 * photo, *v = a->vectors + 3 * row, length = sqrt(dot3(v, v));
        for (int i = 0; i < 3; i++) {
            b.origins[3 * k + i] = a->centres[3 * photo + i] - b.base[i];
            b.directions[3 * k + i] = dot3(R + 3 * i, v) / length;
        }
        b.error[k] = a->error[row] / length;
    }
    return b;
}

static Rays rays_of(const Bundle *b, int64_t point)
{
    const int64_t first = b->start[point];
    return (Rays){b->origins + 3 * first, b->directions + 3 * first, b->error + first, b->start[point + 1] - first};
}

typedef struct {
    double quantile, length, smallest_angle;
    Robust robust;
} Intersecting;

/* The robust scale of the residuals: a quantile, corrected for the redundancy; at least 1. */
static double scale_of(const Bundle *b, int64_t points, const Intersecting *how)
{
    int64_t rays = 0, places = 0;
    /* errors of points with two rays show in their residuals only in part: they are used only if there are no others */
    for (int64_t fewest = 3; fewest > 0 && rays <= 10; fewest -= 2) {
        rays = places = 0;
        for (int64_t point = 0; point < points; point++) {
            const int64_t before = rays;
            for (int64_t row = b->start[point]; row < b->start[point + 1]; row++)
                if (isfinite(b->residual[row]))
                    b->scratch[rays++] = b->residual[row];
            if (rays - before < fewest)
                rays = before;
            places += rays > before;
        }
    }
    const double redundancy = rays ? (double)(2 * rays - 3 * places) / (double)(2 * rays) : 0.0;
    if (redundancy <= 0.0)
        return 1.0;
    return fmax(1.0, quantile_of(b->scratch, rays, how->quantile) / how->length / sqrt(redundancy));
}

/* Intersect all points; what is not determined is NaN, and its rays have no weight. Returns the scale. */
static double intersect_all(const OrientedRays *a, Intersecting *how, double *points, double *deviations, double *factors,
                            double *angles, void *space)
{
    const Bundle b = bundle_in(a, space);
    for (int64_t row = 0; row < a->count; row++)
        factors[row] = 0.0;
    for (int64_t point = 0; point < a->points; point++) {
        const Rays rays = rays_of(&b, point);
        if (rays.count)
            first_meeting(&rays, points + 3 * point, b.residual + b.start[point], b.scratch);
    }
    const double s0 = scale_of(&b, a->points, how);
    how->robust.s0 = s0, how->robust.limit = s0 * how->robust.danish_limit;
    for (int64_t point = 0; point < a->points; point++) {
        const Rays rays = rays_of(&b, point);
        double *X = points + 3 * point, *of_rays = b.residual + b.start[point], variance[3] = {0.0};
        int64_t kept = 0;
        angles[point] = 0.0;
        if (rays.count)
            robust_meeting(&rays, &how->robust, X, of_rays, variance, angles + point, b.scratch);
        for (int64_t row = 0; row < rays.count; row++)
            kept += of_rays[row] >= how->robust.kept;
        const int determined = kept >= 2 && angles[point] >= how->smallest_angle && is_known(X);
        for (int64_t row = 0; row < rays.count && determined; row++)
            factors[b.row[b.start[point] + row]] = of_rays[row];
        for (int i = 0; i < 3; i++) {
            X[i] = determined ? X[i] + b.base[i] : NAN;
            deviations[3 * point + i] = determined ? s0 * sqrt(variance[i]) : NAN;
        }
    }
    return s0;
}
