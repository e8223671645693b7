/* Relative orientation by points whose residuals are of a given scale; prelim_references/relative.py does the same. */

#include "solution.h"

/* Whether more points fit than would at random. */
static int is_beyond_chance(const Judgement *j, const double *squares, double scale, double sure)
{
    const double largest = j->rules->limit * scale;
    int64_t fitting = 0;
    for (int64_t row = 0; row < j->pairs->count; row++)
        fitting += squares[row] <= largest * largest;
    if (fitting <= 5)
        return 0;
    const double chance = log(smaller(largest * sqrt(j->unit), 1.0));
    return j->log_of_sets[fitting - 6] + (double)(fitting - 5) * chance < -sure;
}

/* Adjust starts at a scale and take the one that most points fit; 0 where as many would by chance. */
static int choose_at_scale(const Judgement *j, const RelativeRules *rules, double scale, int64_t starts, double *bases,
                           double *rotations, double *rest, const RelativePoints *points, RelativeFound *found)
{
    const Pairs *p = j->pairs;
    double *scales = rest, *weights = rest + (int64_t)rules->sampling.starts, E[9], least = INFINITY;
    int64_t best = -1;
    for (int64_t k = 0; k < starts; k++)
        scales[k] = scale * rules->sampling.limit / rules->danish.limit;
    if (starts)
        adjust_relative(p, &rules->danish, scales, starts, (int64_t)rules->choice.to_compare, bases, rotations, weights);
    for (int64_t k = 0; k < starts; k++) {
        double *squares = j->squares + p->count * k;
        essential_of(bases + 3 * k, rotations + 9 * k, E);
        squares_at(j, E, squares);
        const double cost = cost_in_front(j, bases + 3 * k, rotations + 9 * k, squares, scale);
        if (cost < least)
            best = k, least = cost;
    }
    if (best < 0 || !is_beyond_chance(j, j->squares + p->count * best, scale, rules->choice.sure))
        return 0;
    memcpy(found->base, bases + 3 * best, sizeof(found->base));
    memcpy(found->rotation, rotations + 9 * best, sizeof(found->rotation));
    essential_of(found->base, found->rotation, E);
    parallaxes_at(p, E, points->parallax);
    for (int64_t row = 0; row < p->count; row++)
        points->weights[row] = danish_weight(fabs(points->parallax[row]) / (p->error[row] * scales[best]),
                                             rules->danish.limit, rules->danish.floor);
    intersect_pairs(p, points, found);
    return 1;
}

/* Adjust an orientation, given in `found`, that is nearly right. */
static int adjust_at_scale(const Pairs *p, const RelativeRules *rules, const double *log_of_sets, double scale,
                           double *space, const RelativePoints *points, RelativeFound *found)
{
    const Judgement j = judgement_of(p, &rules->sampling, log_of_sets, space);
    double *rest = space + judgement_space(&rules->sampling, p->count) + 12 * (int64_t)rules->sampling.starts;
    double base[3], rotation[9];
    memcpy(base, found->base, sizeof(base));
    memcpy(rotation, found->rotation, sizeof(rotation));
    if (!choose_at_scale(&j, rules, scale, 1, base, rotation, rest, points, found))
        return 0;
    found->left_by_rotation =
        left_by_rotation(p, rules->choice.plain_base * scale, (int64_t)rules->choice.rotation_steps, rest);
    return 1;
}

/* Orient the right photo to the left one as most points fit at a scale; 0 where as many would by chance. All samples are
 * judged at once.
 */
static int orient_at_scale(const Pairs *p, const RelativeRules *rules, const int64_t *samples, int64_t number,
                           const double *log_of_sets, double scale, double *space, const RelativePoints *points,
                           RelativeFound *found)
{
    const int64_t most = (int64_t)rules->sampling.starts;
    const Judgement j = judgement_of(p, &rules->sampling, log_of_sets, space);
    double *bases = space + judgement_space(&rules->sampling, p->count), *rotations = bases + 3 * most;
    double *rest = rotations + 9 * most;
    const int64_t kept = keep_best(&j, solve_samples(&j, samples, number, 0), scale);
    const int64_t starts = best_in_front(&j, kept, scale, bases, rotations, rest);
    return choose_at_scale(&j, rules, scale, starts, bases, rotations, rest, points, found);
}
