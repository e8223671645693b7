/* Starting values of a relative orientation: samples of five points, judged by all the others;
 * prelim_references/relative.py does the same and names the sources.
 */

#include "five_points.h"
#include "parallax.h"

#define MOST_MATRICES 10

typedef struct {
    double log_chance, scale, share;
} Agreement;

/* What matrices are judged with; `unit` is the square of the chance that a point has a parallax up to its error. In `by_element`
 * and `costs` there is room for whole lanes.
 */
typedef struct {
    const Pairs *pairs;
    const Sampling *rules;
    const double *log_of_sets;
    double unit, *columns, *sorted, *bars, *essential, *by_element, *squares, *costs, *chosen;
} Judgement;

static int64_t most_matrices(const Sampling *rules)
{
    return (int64_t)rules->kept + MOST_MATRICES * (int64_t)rules->at_once;
}

static int64_t judgement_space(const Sampling *rules, int64_t count)
{
    return 9 * count + most_matrices(rules) * (count + 19) + 9 * (int64_t)rules->kept + 10 * LANES;
}

/* The probability that a point placed at random has a parallax up to its a-priori error. */
static double chance_of_unit(const Pairs *p)
{
    double extent = 0.0, error = 0.0;
    for (int side = 0; side < 2; side++) {
        const double *vectors = side ? p->right : p->left;
        double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
        for (int64_t row = 0; row < p->count; row++)
            for (int i = 0; i < 2; i++) {
                low[i] = fmin(low[i], vectors[3 * row + i]);
                high[i] = fmax(high[i], vectors[3 * row + i]);
            }
        extent = fmax(extent, hypot(high[0] - low[0], high[1] - low[1]));
    }
    for (int64_t row = 0; row < p->count; row++)
        error += p->error[row] / (double)p->count;
    return 2.0 * error / fmax(extent, 1e-300);
}

static Judgement judgement_of(const Pairs *p, const Sampling *rules, const double *log_of_sets, double *space)
{
    const int64_t most = most_matrices(rules);
    const double chance = chance_of_unit(p);
    Judgement j = {p, rules, log_of_sets, chance * chance, space, NULL, NULL, NULL, NULL, NULL, NULL, NULL};
    j.sorted = j.columns + 7 * p->count, j.bars = j.sorted + p->count, j.essential = j.bars + p->count;
    j.by_element = j.essential + 9 * most, j.costs = j.by_element + 9 * (most + LANES);
    j.chosen = j.costs + most + LANES, j.squares = j.chosen + 9 * (int64_t)rules->kept;
    for (int64_t row = 0; row < p->count; row++) {
        for (int i = 0; i < 3; i++) {
            j.columns[i * p->count + row] = p->left[3 * row + i];
            j.columns[(3 + i) * p->count + row] = p->right[3 * row + i];
        }
        j.columns[6 * p->count + row] = 2.0 / (p->error[row] * p->error[row]);
    }
    return j;
}

/* Squares of the parallaxes in units of their a-priori error, from columns, so that several are computed at once. */
static void squares_at(const Judgement *j, const double *E, double *square)
{
    const int64_t count = j->pairs->count;
    const double *x = j->columns, *y = x + count, *z = y + count, *u = z + count, *v = u + count, *w = v + count;
    const double *factor = w + count;
    for (int64_t row = 0; row < count; row++) {
        const double a = E[0] * u[row] + E[1] * v[row] + E[2] * w[row];
        const double b = E[3] * u[row] + E[4] * v[row] + E[5] * w[row];
        const double c = E[6] * u[row] + E[7] * v[row] + E[8] * w[row];
        const double d = E[0] * x[row] + E[3] * y[row] + E[6] * z[row];
        const double e = E[1] * x[row] + E[4] * y[row] + E[7] * z[row];
        const double f = a * x[row] + b * y[row] + c * z[row], gradient = a * a + b * b + d * d + e * e;
        square[row] = factor[row] * f * f / larger(gradient, 1e-300);
    }
}

