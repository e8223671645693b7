/* Adjustment of a spatial similarity with Danish weights; prelim_references/similarity.py does the same and names the
 * sources.
 */

#ifndef ORIP_PRELIM_SIMILARITY_H
#define ORIP_PRELIM_SIMILARITY_H

#include "../compiled/linear.h"
#include <string.h>

#define MOST_UNKNOWNS 7

typedef struct {
    /* target is NaN where a coordinate is not known; source points are reduced to their centroid */
    const double *source, *target, *error;
    const uint8_t *trusted;
    int64_t count, unknowns;
} Common;

/* RULES in orip/prelim/similarity/adjustment.py */
typedef struct {
    double limit, floor, least_error, singular, longest_turn, steps, free_steps, median_of_normal;
} SimilarityRules;

/* `spread` times the median residual is the scale of all; 0: all have full weight. */
typedef struct {
    const SimilarityRules *rules;
    double spread, student_limit;
} SimilarityWeights;

typedef struct {
    double scale, rotation[9], shift[3];
} At;

/* Deviations are those of scale, shift and angles. */
typedef struct {
    At at;
    double angles[3], deviations[MOST_UNKNOWNS], s0, iterations;
} SimilarityFound;

static inline void apply_similarity(const At *at, const double *x, double *turned)
{
    for (int i = 0; i < 3; i++)
        turned[i] = at->scale * dot3(at->rotation + 3 * i, x);
}

/* The limit that a residual exceeds as rarely as a normal one exceeds `limit`, for s0 of small redundancy. */
static inline double student_limit(double limit, double redundancy)
{
    const double z = limit, cube = z * z * z, first = (cube + z) / 4.0;
    return z + first / redundancy + (5.0 * cube * z * z + 16.0 * cube + 3.0 * z) / 96.0 / (redundancy * redundancy);
}

/* Standard deviations of differences in the target system, none much below their median. `space` has room for all. */
static void similarity_errors(const double *source, const double *target_deviation, const double *target,
                              int64_t count, double least, const At *at, double *error, double *space)
{
    int64_t known = 0;
    for (int64_t point = 0; point < count; point++)
        for (int i = 0; i < 3; i++) {
            const int64_t k = 3 * point + i;
            const double *R = at->rotation + 3 * i;
            double square = 0.0;
            for (int j = 0; j < 3; j++) {
                const double turned = at->scale * R[j] * source[3 * point + j];
                square += turned * turned;
            }
            error[k] = sqrt(square + target_deviation[k] * target_deviation[k]);
            if (isfinite(target[k]) && error[k] > 0.0)
                space[known++] = error[k];
        }
    const double floor = known ? least * median_of(space, known) : 1.0;
    for (int64_t k = 0; k < 3 * count; k++)
        error[k] = error[k] < floor ? floor : error[k];
}

/* Weight factors of the coordinates. `space` has room for all. */
static void similarity_factors(const Common *c, const SimilarityWeights *w, const At *at, double *factors,
                               double *space)
{
    int64_t judged = 0;
    for (int64_t point = 0; point < c->count; point++) {
        double turned[3];
        apply_similarity(at, c->source + 3 * point, turned);
        for (int i = 0; i < 3; i++) {
            const int64_t k = 3 * point + i;
            factors[k] = fabs(turned[i] + at->shift[i] - c->target[k]) / c->error[k];
            if (!c->trusted[point] && isfinite(factors[k]))
                space[judged++] = factors[k];
        }
    }
    if (w->spread <= 0.0 || judged == 0) {
        for (int64_t k = 0; k < 3 * c->count; k++)
            factors[k] = 1.0;
        return;
    }
    const double scale = median_of(space, judged) * w->spread;
    const double limit = scale <= 1.0 ? w->rules->limit : scale * w->student_limit;
    for (int64_t k = 0; k < 3 * c->count; k++)
        factors[k] = c->trusted[k / 3] || !isfinite(factors[k]) ? 1.0
                                                                : danish_weight(factors[k], limit, w->rules->floor);
}

/* Partials of the three coordinates of a point whose difference to the image of the centroid is `turned`. */
static inline void similarity_rows(const double *turned, double rows[3][MOST_UNKNOWNS])
{
    memset(rows, 0, 3 * MOST_UNKNOWNS * sizeof(double));
    for (int r = 0; r < 3; r++)
        rows[r][0] = turned[r], rows[r][1 + r] = 1.0;
    rows[0][5] = turned[2], rows[0][6] = -turned[1];
    rows[1][4] = -turned[2], rows[1][6] = turned[0];
    rows[2][4] = turned[1], rows[2][5] = -turned[0];
}

