/* Least squares of the space resection of one photo; orip/prelim/resection_adjustment.py does the same. */

#include "linear.h"
#include "three_points.h"

typedef struct {
    const double *vectors, *coordinates, *deviations;
    double error;
    int64_t count, least;
} Known;

typedef struct {
    double *residual, *partials, *variance, *squares, *weights, *sorted;
} Equations;

#define NUMBERS_OF_A_POINT (2 + 12 + 4)

static Equations equations_in(double *space, int64_t count)
{
    const Equations e = {space, space + 2 * count, space + 14 * count, space + 15 * count, space + 16 * count,
                         space + 17 * count};
    return e;
}

static void linearise_resection(const Known *k, const double *R, const double *centre, Equations *e)
{
    for (int64_t row = 0; row < k->count; row++) {
        const double *X = k->coordinates + 3 * row, *v = k->vectors + 3 * row;
        const double d[3] = {X[0] - centre[0], X[1] - centre[1], X[2] - centre[2]};
        const double scale = -v[2] / sqrt(dot3(d, d)), moved = scale * k->deviations[row];
        double *residual = e->residual + 2 * row;
        const int in_front = project(R, centre, X, v, residual, (double(*)[6])(e->partials + 12 * row));
        e->variance[row] = k->error * k->error + moved * moved;
        e->squares[row] =
            in_front ? (residual[0] * residual[0] + residual[1] * residual[1]) / e->variance[row] : INFINITY;
    }
}

static void solve_resection(const Known *k, const Equations *e, double damping, double *correction)
{
    double N[6][6] = {{0.0}}, right[6] = {0.0}, largest = 0.0;
    for (int64_t row = 0; row < k->count; row++) {
        if (!isfinite(e->squares[row]) || e->weights[row] == 0.0)
            continue;
        const double weight = e->weights[row] / e->variance[row];
        for (int r = 0; r < 2; r++) {
            const double *p = e->partials + 12 * row + 6 * r;
            for (int i = 0; i < 6; i++) {
                right[i] -= weight * p[i] * e->residual[2 * row + r];
                for (int j = 0; j < 6; j++)
                    N[i][j] += weight * p[i] * p[j];
            }
        }
    }
    for (int i = 0; i < 6; i++)
        largest = fmax(largest, N[i][i]);
    for (int i = 0; i < 6; i++)
        N[i][i] += damping * N[i][i] + 1e-13 * largest + 1e-300;
    solve6(N, right);
    memcpy(correction, right, sizeof(right));
}

static void move_photo(const double *correction, const double *R, const double *centre, double *R_moved,
                       double *centre_moved)
{
    const double turn = sqrt(dot3(correction, correction)), factor = fmin(1.0, 0.5 / fmax(turn, 1e-300));
    const double d[3] = {factor * correction[0], factor * correction[1], factor * correction[2]};
    turn3(d, R, R_moved);
    for (int i = 0; i < 3; i++)
        centre_moved[i] = centre[i] + factor * correction[3 + i];
}

/* The sum of the smallest squares, and the largest of these. */
static double trimmed(const Known *k, Equations *e, double *largest)
{
    memcpy(e->sorted, e->squares, (size_t)k->count * sizeof(double));
    *largest = select_smallest(e->sorted, k->count, k->least - 1);
    double sum = 0.0;
    for (int64_t row = 0; row < k->least; row++)
        sum += e->sorted[row];
    return sum;
}

/* Squared residuals of an orientation; their quantile that blunders leave alone. */
static double quantile_at(const Known *k, const double *R, const double *centre, double *sorted)
{
    for (int64_t row = 0; row < k->count; row++) {
        const double *X = k->coordinates + 3 * row, *v = k->vectors + 3 * row;
        const double d[3] = {X[0] - centre[0], X[1] - centre[1], X[2] - centre[2]};
        double u[3];
        for (int i = 0; i < 3; i++)
            u[i] = R[i] * d[0] + R[3 + i] * d[1] + R[6 + i] * d[2];
        const double scale = v[2] / u[2], x = u[0] * scale - v[0], y = u[1] * scale - v[1];
        const double moved = scale * k->deviations[row];
        sorted[row] = u[2] < 0.0 ? (x * x + y * y) / (k->error * k->error + moved * moved) : INFINITY;
    }
    return select_smallest(sorted, k->count, k->least - 1);
}

