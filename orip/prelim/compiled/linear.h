/* Small vectors and matrices, row by row. */

#ifndef ORIP_PRELIM_LINEAR_H
#define ORIP_PRELIM_LINEAR_H

#include "../../lanes.h"
#include <math.h>
#include <stdint.h>

/* Unlike fmax and fmin, which have to treat NaN, these need no call. */
static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

static inline double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void cross3(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1], c[1] = a[2] * b[0] - a[0] * b[2], c[2] = a[0] * b[1] - a[1] * b[0];
}

INLINE Lanes dot_lanes(const Lanes *a, const Lanes *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void cross_lanes(const Lanes *a, const Lanes *b, Lanes *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1], c[1] = a[2] * b[0] - a[0] * b[2], c[2] = a[0] * b[1] - a[1] * b[0];
}

INLINE void turn_lanes(const Lanes *M, const Lanes *v, Lanes *product)
{
    for (int i = 0; i < 3; i++)
        product[i] = dot_lanes(M + 3 * i, v);
}

/* Solve A x = b by elimination with pivoting; both are overwritten, x is in b. */
static inline void solve6(double A[6][6], double b[6])
{
    for (int k = 0; k < 6; k++) {
        int pivot = k;
        for (int i = k + 1; i < 6; i++)
            if (fabs(A[i][k]) > fabs(A[pivot][k]))
                pivot = i;
        for (int j = 0; j < 6; j++) {
            const double kept = A[k][j];
            A[k][j] = A[pivot][j], A[pivot][j] = kept;
        }
        const double kept = b[k];
        b[k] = b[pivot], b[pivot] = kept;
        for (int i = k + 1; i < 6; i++) {
            const double factor = A[i][k] / A[k][k];
            for (int j = k; j < 6; j++)
                A[i][j] -= factor * A[k][j];
            b[i] -= factor * b[k];
        }
    }
    for (int i = 5; i >= 0; i--) {
        for (int j = i + 1; j < 6; j++)
            b[i] -= A[i][j] * b[j];
        b[i] /= A[i][i];
    }
}

/* The inverse of the Cholesky factor of n symmetric equations with unit diagonal, whose lower triangle is overwritten;
 * both matrices have `stride` numbers in a row. Whether they are regular without a doubt: the trace of the inverse is
 * above the reciprocal of the smallest eigenvalue, and the largest one is at most n.
 */
static inline int invert_factor(int n, int stride, double *N, double *inverse, double singular)
{
    double trace = 0.0;
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double *one = N + stride * i + j;
            for (int k = 0; k < j; k++)
                *one -= N[stride * i + k] * N[stride * j + k];
            if (i == j && !(*one > 0.0))
                return 0;
            *one = i == j ? sqrt(*one) : *one / N[stride * j + j];
        }
    for (int k = 0; k < stride * n; k++)
        inverse[k] = 0.0;
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double sum = i == j;
            for (int k = j; k < i; k++)
                sum -= N[stride * i + k] * inverse[stride * k + j];
            inverse[stride * i + j] = sum / N[stride * i + i];
            trace += inverse[stride * i + j] * inverse[stride * i + j];
        }
    return trace * singular < 1.0;
}

/* Exp([d]x) R, into `turned`. */
static inline void turn3(const double *d, const double *R, double *turned)
{
    const double angle = sqrt(dot3(d, d));
    const double sine = angle > 0.0 ? sin(angle) / angle : 1.0;
    const double half = angle > 0.0 ? sin(0.5 * angle) / (0.5 * angle) : 1.0;
    const double versine = 0.5 * half * half;
    for (int j = 0; j < 3; j++) {
        const double column[3] = {R[j], R[3 + j], R[6 + j]};
        double once[3], twice[3];
        cross3(d, column, once);
        cross3(d, once, twice);
        for (int i = 0; i < 3; i++)
            turned[3 * i + j] = column[i] + sine * once[i] + versine * twice[i];
    }
}

/* omega, phi, kappa of R = Rx Ry Rz, as in orip/geometry/rotation.py. */
static inline void angles_of(const double *R, double *angles)
{
    const double cosine = hypot(R[5], R[8]);
    angles[1] = atan2(R[2], cosine);
    if (cosine < 1e-9) {
        const double sign = (double)(angles[1] > 0.0) - (double)(angles[1] < 0.0);
        angles[0] = atan2(sign * R[3], R[4]), angles[2] = 0.0;
    } else {
        angles[0] = atan2(-R[5], R[8]), angles[2] = atan2(-R[1], R[0]);
    }
}

/* Partials of the angles by a small rotation about the axes that they turn to, as in orip/geometry/rotation.py. */
static inline void angle_rates(const double *angles, double *rates)
{
    const double so = sin(angles[0]), co = cos(angles[0]), tp = tan(angles[1]), cp = cos(angles[1]);
    const double rows[9] = {1.0, so * tp, -co * tp, 0.0, co, so, 0.0, -so / cp, co / cp};
    for (int i = 0; i < 9; i++)
        rates[i] = rows[i];
}