/* Normal equations with unit diagonal, as the inverse of their Cholesky factor, and the scaling that made it; 0 where
 * they are, or may be, singular.
 */
static int similarity_normals(const Common *c, const At *at, const double *factors, double singular,
                              double inverse[MOST_UNKNOWNS][MOST_UNKNOWNS], double *right, double *scaling)
{
    const int n = (int)c->unknowns;
    double N[MOST_UNKNOWNS][MOST_UNKNOWNS] = {{0.0}};
    memset(right, 0, MOST_UNKNOWNS * sizeof(double));
    for (int64_t point = 0; point < c->count; point++) {
        double turned[3], rows[3][MOST_UNKNOWNS];
        apply_similarity(at, c->source + 3 * point, turned);
        similarity_rows(turned, rows);
        for (int r = 0; r < 3; r++) {
            const int64_t k = 3 * point + r;
            if (!isfinite(c->target[k]))
                continue;
            const double weight = factors[k] / (c->error[k] * c->error[k]);
            const double residual = turned[r] + at->shift[r] - c->target[k];
            for (int i = 0; i < n; i++) {
                right[i] += weight * rows[r][i] * residual;
                for (int j = 0; j <= i; j++)
                    N[i][j] += weight * rows[r][i] * rows[r][j];
            }
        }
    }
    for (int i = 0; i < n; i++) {
        if (!(N[i][i] > 0.0))
            return 0;
        scaling[i] = 1.0 / sqrt(N[i][i]);
    }
    for (int i = 0; i < n; i++) {
        right[i] *= scaling[i];
        for (int j = 0; j <= i; j++)
            N[i][j] *= scaling[i] * scaling[j];
    }
    return invert_factor(n, MOST_UNKNOWNS, N[0], inverse[0], singular);
}

/* Move to the next state; returns the step in standard deviations of the unknowns, negative where there is none. */
static double similarity_step(const Common *c, const SimilarityRules *rules, const double *factors, At *at)
{
    const int n = (int)c->unknowns;
    double inverse[MOST_UNKNOWNS][MOST_UNKNOWNS], right[MOST_UNKNOWNS], scaling[MOST_UNKNOWNS], turned[9];
    double change[MOST_UNKNOWNS] = {0.0}, square = 0.0;
    if (!similarity_normals(c, at, factors, rules->singular, inverse, right, scaling))
        return -1.0;
    for (int i = 0; i < n; i++) {
        double forward = 0.0;
        for (int k = 0; k <= i; k++)
            forward += inverse[i][k] * right[k];
        square += forward * forward;
        for (int k = 0; k <= i; k++)
            change[k] -= scaling[k] * inverse[i][k] * forward;
    }
    const double turn = sqrt(dot3(change + 4, change + 4));
    const double factor = smaller(1.0, rules->longest_turn / larger(turn, 1e-300));
    for (int i = 0; i < MOST_UNKNOWNS; i++)
        change[i] *= factor;
    at->scale *= exp(change[0]);
    for (int i = 0; i < 3; i++)
        at->shift[i] += change[1 + i];
    turn3(change + 4, at->rotation, turned);
    memcpy(at->rotation, turned, sizeof(turned));
    return sqrt(square / n);
}

/* Returns the number of iterations; 0 where the equations are, or may be, singular. `space` has room for the factors
 * twice.
 */
static int64_t iterate_similarity(const Common *c, const SimilarityWeights *w, At *at, double *factors, double *space)
{
    double *previous = space + 3 * c->count;
    const int64_t steps = (int64_t)w->rules->steps;
    similarity_factors(c, w, at, factors, space);
    for (int64_t iteration = 1; iteration <= steps; iteration++) {
        double change = 0.0;
        const double step = similarity_step(c, w->rules, factors, at);
        if (step < 0.0)
            return 0;
        memcpy(previous, factors, (size_t)(3 * c->count) * sizeof(double));
        if (iteration < (int64_t)w->rules->free_steps)
            similarity_factors(c, w, at, factors, space);
        for (int64_t k = 0; k < 3 * c->count; k++)
            change = larger(change, fabs(factors[k] - previous[k]));
        if ((step < 1e-4 && change < 0.01) || iteration == steps)
            return iteration;
    }
    return 0;
}

