/* The essential matrices of five points; orip/geometry/essential.py has the equations and their source.
 *
 * Of the ten cubic equations those with the leading terms x²z, x², y²z, y², xyz and xy are kept. They give three
 * equations in x, y and 1 whose coefficients are polynomials in z; their determinant has degree ten (Nistér 2004).
 */

#ifndef ORIP_PRELIM_FIVE_POINTS_H
#define ORIP_PRELIM_FIVE_POINTS_H

#include "../compiled/linear.h"
#include <string.h>

#define NEARLY_REAL 0.1
#define DEGREE 10

typedef struct {
    double re, im;
} Complex;

static const double GENERAL[4][4] = {{0.59, 0.38, -0.52, 0.49},
                                     {-0.44, 0.73, 0.47, 0.24},
                                     {-0.33, 0.49, -0.63, -0.51},
                                     {-0.59, -0.29, -0.33, 0.67}};

/* Places of products: of x, y, z, 1 among xx xy xz yy yz zz x y z 1, and of these times x, y, z, 1 among
 * x³ y³ x²y xy² x²z x² y²z y² xyz xy | xz² xz x yz² yz y z³ z² z 1. */
static const int QUADRATIC[4][4] = {{0, 1, 2, 6}, {1, 3, 4, 7}, {2, 4, 5, 8}, {6, 7, 8, 9}};
static const int CUBIC[10][4] = {{0, 2, 4, 5},     {2, 3, 8, 9},     {4, 8, 10, 11}, {3, 1, 6, 7},   {8, 6, 13, 14},
                                 {10, 13, 16, 17}, {5, 9, 11, 12},   {9, 7, 14, 15}, {11, 14, 17, 18},
                                 {12, 15, 18, 19}};

static inline Complex times(Complex a, Complex b)
{
    const Complex c = {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
    return c;
}

static inline Complex minus(Complex a, Complex b)
{
    const Complex c = {a.re - b.re, a.im - b.im};
    return c;
}

static inline Complex over(Complex a, Complex b)
{
    const double square = b.re * b.re + b.im * b.im;
    const Complex c = {(a.re * b.re + a.im * b.im) / square, (a.im * b.re - a.re * b.im) / square};
    return c;
}

static inline double square_of(Complex a) { return a.re * a.re + a.im * a.im; }

/* Four matrices that span all E with left^T E right = 0, by Householder's reflections. */
static void null_space(const double left[5][3], const double right[5][3], double basis[4][9])
{
    double columns[5][9], factors[5];
    for (int k = 0; k < 5; k++) {
        const double size = sqrt(dot3(left[k], left[k]) * dot3(right[k], right[k]));
        for (int i = 0; i < 9; i++)
            columns[k][i] = left[k][i / 3] * right[k][i % 3] / size;
    }
    for (int k = 0; k < 5; k++) {
        double *v = columns[k], norm = 0.0, square = 0.0;
        for (int i = k; i < 9; i++)
            norm += v[i] * v[i];
        v[k] += v[k] < 0.0 ? -sqrt(norm) : sqrt(norm);
        for (int i = k; i < 9; i++)
            square += v[i] * v[i];
        factors[k] = square > 0.0 ? 2.0 / square : 0.0;
        for (int other = k + 1; other < 5; other++) {
            double sum = 0.0;
            for (int i = k; i < 9; i++)
                sum += v[i] * columns[other][i];
            for (int i = k; i < 9; i++)
                columns[other][i] -= factors[k] * sum * v[i];
        }
    }
    double axes[9][4] = {{0.0}};
    for (int b = 0; b < 4; b++)
        axes[5 + b][b] = 1.0;
    for (int k = 4; k >= 0; k--) {
        double sums[4] = {0.0};
        for (int i = k; i < 9; i++)
            for (int b = 0; b < 4; b++)
                sums[b] += columns[k][i] * axes[i][b];
        for (int i = k; i < 9; i++)
            for (int b = 0; b < 4; b++)
                axes[i][b] -= factors[k] * sums[b] * columns[k][i];
    }
    memset(basis, 0, 36 * sizeof(double));
    for (int a = 0; a < 4; a++)
        for (int i = 0; i < 9; i++)
            for (int b = 0; b < 4; b++)
                basis[a][i] += GENERAL[a][b] * axes[i][b];
}

static inline void add_quadratic(double factor, const double *a, const double *b, double *product)
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            product[QUADRATIC[i][j]] += factor * a[i] * b[j];
}

static inline void add_cubic(const double *a, const double *b, double *product)
{
    for (int i = 0; i < 10; i++)
        for (int j = 0; j < 4; j++)
            product[CUBIC[i][j]] += a[i] * b[j];
}

