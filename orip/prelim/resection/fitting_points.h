/* Which points fit their photos, many photos at once; resection.py does the same. */

#include "photo.h"

static int64_t fitting_space(int64_t count, int64_t candidates)
{
    return resection_space(count, candidates) + (candidates + 2) * count;
}

static double log_choose(int64_t n, int64_t m)
{
    return lgamma((double)n + 1.0) - lgamma((double)m + 1.0) - lgamma((double)(n - m) + 1.0);
}

/* See chance.py. */
static int fit_beyond_chance(int64_t n, const double *factors, const double *residual, double extent, double sure)
{
    int64_t m = 0;
    double largest = 0.0;
    for (int64_t row = 0; row < n; row++)
        if (factors[row] >= 1.0)
            m++, largest = larger(largest, residual[2 * row] * residual[2 * row]
                                               + residual[2 * row + 1] * residual[2 * row + 1]);
    if (m <= 3)
        return 0;
    const double chance = smaller(3.14159265358979323846 * largest / larger(extent, 1e-300), 1.0);
    if (chance <= 0.0)
        return 1;
    const double sets = log((double)(n - 3)) + log_choose(n, m) + log_choose(m, 3);
    return sets + (double)(m - 3) * log(chance) < -sure;
}

static int is_useful(const ResectionFound *f, const PhotoJudgement *j)
{
    double angle = 0.0, shift = 0.0;
    for (int i = 0; i < 3; i++)
        angle = larger(angle, f->deviation[i]), shift = larger(shift, f->deviation[3 + i]);
    return f->misfit <= j->misfit * f->radius && angle <= j->angle && shift <= j->shift * f->distance;
}

/* Orient a photo and mark the points that fit it, none if that is useless or by chance; 0 where `resect_photo` finds
 * nothing. */
static int mark_fitting(const PhotoToFit *photo, const ResectionRules *rules, const PhotoJudgement *judgement,
                        int64_t candidates, double *space, double *rotation, double *centre, uint8_t *fits)
{
    const int64_t n = photo->known.count;
    double *factors = space, *residual = factors + candidates * n, *rest = residual + 2 * n;
    double rotations[9 * MOST_CANDIDATES], centres[3 * MOST_CANDIDATES];
    ResectionFound found;
    if (!resect_photo(photo->points, photo->deviations, photo->known, rules, photo->triples, photo->number, candidates,
                      rotations, centres, factors, residual, rest, &found))
        return 0;
    const int agrees = is_useful(&found, judgement)
        && fit_beyond_chance(n, factors, residual, photo->extent, judgement->sure);
    memcpy(rotation, rotations, 9 * sizeof(double));
    memcpy(centre, centres, 3 * sizeof(double));
    for (int64_t row = 0; row < n; row++)
        fits[row] = agrees && factors[row] >= 1.0;
    return 1;
}
