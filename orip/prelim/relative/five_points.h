/* The essential matrices of five points; prelim_references/five_points.py has the equations and their source.
 *
 * Of the ten cubic equations those with the leading terms x²z, x², y²z, y², xyz and xy are kept. They give three
 * equations in x, y and 1 whose coefficients are polynomials in z; their determinant has degree ten (Nistér 2004).
 *
 * As many samples as there are lanes are solved at once, each with the operations, in their order, of one alone.
 */

#include "../../lanes.h"
#include "../compiled/linear.h"
#include <string.h>

#define NEARLY_REAL 0.1
#define DEGREE 10

/* Columns of the cubic equations: ten of leading monomials and ten others, each padded to twelve. */
#define COLUMNS 24
#define LOWER 12

typedef struct {
    Lanes re, im;
} Complex;

static const double GENERAL[4][4] = {{0.59, 0.38, -0.52, 0.49},
                                     {-0.44, 0.73, 0.47, 0.24},
                                     {-0.33, 0.49, -0.63, -0.51},
                                     {-0.59, -0.29, -0.33, 0.67}};

/* Places of products: of x, y, z, 1 among xx xy xz yy yz zz x y z 1, and of these times x, y, z, 1 among the columns
 * x³ y³ x²y xy² x²z x² y²z y² xyz xy | xz² xz x yz² yz y z³ z² z 1. */
static const int QUADRATIC[4][4] = {{0, 1, 2, 6}, {1, 3, 4, 7}, {2, 4, 5, 8}, {6, 7, 8, 9}};
static const int CUBIC[10][4] = {{0, 2, 4, 5},     {2, 3, 8, 9},     {4, 8, 12, 13},   {3, 1, 6, 7},   {8, 6, 15, 16},
                                 {12, 15, 18, 19}, {5, 9, 13, 14},   {9, 7, 16, 17}, {13, 16, 19, 20},
                                 {14, 17, 20, 21}};

INLINE Complex times(Complex a, Complex b)
{
    return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

INLINE Complex minus(Complex a, Complex b) { return (Complex){a.re - b.re, a.im - b.im}; }
INLINE Lanes square_of(Complex a) { return a.re * a.re + a.im * a.im; }

INLINE Complex over(Complex a, Complex b)
{
    const Lanes square = square_of(b);
    return (Complex){(a.re * b.re + a.im * b.im) / square, (a.im * b.re - a.re * b.im) / square};
}

INLINE Complex either_complex(LaneNumbers holds, Complex a, Complex b)
{
    return (Complex){either(holds, a.re, b.re), either(holds, a.im, b.im)};
}

/* Four matrices that span all E with left^T E right = 0, by Householder's reflections. */
static void null_space(Lanes left[5][3], Lanes right[5][3], Lanes basis[4][9])
{
    Lanes columns[5][9], factors[5];
    for (int k = 0; k < 5; k++) {
        const Lanes size = root_of_each(dot_lanes(left[k], left[k]) * dot_lanes(right[k], right[k]));
        for (int i = 0; i < 9; i++)
            columns[k][i] = left[k][i / 3] * right[k][i % 3] / size;
    }
    for (int k = 0; k < 5; k++) {
        Lanes *v = columns[k], norm = ALL(0.0), square = ALL(0.0);
        for (int i = k; i < 9; i++)
            norm += v[i] * v[i];
        norm = root_of_each(norm);
        v[k] += either(v[k] < ALL(0.0), -norm, norm);
        for (int i = k; i < 9; i++)
            square += v[i] * v[i];
        factors[k] = either(square > ALL(0.0), ALL(2.0) / square, ALL(0.0));
        for (int other = k + 1; other < 5; other++) {
            Lanes sum = ALL(0.0);
            for (int i = k; i < 9; i++)
                sum += v[i] * columns[other][i];
            for (int i = k; i < 9; i++)
                columns[other][i] -= factors[k] * sum * v[i];
        }
    }
    Lanes axes[9][4];
    memset(axes, 0, sizeof(axes));
    for (int b = 0; b < 4; b++)
        axes[5 + b][b] = ALL(1.0);
    for (int k = 4; k >= 0; k--) {
        Lanes sums[4] = {ALL(0.0), ALL(0.0), ALL(0.0), ALL(0.0)};
        for (int i = k; i < 9; i++)
            for (int b = 0; b < 4; b++)
                sums[b] += columns[k][i] * axes[i][b];
        for (int i = k; i < 9; i++)
            for (int b = 0; b < 4; b++)
                axes[i][b] -= factors[k] * sums[b] * columns[k][i];
    }
    memset(basis, 0, 36 * sizeof(Lanes));
    for (int a = 0; a < 4; a++)
        for (int i = 0; i < 9; i++)
            for (int b = 0; b < 4; b++)
                basis[a][i] += ALL(GENERAL[a][b]) * axes[i][b];
}

INLINE void add_quadratic(double factor, const Lanes *a, const Lanes *b, Lanes *product)
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            product[QUADRATIC[i][j]] += ALL(factor) * a[i] * b[j];
}