/* Residuals, and s0 of the observations of full weight, negative with no redundancy. */
static double similarity_residuals(const Common *c, const At *at, const double *factors,
                                   double cofactors[MOST_UNKNOWNS][MOST_UNKNOWNS], double *residuals)
{
    double square = 0.0, used = 0.0;
    for (int64_t point = 0; point < c->count; point++) {
        double turned[3], rows[3][MOST_UNKNOWNS];
        apply_similarity(at, c->source + 3 * point, turned);
        similarity_rows(turned, rows);
        for (int r = 0; r < 3; r++) {
            const int64_t k = 3 * point + r;
            residuals[k] = turned[r] + at->shift[r] - c->target[k];
            if (!isfinite(c->target[k]) || factors[k] != 1.0)
                continue;
            const double cofactor = form_of((int)c->unknowns, MOST_UNKNOWNS, cofactors[0], rows[r]);
            const double standard = residuals[k] / c->error[k];
            square += standard * standard, used += 1.0 - cofactor / (c->error[k] * c->error[k]);
        }
    }
    /* redundancy numbers add up to whole numbers apart from rounding */
    return used > 1e-6 ? sqrt(square / used) : -1.0;
}

/* Deviations of scale, shift and angles from the cofactors of the unknowns at the centroid. */
static void similarity_deviations(SimilarityFound *f, const double *centroid,
                                  double cofactors[MOST_UNKNOWNS][MOST_UNKNOWNS], double unit_weight)
{
    double change[MOST_UNKNOWNS][MOST_UNKNOWNS] = {{0.0}}, lever[3][MOST_UNKNOWNS], turned[3], rates[9];
    apply_similarity(&f->at, centroid, turned);
    similarity_rows(turned, lever);
    angle_rates(f->angles, rates);
    change[0][0] = f->at.scale;
    for (int i = 0; i < 3; i++) {
        /* T = (image of the centroid) - m R centroid */
        for (int k = 0; k < MOST_UNKNOWNS; k++)
            change[1 + i][k] = k == 1 + i ? 1.0 : -lever[i][k];
        for (int k = 0; k < 3; k++)
            change[4 + i][4 + k] = rates[3 * i + k];
    }
    for (int u = 0; u < MOST_UNKNOWNS; u++) {
        const double square = form_of(MOST_UNKNOWNS, MOST_UNKNOWNS, cofactors[0], change[u]);
        f->deviations[u] = unit_weight * sqrt(larger(square, 0.0));
    }
}

/* Adjust a similarity whose start is in `found`; 0 where the equations are, or may be, singular. `space` has room for
 * twelve numbers for each point.
 */
static int adjust_similarity(Common *c, const double *source, const double *source_deviation,
                             const double *target_deviation, const SimilarityRules *rules, double *factors,
                             double *residuals, double *space, SimilarityFound *found)
{
    At *at = &found->at;
    double *reduced = space, *error = space + 3 * c->count, *rest = space + 6 * c->count;
    double centroid[3] = {0.0}, turned[3], right[MOST_UNKNOWNS], scaling[MOST_UNKNOWNS];
    double inverse[MOST_UNKNOWNS][MOST_UNKNOWNS], cofactors[MOST_UNKNOWNS][MOST_UNKNOWNS] = {{0.0}};
    int64_t known = 0;
    for (int64_t k = 0; k < 3 * c->count; k++)
        centroid[k % 3] += source[k] / (double)c->count, known += isfinite(c->target[k]) != 0;
    for (int64_t k = 0; k < 3 * c->count; k++)
        reduced[k] = source[k] - centroid[k % 3];
    similarity_errors(source_deviation, target_deviation, c->target, c->count, rules->least_error, at, error, rest);
    c->source = reduced, c->error = error;
    apply_similarity(at, centroid, turned);
    for (int i = 0; i < 3; i++)
        at->shift[i] += turned[i];
    const double redundancy = (double)(known - c->unknowns);
    const SimilarityWeights weights = {
        rules, redundancy > 0.0 ? sqrt((double)known / redundancy) / rules->median_of_normal : 0.0,
        redundancy > 0.0 ? student_limit(rules->limit, redundancy) : rules->limit};
    found->iterations = (double)iterate_similarity(c, &weights, at, factors, rest);
    if (found->iterations < 1.0 || !similarity_normals(c, at, factors, rules->singular, inverse, right, scaling))
        return 0;
    for (int i = 0; i < c->unknowns; i++)
        for (int j = 0; j < c->unknowns; j++)
            for (int k = i > j ? i : j; k < c->unknowns; k++)
                cofactors[i][j] += scaling[i] * inverse[k][i] * inverse[k][j] * scaling[j];
    const double s0 = similarity_residuals(c, at, factors, cofactors, residuals);
    found->s0 = larger(s0, 0.0);
    apply_similarity(at, centroid, turned);
    for (int i = 0; i < 3; i++)
        at->shift[i] -= turned[i];
    angles_of(at->rotation, found->angles);
    similarity_deviations(found, centroid, cofactors, s0 < 0.0 ? 1.0 : s0);
    return 1;
}

#endif