/* Orientations of triples of points, up to four each, with their quantiles; infinite where there is none. */
static void rank_triples(const Known *k, const int64_t *triples, int64_t number, double *rotations, double *centres,
                         double *quantiles, double *sorted)
{
    for (int64_t triple = 0; triple < number; triple++) {
        double vectors[3][3], points[3][3];
        double *R = rotations + 36 * triple, *centre = centres + 12 * triple;
        for (int m = 0; m < 3; m++) {
            const int64_t row = triples[3 * triple + m];
            memcpy(vectors[m], k->vectors + 3 * row, sizeof(vectors[m]));
            memcpy(points[m], k->coordinates + 3 * row, sizeof(points[m]));
        }
        const int found = three_points(vectors, points, (double(*)[9])R, (double(*)[3])centre);
        for (int s = 0; s < 4; s++)
            quantiles[4 * triple + s] =
                s < found ? quantile_at(k, R + 9 * s, centre + 3 * s, sorted) : INFINITY;
    }
}

/* Least trimmed squares of one orientation, some steps; its squared residuals. */
static void improve_one(const Known *k, int64_t steps, double *R, double *centre, double *squares, double *space)
{
    Equations here = equations_in(space, k->count), there = equations_in(space + NUMBERS_OF_A_POINT * k->count, k->count);
    double limit, limit_there, damping = 1e-3;
    linearise_resection(k, R, centre, &here);
    double sum = trimmed(k, &here, &limit);
    for (int64_t step = 0; step < steps; step++) {
        double correction[6], R_moved[9], centre_moved[3];
        for (int64_t row = 0; row < k->count; row++)
            here.weights[row] = here.squares[row] <= limit && isfinite(here.squares[row]);
        solve_resection(k, &here, damping, correction);
        move_photo(correction, R, centre, R_moved, centre_moved);
        linearise_resection(k, R_moved, centre_moved, &there);
        const double sum_there = trimmed(k, &there, &limit_there);
        const int better = sum_there <= sum;
        damping *= better ? 0.1 : 10.0;
        if (better) {
            const Equations kept = here;
            here = there, there = kept, sum = sum_there, limit = limit_there;
            memcpy(R, R_moved, sizeof(R_moved));
            memcpy(centre, centre_moved, sizeof(centre_moved));
        }
    }
    memcpy(squares, here.squares, (size_t)k->count * sizeof(double));
}

typedef struct {
    double limit, floor, steady, same_scale;
    int64_t iterations;
} Danish;

/* Adjust one orientation with Danish weights, whose limit follows the variance of the points that keep theirs. */
static void adjust_one(const Known *k, const Danish *danish, double variance, double *R, double *centre,
                       double *factors, double *space)
{
    Equations here = equations_in(space, k->count);
    double limit = fmax(variance, 1.0);
    for (int64_t iteration = 0; iteration < danish->iterations; iteration++) {
        double correction[6], R_moved[9], centre_moved[3], largest = 0.0, sum = 0.0;
        int64_t whole = 0;
        linearise_resection(k, R, centre, &here);
        for (int64_t row = 0; row < k->count; row++) {
            here.weights[row] = danish_weight(sqrt(here.squares[row] / limit), danish->limit, danish->floor);
            if (here.weights[row] == 1.0)
                sum += here.squares[row], whole++;
        }
        solve_resection(k, &here, 0.0, correction);
        move_photo(correction, R, centre, R_moved, centre_moved);
        memcpy(R, R_moved, sizeof(R_moved));
        memcpy(centre, centre_moved, sizeof(centre_moved));
        for (int i = 0; i < 6; i++)
            largest = fmax(largest, fabs(correction[i]));
        if (largest < danish->steady) {
            const double estimated = 2 * whole > 6 ? fmax(sum / (double)(2 * whole - 6), 1.0) : 1.0;
            const double ratio = estimated / limit;
            if ((1.0 / danish->same_scale < ratio && ratio < danish->same_scale)
                || iteration > danish->iterations / 2)
                break;
            limit = estimated;
        }
    }
    memcpy(factors, here.weights, (size_t)k->count * sizeof(double));
}
