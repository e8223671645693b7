/* Relative orientation of one pair of photos; prelim_references/relative.py does the same and names the sources.
 */

#include "adjustment.h"
#include "start.h"

static int64_t relative_space(const RelativeRules *rules, int64_t count)
{
    const int64_t kept = (int64_t)rules->sampling.kept, starts = (int64_t)rules->sampling.starts;
    return judgement_space(&rules->sampling, count) + 12 * kept + starts * 13 + (starts + LANES) * count + 9 * count;
}

/* The least squares rotation that takes directions to others; M is the sum of their dyads. */
static void rotation_from(const double *M, double *R)
{
    double u[3][3], v[3][3];
    singular_vectors(M, u, v);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[3 * i + j] = u[0][i] * v[0][j] + u[1][i] * v[1][j] + u[2][i] * v[2][j];
}

/* The median residual of a pure rotation between two photos, in standard deviations; the iterations end at the first one
 * above `plain`. `space` has room for 9 numbers for each point.
 */
static double left_by_rotation(const Pairs *p, double plain, int64_t steps, double *space)
{
    double *left = space, *right = space + 3 * p->count, *weights = space + 6 * p->count;
    double *distance = space + 7 * p->count, *sorted = space + 8 * p->count, median = INFINITY;
    for (int64_t row = 0; row < p->count; row++) {
        const double *a = p->left + 3 * row, *b = p->right + 3 * row;
        for (int i = 0; i < 3; i++) {
            left[3 * row + i] = a[i] / sqrt(dot3(a, a));
            right[3 * row + i] = b[i] / sqrt(dot3(b, b));
        }
        weights[row] = 1.0;
    }
    for (int64_t step = 0; step < steps; step++) {
        double M[9] = {0.0}, R[9];
        for (int64_t row = 0; row < p->count; row++)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    M[3 * i + j] += weights[row] * left[3 * row + i] * right[3 * row + j];
        rotation_from(M, R);
        for (int64_t row = 0; row < p->count; row++) {
            double turned[3], apart[3];
            times3(R, right + 3 * row, turned);
            for (int i = 0; i < 3; i++)
                apart[i] = left[3 * row + i] - turned[i];
            const double *a = p->left + 3 * row;
            distance[row] = sqrt(dot3(apart, apart) * dot3(a, a)) / p->error[row];
            weights[row] = 1.0 / fmax(distance[row], 1e-3);
        }
        memcpy(sorted, distance, (size_t)p->count * sizeof(double));
        median = median_of(sorted, p->count);
        if (median > plain)
            break;
    }
    return median;
}

/* The angle of a rotation. */
static inline double turn_of(double trace) { return acos(smaller(larger(0.5 * (trace - 1.0), -1.0), 1.0)); }

/* The best of several orientations, by what they cost; of equally good ones that with the smallest rotation. */
static int64_t choose_orientation(const Choice *c, int64_t number, const double *bases, const double *rotations,
                      const double *costs, double *ambiguous)
{
    int64_t best = 0, chosen = -1;
    double least = INFINITY;
    for (int64_t k = 1; k < number; k++)
        if (costs[k] < costs[best])
            best = k;
    *ambiguous = 0.0;
    for (int64_t k = 0; k < number; k++) {
        const double *R = rotations + 9 * k, *other = rotations + 9 * best;
        double trace = 0.0;
        for (int i = 0; i < 9; i++)
            trace += R[i] * other[i];
        const double between = acos(smaller(larger(dot3(bases + 3 * k, bases + 3 * best), -1.0), 1.0));
        const int rival = costs[k] <= costs[best] + c->equally_good && larger(turn_of(trace), between) > c->same;
        if (rival)
            *ambiguous = 1.0;
        if (!rival && k != best)
            continue;
        const double turn = turn_of(R[0] + R[4] + R[8]);
        if (turn < least)
            least = turn, chosen = k;
    }
    return chosen;
}

/* The sum of squares in units of a scale; a point behind a photo counts as not fitting. */
static double cost_in_front(const Judgement *j, const double *base, const double *R, const double *squares, double scale)
{
    const double limit = j->rules->limit * j->rules->limit;
    double cost = 0.0;
    for (int64_t row = 0; row < j->pairs->count; row++) {
        double along[2];
        along_rays(base, R, j->pairs->left + 3 * row, j->pairs->right + 3 * row, along);
        const int in_front = along[0] > 0.0 && along[1] > 0.0;
        cost += in_front ? smaller(squares[row] / (scale * scale), limit) : limit;
    }
    return cost;
}

/* Adjust starts and choose the best one, which is written to `found`; returns its place. */
static int64_t try_starts(const Judgement *j, const RelativeRules *rules, int64_t number, double *bases,
                          double *rotations, double *space, RelativeFound *found)
{
    const Pairs *p = j->pairs;
    double *scales = space, *costs = space, *weights = space + number;
    for (int64_t k = 0; k < number; k++) {
        double E[9];
        essential_of(bases + 3 * k, rotations + 9 * k, E);
        squares_at(j, E, j->squares);
        scales[k] = consensus(j, j->squares).scale;
    }
    found->iterations = (double)adjust_relative(p, &rules->danish, scales, number, (int64_t)rules->choice.to_compare,
                                                bases, rotations, weights);
    for (int64_t k = 0; k < number; k++) {
        double E[9];
        essential_of(bases + 3 * k, rotations + 9 * k, E);
        squares_at(j, E, j->squares + p->count * k);
    }
    const Agreement agreed = best_agreement(j, number);
    const double sure = smaller((double)(p->count - 5), rules->choice.sure);
    found->scale = agreed.scale, found->by_chance = agreed.log_chance > -sure;
    for (int64_t k = 0; k < number; k++)
        costs[k] = cost_in_front(j, bases + 3 * k, rotations + 9 * k, j->squares + p->count * k, agreed.scale);
    return choose_orientation(&rules->choice, number, bases, rotations, costs, &found->ambiguous);
}