static void add_cubic(const Lanes *a, const Lanes *b, Lanes *product)
{
    for (int i = 0; i < 10; i++)
        for (int j = 0; j < 4; j++)
            product[CUBIC[i][j]] += a[i] * b[j];
}

static void cubic_equations(Lanes basis[4][9], Lanes equations[10][COLUMNS])
{
    Lanes e[9][4], squares[3][3][10], trace[10];
    memset(squares, 0, sizeof(squares));
    memset(equations, 0, 10 * COLUMNS * sizeof(Lanes));
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < 4; k++)
            e[i][k] = basis[k][i];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        Lanes minor[10];
        memset(minor, 0, sizeof(minor));
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
        trace[m] = ALL(0.5) * (squares[0][0][m] + squares[1][1][m] + squares[2][2][m]);
    for (int i = 0; i < 3; i++)
        for (int m = 0; m < 10; m++)
            squares[i][i][m] -= trace[m];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                add_cubic(squares[i][k], e[3 * k + j], equations[1 + 3 * i + j]);
}

/* Subtract a multiple of a row from another one, from a column on; what stands before it no longer counts. */
INLINE void subtract_row(double factor, const double *row, double *from, int column)
{
    for (int j = column / LANES * LANES; j < COLUMNS; j += LANES)
        AT(from + j) -= ALL(factor) * AT(row + j);
}

/* Reduce the leading ten columns of a sample to the identity, in the last six rows; 0 where that is impossible. */
static int reduce(double a[10][COLUMNS])
{
    for (int k = 0; k < 10; k++) {
        int pivot = k;
        for (int i = k + 1; i < 10; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k]))
                pivot = i;
        if (a[pivot][k] == 0.0)
            return 0;
        for (int j = k / LANES * LANES; j < COLUMNS; j += LANES) {
            const Lanes kept = AT(a[k] + j);
            AT(a[k] + j) = AT(a[pivot] + j), AT(a[pivot] + j) = kept;
        }
        for (int i = k + 1; i < 10; i++)
            subtract_row(a[i][k] / a[k][k], a[k], a[i], k);
    }
    for (int k = 9; k >= 4; k--) {
        for (int i = k + 1; i < 10; i++)
            subtract_row(a[k][i], a[i], a[k], LOWER);
        for (int j = LOWER; j < COLUMNS; j += LANES)
            AT(a[k] + j) /= ALL(a[k][k]);
    }
    return 1;
}

/* Coefficients, lowest power first, of the polynomials that multiply x, y and 1 in row - z lower, of the columns that are
 * left.
 */
static void polynomials(const Lanes *row, const Lanes *lower, Lanes of[3][5])
{
    for (int v = 0; v < 2; v++) {
        const Lanes *r = row + 3 * v, *l = lower + 3 * v;
        of[v][0] = r[2], of[v][1] = r[1] - l[2], of[v][2] = r[0] - l[1], of[v][3] = -l[0], of[v][4] = ALL(0.0);
    }
    of[2][0] = row[9], of[2][4] = -lower[6];
    for (int i = 1; i < 4; i++)
        of[2][i] = row[9 - i] - lower[10 - i];
}