/* Sort in ascending order: by halves about a pivot (Hoare 1961), a few numbers by insertion. */
static void sort(double *a, int64_t n)
{
    while (n > 16) {
        select_smallest(a, n, n / 2);
        sort(a, n / 2);
        a += n / 2, n -= n / 2;
    }
    for (int64_t i = 1; i < n; i++) {
        const double number = a[i];
        int64_t k = i;
        for (; k > 0 && a[k - 1] > number; k--)
            a[k] = a[k - 1];
        a[k] = number;
    }
}

/* How many points agree, compared with chance. */
static Agreement consensus(const Judgement *j, const double *squares)
{
    const int64_t count = j->pairs->count;
    Agreement agreed = {INFINITY, 1.0, 1.0};
    double sum = 0.0;
    if (count <= 5) {
        agreed.log_chance = 0.0;
        return agreed;
    }
    memcpy(j->sorted, squares, (size_t)count * sizeof(double));
    sort(j->sorted, count);
    for (int64_t k = 0; k < count; k++) {
        sum += j->sorted[k];
        if (k < 5)
            continue;
        const double least = j->rules->no_better * j->rules->no_better;
        const double largest = smaller(larger(larger(j->sorted[k], least) * j->unit, 1e-300), 1.0);
        const double log_chance = j->log_of_sets[k - 5] + 0.5 * (double)(k - 4) * log(largest);
        if (log_chance < agreed.log_chance) {
            agreed.log_chance = log_chance, agreed.share = (double)(k + 1) / (double)count;
            agreed.scale = larger(sqrt(sum / (double)(k - 4)), 1.0);
        }
    }
    return agreed;
}

/* For each number of points from 6, the bar: the square that the largest of so many must not exceed if they, or fewer, are
 * to be less explained by chance than the best agreement so far.
 */
static void raise_bars(const Judgement *j, double log_chance)
{
    const double least = j->rules->no_better * j->rules->no_better * j->unit;
    double highest = 0.0;
    for (int64_t k = 5; k < j->pairs->count; k++) {
        const double largest = exp(2.0 * (log_chance - j->log_of_sets[k - 5]) / (double)(k - 4));
        if (largest > least)
            highest = larger(highest, largest > 1.0 ? INFINITY : largest / j->unit);
        j->bars[k] = highest;
    }
}

/* Whether the agreement of points can be less explained by chance than the best one so far: whether a bar is met. */
static int may_agree(const Judgement *j, const double *squares)
{
    for (int64_t agreeing = j->pairs->count; agreeing > 5;) {
        const double bar = j->bars[agreeing - 1];
        int64_t below = 0;
        for (int64_t row = 0; row < j->pairs->count; row++)
            below += squares[row] <= bar;
        if (below >= agreeing)
            return 1;
        agreeing = below;
    }
    return 0;
}

/* The agreement, of several adjustments, that chance explains least. */
static Agreement best_agreement(const Judgement *j, int64_t number)
{
    const int64_t count = j->pairs->count;
    Agreement best = {INFINITY, 1.0, 1.0};
    for (int64_t k = 0; k < number; k++) {
        const double *squares = j->squares + count * k;
        if (isfinite(best.log_chance) && !may_agree(j, squares))
            continue;
        const Agreement agreed = consensus(j, squares);
        if (agreed.log_chance < best.log_chance) {
            best = agreed;
            raise_bars(j, best.log_chance);
        }
    }
    return best;
}

/* Exclude the matrices that are like another one, four at once: their costs become infinite. */
static void exclude_alike(const Judgement *j, int64_t number, const double *e)
{
    for (int64_t first = 0; first < number; first += LANES) {
        Lanes product = ALL(0.0), *costs = &AT(j->costs + first);
        for (int i = 0; i < 9; i++)
            product += AT(j->by_element + 9 * first + LANES * i) * ALL(e[i]);
        *costs = either(size_of_each(product) < ALL(j->rules->alike), *costs, ALL(INFINITY));
    }
}

