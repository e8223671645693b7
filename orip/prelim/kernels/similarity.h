/* Adjustment of a spatial similarity with Danish weights; orip/prelim/similarity_adjustment.py does the same. */

#include "linear.h"

#define MOST_UNKNOWNS 7

typedef struct {
    /* target is NaN, and so is the error, where a coordinate is not known */
    const double *source, *target, *error;
    const uint8_t *trusted;
    int64_t count, unknowns;
} Common;

typedef struct {
    double limit, student_limit, floor, spread, singular, longest_turn;
    int64_t steps, free_steps;
} SimilarityDanish;

typedef struct {
    double scale, rotation[9], shift[3];
} At;

static inline void apply_similarity(const At *at, const double *x, double *turned)
{
    for (int i = 0; i < 3; i++)
        turned[i] = at->scale * dot3(at->rotation + 3 * i, x);
}

/* Weight factors of the coordinates; `spread` turns the median residual into their scale, 0: all weigh fully. */
static void similarity_factors(const Common *c, const SimilarityDanish *d, const At *at, double *factors,
                               double *residual)
{
    int64_t judged = 0;
    for (int64_t point = 0; point < c->count; point++) {
        double turned[3];
        apply_similarity(at, c->source + 3 * point, turned);
        for (int i = 0; i < 3; i++) {
            const int64_t k = 3 * point + i;
            factors[k] = fabs(turned[i] + at->shift[i] - c->target[k]) / c->error[k];
            if (!c->trusted[point] && isfinite(factors[k]))
                residual[judged++] = factors[k];
        }
    }
    if (d->spread <= 0.0 || judged == 0) {
        for (int64_t k = 0; k < 3 * c->count; k++)
            factors[k] = 1.0;
        return;
    }
    const double scale = median_of(residual, judged) * d->spread, limit = scale <= 1.0 ? d->limit : scale * d->student_limit;
    for (int64_t k = 0; k < 3 * c->count; k++)
        factors[k] = c->trusted[k / 3] || !isfinite(factors[k]) ? 1.0 : danish_weight(factors[k], limit, d->floor);
}

/* Solve by Cholesky's factors, with unit diagonal; 0 where the inverse is too large to be sure that it is one. */
static int solve_scaled(double N[MOST_UNKNOWNS][MOST_UNKNOWNS], double *b, int n, double singular)
{
    double inverse[MOST_UNKNOWNS][MOST_UNKNOWNS], trace = 0.0;
    for (int j = 0; j < n; j++) {
        for (int k = 0; k < j; k++)
            N[j][j] -= N[j][k] * N[j][k];
        if (!(N[j][j] > 0.0))
            return 0;
        N[j][j] = sqrt(N[j][j]);
        for (int i = j + 1; i < n; i++) {
            for (int k = 0; k < j; k++)
                N[i][j] -= N[i][k] * N[j][k];
            N[i][j] /= N[j][j];
        }
    }
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double sum = i == j;
            for (int k = j; k < i; k++)
                sum -= N[i][k] * inverse[k][j];
            inverse[i][j] = sum / N[i][i];
            trace += inverse[i][j] * inverse[i][j];
        }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= N[i][k] * b[k];
        b[i] /= N[i][i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= N[k][i] * b[k];
        b[i] /= N[i][i];
    }
    /* the trace is above the reciprocal of the smallest eigenvalue */
    return trace * singular < 1.0;
}

/* Move to the next state; returns the step in standard deviations of the unknowns, negative where there is none. */
static double similarity_step(const Common *c, const SimilarityDanish *d, const double *factors, At *at)
{
    const int n = (int)c->unknowns;
    double N[MOST_UNKNOWNS][MOST_UNKNOWNS] = {{0.0}}, right[MOST_UNKNOWNS] = {0.0}, change[MOST_UNKNOWNS] = {0.0};
    double scaling[MOST_UNKNOWNS], square = 0.0;
    for (int64_t point = 0; point < c->count; point++) {
        double turned[3];
        apply_similarity(at, c->source + 3 * point, turned);
        const double rows[3][MOST_UNKNOWNS] = {{turned[0], 1.0, 0.0, 0.0, 0.0, turned[2], -turned[1]},
                                               {turned[1], 0.0, 1.0, 0.0, -turned[2], 0.0, turned[0]},
                                               {turned[2], 0.0, 0.0, 1.0, turned[1], -turned[0], 0.0}};
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
            return -1.0;
        scaling[i] = 1.0 / sqrt(N[i][i]);
    }
    for (int i = 0; i < n; i++) {
        right[i] *= scaling[i], change[i] = -right[i];
        for (int j = 0; j <= i; j++)
            N[i][j] *= scaling[i] * scaling[j];
    }
    if (!solve_scaled(N, change, n, d->singular))
        return -1.0;
    for (int i = 0; i < n; i++)
        square -= change[i] * right[i], change[i] *= scaling[i];
    const double turn = sqrt(dot3(change + 4, change + 4)), factor = fmin(1.0, d->longest_turn / fmax(turn, 1e-300));
    for (int i = 0; i < MOST_UNKNOWNS; i++)
        change[i] *= factor;
    double turned[9];
    at->scale *= exp(change[0]);
    for (int i = 0; i < 3; i++)
        at->shift[i] += change[1 + i];
    turn3(change + 4, at->rotation, turned);
    memcpy(at->rotation, turned, sizeof(turned));
    return sqrt(fmax(0.0, square) / n);
}

/* Returns the number of iterations; 0 where the equations are, or may be, singular. */
static int64_t adjust_similarity(const Common *c, const SimilarityDanish *d, At *at, double *factors, double *previous,
                                 double *scratch)
{
    const size_t size = (size_t)(3 * c->count) * sizeof(double);
    similarity_factors(c, d, at, factors, scratch);
    for (int64_t iteration = 1; iteration <= d->steps; iteration++) {
        double change = 0.0;
        const double step = similarity_step(c, d, factors, at);
        if (step < 0.0)
            return 0;
        memcpy(previous, factors, size);
        if (iteration < d->free_steps)
            similarity_factors(c, d, at, factors, scratch);
        for (int64_t k = 0; k < 3 * c->count; k++)
            change = fmax(change, fabs(factors[k] - previous[k]));
        if ((step < 1e-4 && change < 0.01) || iteration == d->steps)
            return iteration;
    }
    return 0;
}
