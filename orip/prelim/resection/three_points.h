/* Three-point resection, as in prelim_references/three_points.py, which explains it and names the sources.
 *
 * As many triples of points as there are lanes are solved at once, each with the operations, in their order, of one alone.
 */

#include "../compiled/linear.h"
#include <string.h>

#define FLAT 1e-6
#define MIX 0.4142
#define MISCLOSURE 1e-8

static const int PAIRS[3][2] = {{0, 1}, {0, 2}, {1, 2}};

/* Orientations, photo to ground, in the lanes of a triple each, and in which lanes there is one. */
typedef struct {
    Lanes rotation[9], centre[3];
    LaneNumbers found;
} OfTriples;

/* In which lanes three points do not lie on one line. */
static LaneNumbers are_a_triangle(Lanes p[3][3])
{
    Lanes sides[3][3], normal[3], longest = ALL(0.0);
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            sides[k][i] = p[PAIRS[k][1]][i] - p[PAIRS[k][0]][i];
        longest = larger_of_each(longest, dot_lanes(sides[k], sides[k]));
    }
    cross_lanes(sides[0], sides[1], normal);
    return root_of_each(dot_lanes(normal, normal)) > ALL(FLAT) * longest;
}

/* Right-handed axes, as rows, that are in the same position in congruent triangles. */
static void axes_of(Lanes p[3][3], Lanes axes[3][3])
{
    Lanes along[3], other[3], normal[3];
    for (int i = 0; i < 3; i++)
        along[i] = p[1][i] - p[0][i], other[i] = p[2][i] - p[0][i];
    cross_lanes(along, other, normal);
    const Lanes length = root_of_each(dot_lanes(along, along)), area = root_of_each(dot_lanes(normal, normal));
    for (int i = 0; i < 3; i++)
        axes[0][i] = along[i] / length, axes[2][i] = normal[i] / area;
    cross_lanes(axes[2], axes[0], axes[1]);
}