/* The equations in x, y and 1, and which samples have them. */
static void equations_in_z(Lanes equations[10][COLUMNS], Lanes b[3][3][5], int *regular)
{
    double rows[LANES][10][COLUMNS], *of_lanes[LANES];
    Lanes left[6][10];
    for (int i = 0; i < 10; i++)
        for (int j = 0; j < COLUMNS; j += LANES) {
            for (int lane = 0; lane < LANES; lane++)
                of_lanes[lane] = rows[lane][i] + j;
            spread(equations[i] + j, of_lanes);
        }
    for (int lane = 0; lane < LANES; lane++)
        regular[lane] = reduce(rows[lane]);
    for (int i = 0; i < 6; i++) {
        for (int lane = 0; lane < LANES; lane++)
            of_lanes[lane] = rows[lane][4 + i] + LOWER;
        for (int j = 0; j < 10; j++)
            left[i][j] = GATHERED(of_lanes, j);
    }
    for (int k = 0; k < 3; k++)
        polynomials(left[2 * k], left[2 * k + 1], b[k]);
}

static void determinant_of(Lanes b[3][3][5], Lanes *determinant)
{
    memset(determinant, 0, (DEGREE + 1) * sizeof(Lanes));
    for (int i = 0; i < 3; i++) {
        const Lanes(*j)[5] = (const Lanes(*)[5])b[(i + 1) % 3], (*k)[5] = (const Lanes(*)[5])b[(i + 2) % 3];
        Lanes minor[7];
        memset(minor, 0, sizeof(minor));
        for (int p = 0; p < 4; p++)
            for (int q = 0; q < 4; q++)
                minor[p + q] += j[0][p] * k[1][q] - j[1][p] * k[0][q];
        for (int p = 0; p < 7; p++)
            for (int q = 0; q < 5; q++)
                determinant[p + q] += minor[p] * b[i][2][q];
    }
}

/* Value and first derivative of a polynomial, lowest power first. */
INLINE void value_and_slope(const Lanes *a, Complex z, Complex *value, Complex *first)
{
    Complex p = {a[DEGREE], ALL(0.0)}, d = {ALL(0.0), ALL(0.0)};
    for (int k = DEGREE - 1; k >= 0; k--) {
        d = times(d, z), d.re += p.re, d.im += p.im;
        p = times(p, z), p.re += a[k];
    }
    *value = p, *first = d;
}

INLINE Complex root_of(Complex a)
{
    const Lanes size = root_of_each(root_of_each(square_of(a)));
    const Lanes more = ALL(0.5) * (size * size + a.re), less = ALL(0.5) * (size * size - a.re);
    const Lanes re = root_of_each(either(more > ALL(0.0), more, ALL(0.0)));
    const Lanes im = root_of_each(either(less > ALL(0.0), less, ALL(0.0)));
    return (Complex){re, either(a.im < ALL(0.0), -im, im)};
}

/* Polynomials of the degrees up to `top`, the places on the way to a root of each, and the steps there. */
typedef struct {
    Lanes a[DEGREE + 1], degree, step;
    Complex z;
    int top;
} RootSearch;

#define MOST_STEPS 50

/* A step towards a root of each polynomial (Laguerre); returns which of them are there. */
INLINE LaneNumbers step_to_roots(RootSearch *s)
{
    /* a step of another length breaks the rare cycle */
    static const double UNUSUAL[5] = {1.0, 0.5, 0.25, 0.75, 0.13};
    const Complex z = s->z;
    const Lanes size = root_of_each(square_of(z)), one_less = s->degree - ALL(1.0);
    Lanes rounding = size_of_each(s->a[s->top]), length = ALL(1.0);
    Complex p = {s->a[s->top], ALL(0.0)}, d = {ALL(0.0), ALL(0.0)}, f = {ALL(0.0), ALL(0.0)};
    for (int k = s->top - 1; k >= 0; k--) {
        f = times(f, z), f.re += d.re, f.im += d.im;
        d = times(d, z), d.re += p.re, d.im += p.im;
        p = times(p, z), p.re += s->a[k];
        rounding = rounding * size + size_of_each(s->a[k]);
    }
    const LaneNumbers zero = square_of(p) <= ALL(1e-31) * rounding * rounding;
    const Complex g = over(d, p), g2 = times(g, g), quotient = over(f, p);
    const Complex h = {g2.re - ALL(2.0) * quotient.re, g2.im - ALL(2.0) * quotient.im};
    const Complex inner = {one_less * (s->degree * h.re - g2.re), one_less * (s->degree * h.im - g2.im)};
    const Complex root = root_of(inner), plus = {g.re + root.re, g.im + root.im}, less = minus(g, root);
    const Complex below = either_complex(square_of(plus) > square_of(less), plus, less);
    const Complex n = {s->degree, ALL(0.0)}, away = {ALL(1.0) + size, s->step};
    const Complex change = either_complex(square_of(below) > ALL(0.0), over(n, below), away);
    for (int lane = 0; lane < LANES; lane++)
        if ((int)LANE(s->step, lane) % 10 == 0)
            LANE(length, lane) = UNUSUAL[(int)LANE(s->step, lane) / 10 % 5];
    const Complex moved = {z.re - length * change.re, z.im - length * change.im};
    const LaneNumbers stays = zero | ((moved.re == z.re) & (moved.im == z.im));
    s->z = either_complex(stays, z, moved);
    const LaneNumbers ended = stays | (square_of(change) < ALL(1e-24) * square_of(s->z))
        | (s->step >= ALL((double)MOST_STEPS));
    s->step += ALL(1.0);
    return ended;
}

