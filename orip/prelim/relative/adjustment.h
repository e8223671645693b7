/* Adjustment of relative orientations with Danish weights; prelim_references/relative.py does the same and names
 * the sources.
 */

#include "parallax.h"

/* Two directions across a base: the images of the second and third axis in Householder's reflection. */
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

/* Some orientations, one in each lane; lanes without one have the last one. */
static Orientations orientations_of(const double *bases, const double *rotations, int number)
{
    Orientations o;
    for (int lane = 0; lane < LANES; lane++) {
        const int k = lane < number ? lane : number - 1;
        double E[9], across[2][3];
        essential_of(bases + 3 * k, rotations + 9 * k, E);
        across_of(bases + 3 * k, across);
        for (int i = 0; i < 9; i++)
            LANE(o.E[i], lane) = E[i], LANE(o.R[i], lane) = rotations[9 * k + i];
        for (int i = 0; i < 3; i++) {
            LANE(o.base[i], lane) = bases[3 * k + i];
            LANE(o.across[0][i], lane) = across[0][i], LANE(o.across[1][i], lane) = across[1][i];
        }
    }
    return o;
}

static void solve5(Lanes A[5][5], Lanes *b)
{
    for (int k = 0; k < 5; k++)
        for (int i = k + 1; i < 5; i++) {
            const Lanes factor = A[i][k] / A[k][k];
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

/* Add weighted equations to normal equations, above their diagonal. */
INLINE void add_equations(const Lanes design[5], Lanes weight, Lanes N[5][5])
{
    for (int i = 0; i < 5; i++)
        for (int j = i; j < 5; j++)
            N[i][j] += weight * design[i] * design[j];
}

/* Copy the upper triangle of the normal equations to the lower one, and keep them solvable. */
static void complete(const RelativeDanish *d, Lanes N[5][5])
{
    Lanes trace = ALL(0.0);
    for (int i = 0; i < 5; i++)
        trace += N[i][i];
    for (int i = 0; i < 5; i++) {
        N[i][i] += ALL(d->regular) * trace + ALL(1e-300);
        for (int j = 0; j < i; j++)
            N[i][j] = N[j][i];
    }
}

/* Move an orientation; returns the square of the correction in standard deviations. */
static double move_orientation(const RelativeDanish *d, double *step, const double *right, double across[2][3],
                               double *base, double *R)
{
    double square = 0.0, longest = 0.0, turned[9];
    for (int i = 0; i < 5; i++)
        square += step[i] * right[i], longest = larger(longest, fabs(step[i]));
    const double factor = smaller(1.0, d->longest / larger(longest, 1e-300));
    for (int i = 0; i < 5; i++)
        step[i] *= factor;
    for (int i = 0; i < 3; i++)
        base[i] += step[0] * across[0][i] + step[1] * across[1][i];
    const double length = sqrt(dot3(base, base));
    for (int i = 0; i < 3; i++)
        base[i] /= length;
    turn3(step + 2, R, turned);
    memcpy(R, turned, sizeof(turned));
    return square;
}

/* Danish weights, in the lanes of an orientation each. */
INLINE Lanes danish_weights(const RelativeDanish *d, Lanes residual)
{
    Lanes weights = ALL(1.0);
    const LaneNumbers whole = residual <= ALL(d->limit);
    if (in_any(whole == 0))
        for (int lane = 0; lane < LANES; lane++)
            if (!LANE_NUMBER(whole, lane))
                LANE(weights, lane) = danish_weight(LANE(residual, lane), d->limit, d->floor);
    return weights;
}

/* One iteration of as many orientations as there are lanes, or fewer; returns the largest square of a correction in standard
 * deviations.
 */
static double relative_step(const Pairs *p, const RelativeDanish *d, const double *scales, int number, int weights_held,
                            double *bases, double *rotations, Lanes *weights)
{
    const Orientations o = orientations_of(bases, rotations, number);
    Lanes N[5][5], right[5], step[5], scale;
    double largest = 0.0;
    memset(N, 0, sizeof(N));
    memset(right, 0, sizeof(right));
    for (int lane = 0; lane < LANES; lane++)
        LANE(scale, lane) = scales[lane < number ? lane : number - 1];
    for (int64_t row = 0; row < p->count; row++) {
        Lanes design[5], left_vector[3], right_vector[3];
        for (int i = 0; i < 3; i++)
            left_vector[i] = ALL(p->left[3 * row + i]), right_vector[i] = ALL(p->right[3 * row + i]);
        const Lanes value = parallaxes_with_partials(&o, left_vector, right_vector, design), error = ALL(p->error[row]);
        if (!weights_held)
            weights[row] = danish_weights(d, size_of_each(value) / (error * scale));
        const Lanes weight = weights[row] / (error * error);
        for (int i = 0; i < 5; i++)
            right[i] -= weight * value * design[i];
        add_equations(design, weight, N);
    }
    complete(d, N);
    memcpy(step, right, sizeof(step));
    solve5(N, step);
    for (int lane = 0; lane < number; lane++) {
        double of_lane[5], right_of_lane[5], across[2][3];
        for (int i = 0; i < 5; i++)
            of_lane[i] = LANE(step[i], lane), right_of_lane[i] = LANE(right[i], lane);
        for (int i = 0; i < 3; i++)
            across[0][i] = LANE(o.across[0][i], lane), across[1][i] = LANE(o.across[1][i], lane);
        largest = larger(largest, move_orientation(d, of_lane, right_of_lane, across, bases + 3 * lane, rotations + 9 * lane));
    }
    return largest;
}

/* Adjust orientations side by side until all have converged; returns the number of iterations. The weights of a point in
 * the orientations of several lanes stand together; there is room for whole lanes.
 */
static int64_t adjust_relative(const Pairs *p, const RelativeDanish *d, const double *scales, int64_t number,
                               int64_t most, double *bases, double *rotations, double *weights)
{
    for (int64_t iteration = 1;; iteration++) {
        double largest = 0.0;
        for (int64_t k = 0; k < number; k += LANES)
            largest = larger(largest, relative_step(p, d, scales + k, (int)smaller((double)(number - k), LANES),
                                                    iteration > (int64_t)d->held, bases + 3 * k, rotations + 9 * k,
                                                    &AT(weights + p->count * k)));
        if (largest < d->converged * d->converged || iteration == most)
            return iteration;
    }
}

/* The equations of all points, five numbers for each. */
static void designs_of(const Pairs *p, const double *base, const double *R, double *designs)
{
    const Orientations o = orientations_of(base, R, 1);
    for (int64_t first = 0; first < p->count; first += LANES) {
        Lanes design[5], left[3], right[3];
        for (int lane = 0; lane < LANES; lane++) {
            const int64_t row = first + lane < p->count ? first + lane : p->count - 1;
            for (int i = 0; i < 3; i++)
                LANE(left[i], lane) = p->left[3 * row + i], LANE(right[i], lane) = p->right[3 * row + i];
        }
        parallaxes_with_partials(&o, left, right, design);
        for (int lane = 0; lane < LANES && first + lane < p->count; lane++)
            for (int i = 0; i < 5; i++)
                designs[5 * (first + lane) + i] = LANE(design[i], lane);
    }
}

/* Redundancy numbers of an adjusted orientation, and the inverse of its normal equations. `designs` has room for five
 * numbers for each point.
 */
static void relative_precision(const Pairs *p, const RelativeDanish *d, const double *base, const double *R,
                               const double *weights, double *redundancy, double inverse[5][5], double *designs)
{
    Lanes N[5][5];
    memset(N, 0, sizeof(N));
    designs_of(p, base, R, designs);
    for (int64_t row = 0; row < p->count; row++) {
        Lanes design[5];
        for (int i = 0; i < 5; i++)
            design[i] = ALL(designs[5 * row + i]);
        add_equations(design, ALL(weights[row] / (p->error[row] * p->error[row])), N);
    }
    complete(d, N);
    for (int k = 0; k < 5; k++) {
        Lanes used[5][5], column[5];
        memcpy(used, N, sizeof(N));
        memset(column, 0, sizeof(column));
        column[k] = ALL(1.0);
        solve5(used, column);
        for (int i = 0; i < 5; i++)
            inverse[i][k] = LANE(column[i], 0);
    }
    for (int64_t row = 0; row < p->count; row++) {
        const double cofactor = form_of(5, 5, inverse[0], designs + 5 * row);
        redundancy[row] = larger(1.0 - weights[row] * cofactor / (p->error[row] * p->error[row]), 0.0);
    }
}
