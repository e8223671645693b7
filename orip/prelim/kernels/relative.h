/* Relative orientation of one pair of photos; orip/prelim/relative_start.py, relative_adjustment.py and parallax.py do
 * the same, and say where it comes from.
 */

#include "five_points.h"
#include "linear.h"

typedef struct {
    const double *left, *right, *error;
    int64_t count;
} Pairs;

typedef struct {
    double unit, no_better, limit, alike;
    const double *log_of_sets;
    int64_t kept;
} Judgement;

typedef struct {
    double log_chance, scale, share;
} Agreement;

typedef struct {
    double limit, floor, converged, longest, regular;
    int64_t iterations, held;
} RelativeDanish;

static inline void times3(const double *M, const double *v, double *product)
{
    for (int i = 0; i < 3; i++)
        product[i] = dot3(M + 3 * i, v);
}

static inline void transposed_times3(const double *M, const double *v, double *product)
{
    for (int i = 0; i < 3; i++)
        product[i] = M[i] * v[0] + M[3 + i] * v[1] + M[6 + i] * v[2];
}

/* F, its gradients by the left and the right image vector, and the square of them by the photo coordinates. */
static inline double condition(const double *E, const double *left, const double *right, double *by_left,
                               double *by_right, double *square)
{
    times3(E, right, by_left);
    transposed_times3(E, left, by_right);
    *square = fmax(by_left[0] * by_left[0] + by_left[1] * by_left[1] + by_right[0] * by_right[0]
                       + by_right[1] * by_right[1],
                   1e-300);
    return dot3(by_left, left);
}

static void parallaxes_at(const Pairs *p, const double *E, double *value)
{
    for (int64_t row = 0; row < p->count; row++) {
        double by_left[3], by_right[3], square;
        const double f = condition(E, p->left + 3 * row, p->right + 3 * row, by_left, by_right, &square);
        value[row] = f * sqrt(2.0 / square);
    }
}

