/* Adjustment of relative orientations with Danish weights; orip/prelim/relative/adjustment.py does the same and names
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

/* Add a weighted equation to normal equations, above their diagonal. */
static inline void add_equation(const double design[5], double weight, double N[5][5])
{
    for (int i = 0; i < 5; i++)
        for (int j = i; j < 5; j++)
            N[i][j] += weight * design[i] * design[j];
}

/* Copy the upper triangle of the normal equations to the lower one, and keep them solvable. */
static void complete(const RelativeDanish *d, double N[5][5])
{
    double trace = 0.0;
    for (int i = 0; i < 5; i++)
        trace += N[i][i];
    for (int i = 0; i < 5; i++) {
        N[i][i] += d->regular * trace + 1e-300;
        for (int j = 0; j < i; j++)
            N[i][j] = N[j][i];
    }
}

/* One iteration; returns the square of the correction in standard deviations. */
static double relative_step(const Pairs *p, const RelativeDanish *d, double scale, int weights_held, double *base,
                            double *R, double *weights)
{
    double E[9], across[2][3], N[5][5] = {{0.0}}, right[5] = {0.0}, step[5], longest = 0.0, square = 0.0;
    essential_of(base, R, E);
    across_of(base, across);
    for (int64_t row = 0; row < p->count; row++) {
        double design[5];
        const double value = parallax_row(E, base, R, across, p->left + 3 * row, p->right + 3 * row, design);
        if (!weights_held)
            weights[row] = danish_weight(fabs(value) / (p->error[row] * scale), d->limit, d->floor);
        const double weight = weights[row] / (p->error[row] * p->error[row]);
        for (int i = 0; i < 5; i++)
            right[i] -= weight * value * design[i];
        add_equation(design, weight, N);
    }
    complete(d, N);
    memcpy(step, right, sizeof(step));
    solve5(N, step);
    for (int i = 0; i < 5; i++)
        square += step[i] * right[i], longest = larger(longest, fabs(step[i]));
    const double factor = smaller(1.0, d->longest / larger(longest, 1e-300));
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

/* Adjust orientations side by side until all have converged; returns the number of iterations. */
static int64_t adjust_relative(const Pairs *p, const RelativeDanish *d, const double *scales, int64_t number,
                               int64_t most, double *bases, double *rotations, double *weights)
{
    for (int64_t iteration = 1;; iteration++) {
        double largest = 0.0;
        for (int64_t k = 0; k < number; k++)
            largest = larger(largest, relative_step(p, d, scales[k], iteration > (int64_t)d->held, bases + 3 * k,
                                                    rotations + 9 * k, weights + p->count * k));
        if (largest < d->converged * d->converged || iteration == most)
            return iteration;
    }
}

/* Redundancy numbers of an adjusted orientation, and the inverse of its normal equations. */
static void relative_precision(const Pairs *p, const RelativeDanish *d, const double *base, const double *R,
                               const double *weights, double *redundancy, double inverse[5][5])
{
    double E[9], across[2][3], N[5][5] = {{0.0}}, design[5];
    essential_of(base, R, E);
    across_of(base, across);
    for (int64_t row = 0; row < p->count; row++) {
        parallax_row(E, base, R, across, p->left + 3 * row, p->right + 3 * row, design);
        add_equation(design, weights[row] / (p->error[row] * p->error[row]), N);
    }
    complete(d, N);
    for (int k = 0; k < 5; k++) {
        double used[5][5], column[5] = {0.0};
        memcpy(used, N, sizeof(N));
        column[k] = 1.0;
        solve5(used, column);
        for (int i = 0; i < 5; i++)
            inverse[i][k] = column[i];
    }
    for (int64_t row = 0; row < p->count; row++) {
        double cofactor = 0.0;
        parallax_row(E, base, R, across, p->left + 3 * row, p->right + 3 * row, design);
        for (int i = 0; i < 5; i++)
            for (int j = 0; j < 5; j++)
                cofactor += design[i] * inverse[i][j] * design[j];
        redundancy[row] = larger(1.0 - weights[row] * cofactor / (p->error[row] * p->error[row]), 0.0);
    }
}