static void cubic_equations(double basis[4][9], double equations[10][20])
{
    double e[9][4], squares[3][3][10] = {{{0.0}}}, trace[10];
    memset(equations, 0, 200 * sizeof(double));
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < 4; k++)
            e[i][k] = basis[k][i];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        double minor[10] = {0.0};
        add_quadratic(1.0, e[j], e[3 + k], minor);
        add_quadratic(-1.0, e[k], e[3 + j], minor);
        add_cubic(minor, e[6 + i], equations[0]);
    }
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            for (int k = 0; k < 3; k++)
                add_quadratic(2.0, e[3 * i + k], e[3 * j + k], squares[i][j]);
            memcpy(squares[j][i], squares[i][j], sizeof(trace));
        }
    for (int m = 0; m < 10; m++)
        trace[m] = 0.5 * (squares[0][0][m] + squares[1][1][m] + squares[2][2][m]);
    for (int i = 0; i < 3; i++)
        for (int m = 0; m < 10; m++)
            squares[i][i][m] -= trace[m];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                add_cubic(squares[i][k], e[3 * k + j], equations[1 + 3 * i + j]);
}

/* Reduce the leading ten columns to the identity, in the last six rows; 0 where that is impossible. */
static int reduce(double a[10][20])
{
    for (int k = 0; k < 10; k++) {
        int pivot = k;
        for (int i = k + 1; i < 10; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k]))
                pivot = i;
        if (a[pivot][k] == 0.0)
            return 0;
        for (int j = k; j < 20; j++) {
            const double kept = a[k][j];
            a[k][j] = a[pivot][j], a[pivot][j] = kept;
        }
        for (int i = k + 1; i < 10; i++) {
            const double factor = a[i][k] / a[k][k];
            for (int j = k; j < 20; j++)
                a[i][j] -= factor * a[k][j];
        }
    }
    for (int k = 9; k >= 4; k--) {
        for (int j = 10; j < 20; j++) {
            for (int i = k + 1; i < 10; i++)
                a[k][j] -= a[k][i] * a[i][j];
            a[k][j] /= a[k][k];
        }
    }
    return 1;
}

/* Coefficients, lowest power first, of the polynomials that multiply x, y and 1 in row - z lower. */
static void polynomials(const double *row, const double *lower, double of[3][5])
{
    for (int v = 0; v < 2; v++) {
        const double *r = row + 10 + 3 * v, *l = lower + 10 + 3 * v;
        of[v][0] = r[2], of[v][1] = r[1] - l[2], of[v][2] = r[0] - l[1], of[v][3] = -l[0], of[v][4] = 0.0;
    }
    of[2][0] = row[19], of[2][4] = -lower[16];
    for (int i = 1; i < 4; i++)
        of[2][i] = row[19 - i] - lower[20 - i];
}

static void determinant_of(double b[3][3][5], double *determinant)
{
    memset(determinant, 0, (DEGREE + 1) * sizeof(double));
    for (int i = 0; i < 3; i++) {
        const double(*j)[5] = b[(i + 1) % 3], (*k)[5] = b[(i + 2) % 3];
        double minor[7] = {0.0};
        for (int p = 0; p < 4; p++)
            for (int q = 0; q < 4; q++)
                minor[p + q] += j[0][p] * k[1][q] - j[1][p] * k[0][q];
        for (int p = 0; p < 7; p++)
            for (int q = 0; q < 5; q++)
                determinant[p + q] += minor[p] * b[i][2][q];
    }
}

/* Value and first two derivatives (the second one halved) of a polynomial, lowest power first. */
static void horner(const double *a, int degree, Complex z, Complex *value, Complex *first, Complex *second)
{
    Complex p = {a[degree], 0.0}, d = {0.0, 0.0}, f = {0.0, 0.0};
    for (int k = degree - 1; k >= 0; k--) {
        f = times(f, z), f.re += d.re, f.im += d.im;
        d = times(d, z), d.re += p.re, d.im += p.im;
        p = times(p, z), p.re += a[k];
    }
    *value = p, *first = d, *second = f;
}

static Complex root_of(Complex a)
{
    const double size = sqrt(sqrt(square_of(a)));
    const double re = sqrt(fmax(0.5 * (size * size + a.re), 0.0)), im = sqrt(fmax(0.5 * (size * size - a.re), 0.0));
    const Complex root = {re, a.im < 0.0 ? -im : im};
    return root;
}

/* A root of a polynomial, from a start (Laguerre). */
static Complex laguerre(const double *a, int degree, Complex z)
{
    /* a step of another length breaks the rare cycle */
    static const double UNUSUAL[5] = {1.0, 0.5, 0.25, 0.75, 0.13};
    for (int step = 1; step <= 50; step++) {
        Complex p, d, f;
        horner(a, degree, z, &p, &d, &f);
        double rounding = fabs(a[degree]);
        const double size = sqrt(square_of(z));
        for (int k = degree - 1; k >= 0; k--)
            rounding = rounding * size + fabs(a[k]);
        if (square_of(p) <= 1e-31 * rounding * rounding)
            break;
        const Complex g = over(d, p), g2 = times(g, g), quotient = over(f, p);
        const Complex h = {g2.re - 2.0 * quotient.re, g2.im - 2.0 * quotient.im};
        const Complex inner = {(degree - 1) * (degree * h.re - g2.re), (degree - 1) * (degree * h.im - g2.im)};
        const Complex s = root_of(inner), plus = {g.re + s.re, g.im + s.im}, less = minus(g, s);
        const Complex below = square_of(plus) > square_of(less) ? plus : less, n = {(double)degree, 0.0};
        Complex change = {1.0 + size, (double)step};
        if (square_of(below) > 0.0)
            change = over(n, below);
        const double length = step % 10 ? 1.0 : UNUSUAL[step / 10 % 5];
        const Complex moved = {z.re - length * change.re, z.im - length * change.im};
        if (moved.re == z.re && moved.im == z.im)
            break;
        z = moved;
        if (square_of(change) < 1e-24 * square_of(z))
            break;
    }
    return z;
}