/* Move the best matrices that are not alike to the front, the best first; returns how many. Costs are overwritten. */
static int64_t best_unlike(const Judgement *j, int64_t number)
{
    int64_t found = 0;
    for (int64_t k = 0; k < number; k++)
        for (int i = 0; i < 9; i++)
            j->by_element[9 * (k - k % LANES) + LANES * i + k % LANES] = j->essential[9 * k + i];
    for (; found < (int64_t)j->rules->kept; found++) {
        int64_t best = 0;
        for (int64_t k = 1; k < number; k++)
            if (j->costs[k] < j->costs[best])
                best = k;
        if (number == 0 || !isfinite(j->costs[best]))
            break;
        double *e = j->chosen + 9 * found;
        memcpy(e, j->essential + 9 * best, 9 * sizeof(double));
        exclude_alike(j, number, e);
        j->costs[best] = INFINITY;
    }
    memcpy(j->essential, j->chosen, (size_t)found * 9 * sizeof(double));
    return found;
}

/* Add the matrices of samples of five points to those there are, with the squares of all; returns how many. */
static int64_t solve_samples(const Judgement *j, const int64_t *drawn, int64_t samples, int64_t number)
{
    const Pairs *p = j->pairs;
    for (int64_t first = 0; first < samples; first += LANES) {
        Lanes left[5][3], right[5][3];
        const int lanes = samples - first < LANES ? (int)(samples - first) : LANES;
        for (int lane = 0; lane < LANES; lane++)
            for (int k = 0; k < 5; k++) {
                /* lanes without a sample have the last one */
                const int64_t row = drawn[5 * (first + (lane < lanes ? lane : lanes - 1)) + k];
                for (int i = 0; i < 3; i++) {
                    LANE(left[k][i], lane) = p->left[3 * row + i];
                    LANE(right[k][i], lane) = p->right[3 * row + i];
                }
            }
        number += five_points(left, right, lanes, (double(*)[9])(j->essential + 9 * number));
    }
    for (int64_t k = 0; k < number; k++)
        squares_at(j, j->essential + 9 * k, j->squares + p->count * k);
    return number;
}

/* Keep the best matrices at a scale; returns how many. The sums of as many matrices as there are lanes are formed at once. */
static int64_t keep_best(const Judgement *j, int64_t number, double scale)
{
    const double largest = scale * scale * j->rules->limit * j->rules->limit;
    for (int64_t first = 0; first < number; first += LANES) {
        const double *squares[LANES];
        double sums[LANES] = {0.0};
        for (int lane = 0; lane < LANES; lane++)
            squares[lane] = j->squares + j->pairs->count * (first + lane < number ? first + lane : first);
        for (int64_t row = 0; row < j->pairs->count; row++)
            for (int lane = 0; lane < LANES; lane++)
                sums[lane] += smaller(squares[lane][row], largest);
        for (int lane = 0; lane < LANES && first + lane < number; lane++)
            j->costs[first + lane] = sums[lane];
    }
    return best_unlike(j, number);
}

/* How many samples make it likely that one of them is free of blunders. */
static double samples_needed(const Sampling *rules, const Agreement *best)
{
    const double clean = smaller(pow(best->share, 5.0), 1.0 - 1e-12), needed = log(rules->missed) / log1p(-clean);
    return larger(needed, best->scale > rules->ordinary_scale ? rules->samples_of_large_scale : 0.0);
}