/* The standard error of unit weight of the points with full weight; 0 without redundancy. */
static double unit_weight_error(const Pairs *p, const RelativePoints *points)
{
    double square = 0.0, redundancy = 0.0;
    for (int64_t row = 0; row < p->count; row++)
        if (points->weights[row] == 1.0) {
            const double residual = points->parallax[row] / p->error[row];
            square += residual * residual, redundancy += points->redundancy[row];
        }
    return p->count == 5 || redundancy < 1e-6 ? 0.0 : sqrt(square / redundancy);
}

/* Standard deviations of the base, whose largest component is held, and of the angles. */
static void deviations_of(double inverse[5][5], RelativeFound *f)
{
    double across[2][3], rates[9];
    int held = 0;
    across_of(f->base, across);
    for (int i = 1; i < 3; i++)
        if (fabs(f->base[i]) > fabs(f->base[held]))
            held = i;
    for (int i = 0; i < 3; i++) {
        double partials[2];
        for (int k = 0; k < 2; k++)
            partials[k] = across[k][i] - f->base[i] / f->base[held] * across[k][held];
        f->base_deviation[i] = sqrt(larger(form_of(2, 5, inverse[0], partials), 0.0));
    }
    angle_rates(f->angles, rates);
    for (int i = 0; i < 3; i++)
        f->angle_deviation[i] = sqrt(larger(form_of(3, 5, inverse[2] + 2, rates + 3 * i), 0.0));
}

/* Standard deviations of the intersection of both rays of a point for a fixed orientation; `error` is that of a photo
 * coordinate.
 */
static void intersection_deviations(const double *base, const double *R, const double *left, const double *right,
                                    double error, const double *X, double *deviations)
{
    static const double UNTURNED[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, ORIGIN[3] = {0.0, 0.0, 0.0};
    double partials[4][6], residual[2], N[9] = {0.0}, minors[9];
    project(UNTURNED, ORIGIN, X, left, residual, partials);
    project(R, base, X, right, residual, partials + 2);
    for (int r = 0; r < 4; r++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                N[3 * i + j] += partials[r][3 + i] * partials[r][3 + j];
    const double trace = N[0] + N[4] + N[8];
    for (int i = 0; i < 3; i++)
        N[4 * i] += 1e-15 * trace;
    const double determinant = minors3(N, minors);
    for (int i = 0; i < 3; i++)
        deviations[i] = error * sqrt(larger(minors[4 * i] / determinant, 0.0));
}

/* Where the rays of each point meet, and how well. */
static void intersect_pairs(const Pairs *p, const RelativePoints *points, RelativeFound *f)
{
    int64_t usable = 0;
    f->length = 0.0;
    for (int64_t row = 0; row < p->count; row++) {
        const double *left = p->left + 3 * row, *right = p->right + 3 * row;
        double along[2], *X = points->coordinates + 3 * row, *deviations = points->deviations + 3 * row;
        meeting_of(f->base, f->rotation, left, right, X, along);
        points->in_front[row] = along[0] > 0.0 && along[1] > 0.0;
        points->usable[row] = points->weights[row] == 1.0 && points->in_front[row] && is_known(X);
        if (points->usable[row]) {
            f->length += 0.001 / along[0], usable++;
            intersection_deviations(f->base, f->rotation, left, right, p->error[row] / sqrt(2.0), X, deviations);
        } else {
            deviations[0] = deviations[1] = deviations[2] = NAN;
        }
    }
    f->length /= usable ? (double)usable : 1.0;
}

/* Orient the right photo to the left one; 0 where the points determine nothing. */
static int orient_relatively(const Pairs *p, const RelativeRules *rules, const int64_t *samples, int64_t number,
                             const double *log_of_sets, double *space, const RelativePoints *points,
                             RelativeFound *found)
{
    const Judgement j = judgement_of(p, &rules->sampling, log_of_sets, space);
    double *bases = space + judgement_space(&rules->sampling, p->count);
    double *rotations = bases + 3 * (int64_t)rules->sampling.starts;
    double *rest = rotations + 9 * (int64_t)rules->sampling.starts, E[9], inverse[5][5];
    const int64_t starts = starting_orientations(&j, samples, number, bases, rotations, rest);
    if (!starts)
        return 0;
    const int64_t best = try_starts(&j, rules, starts, bases, rotations, rest, found);
    memcpy(found->base, bases + 3 * best, sizeof(found->base));
    memcpy(found->rotation, rotations + 9 * best, sizeof(found->rotation));
    found->iterations += (double)adjust_relative(p, &rules->danish, &found->scale, 1, (int64_t)rules->choice.most,
                                                 found->base, found->rotation, rest);
    for (int64_t row = 0; row < p->count; row++)
        points->weights[row] = rest[LANES * row];
    essential_of(found->base, found->rotation, E);
    parallaxes_at(p, E, points->parallax);
    relative_precision(p, &rules->danish, found->base, found->rotation, points->weights, points->redundancy, inverse,
                       rest);
    found->seuw = unit_weight_error(p, points);
    angles_of(found->rotation, found->angles);
    deviations_of(inverse, found);
    intersect_pairs(p, points, found);
    found->left_by_rotation =
        left_by_rotation(p, rules->choice.plain_base * found->scale, (int64_t)rules->choice.rotation_steps, rest);
    return 1;
}
