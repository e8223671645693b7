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

/* The minors of a symmetric matrix, in which they are its inverse times the determinant, which is returned. */
static inline double minors3(const double *N, double *minors)
{
    cross3(N + 3, N + 6, minors);
    cross3(N + 6, N, minors + 3);
    cross3(N, N + 3, minors + 6);
    return dot3(N, minors);
}

/* x Q x^T with a matrix of `stride` numbers in a row. */
static inline double form_of(int n, int stride, const double *Q, const double *x)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            sum += x[i] * Q[stride * i + j] * x[j];
    return sum;
}

static inline int is_known(const double *point) { return isfinite(point[0]) && isfinite(point[1]) && isfinite(point[2]); }

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

/* Exchange vectors in some lanes. */
INLINE void exchange_lanes(LaneNumbers where, Lanes *a, Lanes *b, int size)
{
    for (int i = 0; i < size; i++) {
        const Lanes kept = a[i];
        a[i] = either(where, b[i], kept), b[i] = either(where, kept, b[i]);
    }
}

/* Eigenvalues, ascending, and eigenvectors (rows) of symmetric matrices by Jacobi's rotations. */
static inline void eigen3_lanes(Lanes A[3][3], Lanes values[3], Lanes V[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            V[i][j] = ALL((double)(i == j));
    for (int sweep = 0; sweep < 30; sweep++) {
        const Lanes off = size_of_each(A[0][1]) + size_of_each(A[0][2]) + size_of_each(A[1][2]);
        const LaneNumbers goes_on =
            off > ALL(1e-18) * (size_of_each(A[0][0]) + size_of_each(A[1][1]) + size_of_each(A[2][2]) + off);
        if (!in_any(goes_on))
            break;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                const LaneNumbers turns = goes_on & (A[p][q] != ALL(0.0));
                const Lanes theta = (A[q][q] - A[p][p]) / (ALL(2.0) * A[p][q]);
                const Lanes size = ALL(1.0) / (size_of_each(theta) + root_of_each(theta * theta + ALL(1.0)));
                const Lanes t = either(turns, either(theta < ALL(0.0), -size, size), ALL(0.0));
                const Lanes c = ALL(1.0) / root_of_each(t * t + ALL(1.0)), s = t * c;
                for (int k = 0; k < 3; k++) {
                    const Lanes kp = A[k][p], kq = A[k][q];
                    A[k][p] = c * kp - s * kq, A[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < 3; k++) {
                    const Lanes pk = A[p][k], qk = A[q][k], vp = V[p][k], vq = V[q][k];
                    A[p][k] = c * pk - s * qk, A[q][k] = s * pk + c * qk;
                    V[p][k] = c * vp - s * vq, V[q][k] = s * vp + c * vq;
                }
            }
    }
    for (int i = 0; i < 3; i++)
        values[i] = A[i][i];
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2 - i; j++) {
            const LaneNumbers descend = values[j] > values[j + 1];
            exchange_lanes(descend, values + j, values + j + 1, 1);
            exchange_lanes(descend, V[j], V[j + 1], 3);
        }
}

/* The same of one matrix. */
static inline void eigen3(double A[3][3], double values[3], double V[3][3])
{
    Lanes matrix[3][3], found[3], vectors[3][3];
    for (int k = 0; k < 9; k++)
        matrix[k / 3][k % 3] = ALL(A[k / 3][k % 3]);
    eigen3_lanes(matrix, found, vectors);
    for (int k = 0; k < 9; k++)
        values[k / 3] = LANE(found[k / 3], 0), V[k / 3][k % 3] = LANE(vectors[k / 3][k % 3], 0);
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
    transposed_times3(R, d, u);
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