/* Left and right singular vectors of a matrix, those of the largest singular value first, right-handed. */
static void singular_vectors(const double *M, double u[3][3], double v[3][3])
{
    double square[3][3], values[3], V[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            square[i][j] = M[i] * M[j] + M[3 + i] * M[3 + j] + M[6 + i] * M[6 + j];
    eigen3(square, values, V);
    for (int i = 0; i < 3; i++)
        v[0][i] = V[2][i], v[1][i] = V[1][i];
    cross3(v[0], v[1], v[2]);
    for (int k = 0; k < 2; k++) {
        times3(M, v[k], u[k]);
        const double along = k ? dot3(u[0], u[1]) : 0.0;
        for (int i = 0; i < 3; i++)
            u[k][i] -= along * u[0][i];
        const double length = sqrt(dot3(u[k], u[k]));
        for (int i = 0; i < 3; i++)
            u[k][i] /= length;
    }
    cross3(u[0], u[1], u[2]);
}

/* The four pairs of base and rotation of an essential matrix (Hartley and Zisserman 2004, result 9.19). */
static void photos_of(const double *E, double bases[4][3], double rotations[4][9])
{
    double u[3][3], v[3][3];
    singular_vectors(E, u, v);
    for (int k = 0; k < 4; k++) {
        /* U Z V^T with a quarter turn Z, forwards or back */
        const double turn = k < 2 ? 1.0 : -1.0, sign = k % 2 ? -1.0 : 1.0;
        for (int i = 0; i < 3; i++) {
            bases[k][i] = sign * u[2][i];
            for (int j = 0; j < 3; j++)
                rotations[k][3 * i + j] = turn * (u[1][i] * v[0][j] - u[0][i] * v[1][j]) + u[2][i] * v[2][j];
        }
    }
}

/* The orientation of an essential matrix with the most points in front; returns its cost. */
static double front_of(const Judgement *j, const double *E, double largest, double *base, double *R)
{
    double bases[4][3], rotations[4][9], *squares = j->sorted, least = INFINITY;
    squares_at(j, E, squares);
    photos_of(E, bases, rotations);
    for (int k = 0; k < 4; k += 2) {
        /* with the base reversed both distances change their signs */
        double costs[2] = {0.0, 0.0};
        for (int64_t row = 0; row < j->pairs->count; row++) {
            double along[2];
            along_rays(bases[k], rotations[k], j->pairs->left + 3 * row, j->pairs->right + 3 * row, along);
            const double fitting = smaller(squares[row], largest);
            costs[0] += along[0] > 0.0 && along[1] > 0.0 ? fitting : largest;
            costs[1] += along[0] < 0.0 && along[1] < 0.0 ? fitting : largest;
        }
        for (int i = 0; i < 2; i++)
            if (costs[i] < least) {
                least = costs[i];
                memcpy(base, bases[k + i], sizeof(bases[k]));
                memcpy(R, rotations[k], sizeof(rotations[k]));
            }
    }
    return least;
}

/* Of each matrix the orientation with the most points in front, the best orientations first; returns how many. `space`
 * has room for the bases and rotations of all matrices.
 */
static int64_t best_in_front(const Judgement *j, int64_t number, double scale, double *bases, double *rotations,
                             double *space)
{
    const Sampling *rules = j->rules;
    double *all_bases = space, *all_rotations = space + 3 * number;
    const double largest = scale * scale * rules->limit * rules->limit;
    int64_t found = 0;
    for (int64_t k = 0; k < number; k++)
        j->costs[k] = front_of(j, j->essential + 9 * k, largest, all_bases + 3 * k, all_rotations + 9 * k);
    for (; found < number && found < (int64_t)rules->starts; found++) {
        int64_t least = 0;
        for (int64_t k = 1; k < number; k++)
            if (j->costs[k] < j->costs[least])
                least = k;
        j->costs[least] = INFINITY;
        memcpy(bases + 3 * found, all_bases + 3 * least, 3 * sizeof(double));
        memcpy(rotations + 9 * found, all_rotations + 9 * least, 9 * sizeof(double));
    }
    return found;
}

/* The best orientations that samples of five points give, best first; returns how many. `space` as for `best_in_front`
 * of all matrices that are kept.
 */
static int64_t starting_orientations(const Judgement *j, const int64_t *samples, int64_t number, double *bases,
                                     double *rotations, double *space)
{
    const Sampling *rules = j->rules;
    Agreement best = {INFINITY, 1.0, 1.0};
    int64_t kept = 0;
    for (int64_t start = 0, drawn; start < number; start += drawn) {
        drawn = start + (int64_t)rules->at_once < number ? (int64_t)rules->at_once : number - start;
        const int64_t solved = solve_samples(j, samples + 5 * start, drawn, kept);
        best = best_agreement(j, solved);
        kept = keep_best(j, solved, best.scale);
        if (kept && (double)(start + drawn) >= samples_needed(rules, &best))
            break;
    }
    return best_in_front(j, kept, best.scale, bases, rotations, space);
}
