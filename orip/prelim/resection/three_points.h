/* Three-point resection, as in orip/geometry/three_point_resection.py, which explains it and names the sources. */

#include "../compiled/linear.h"

#define FLAT 1e-6
#define MIX 0.4142
#define MISCLOSURE 1e-8

static const int PAIRS[3][2] = {{0, 1}, {0, 2}, {1, 2}};

static int on_one_line(const double p[3][3])
{
    double sides[3][3], normal[3], longest = 0.0;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            sides[k][i] = p[PAIRS[k][1]][i] - p[PAIRS[k][0]][i];
        longest = fmax(longest, dot3(sides[k], sides[k]));
    }
    cross3(sides[0], sides[1], normal);
    return !(sqrt(dot3(normal, normal)) > FLAT * longest);
}

/* Right-handed axes, as columns, that are in the same position in congruent triangles. */
static void axes_of(const double p[3][3], double axes[3][3])
{
    double along[3], other[3], normal[3], third[3];
    for (int i = 0; i < 3; i++)
        along[i] = p[1][i] - p[0][i], other[i] = p[2][i] - p[0][i];
    cross3(along, other, normal);
    const double length = sqrt(dot3(along, along)), area = sqrt(dot3(normal, normal));
    for (int i = 0; i < 3; i++)
        along[i] /= length, normal[i] /= area;
    cross3(normal, along, third);
    for (int i = 0; i < 3; i++)
        axes[i][0] = along[i], axes[i][1] = third[i], axes[i][2] = normal[i];
}

static void minors_of(double m[3][3], double minors[3][3])
{
    cross3(m[1], m[2], minors[0]);
    cross3(m[2], m[0], minors[1]);
    cross3(m[0], m[1], minors[2]);
}

/* The real root of a cubic, lowest power first, that lies farthest from the others (Cardano, Vieta). */
static double isolated_root(const double *c)
{
    const double leading = c[3] == 0.0 ? 1e-300 : c[3], c0 = c[0] / leading, c1 = c[1] / leading, c2 = c[2] / leading;
    const double p = (c1 - c2 * c2 / 3.0) / 3.0, q = (c2 * c2 * c2 / 27.0 - c2 * c1 / 6.0) + c0 / 2.0;
    const double discriminant = q * q + p * p * p;
    double root;
    if (discriminant > 0.0) {
        const double cube = cbrt(fabs(q) + sqrt(discriminant));
        root = cube - p / (cube == 0.0 ? 1.0 : cube);
    } else {
        const double radius = sqrt(fmax(-p, 0.0)), cubed = radius == 0.0 ? 1.0 : radius * radius * radius;
        root = 2.0 * radius * cos(acos(fmin(fabs(q) / cubed, 1.0)) / 3.0);
    }
    root = -(q < 0.0 ? -1.0 : 1.0) * root - c2 / 3.0;
    for (int step = 0; step < 2; step++) {
        const double slope = (3.0 * root + 2.0 * c2) * root + c1, value = ((root + c2) * root + c1) * root + c0;
        root -= slope == 0.0 ? 0.0 : value / slope;
    }
    return root;
}

static double form_at(double form[3][3], const double *p, const double *q)
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += p[i] * dot3(form[i], q);
    return sum;
}

/* The two directions in the plane of p and q in which a quadratic form vanishes. */
static void solve_in_plane(double form[3][3], const double *p, const double *q, double directions[2][3])
{
    const double pp = form_at(form, p, p), pq = form_at(form, p, q), qq = form_at(form, q, q);
    const double root = sqrt(fmax(pq * pq - pp * qq, 0.0)), h = -(pq + (pq < 0.0 ? -root : root));
    for (int i = 0; i < 3; i++) {
        directions[0][i] = h * p[i] + pp * q[i];
        directions[1][i] = qq * p[i] + h * q[i];
    }
}

/* Four directions in which both forms vanish, if they are real. */
static void intersect_conics(double forms[2][3][3], double directions[4][3])
{
    double minors[2][3][3], c[4] = {0.0};
    minors_of(forms[0], minors[0]);
    minors_of(forms[1], minors[1]);
    c[0] = dot3(forms[0][0], minors[0][0]), c[3] = dot3(forms[1][0], minors[1][0]);
    for (int i = 0; i < 3; i++)
        c[1] += dot3(minors[0][i], forms[1][i]), c[2] += dot3(minors[1][i], forms[0][i]);
    const int turn = fabs(c[3]) < fabs(c[0]);
    const double turned[4] = {c[3], c[2], c[1], c[0]};
    const double root = isolated_root(turn ? turned : c);
    double singular[3][3], values[3], axes[3][3], plus[3], minus[3], common[3];
    double(*one)[3] = forms[turn], (*other)[3] = forms[!turn];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            singular[i][j] = one[i][j] + root * other[i][j];
    eigen3(singular, values, axes);
    for (int i = 0; i < 3; i++) {
        const double a = sqrt(fmax(values[2], 0.0)) * axes[i][0], b = sqrt(fmax(-values[0], 0.0)) * axes[i][2];
        common[i] = axes[i][1], plus[i] = a + b, minus[i] = a - b;
    }
    solve_in_plane(other, common, plus, directions);
    solve_in_plane(other, common, minus, directions + 2);
}