/* Eigenvalues, ascending, and eigenvectors (columns) of a symmetric matrix by Jacobi's rotations. */
static inline void eigen3(double A[3][3], double values[3], double V[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            V[i][j] = i == j;
    for (int sweep = 0; sweep < 30; sweep++) {
        const double off = fabs(A[0][1]) + fabs(A[0][2]) + fabs(A[1][2]);
        if (off <= 1e-18 * (fabs(A[0][0]) + fabs(A[1][1]) + fabs(A[2][2]) + off))
            break;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                if (A[p][q] == 0.0)
                    continue;
                const double theta = (A[q][q] - A[p][p]) / (2.0 * A[p][q]);
                const double t = (theta < 0.0 ? -1.0 : 1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < 3; k++) {
                    const double kp = A[k][p], kq = A[k][q];
                    A[k][p] = c * kp - s * kq, A[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < 3; k++) {
                    const double pk = A[p][k], qk = A[q][k];
                    A[p][k] = c * pk - s * qk, A[q][k] = s * pk + c * qk;
                }
                for (int k = 0; k < 3; k++) {
                    const double kp = V[k][p], kq = V[k][q];
                    V[k][p] = c * kp - s * kq, V[k][q] = s * kp + c * kq;
                }
            }
    }
    for (int i = 0; i < 3; i++)
        values[i] = A[i][i];
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2 - i; j++)
            if (values[j] > values[j + 1]) {
                const double kept = values[j];
                values[j] = values[j + 1], values[j + 1] = kept;
                for (int k = 0; k < 3; k++) {
                    const double v = V[k][j];
                    V[k][j] = V[k][j + 1], V[k][j + 1] = v;
                }
            }
}

/* Move the k-th smallest of n numbers to where sorting would put it, and the smaller ones before it (Hoare 1961). */
static inline double select_smallest(double *a, int64_t n, int64_t k)
{
    int64_t low = 0, high = n - 1;
    while (low < high) {
        const double pivot = a[low + (high - low) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (a[i] < pivot)
                i++;
            while (pivot < a[j])
                j--;
            if (i <= j) {
                const double kept = a[i];
                a[i] = a[j], a[j] = kept;
                i++, j--;
            }
        }
        if (k <= j)
            high = j;
        else if (k >= i)
            low = i;
        else
            break;
    }
    return a[k];
}

/* The quantile of n numbers, which are reordered, by linear interpolation between its neighbours. */
static inline double quantile_of(double *a, int64_t n, double share)
{
    const double place = share * (double)(n - 1);
    const int64_t k = (int64_t)place;
    const double lower = select_smallest(a, n, k);
    if (k + 1 >= n)
        return lower;
    double upper = a[k + 1];
    for (int64_t i = k + 2; i < n; i++)
        upper = fmin(upper, a[i]);
    return lower + (place - (double)k) * (upper - lower);
}

/* The median of n numbers, which are reordered. */
static inline double median_of(double *a, int64_t n)
{
    const double upper = select_smallest(a, n, n / 2);
    if (n % 2)
        return upper;
    double lower = a[0];
    for (int64_t k = 1; k < n / 2; k++)
        lower = fmax(lower, a[k]);
    return 0.5 * (lower + upper);
}

/* Weighted square of a residual that is of no influence, as in orip/adjustment/weights.py. */
#define NO_INFLUENCE 0.01

/* Danish weight of a standard residual (Krarup, Juhl and Kubik 1980); floor as in orip/adjustment/weights.py. */
static inline double danish_weight(double u, double limit, double floor)
{
    if (u <= limit)
        return 1.0;
    const double w = exp(-u / limit), largest = fmax(u, 1.0), least = fmin(floor, NO_INFLUENCE / (largest * largest));
    return w > least ? w : least;
}

/* Project: residual computed minus measured (2), partials by rotation and projection centre (2 x 6); whether in front. */
static inline int project(const double *R, const double *centre, const double *X, const double *vector,
                          double *residual, double (*partials)[6])
{
    const double d[3] = {X[0] - centre[0], X[1] - centre[1], X[2] - centre[2]}, c = -vector[2];
    double u[3];
    for (int i = 0; i < 3; i++)
        u[i] = R[i] * d[0] + R[3 + i] * d[1] + R[6 + i] * d[2];
    const int in_front = u[2] < -1e-6 * sqrt(dot3(u, u));
    const double depth = in_front ? u[2] : -1.0, scale = -c / depth;
    const double xy[2] = {scale * u[0], scale * u[1]};
    for (int r = 0; r < 2; r++) {
        residual[r] = xy[r] - vector[r];
        if (!partials)
            continue;
        double by_point[3];
        for (int k = 0; k < 3; k++)
            by_point[k] = scale * R[3 * k + r] - xy[r] / depth * R[3 * k + 2];
        /* by_point [d]x is by_point × d */
        cross3(by_point, d, partials[r]);
        for (int k = 0; k < 3; k++)
            partials[r][3 + k] = -by_point[k];
    }
    return in_front;
}

#endif