/* Divide the polynomial of a lane by a root, and by its conjugate, and begin again. */
static void take_root(RootSearch *s, int lane, Complex *root)
{
    double a[DEGREE + 1], re = LANE(s->z.re, lane), im = LANE(s->z.im, lane);
    int degree = (int)LANE(s->degree, lane);
    const int conjugates = degree > 1 && fabs(im) > 1e-10 * fabs(re);
    for (int k = 0; k <= degree; k++)
        a[k] = LANE(s->a[k], lane);
    im = conjugates ? fabs(im) : 0.0;
    const double sum = 2.0 * re, square = re * re + im * im;
    for (int k = degree - 1; k >= 0; k--)
        a[k] += conjugates ? sum * a[k + 1] - (k + 2 <= degree ? square * a[k + 2] : 0.0) : re * a[k + 1];
    const int fewer = conjugates ? 2 : 1;
    for (int k = 0; k <= degree; k++)
        LANE(s->a[k], lane) = k + fewer <= degree ? a[k + fewer] : 0.0;
    LANE(root->re, lane) = re, LANE(root->im, lane) = im;
    LANE(s->degree, lane) = degree - fewer;
    LANE(s->z.re, lane) = LANE(s->z.im, lane) = 0.0, LANE(s->step, lane) = 1.0;
}

/* Newton steps on the polynomial itself: after division by other roots a root is inexact. */
static Complex polished(const Lanes *a, Complex z)
{
    Complex p, d, there, slope;
    value_and_slope(a, z, &p, &d);
    LaneNumbers better = ALL(0.0) == ALL(0.0);
    for (int step = 0; step < 2; step++) {
        const Complex moved = minus(z, over(p, d));
        value_and_slope(a, moved, &there, &slope);
        better = better & (square_of(there) < square_of(p));
        z = either_complex(better, moved, z);
        p = there, d = slope;
    }
    return z;
}

/* The highest degree of the polynomials of all lanes. */
static int highest_degree(const RootSearch *s)
{
    int highest = 0;
    for (int lane = 0; lane < LANES; lane++)
        highest = LANE(s->degree, lane) > highest ? (int)LANE(s->degree, lane) : highest;
    return highest;
}

/* All roots of real polynomials, of conjugate pairs the one above the real axis; returns the largest number of them. */
static int roots_of(const Lanes *coefficients, const int *regular, Complex *roots, int *found)
{
    RootSearch s = {.degree = ALL(0.0), .step = ALL(1.0), .z = {ALL(0.0), ALL(0.0)}};
    memcpy(s.a, coefficients, sizeof(s.a));
    memset(roots, 0, DEGREE * sizeof(Complex));
    for (int lane = 0; lane < LANES; lane++) {
        int degree = regular[lane] ? DEGREE : 0;
        while (degree > 0 && LANE(s.a[degree], lane) == 0.0)
            degree--;
        LANE(s.degree, lane) = degree, found[lane] = 0;
    }
    while ((s.top = highest_degree(&s)) > 0) {
        LaneNumbers ended = step_to_roots(&s);
        while (!in_any(ended))
            ended = step_to_roots(&s);
        for (int lane = 0; lane < LANES; lane++) {
            if (!LANE_NUMBER(ended, lane) || LANE(s.degree, lane) == 0.0)
                continue;
            if (isfinite(LANE(s.z.re, lane)) && isfinite(LANE(s.z.im, lane)))
                take_root(&s, lane, roots + found[lane]++);
            else
                LANE(s.degree, lane) = 0.0;
        }
    }
    int most = 0;
    for (int lane = 0; lane < LANES; lane++)
        most = found[lane] > most ? found[lane] : most;
    for (int k = 0; k < most; k++)
        roots[k] = polished(coefficients, roots[k]);
    return most;
}