static void minors_of(Lanes m[3][3], Lanes minors[3][3])
{
    cross_lanes(m[1], m[2], minors[0]);
    cross_lanes(m[2], m[0], minors[1]);
    cross_lanes(m[0], m[1], minors[2]);
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

INLINE Lanes form_at(Lanes form[3][3], const Lanes *p, const Lanes *q)
{
    return p[0] * dot_lanes(form[0], q) + p[1] * dot_lanes(form[1], q) + p[2] * dot_lanes(form[2], q);
}

INLINE Lanes root_of_positive(Lanes number) { return root_of_each(larger_of_each(number, ALL(0.0))); }

/* The two directions in the plane of p and q in which a quadratic form vanishes. */
static void solve_in_plane(Lanes form[3][3], const Lanes *p, const Lanes *q, Lanes directions[2][3])
{
    const Lanes pp = form_at(form, p, p), pq = form_at(form, p, q), qq = form_at(form, q, q);
    const Lanes root = root_of_positive(pq * pq - pp * qq), h = -(pq + either(pq < ALL(0.0), -root, root));
    for (int i = 0; i < 3; i++) {
        directions[0][i] = h * p[i] + pp * q[i];
        directions[1][i] = qq * p[i] + h * q[i];
    }
}

/* Four directions in which both forms vanish, if they are real. */
static void intersect_conics(Lanes forms[2][3][3], Lanes directions[4][3])
{
    Lanes minors[2][3][3], c[4] = {ALL(0.0), ALL(0.0), ALL(0.0), ALL(0.0)}, root;
    minors_of(forms[0], minors[0]);
    minors_of(forms[1], minors[1]);
    c[0] = dot_lanes(forms[0][0], minors[0][0]), c[3] = dot_lanes(forms[1][0], minors[1][0]);
    for (int i = 0; i < 3; i++)
        c[1] += dot_lanes(minors[0][i], forms[1][i]), c[2] += dot_lanes(minors[1][i], forms[0][i]);
    const LaneNumbers turn = size_of_each(c[3]) < size_of_each(c[0]);
    exchange_lanes(turn, c, c + 3, 1);
    exchange_lanes(turn, c + 1, c + 2, 1);
    exchange_lanes(turn, forms[0][0], forms[1][0], 9);
    for (int lane = 0; lane < LANES; lane++) {
        const double of_lane[4] = {LANE(c[0], lane), LANE(c[1], lane), LANE(c[2], lane), LANE(c[3], lane)};
        LANE(root, lane) = isolated_root(of_lane);
    }
    Lanes singular[3][3], values[3], axes[3][3], plus[3], less[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            singular[i][j] = forms[0][i][j] + root * forms[1][i][j];
    eigen3_lanes(singular, values, axes);
    const Lanes above = root_of_positive(values[2]), below = root_of_positive(-values[0]);
    for (int i = 0; i < 3; i++) {
        const Lanes a = above * axes[0][i], b = below * axes[2][i];
        plus[i] = a + b, less[i] = a - b;
    }
    solve_in_plane(forms[1], axes[1], plus, directions);
    solve_in_plane(forms[1], axes[1], less, directions + 2);
}

static void misclosures(const Lanes *d, const Lanes *cosines, const Lanes *squares, Lanes *f)
{
    for (int k = 0; k < 3; k++) {
        const Lanes a = d[PAIRS[k][0]], b = d[PAIRS[k][1]];
        f[k] = a * a + b * b - ALL(2.0) * a * b * cosines[k] - squares[k];
    }
}

static void newton_step(Lanes *dist, const Lanes *cosines, const Lanes *squares)
{
    Lanes miss[3];
    misclosures(dist, cosines, squares, miss);
    const Lanes f01 = ALL(-0.5) * miss[0], f02 = ALL(-0.5) * miss[1], f12 = ALL(-0.5) * miss[2];
    const Lanes d0 = dist[0], d1 = dist[1], d2 = dist[2], c01 = cosines[0], c02 = cosines[1], c12 = cosines[2];
    const Lanes a = d0 - c01 * d1, b = d1 - c01 * d0, c = d0 - c02 * d2, d = d2 - c02 * d0, e = d1 - c12 * d2,
                f = d2 - c12 * d1;
    const Lanes determinant = a * d * e + b * c * f;
    /* at a double solution the step would be rounding magnified */
    const LaneNumbers moves = size_of_each(determinant) > ALL(1e-14);
    const Lanes steps[3] = {f01 * d * e + b * (f02 * f - d * f12), a * (d * f12 - f02 * f) + f01 * c * f,
                            e * (a * f02 - c * f01) + b * c * f12};
    for (int i = 0; i < 3; i++)
        dist[i] += either(moves, steps[i] / determinant, ALL(0.0));
}

/* What the distances of three points obey, all divided by the size of the triangle: the sum of its squared sides. */
typedef struct {
    Lanes unit[3][3], cosines[3], squares[3], size, sum[3][3];
} Triangle;

/* The triangle, and two forms that vanish at its distances. */
static void triangle_of(Lanes unit[3][3], Lanes points[3][3], Triangle *t, Lanes pencil[2][3][3])
{
    Lanes forms[3][3][3];
    memset(forms, 0, sizeof(forms));
    memcpy(t->unit, unit, sizeof(t->unit));
    t->size = ALL(0.0);
    for (int k = 0; k < 3; k++) {
        const int i = PAIRS[k][0], j = PAIRS[k][1];
        Lanes side[3];
        for (int axis = 0; axis < 3; axis++)
            side[axis] = points[i][axis] - points[j][axis];
        t->cosines[k] = dot_lanes(unit[i], unit[j]);
        t->size += t->squares[k] = dot_lanes(side, side);
        forms[k][i][i] = forms[k][j][j] = ALL(1.0);
        forms[k][i][j] = forms[k][j][i] = -t->cosines[k];
    }
    for (int k = 0; k < 3; k++)
        t->squares[k] /= t->size;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const Lanes p = forms[0][i][j] * t->squares[2] - forms[2][i][j] * t->squares[0];
            const Lanes q = forms[1][i][j] * t->squares[2] - forms[2][i][j] * t->squares[1];
            pencil[0][i][j] = p + ALL(MIX) * q, pencil[1][i][j] = q - ALL(MIX) * p;
            t->sum[i][j] = forms[0][i][j] + forms[1][i][j] + forms[2][i][j];
        }
}

/* Distances in a given direction; returns in which lanes they close the triangle in front of the photo. */
static LaneNumbers find_distances(const Triangle *t, Lanes *d)
{
    Lanes miss[3];
    const Lanes squares = t->squares[0] + t->squares[1] + t->squares[2];
    /* the sum of the three equations, a positive form, fixes the length */
    const Lanes length =
        root_of_each(squares / larger_of_each(form_at((Lanes(*)[3])t->sum, d, d), ALL(1e-300)));
    const Lanes scale = either(d[0] + d[1] + d[2] < ALL(0.0), -length, length);
    for (int i = 0; i < 3; i++)
        d[i] *= scale;
    for (int step = 0; step < 2; step++)
        newton_step(d, t->cosines, t->squares);
    misclosures(d, t->cosines, t->squares, miss);
    LaneNumbers closed = ALL(0.0) == ALL(0.0);
    for (int i = 0; i < 3; i++)
        closed = closed & (size_of_each(miss[i]) < ALL(MISCLOSURE)) & (d[i] > ALL(0.0));
    return closed;
}

/* The orientation that takes points at distances to the ground, where they have known axes. */
static void orient_triangle(const Triangle *t, const Lanes *d, Lanes points[3][3], Lanes ground[3][3], OfTriples *o)
{
    Lanes seen[3][3], axes[3][3];
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            seen[k][i] = d[k] * root_of_each(t->size) * t->unit[k][i];
    axes_of(seen, axes);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            o->rotation[3 * i + j] = ground[0][i] * axes[0][j] + ground[1][i] * axes[1][j] + ground[2][i] * axes[2][j];
    for (int i = 0; i < 3; i++) {
        o->centre[i] = ALL(0.0);
        for (int k = 0; k < 3; k++)
            o->centre[i] += (points[k][i] - dot_lanes(o->rotation + 3 * i, seen[k])) / ALL(3.0);
    }
}

/* All orientations from which three points are seen in given directions. */
static void three_points(Lanes vectors[3][3], Lanes points[3][3], OfTriples found[4])
{
    Lanes unit[3][3], pencil[2][3][3], distances[4][3], ground[3][3];
    Triangle t;
    for (int k = 0; k < 3; k++) {
        const Lanes length = root_of_each(dot_lanes(vectors[k], vectors[k]));
        for (int i = 0; i < 3; i++)
            unit[k][i] = vectors[k][i] / length;
    }
    const LaneNumbers regular = are_a_triangle(unit) & are_a_triangle(points);
    triangle_of(unit, points, &t, pencil);
    intersect_conics(pencil, distances);
    axes_of(points, ground);
    for (int s = 0; s < 4; s++) {
        found[s].found = regular & find_distances(&t, distances[s]);
        if (in_any(found[s].found))
            orient_triangle(&t, distances[s], points, ground, found + s);
    }
}
