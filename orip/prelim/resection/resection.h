/* Least squares of the space resection of one photo; prelim_references/resection.py does the same. */

#include "resection_loops.h"
#include "three_points.h"

typedef struct {
    double *residual, *partials, *variance, *squares, *weights, *sorted;
} Equations;

static Equations equations_in(double *space, int64_t count)
{
    return (Equations){space, space + 2 * count, space + 14 * count, space + 15 * count, space + 16 * count,
                       space + 17 * count};
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

/* Normal equations of the points with weights, and their right-hand side. */
static void resection_normals(const Known *k, const Equations *e, double N[6][6], double right[6])
{
    memset(N, 0, 36 * sizeof(double));
    memset(right, 0, 6 * sizeof(double));
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
}

static void solve_resection(const Known *k, const Equations *e, double damping, double *correction)
{
    double N[6][6], largest = 0.0;
    resection_normals(k, e, N, correction);
    for (int i = 0; i < 6; i++)
        largest = fmax(largest, N[i][i]);
    for (int i = 0; i < 6; i++)
        N[i][i] += damping * N[i][i] + 1e-13 * largest + 1e-300;
    solve6(N, correction);
}

static void move_photo(const double *correction, double largest_turn, const double *R, const double *centre,
                       double *R_moved, double *centre_moved)
{
    const double turn = sqrt(dot3(correction, correction)), factor = fmin(1.0, largest_turn / fmax(turn, 1e-300));
    const double d[3] = {factor * correction[0], factor * correction[1], factor * correction[2]};
    turn3(d, R, R_moved);
    for (int i = 0; i < 3; i++)
        centre_moved[i] = centre[i] + factor * correction[3 + i];
}

/* The sum of the smallest squares, and the largest of these. */
static double trimmed(const Known *k, const double *squares, double *sorted, double *largest)
{
    memcpy(sorted, squares, (size_t)k->count * sizeof(double));
    *largest = select_smallest(sorted, k->count, k->least - 1);
    double sum = 0.0;
    for (int64_t row = 0; row < k->least; row++)
        sum += sorted[row];
    return sum;
}

/* Squared residuals of each point in the orientations of several lanes. */
static void squares_of_lanes(const Known *k, const Lanes *R, const Lanes *centre, Lanes *squares)
{
    for (int64_t row = 0; row < k->count; row++) {
        const double *X = k->coordinates + 3 * row, *v = k->vectors + 3 * row;
        const Lanes d[3] = {ALL(X[0]) - centre[0], ALL(X[1]) - centre[1], ALL(X[2]) - centre[2]};
        Lanes u[3];
        for (int i = 0; i < 3; i++)
            u[i] = R[i] * d[0] + R[3 + i] * d[1] + R[6 + i] * d[2];
        const Lanes scale = ALL(v[2]) / u[2], x = u[0] * scale - ALL(v[0]), y = u[1] * scale - ALL(v[1]);
        const Lanes moved = scale * ALL(k->deviations[row]);
        const Lanes square = (x * x + y * y) / (ALL(k->error * k->error) + moved * moved);
        squares[row] = either(u[2] < ALL(0.0), square, ALL(INFINITY));
    }
}

/* Orientations in the order of their triples, in the lanes of as many groups as are needed, and the number of each triple. */
typedef struct {
    Lanes rotations[4][9], centres[4][3];
    int64_t triple[4 * LANES];
    int number;
} OfSeveral;

/* The orientations of as many triples as there are lanes, or fewer. */
static void orient_triples(const Known *k, const int64_t *triples, int number, OfSeveral *all)
{
    Lanes vectors[3][3], points[3][3];
    OfTriples of[4];
    for (int lane = 0; lane < LANES; lane++)
        for (int m = 0; m < 3; m++) {
            /* lanes without a triple have the last one */
            const int64_t row = triples[3 * (lane < number ? lane : number - 1) + m];
            for (int i = 0; i < 3; i++) {
                LANE(vectors[m][i], lane) = k->vectors[3 * row + i];
                LANE(points[m][i], lane) = k->coordinates[3 * row + i];
            }
        }
    three_points(vectors, points, of);
    all->number = 0;
    for (int lane = 0; lane < number; lane++)
        for (int s = 0; s < 4; s++) {
            if (!LANE_NUMBER(of[s].found, lane))
                continue;
            const int group = all->number / LANES, place = all->number % LANES;
            for (int i = 0; i < 9; i++)
                LANE(all->rotations[group][i], place) = LANE(of[s].rotation[i], lane);
            for (int i = 0; i < 3; i++)
                LANE(all->centres[group][i], place) = LANE(of[s].centre[i], lane);
            all->triple[all->number++] = lane;
        }
}

/* The best orientations so far, the best first, with the quantiles of their squared residuals that blunders do not affect. */
typedef struct {
    double *rotations, *centres, *quantiles;
    int64_t kept;
} Ranking;

/* Put an orientation in its place. */
static void rank_orientation(const Ranking *r, const Lanes *R, const Lanes *centre, int lane, double quantile)
{
    int64_t place = r->kept - 1;
    for (; place > 0 && quantile < r->quantiles[place - 1]; place--) {
        r->quantiles[place] = r->quantiles[place - 1];
        memcpy(r->rotations + 9 * place, r->rotations + 9 * (place - 1), 9 * sizeof(double));
        memcpy(r->centres + 3 * place, r->centres + 3 * (place - 1), 3 * sizeof(double));
    }
    r->quantiles[place] = quantile;
    for (int i = 0; i < 9; i++)
        r->rotations[9 * place + i] = LANE(R[i], lane);
    for (int i = 0; i < 3; i++)
        r->centres[3 * place + i] = LANE(centre[i], lane);
}

/* Rank orientations up to the triple with which as many fit as are kept; returns how many fit. `space` has room for the
 * points in all lanes, and once more.
 */
static int64_t rank_orientations(const Known *k, const OfSeveral *all, double fits, int64_t fitting, const Ranking *r,
                                 double *space)
{
    double *squares = space, *sorted = space + LANES * k->count, *worst = r->quantiles + r->kept - 1;
    for (int one = 0; one < all->number; one++) {
        const int group = one / LANES, lane = one % LANES;
        if (fitting >= r->kept && all->triple[one] != all->triple[one - 1])
            break;
        if (lane == 0)
            squares_of_lanes(k, all->rotations[group], all->centres[group], (Lanes *)squares);
        int64_t below = 0;
        for (int64_t row = 0; row < k->count; row++)
            sorted[row] = squares[LANES * row + lane], below += sorted[row] < *worst;
        if (below < k->least)
            continue;
        const double quantile = select_smallest(sorted, k->count, k->least - 1);
        fitting += quantile <= fits;
        rank_orientation(r, all->rotations[group], all->centres[group], lane, quantile);
    }
    return fitting;
}

/* The best orientations of triples of points, the best first, with their quantiles; infinite where there is none.
 * It ends when as many as are kept fit. */
static void rank_triples(const Known *k, const int64_t *triples, int64_t number, double fits, int64_t kept,
                         double *rotations, double *centres, double *quantiles, double *space)
{
    const Ranking ranking = {rotations, centres, quantiles, kept};
    int64_t fitting = 0;
    for (int64_t place = 0; place < kept; place++)
        quantiles[place] = INFINITY;
    for (int64_t first = 0; first < number && fitting < kept; first += LANES) {
        IN_LINES OfSeveral all;
        orient_triples(k, triples + 3 * first, (int)smaller((double)(number - first), LANES), &all);
        fitting = rank_orientations(k, &all, fits, fitting, &ranking, space);
    }
}

/* Some steps of least trimmed squares for one orientation, and its squared residuals. */
static void improve_one(const Known *k, int64_t steps, double largest_turn, double *R, double *centre,
                        double *squares, double *space)
{
    Equations here = equations_in(space, k->count), there = equations_in(space + NUMBERS_OF_A_POINT * k->count, k->count);
    double limit, limit_there, damping = 1e-3;
    linearise_resection(k, R, centre, &here);
    double sum = trimmed(k, here.squares, here.sorted, &limit);
    for (int64_t step = 0; step < steps; step++) {
        double correction[6], R_moved[9], centre_moved[3];
        for (int64_t row = 0; row < k->count; row++)
            here.weights[row] = here.squares[row] <= limit && isfinite(here.squares[row]);
        solve_resection(k, &here, damping, correction);
        move_photo(correction, largest_turn, R, centre, R_moved, centre_moved);
        linearise_resection(k, R_moved, centre_moved, &there);
        const double sum_there = trimmed(k, there.squares, there.sorted, &limit_there);
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

/* Adjust one orientation with Danish weights, whose limit follows from the variance of the points with full weight.
 * In the end the given space has the equations of the adjusted orientation. */
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
        move_photo(correction, danish->largest_turn, R, centre, R_moved, centre_moved);
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
    linearise_resection(k, R, centre, &here);
}

/* The least of the variances of unit weight of several orientations, from their trimmed sums of squares. */
static double least_variance(const Known *k, const OrientationChoice *s, const double *squares, int64_t number,
                             double *sorted)
{
    double least = INFINITY, largest;
    for (int64_t one = 0; one < number; one++)
        least = smaller(s->per_sum * trimmed(k, squares + one * k->count, sorted, &largest), least);
    return least;
}

static int is_same(const double *R, const double *centre, const double *R_other, const double *centre_other,
                   double same)
{
    double turn = 0.0, shift = 0.0;
    for (int i = 0; i < 9; i++)
        turn += (R[i] - R_other[i]) * (R[i] - R_other[i]);
    for (int i = 0; i < 3; i++)
        shift += (centre[i] - centre_other[i]) * (centre[i] - centre_other[i]);
    return sqrt(0.5 * turn) < same && sqrt(shift / dot3(centre, centre)) < same;
}

/* Which orientations cost the least or not much more, the least first, and differ from all before them. */
static int64_t choose(const Known *k, const OrientationChoice *s, const double *rotations, const double *centres,
                      const double *squares, int64_t number, double variance, int64_t *chosen)
{
    const double unit = fmin(fmax(variance, 1.0), 1e300), most = s->limit * s->limit;
    double costs[MOST_ORIENTATIONS];
    int64_t order[MOST_ORIENTATIONS], kept = 0;
    for (int64_t one = 0; one < number; one++) {
        double cost = 0.0;
        for (int64_t row = 0; row < k->count; row++) {
            const double square = squares[one * k->count + row] / unit;
            cost += square < most ? square : square >= most ? most : NAN;
        }
        costs[one] = isnan(cost) ? INFINITY : cost; /* an orientation may have run away */
        int64_t place = one;
        for (; place > 0 && costs[one] < costs[order[place - 1]]; place--)
            order[place] = order[place - 1];
        order[place] = one;
    }
    for (int64_t place = 0; place < number; place++) {
        const int64_t one = order[place];
        int is_new = costs[one] <= costs[order[0]] + s->excess;
        for (int64_t other = 0; other < kept && is_new; other++)
            is_new = !is_same(rotations + 9 * chosen[other], centres + 3 * chosen[other], rotations + 9 * one,
                              centres + 3 * one, s->same);
        if (is_new)
            chosen[kept++] = one;
    }
    return kept;
}

/* Improve orientations, adjust the likeliest, and put those that remain likely first, the best before the others;
 * of the best one weight factors, residuals, squares and normal equations. Returns how many remain. */
static int64_t choose_orientations(const Known *k, const OrientationChoice *s, int64_t number, double *rotations,
                                   double *centres, double *squares, double *factors, double *residual,
                                   double *normals, double *space)
{
    double R[MOST_ORIENTATIONS][9], centre[MOST_ORIENTATIONS][3], right[6];
    int64_t chosen[MOST_ORIENTATIONS];
    double *sorted = space;
    for (int64_t one = 0; one < number; one++)
        improve_one(k, s->steps, s->largest_turn, rotations + 9 * one, centres + 3 * one, squares + one * k->count,
                    space);
    const double variance = least_variance(k, s, squares, number, sorted);
    const int64_t likely = choose(k, s, rotations, centres, squares, number, variance, chosen);
    for (int64_t one = 0; one < likely; one++) {
        memcpy(R[one], rotations + 9 * chosen[one], sizeof(R[one]));
        memcpy(centre[one], centres + 3 * chosen[one], sizeof(centre[one]));
        adjust_one(k, &s->danish, variance, R[one], centre[one], factors + one * k->count, space);
        memcpy(squares + one * k->count, equations_in(space, k->count).squares, (size_t)k->count * sizeof(double));
    }
    const double final = least_variance(k, s, squares, likely, sorted);
    const int64_t left = choose(k, s, R[0], centre[0], squares, likely, final, chosen);
    for (int64_t one = 0; one < left; one++) {
        memcpy(rotations + 9 * one, R[chosen[one]], sizeof(R[0]));
        memcpy(centres + 3 * one, centre[chosen[one]], sizeof(centre[0]));
    }
    Equations best = equations_in(space, k->count);
    linearise_resection(k, rotations, centres, &best);
    memmove(factors, factors + chosen[0] * k->count, (size_t)k->count * sizeof(double));
    memcpy(best.weights, factors, (size_t)k->count * sizeof(double));
    memcpy(residual, best.residual, 2 * (size_t)k->count * sizeof(double));
    memcpy(squares, best.squares, (size_t)k->count * sizeof(double));
    resection_normals(k, &best, (double(*)[6])normals, right);
    return left;
}