/* Newton steps on the polynomial itself: after division by other roots a root is inexact. */
static Complex polished(const double *a, int degree, Complex z)
{
    for (int step = 0; step < 2; step++) {
        Complex p, d, f;
        horner(a, degree, z, &p, &d, &f);
        const Complex moved = minus(z, over(p, d));
        Complex there;
        horner(a, degree, moved, &there, &d, &f);
        if (!(square_of(there) < square_of(p)))
            break;
        z = moved;
    }
    return z;
}

/* All roots of a real polynomial, of conjugate pairs the one above the real axis; returns how many. */
static int roots_of(const double *coefficients, Complex *roots)
{
    double a[DEGREE + 1];
    int degree = DEGREE, found = 0;
    memcpy(a, coefficients, sizeof(a));
    while (degree > 0 && a[degree] == 0.0)
        degree--;
    const int whole = degree;
    while (degree > 0) {
        const Complex zero = {0.0, 0.0};
        Complex z = laguerre(a, degree, zero);
        if (!isfinite(z.re) || !isfinite(z.im))
            break;
        if (degree == 1 || fabs(z.im) <= 1e-10 * fabs(z.re)) {
            z.im = 0.0;
            for (int k = degree - 1; k >= 0; k--)
                a[k] += z.re * a[k + 1];
            for (int k = 0; k < degree; k++)
                a[k] = a[k + 1];
            degree -= 1;
        } else {
            const double sum = 2.0 * z.re, square = square_of(z);
            z.im = fabs(z.im);
            for (int k = degree - 1; k >= 0; k--)
                a[k] += sum * a[k + 1] - (k + 2 <= degree ? square * a[k + 2] : 0.0);
            for (int k = 0; k <= degree - 2; k++)
                a[k] = a[k + 2];
            degree -= 2;
        }
        roots[found++] = polished(coefficients, whole, z);
    }
    return found;
}

static Complex value_at(const double *a, Complex z)
{
    Complex p = {a[4], 0.0};
    for (int k = 3; k >= 0; k--)
        p = times(p, z), p.re += a[k];
    return p;
}

/* x and y from the two equations that are least parallel; returns whether they are finite. */
static int others_of(double b[3][3][5], Complex z, Complex *x, Complex *y)
{
    Complex rows[3][3], best[3] = {{0.0, 0.0}};
    double largest = -1.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            rows[i][j] = value_at(b[i][j], z);
    for (int i = 0; i < 3; i++) {
        const Complex *p = rows[i], *q = rows[(i + 1) % 3];
        Complex c[3];
        for (int j = 0; j < 3; j++)
            c[j] = minus(times(p[(j + 1) % 3], q[(j + 2) % 3]), times(p[(j + 2) % 3], q[(j + 1) % 3]));
        const double size = square_of(c[0]) + square_of(c[1]) + square_of(c[2]);
        if (size > largest)
            largest = size, memcpy(best, c, sizeof(best));
    }
    *x = over(best[0], best[2]), *y = over(best[1], best[2]);
    return isfinite(x->re) && isfinite(x->im) && isfinite(y->re) && isfinite(y->im);
}

/* Essential matrices, with the norm 1, of five points; returns how many. */
static int five_points(const double left[5][3], const double right[5][3], double essential[10][9])
{
    double basis[4][9], equations[10][20], b[3][3][5], determinant[DEGREE + 1];
    Complex roots[DEGREE];
    null_space(left, right, basis);
    cubic_equations(basis, equations);
    if (!reduce(equations))
        return 0;
    for (int k = 0; k < 3; k++)
        polynomials(equations[4 + 2 * k], equations[5 + 2 * k], b[k]);
    determinant_of(b, determinant);
    const int number = roots_of(determinant, roots);
    int found = 0;
    for (int k = 0; k < number; k++) {
        const Complex z = roots[k];
        Complex x, y;
        if (!others_of(b, z, &x, &y))
            continue;
        const double size = fmax(fmax(square_of(x), square_of(y)), fmax(square_of(z), 1.0));
        const double im = fmax(fabs(x.im), fmax(fabs(y.im), fabs(z.im)));
        if (!(im * im < NEARLY_REAL * NEARLY_REAL * size))
            continue;
        double *e = essential[found], norm = 0.0;
        for (int i = 0; i < 9; i++) {
            e[i] = x.re * basis[0][i] + y.re * basis[1][i] + z.re * basis[2][i] + basis[3][i];
            norm += e[i] * e[i];
        }
        norm = sqrt(norm);
        for (int i = 0; i < 9; i++)
            e[i] /= norm;
        found += isfinite(norm) && norm > 0.0;
    }
    return found;
}

#endif