static void misclosures(const double *d, const double *cosines, const double *squares, double *f)
{
    for (int k = 0; k < 3; k++) {
        const double a = d[PAIRS[k][0]], b = d[PAIRS[k][1]];
        f[k] = a * a + b * b - 2.0 * a * b * cosines[k] - squares[k];
    }
}

static void newton_step(double *dist, const double *cosines, const double *squares)
{
    double miss[3];
    misclosures(dist, cosines, squares, miss);
    const double f01 = -0.5 * miss[0], f02 = -0.5 * miss[1], f12 = -0.5 * miss[2];
    const double d0 = dist[0], d1 = dist[1], d2 = dist[2], c01 = cosines[0], c02 = cosines[1], c12 = cosines[2];
    const double a = d0 - c01 * d1, b = d1 - c01 * d0, c = d0 - c02 * d2, d = d2 - c02 * d0, e = d1 - c12 * d2,
                 f = d2 - c12 * d1;
    const double determinant = a * d * e + b * c * f;
    /* at a double solution the step would be rounding magnified */
    if (!(fabs(determinant) > 1e-14))
        return;
    dist[0] += (f01 * d * e + b * (f02 * f - d * f12)) / determinant;
    dist[1] += (a * (d * f12 - f02 * f) + f01 * c * f) / determinant;
    dist[2] += (e * (a * f02 - c * f01) + b * c * f12) / determinant;
}

/* All orientations, photo to ground, from which three points are seen in given directions; returns how many. */
static int three_points(const double vectors[3][3], const double points[3][3], double rotations[4][9],
                        double centres[4][3])
{
    double unit[3][3], cosines[3], squares[3], forms[3][3][3] = {{{0.0}}}, pencil[2][3][3], size = 0.0, ground[3][3];
    for (int k = 0; k < 3; k++) {
        const double length = sqrt(dot3(vectors[k], vectors[k]));
        for (int i = 0; i < 3; i++)
            unit[k][i] = vectors[k][i] / length;
    }
    if (on_one_line(unit) || on_one_line(points))
        return 0;
    for (int k = 0; k < 3; k++) {
        const int i = PAIRS[k][0], j = PAIRS[k][1];
        double side[3];
        for (int axis = 0; axis < 3; axis++)
            side[axis] = points[i][axis] - points[j][axis];
        cosines[k] = dot3(unit[i], unit[j]);
        size += squares[k] = dot3(side, side);
        forms[k][i][i] = forms[k][j][j] = 1.0;
        forms[k][i][j] = forms[k][j][i] = -cosines[k];
    }
    double sum[3][3];
    for (int k = 0; k < 3; k++)
        squares[k] /= size;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double p = forms[0][i][j] * squares[2] - forms[2][i][j] * squares[0];
            const double q = forms[1][i][j] * squares[2] - forms[2][i][j] * squares[1];
            pencil[0][i][j] = p + MIX * q, pencil[1][i][j] = q - MIX * p;
            sum[i][j] = forms[0][i][j] + forms[1][i][j] + forms[2][i][j];
        }
    double distances[4][3];
    intersect_conics(pencil, distances);
    axes_of(points, ground);
    int found = 0;
    for (int s = 0; s < 4; s++) {
        double *d = distances[s], miss[3];
        const double sign = d[0] + d[1] + d[2] < 0.0 ? -1.0 : 1.0;
        /* the sum of the three equations, a positive form, fixes the length */
        const double scale =
            sign * sqrt((squares[0] + squares[1] + squares[2]) / fmax(form_at(sum, d, d), 1e-300));
        for (int i = 0; i < 3; i++)
            d[i] *= scale;
        for (int step = 0; step < 2; step++)
            newton_step(d, cosines, squares);
        misclosures(d, cosines, squares, miss);
        const double worst = fmax(fabs(miss[0]), fmax(fabs(miss[1]), fabs(miss[2])));
        if (!(worst < MISCLOSURE && d[0] > 0.0 && d[1] > 0.0 && d[2] > 0.0))
            continue;
        double seen[3][3], axes[3][3], *R = rotations[found], *centre = centres[found];
        for (int k = 0; k < 3; k++)
            for (int i = 0; i < 3; i++)
                seen[k][i] = d[k] * sqrt(size) * unit[k][i];
        axes_of(seen, axes);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                R[3 * i + j] = dot3(ground[i], axes[j]);
        for (int i = 0; i < 3; i++) {
            centre[i] = 0.0;
            for (int k = 0; k < 3; k++)
                centre[i] += (points[k][i] - dot3(R + 3 * i, seen[k])) / 3.0;
        }
        found++;
    }
    return found;
}