INLINE Complex value_at(const Lanes *a, Complex z)
{
    Complex p = {a[4], ALL(0.0)};
    for (int k = 3; k >= 0; k--)
        p = times(p, z), p.re += a[k];
    return p;
}

/* x and y from the two equations that are least parallel. */
static void others_of(Lanes b[3][3][5], Complex z, Complex *x, Complex *y)
{
    Complex rows[3][3], best[3];
    Lanes largest = ALL(-1.0);
    memset(best, 0, sizeof(best));
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            rows[i][j] = value_at(b[i][j], z);
    for (int i = 0; i < 3; i++) {
        const Complex *p = rows[i], *q = rows[(i + 1) % 3];
        Complex c[3];
        for (int j = 0; j < 3; j++)
            c[j] = minus(times(p[(j + 1) % 3], q[(j + 2) % 3]), times(p[(j + 2) % 3], q[(j + 1) % 3]));
        const Lanes size = square_of(c[0]) + square_of(c[1]) + square_of(c[2]);
        for (int j = 0; j < 3; j++)
            best[j] = either_complex(size > largest, c[j], best[j]);
        largest = either(size > largest, size, largest);
    }
    *x = over(best[0], best[2]), *y = over(best[1], best[2]);
}

/* The matrix with the norm 1 of a root, and whether it is one: nearly real. */
static LaneNumbers essential_at(Lanes basis[4][9], Lanes b[3][3][5], Complex z, Lanes e[9])
{
    Complex x, y;
    Lanes norm = ALL(0.0);
    others_of(b, z, &x, &y);
    const Lanes size = larger_of_each(larger_of_each(square_of(x), square_of(y)), larger_of_each(square_of(z), ALL(1.0)));
    const Lanes im = larger_of_each(size_of_each(x.im), larger_of_each(size_of_each(y.im), size_of_each(z.im)));
    for (int i = 0; i < 9; i++) {
        e[i] = x.re * basis[0][i] + y.re * basis[1][i] + z.re * basis[2][i] + basis[3][i];
        norm += e[i] * e[i];
    }
    norm = root_of_each(norm);
    for (int i = 0; i < 9; i++)
        e[i] /= norm;
    const Lanes infinite = ALL(INFINITY);
    return (size_of_each(x.re) < infinite) & (size_of_each(x.im) < infinite) & (size_of_each(y.re) < infinite)
        & (size_of_each(y.im) < infinite) & (im * im < ALL(NEARLY_REAL * NEARLY_REAL) * size) & (norm < infinite)
        & (norm > ALL(0.0));
}

/* Essential matrices, with the norm 1, of samples of five points, ten at most for each; returns how many there are of the
 * first `samples` lanes.
 */
static int five_points(Lanes left[5][3], Lanes right[5][3], int samples, double (*essential)[9])
{
    IN_LINES Lanes basis[4][9], equations[10][COLUMNS], b[3][3][5], determinant[DEGREE + 1], e[DEGREE][9];
    Complex roots[DEGREE];
    LaneNumbers real[DEGREE];
    int regular[LANES], number[LANES], found = 0;
    null_space(left, right, basis);
    cubic_equations(basis, equations);
    equations_in_z(equations, b, regular);
    for (int lane = samples; lane < LANES; lane++)
        regular[lane] = 0;
    determinant_of(b, determinant);
    const int most = roots_of(determinant, regular, roots, number);
    for (int k = 0; k < most; k++)
        real[k] = essential_at(basis, b, roots[k], e[k]);
    for (int lane = 0; lane < samples; lane++)
        for (int k = 0; k < number[lane]; k++)
            if (LANE_NUMBER(real[k], lane)) {
                for (int i = 0; i < 9; i++)
                    essential[found][i] = LANE(e[k][i], lane);
                found++;
            }
    return found;
}