static void residuals_at(const Pairs *p, const double *E, double *residual)
{
    parallaxes_at(p, E, residual);
    for (int64_t row = 0; row < p->count; row++)
        residual[row] = fabs(residual[row]) / p->error[row];
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

/* Sort upwards: halves about a pivot (Hoare 1961), a few numbers one by one. */
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

/* How many points agree, against chance; the residuals are sorted. */
static Agreement consensus(const Judgement *j, double *residual, int64_t count)
{
    Agreement agreed = {INFINITY, 1.0, 1.0};
    double square = 0.0;
    if (count <= 5) {
        agreed.log_chance = 0.0;
        return agreed;
    }
    sort(residual, count);
    for (int64_t k = 0; k < count; k++) {
        square += residual[k] * residual[k];
        if (k < 5)
            continue;
        const double largest = fmin(fmax(fmax(residual[k], j->no_better) * j->unit, 1e-300), 1.0);
        const double log_chance = j->log_of_sets[k - 5] + (double)(k - 4) * log(largest);
        if (log_chance < agreed.log_chance) {
            agreed.log_chance = log_chance, agreed.share = (double)(k + 1) / (double)count;
            agreed.scale = fmax(sqrt(square / (double)(k - 4)), 1.0);
        }
    }
    return agreed;
}

static inline double cost_of(const double *residual, int64_t count, double scale, double limit)
{
    double sum = 0.0;
    for (int64_t row = 0; row < count; row++) {
        const double u = fmin(residual[row] / scale, limit);
        sum += u * u;
    }
    return sum;
}

/* Move the best matrices that are not alike to the front, the best first; returns how many. Costs are used up. */
static int64_t best_unlike(const Judgement *j, double *essential, int64_t number, double *costs, double *chosen)
{
    int64_t found = 0;
    for (; found < j->kept; found++) {
        int64_t best = -1;
        for (int64_t k = 0; k < number; k++)
            if (isfinite(costs[k]) && (best < 0 || costs[k] < costs[best]))
                best = k;
        if (best < 0)
            break;
        double *e = chosen + 9 * found;
        memcpy(e, essential + 9 * best, 9 * sizeof(double));
        for (int64_t k = 0; k < number; k++) {
            double product = 0.0;
            for (int i = 0; i < 9; i++)
                product += essential[9 * k + i] * e[i];
            if (!(fabs(product) < j->alike) || k == best)
                costs[k] = INFINITY;
        }
    }
    memcpy(essential, chosen, (size_t)found * 9 * sizeof(double));
    return found;
}

/* Add the matrices of samples of five points to those there are, and keep the best; returns how many. */
static int64_t judge_samples(const Pairs *p, const Judgement *j, const int64_t *drawn, int64_t samples,
                             double *essential, int64_t number, double *residuals, double *sorted, double *costs,
                             double *chosen, Agreement *best)
{
    for (int64_t sample = 0; sample < samples; sample++) {
        double left[5][3], right[5][3];
        for (int k = 0; k < 5; k++) {
            const int64_t row = drawn[5 * sample + k];
            memcpy(left[k], p->left + 3 * row, sizeof(left[k]));
            memcpy(right[k], p->right + 3 * row, sizeof(right[k]));
        }
        number += five_points(left, right, (double(*)[9])(essential + 9 * number));
    }
    best->log_chance = INFINITY;
    for (int64_t k = 0; k < number; k++) {
        residuals_at(p, essential + 9 * k, residuals + p->count * k);
        memcpy(sorted, residuals + p->count * k, (size_t)p->count * sizeof(double));
        const Agreement agreed = consensus(j, sorted, p->count);
        if (agreed.log_chance < best->log_chance)
            *best = agreed;
    }
    for (int64_t k = 0; k < number; k++)
        costs[k] = cost_of(residuals + p->count * k, p->count, best->scale, j->limit);
    return best_unlike(j, essential, number, costs, chosen);
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
        v[0][i] = V[i][2], v[1][i] = V[i][1];
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

static inline int is_in_front(const double *base, const double *R, const double *left, const double *right)
{
    double turned[3], normal[3], by_right[3], by_left[3];
    times3(R, right, turned);
    cross3(left, turned, normal);
    cross3(base, turned, by_right);
    cross3(base, left, by_left);
    /* parallel rays are nowhere */
    return dot3(normal, normal) > 0.0 && dot3(by_right, normal) > 0.0 && dot3(by_left, normal) > 0.0;
}

/* Of an essential matrix the orientation with the most points in front, and what it costs. */
static double front_of(const Pairs *p, const double *E, double scale, double limit, double *base, double *R,
                       double *residual)
{
    double bases[4][3], rotations[4][9], least = INFINITY;
    residuals_at(p, E, residual);
    photos_of(E, bases, rotations);
    for (int k = 0; k < 4; k++) {
        double cost = 0.0;
        for (int64_t row = 0; row < p->count; row++) {
            const int seen = is_in_front(bases[k], rotations[k], p->left + 3 * row, p->right + 3 * row);
            const double u = seen ? fmin(residual[row] / scale, limit) : limit;
            cost += u * u;
        }
        if (cost < least) {
            least = cost;
            memcpy(base, bases[k], sizeof(bases[k]));
            memcpy(R, rotations[k], sizeof(rotations[k]));
        }
    }
    return least;
}

static void essential_of(const double *base, const double *R, double *E)
{
    for (int j = 0; j < 3; j++) {
        const double column[3] = {R[j], R[3 + j], R[6 + j]};
        double turned[3];
        cross3(base, column, turned);
        for (int i = 0; i < 3; i++)
            E[3 * i + j] = turned[i];
    }
}

/* Two directions across a base: what Householder's reflection makes of the second and third axis. */
static void across_of(const double *base, double across[2][3])
{
    double v[3] = {base[0], base[1], base[2]};
    const double length = sqrt(dot3(base, base));
    v[0] += base[0] < 0.0 ? -length : length;
    const double factor = 2.0 / dot3(v, v);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 3; i++)
            across[k][i] = (i == k + 1) - factor * v[i] * v[k + 1];
}

static void solve5(double A[5][5], double *b)
{
    for (int k = 0; k < 5; k++)
        for (int i = k + 1; i < 5; i++) {
            const double factor = A[i][k] / A[k][k];
            for (int j = k; j < 5; j++)
                A[i][j] -= factor * A[k][j];
            b[i] -= factor * b[k];
        }
    for (int i = 4; i >= 0; i--) {
        for (int j = i + 1; j < 5; j++)
            b[i] -= A[i][j] * b[j];
        b[i] /= A[i][i];
    }
}

/* One point: parallax, and its partials by the base across itself and by a small rotation, over the error. */
static inline double parallax_row(const double *E, const double *base, const double *R, const double across[2][3],
                                  const double *left, const double *right, double error, double *design)
{
    double by_left[3], by_right[3], square, turned[3], turned_gradient[3], of_left[3], of_right[3];
    const double f = condition(E, left, right, by_left, by_right, &square);
    const double root = sqrt(2.0 / square), value = f * root, shrinking = value / square;
    by_left[2] = by_right[2] = 0.0;
    times3(R, right, turned);
    times3(R, by_right, turned_gradient);
    for (int i = 0; i < 3; i++) {
        of_left[i] = root * left[i] - shrinking * by_left[i];
        of_right[i] = -shrinking * turned_gradient[i];
    }
    double a[3], b[3], by_base[3];
    cross3(turned, of_left, a);
    cross3(of_right, left, b);
    for (int i = 0; i < 3; i++)
        by_base[i] = (a[i] + b[i]) / error;
    design[0] = dot3(by_base, across[0]), design[1] = dot3(by_base, across[1]);
    double c[3], d[3];
    cross3(base, of_left, c);
    cross3(c, turned, a);
    cross3(base, left, d);
    cross3(d, of_right, b);
    for (int i = 0; i < 3; i++)
        design[2 + i] = (a[i] + b[i]) / error;
    return value;
}

/* One iteration; returns the square of the correction in standard deviations. */
static double relative_step(const Pairs *p, const RelativeDanish *d, double limit, int weights_held, double *base,
                            double *R, double *weights)
{
    double E[9], across[2][3], N[5][5] = {{0.0}}, right[5] = {0.0}, step[5], trace = 0.0, longest = 0.0, square = 0.0;
    essential_of(base, R, E);
    across_of(base, across);
    for (int64_t row = 0; row < p->count; row++) {
        double design[5];
        const double value =
            parallax_row(E, base, R, across, p->left + 3 * row, p->right + 3 * row, p->error[row], design);
        if (!weights_held)
            weights[row] = danish_weight(fabs(value) / (p->error[row] * limit), d->limit, d->floor);
        for (int i = 0; i < 5; i++) {
            const double weighted = weights[row] * design[i];
            right[i] -= weighted * value / p->error[row];
            for (int j = 0; j < 5; j++)
                N[i][j] += weighted * design[j];
        }
    }
    for (int i = 0; i < 5; i++)
        trace += N[i][i];
    for (int i = 0; i < 5; i++)
        N[i][i] += d->regular * trace + 1e-300;
    memcpy(step, right, sizeof(step));
    solve5(N, step);
    for (int i = 0; i < 5; i++)
        square += step[i] * right[i], longest = fmax(longest, fabs(step[i]));
    const double factor = fmin(1.0, d->longest / fmax(longest, 1e-300));
    for (int i = 0; i < 5; i++)
        step[i] *= factor;
    for (int i = 0; i < 3; i++)
        base[i] += step[0] * across[0][i] + step[1] * across[1][i];
    const double length = sqrt(dot3(base, base));
    double turned[9];
    for (int i = 0; i < 3; i++)
        base[i] /= length;
    turn3(step + 2, R, turned);
    memcpy(R, turned, sizeof(turned));
    return square;
}

/* Adjust orientations side by side, until none of them moves; returns the number of iterations. */
static int64_t adjust_pairs(const Pairs *p, const RelativeDanish *d, const double *limits, int64_t number,
                            double *bases, double *rotations, double *weights, double *parallax)
{
    int64_t iteration = 1;
    for (;; iteration++) {
        double largest = 0.0;
        for (int64_t k = 0; k < number; k++)
            largest = fmax(largest, relative_step(p, d, limits[k], iteration > d->held, bases + 3 * k,
                                                  rotations + 9 * k, weights + p->count * k));
        if (largest < d->converged * d->converged || iteration == d->iterations)
            break;
    }
    for (int64_t k = 0; k < number; k++) {
        double E[9];
        essential_of(bases + 3 * k, rotations + 9 * k, E);
        parallaxes_at(p, E, parallax + p->count * k);
    }
    return iteration;
}

/* Redundancy numbers of an adjusted orientation, and the inverse of its normal equations (5 x 5). */
static void relative_precision(const Pairs *p, double regular, const double *base, const double *R,
                               const double *weights, double *redundancy, double *inverse)
{
    double E[9], across[2][3], N[5][5] = {{0.0}}, design[5], trace = 0.0;
    essential_of(base, R, E);
    across_of(base, across);
    for (int64_t row = 0; row < p->count; row++) {
        parallax_row(E, base, R, across, p->left + 3 * row, p->right + 3 * row, p->error[row], design);
        for (int i = 0; i < 5; i++)
            for (int j = 0; j < 5; j++)
                N[i][j] += weights[row] * design[i] * design[j];
    }
    for (int i = 0; i < 5; i++)
        trace += N[i][i];
    for (int i = 0; i < 5; i++)
        N[i][i] += regular * trace + 1e-300;
    for (int k = 0; k < 5; k++) {
        double used[5][5], column[5] = {0.0};
        memcpy(used, N, sizeof(N));
        column[k] = 1.0;
        solve5(used, column);
        for (int i = 0; i < 5; i++)
            inverse[5 * i + k] = column[i];
    }
    for (int64_t row = 0; row < p->count; row++) {
        double cofactor = 0.0;
        parallax_row(E, base, R, across, p->left + 3 * row, p->right + 3 * row, p->error[row], design);
        for (int i = 0; i < 5; i++)
            for (int j = 0; j < 5; j++)
                cofactor += design[i] * inverse[5 * i + j] * design[j];
        redundancy[row] = fmax(1.0 - weights[row] * cofactor, 0.0);
    }
}

/* The rotation that takes directions to others with the least squares; M is the sum of their dyads. */
static void rotation_from(const double *M, double *R)
{
    double u[3][3], v[3][3];
    singular_vectors(M, u, v);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[3 * i + j] = u[0][i] * v[0][j] + u[1][i] * v[1][j] + u[2][i] * v[2][j];
}

/* The median of what a rotation alone leaves between two photos, in standard deviations, or the first one above
 * `plain`. `space` has room for 9 numbers a point.
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

/* Standard deviations of the intersections of both rays of each point from the orientation that is held; `error` is
 * that of a photo coordinate.
 */
static void intersection_deviations(const Pairs *p, const double *base, const double *R, const double *coordinates,
                                    double *deviations)
{
    static const double UNTURNED[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, ORIGIN[3] = {0.0, 0.0, 0.0};
    for (int64_t row = 0; row < p->count; row++) {
        const double *X = coordinates + 3 * row;
        double partials[4][6], residual[2], N[9] = {0.0}, minors[9], trace;
        project(UNTURNED, ORIGIN, X, p->left + 3 * row, residual, partials);
        project(R, base, X, p->right + 3 * row, residual, partials + 2);
        for (int r = 0; r < 4; r++)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    N[3 * i + j] += partials[r][3 + i] * partials[r][3 + j];
        trace = N[0] + N[4] + N[8];
        for (int i = 0; i < 3; i++)
            N[4 * i] += 1e-15 * trace;
        cross3(N + 3, N + 6, minors);
        cross3(N + 6, N, minors + 3);
        cross3(N, N + 3, minors + 6);
        const double determinant = dot3(N, minors);
        for (int i = 0; i < 3; i++)
            deviations[3 * row + i] = p->error[row] * sqrt(fmax(minors[4 * i] / determinant, 0.0));
    }
}
