/* The resection of one photo as a whole, where nothing is unusual; resection.py does the same for all photos. */

#include "resection.h"

static int64_t resection_space(int64_t count, int64_t candidates)
{
    return (4 + candidates + 2 * NUMBERS_OF_A_POINT) * count;
}

/* The mean of the first `size` of three coordinates, and whether the points lie on one line or in one place. */
static int lie_on_one_line(const double *points, int64_t count, int size, double one_line, double *mean)
{
    double moments[9] = {0.0}, trace = 0.0, squares = 0.0;
    for (int i = 0; i < size; i++) {
        mean[i] = 0.0;
        for (int64_t row = 0; row < count; row++)
            mean[i] += points[3 * row + i];
        mean[i] /= (double)count;
    }
    for (int64_t row = 0; row < count; row++)
        for (int i = 0; i < size; i++)
            for (int j = 0; j < size; j++)
                moments[3 * i + j] += (points[3 * row + i] - mean[i]) * (points[3 * row + j] - mean[j]);
    for (int k = 0; k < 9; k++)
        squares += moments[k] * moments[k], trace += k % 4 ? 0.0 : moments[k];
    return trace * trace - squares <= 2.0 * one_line * one_line * trace * trace;
}

/* Points from their centroid in units of their spread; returns the spread. */
static double reduce_points(const double *points, const double *deviations, int64_t count, const double *centroid,
                            double *coordinates, double *reduced)
{
    double sum = 0.0;
    for (int64_t k = 0; k < 3 * count; k++) {
        coordinates[k] = points[k] - centroid[k % 3];
        sum += coordinates[k] * coordinates[k];
    }
    const double spread = sqrt(sum / (double)count);
    for (int64_t k = 0; k < 3 * count; k++)
        coordinates[k] /= spread;
    for (int64_t row = 0; row < count; row++)
        reduced[row] = (isnan(deviations[row]) ? 0.0 : deviations[row]) / spread;
    return spread;
}

/* Whether points from their centroid are so near to a plane that its homography gives orientations, too. */
static int is_flat(const double *points, int64_t count, double plane)
{
    double moments[3][3] = {{0.0}}, values[3], axes[3][3];
    for (int64_t row = 0; row < count; row++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                moments[i][j] += points[3 * row + i] * points[3 * row + j];
    eigen3(moments, values, axes);
    return values[0] < plane * plane * values[1] && plane > 0.0;
}

static OrientationChoice choice_of(const ResectionRules *r, const Known *k)
{
    const double count = (double)k->count, least = (double)k->least, left_out = 1.0 - least / count;
    /* see `variance_of_least` in orip/prelim/resection/known_points.py */
    const double share = 1.0 + (left_out > 0.0 ? left_out * log(left_out) / (1.0 - left_out) : 0.0);
    const double per_sum = count / larger(count - 3.0, 1.0) / (2.0 * least * share);
    return (OrientationChoice){
        r->limit, r->alike * larger(2.0 * least - 6.0, 2.0), r->same, per_sum, r->largest_turn,
        (int64_t)r->improvements,
        {r->limit, r->floor, r->steady, r->same_scale, r->largest_turn, (int64_t)r->iterations}};
}

/* Root cofactors of six unknowns; whether their equations are regular without a doubt. */
static int root_cofactors(const double *normals, double regular, double *roots)
{
    double L[6][6], inverse[6][6], scale[6];
    for (int i = 0; i < 6; i++) {
        scale[i] = sqrt(normals[7 * i]);
        if (!(scale[i] > 0.0))
            return 0;
    }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++)
            L[i][j] = normals[6 * i + j] / (scale[i] * scale[j]);
    if (!invert_factor(6, 6, L[0], inverse[0], 6.0 * regular))
        return 0;
    for (int j = 0; j < 6; j++) {
        double sum = 0.0;
        for (int i = j; i < 6; i++)
            sum += inverse[i][j] * inverse[i][j];
        roots[j] = sqrt(sum) / scale[j];
    }
    return 1;
}

static void judge_residuals(const Known *k, const double *factors, const double *squares, const double *mean,
                            double *residual, ResectionFound *f)
{
    double sum = 0.0, mm = 0.0, farthest = 0.0, whole = 0.0;
    for (int64_t row = 0; row < k->count; row++) {
        const double x = k->vectors[3 * row] - mean[0], y = k->vectors[3 * row + 1] - mean[1];
        double *v = residual + 2 * row;
        farthest = larger(farthest, x * x + y * y);
        if (factors[row] == 1.0)
            whole += 1.0, sum += squares[row], mm += v[0] * v[0] + v[1] * v[1];
        if (!isfinite(squares[row]))
            v[0] = v[1] = NAN;
    }
    f->redundancy = larger(2.0 * whole - 6.0, 0.0);
    f->s0 = f->redundancy > 0.0 ? sqrt(sum / f->redundancy) : 1.0;
    f->misfit = sqrt(mm / larger(2.0 * whole, 1.0)), f->radius = sqrt(farthest);
}

/* Orient a photo by more than three points: the orientations that fit, the best first, and of that one weight factors,
 * residuals, and what else is found. Returns how many they are; none where the points are on a line, no triple leads
 * to an orientation, or to none that fits points near a plane, or the equations may be singular.
 */
static int64_t resect_photo(const double *points, const double *deviations, Known k, const ResectionRules *rules,
                            const int64_t *triples, int64_t number, int64_t candidates, double *rotations,
                            double *centres, double *factors, double *residual, double *space, ResectionFound *f)
{
    const int64_t n = k.count;
    double centroid[3], mean[3], quantiles[MOST_CANDIDATES], normals[36];
    double *coordinates = space, *reduced = space + 3 * n, *squares = space + 4 * n, *rest = squares + candidates * n;
    if (lie_on_one_line(points, n, 3, rules->one_line, centroid)
        || lie_on_one_line(k.vectors, n, 2, rules->one_line, mean))
        return 0;
    const double spread = reduce_points(points, deviations, n, centroid, coordinates, reduced);
    k.coordinates = coordinates, k.deviations = reduced;
    rank_triples(&k, triples, number, rules->fits, candidates, rotations, centres, quantiles, rest);
    int64_t starts = 0;
    while (starts < candidates && isfinite(quantiles[starts]))
        starts++;
    if (!starts || (quantiles[0] > rules->fits && is_flat(coordinates, n, rules->plane)))
        return 0;
    const OrientationChoice choice = choice_of(rules, &k);
    const int64_t left = choose_orientations(&k, &choice, starts, rotations, centres, squares, factors, residual,
                                             normals, rest);
    if (!root_cofactors(normals, rules->regular, f->deviation))
        return 0;
    judge_residuals(&k, factors, squares, mean, residual, f);
    f->distance = spread * sqrt(dot3(centres, centres));
    for (int i = 0; i < 6; i++)
        f->deviation[i] *= (i < 3 ? 1.0 : spread) * f->s0;
    for (int64_t i = 0; i < 3 * left; i++)
        centres[i] = centroid[i % 3] + spread * centres[i];
    return left;
}
