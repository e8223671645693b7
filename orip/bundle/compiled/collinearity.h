/* Collinearity of photo points, one in each lane: residuals in mm and partials.
 *
 * For the formulas and their sources see orip/geometry/perspective.py, orip/geometry/equidistant.py and
 * orip/interior/image_coordinates.py with what it imports; tests/bundle/test_photo_loop.py compares every row of partials with theirs.
 */

#include <math.h>
#include <stdint.h>

#include "../../lanes.h"

#define CAMERA_PARAMETERS 13
#define COEFFICIENT_COUNT 9
#define MOST_ADDITIONAL 44
#define POLYNOMIALS 5
#define PRODUCTS (POLYNOMIALS * POLYNOMIALS)

/* How many of the shifts and turns of a photo during a readout are unknowns, shifts first: the loops are compiled with
 * none, three and six. */
#define MOST_MOTION_UNKNOWNS 6
#define MOTION_STEP 3
#ifndef MOTION_UNKNOWNS
#define MOTION_UNKNOWNS 0
#endif

/* Where the partials by each group of unknowns begin. */
enum { CAMERA = 0, COEFFICIENTS = 3, READOUT = 12, PHOTO = 13, ROTATION = 16, POINT = 19, MOTION = 22, ELEMENTS = MOTION + MOTION_UNKNOWNS };

/* The deformation by a set of additional parameters: dx and dy are sums of products B_i(y) A_j(x) of two polynomials of a
 * coordinate, numbered i times `polynomials` plus j. by_powers: their coefficients by powers of the coordinate; dx, dy:
 * those of the products. Product 0 is a shift, which no set has. */
typedef struct {
    int64_t polynomials;
    const double *by_powers, *in_image[2];
} Set;

/* motion: a second, zero where no readout is unknown; moved: during a readout, with what is corrected of it; by_turns: from
 * small changes of the turns until the row to rotations about the ground axes. */
typedef struct {
    Lanes camera[CAMERA_PARAMETERS], centre[3], rotation[9], basis[9], ground[3], xy[2], motion[6], moved[6], by_turns[9], row, row_a_mm[2];
} IN_LINES Ray;

/* product: those of a set, by whose coefficients in dx (or dy) they are the partials of x (or y). */
typedef struct {
    Lanes residual[2], partials[2][ELEMENTS], product[PRODUCTS];
    int in_front[LANES];
} IN_LINES Linearised;

typedef struct {
    Lanes value[2], by_xy[2][2], by_coefficients[2][COEFFICIENT_COUNT];
} Distorted;

/* k: A1 A3 A5 A7 A9 P1 P2 B1 B2; x, y: mm from the principal point. */
INLINE void distortion(const Lanes *k, Lanes x, Lanes y, Distorted *d)
{
    const Lanes xx = x * x, yy = y * y, xy2 = 2.0 * x * y, s = xx + yy;
    const Lanes radial = k[0] + s * (k[1] + s * (k[2] + s * (k[3] + s * k[4])));
    const Lanes by_s = k[1] + s * (2.0 * k[2] + s * (3.0 * k[3] + s * (4.0 * k[4])));
    const Lanes p1 = k[5], p2 = k[6], b1 = k[7], b2 = k[8], none = ALL(0.0);
    d->value[0] = x * radial + p1 * (s + 2.0 * xx) + p2 * xy2 + b1 * x + b2 * y;
    d->value[1] = y * radial + p2 * (s + 2.0 * yy) + p1 * xy2;
    d->by_xy[0][0] = radial + 2.0 * xx * by_s + 6.0 * p1 * x + 2.0 * p2 * y + b1;
    d->by_xy[1][0] = xy2 * by_s + 2.0 * p2 * x + 2.0 * p1 * y;
    d->by_xy[0][1] = d->by_xy[1][0] + b2;
    d->by_xy[1][1] = radial + 2.0 * yy * by_s + 6.0 * p2 * y + 2.0 * p1 * x;
    d->by_coefficients[0][0] = x;
    d->by_coefficients[1][0] = y;
    for (int term = 1; term < 5; term++) {
        d->by_coefficients[0][term] = d->by_coefficients[0][term - 1] * s;
        d->by_coefficients[1][term] = d->by_coefficients[1][term - 1] * s;
    }
    d->by_coefficients[0][5] = s + 2.0 * xx;
    d->by_coefficients[1][5] = d->by_coefficients[0][6] = xy2;
    d->by_coefficients[1][6] = s + 2.0 * yy;
    d->by_coefficients[0][7] = x;
    d->by_coefficients[0][8] = y;
    d->by_coefficients[1][7] = d->by_coefficients[1][8] = none;
}

/* Measured coordinates free of distortion, for a polynomial that is given at measured coordinates. */
INLINE void correction(const Lanes *k, Lanes x, Lanes y, Distorted *d)
{
    const Lanes b1 = k[7], b2 = k[8], none = ALL(0.0);
    const Lanes without_affinity[COEFFICIENT_COUNT] = {k[0], k[1], k[2], k[3], k[4], k[5], k[6], none, none};
    const Lanes freed = x - (b1 * x + b2 * y);
    distortion(without_affinity, freed, y, d);
    d->value[0] = freed - d->value[0];
    d->value[1] = y - d->value[1];
    for (int row = 0; row < 2; row++) {
        const Lanes by_x = (row == 0 ? 1.0 : 0.0) - d->by_xy[row][0], by_y = (row == 1 ? 1.0 : 0.0) - d->by_xy[row][1];
        d->by_xy[row][0] = by_x * (1.0 - b1);
        d->by_xy[row][1] = by_y - by_x * b2;
        for (int term = 0; term < 7; term++)
            d->by_coefficients[row][term] = -d->by_coefficients[row][term];
        d->by_coefficients[row][7] = -by_x * x;
        d->by_coefficients[row][8] = -by_x * y;
    }
}

/* Values and derivatives of a set's polynomials at a coordinate. */
INLINE void polynomials(const Set *set, Lanes t, Lanes *value, Lanes *derivative)
{
    for (int64_t p = 0; p < set->polynomials; p++) {
        const double *c = set->by_powers + POLYNOMIALS * p;
        value[p] = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])));
        derivative[p] = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4])));
    }
}

/* Add the deformation by a set at (x, y) in the fiducial system to the residuals; by_place: its partials by x and y. The
 * products are found if `linear`. */
INLINE void deform(const Set *set, Lanes x, Lanes y, int linear, Linearised *found, Lanes (*by_place)[2])
{
    const int64_t count = set->polynomials;
    Lanes of_x[POLYNOMIALS], by_x[POLYNOMIALS], of_y[POLYNOMIALS], by_y[POLYNOMIALS];
    polynomials(set, x, of_x, by_x);
    polynomials(set, y, of_y, by_y);
    for (int row = 0; row < 2; row++)
        for (int64_t i = 0; i < count; i++) {
            const double *coefficients = set->in_image[row] + count * i;
            Lanes along_x = ALL(0.0), slope = ALL(0.0);
            for (int64_t j = 0; j < count; j++) {
                along_x += coefficients[j] * of_x[j];
                slope += coefficients[j] * by_x[j];
            }
            found->residual[row] += of_y[i] * along_x;
            by_place[row][0] += of_y[i] * slope;
            by_place[row][1] += by_y[i] * along_x;
        }
    for (int64_t i = 0; linear && i < count; i++)
        for (int64_t j = 0; j < count; j++)
            found->product[i * count + j] = of_y[i] * of_x[j];
}

/* Cosine of the angle from the axis beyond which an equidistant camera shows nothing, 175 degrees, and the square of the
 * angle below which its third power is nothing beside it: see orip/geometry/equidistant.py. */
#define LEAST_COSINE (-0.99619469809174555)
#define ON_AXIS 1e-16

/* The image of ground points by a projection with C = 1, and its partials by U. */
typedef struct {
    Lanes direction[2], by_u[2][3];
} Projected;

/* (U1, U2) / -U3; by_u has the same element for both coordinates, none between them. */
INLINE void perspective(const Lanes *u, Projected *p, int *in_front)
{
    for (int lane = 0; lane < LANES; lane++) {
        /* depth < -1e-6 |u|, squared to save the root */
        const double a = LANE(u[0], lane), b = LANE(u[1], lane), depth = LANE(u[2], lane);
        in_front[lane] = depth < 0.0 && depth * depth > 1e-12 * (a * a + b * b + depth * depth);
    }
    const Lanes inverse = -1.0 / u[2];
    for (int row = 0; row < 2; row++) {
        p->direction[row] = u[row] * inverse;
        p->by_u[row][row] = inverse;
        p->by_u[row][1 - row] = ALL(0.0);
        p->by_u[row][2] = p->direction[row] * inverse;
    }
}

/* theta (U1, U2) / rho with tan theta = rho / -U3. */
INLINE void equidistant(const Lanes *u, Projected *p, int *in_front)
{
    Lanes scale = ALL(0.0), bend = ALL(0.0), by_depth = ALL(0.0);
    for (int lane = 0; lane < LANES; lane++) {
        const double a = LANE(u[0], lane), b = LANE(u[1], lane), depth = LANE(u[2], lane);
        const double across = a * a + b * b, square = across + depth * depth, distance = sqrt(across);
        const double s = distance > 0.0 ? atan2(distance, -depth) / distance : -1.0 / depth;
        in_front[lane] = -depth > LEAST_COSINE * sqrt(square);
        LANE(scale, lane) = s;
        LANE(bend, lane) = across > ON_AXIS * square ? (-depth / square - s) / across : 0.0;
        LANE(by_depth, lane) = 1.0 / square;
    }
    for (int row = 0; row < 2; row++) {
        p->direction[row] = scale * u[row];
        p->by_u[row][row] = scale + bend * u[row] * u[row];
        p->by_u[row][1 - row] = bend * u[0] * u[1];
        p->by_u[row][2] = u[row] * by_depth;
    }
}

/* I + sine [a]x + versine [a]x^2, with the square of the length of a. */
INLINE void axis_matrix(const Lanes *a, Lanes square, Lanes sine, Lanes versine, Lanes *matrix)
{
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            matrix[3 * row + column] = versine * a[row] * a[column];
    for (int axis = 0; axis < 3; axis++) {
        const int next = (axis + 1) % 3, last = (axis + 2) % 3;
        matrix[4 * axis] += 1.0 - versine * square;
        matrix[3 * last + next] += sine * a[axis];
        matrix[3 * next + last] -= sine * a[axis];
    }
}

/* Square of an angle below which the terms that follow in the series are smaller than rounding. */
#define SMALL_SQUARE 1e-3

/* 1 / n! - s / (n + 2)! + s^2 / (n + 4)! ... for small s; factorial: n!. */
INLINE Lanes alternating_series(Lanes s, int n, double factorial)
{
    double term[4] = {1.0 / factorial};
    for (int k = 1; k < 4; k++)
        term[k] = -term[k - 1] / ((n + 2 * k - 1) * (n + 2 * k));
    return term[0] + s * (term[1] + s * (term[2] + s * term[3]));
}

/* Exp([a]x), and if `linear` J with Exp([a + d]x) = Exp([J d]x) Exp([a]x) for small d: see rotation_about_axes of
 * orip/geometry/rotation.py and orip/geometry/rolling_shutter.py. */
INLINE void rotation_about(const Lanes *a, int linear, Lanes *rotation, Lanes *by_turns)
{
    const Lanes square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    Lanes sine = alternating_series(square, 1, 1.0), versine = alternating_series(square, 2, 2.0);
    Lanes rest = alternating_series(square, 3, 6.0);
    for (int lane = 0; lane < LANES; lane++)
        if (LANE(square, lane) > SMALL_SQUARE) {
            const double angle = sqrt(LANE(square, lane)), half = sin(0.5 * angle) / angle;
            LANE(sine, lane) = sin(angle) / angle, LANE(versine, lane) = 2.0 * half * half;
            LANE(rest, lane) = (1.0 - LANE(sine, lane)) / LANE(square, lane);
        }
    axis_matrix(a, square, sine, versine, rotation);
    if (linear)
        axis_matrix(a, square, versine, rest, by_turns);
}

INLINE void turn_matrix(const Lanes *turn, Lanes *matrix)
{
    for (int column = 0; column < 3; column++) {
        const Lanes a = matrix[column], b = matrix[3 + column], c = matrix[6 + column];
        for (int row = 0; row < 3; row++)
            matrix[3 * row + column] = turn[3 * row] * a + turn[3 * row + 1] * b + turn[3 * row + 2] * c;
    }
}

/* Take a ray's photo to where it was when the row of the photo point was exposed; rotations about the ground axes are
 * those of then. See orip/geometry/rolling_shutter.py. */
INLINE void move_ray(Ray *ray, int turned, int linear)
{
    Lanes angles[3], turn[9];
    for (int axis = 0; axis < 3; axis++) {
        ray->centre[axis] += ray->row * ray->moved[axis];
        angles[axis] = ray->row * ray->moved[3 + axis];
    }
    rotation_about(angles, linear, turn, ray->by_turns);
    turn_matrix(turn, ray->rotation);
    if (turned && linear)
        turn_matrix(turn, ray->basis);
    else
        for (int k = 0; linear && k < 9; k++)
            ray->basis[k] = turn[k];
}

/* Linearise photo points. The numbers in lanes whose point is not in front of the camera are meaningless.
 *
 * is_equidistant: the projection, else the perspective; rotation: photo to ground, by rows; basis: from the photo's rotation unknowns to rotations about the ground axes, used
 * with `turned`; moving: the ray was moved by move_ray; set: NULL for a camera without one; partials are found if `linear`.
 */
INLINE void collinearity(const Ray *ray, int is_equidistant, int at_measured, const Set *set, int turned, int moving,
                         int linear, Linearised *found)
{
    const Lanes *camera = ray->camera, *rotation = ray->rotation;
    const Lanes v[3] = {ray->ground[0] - ray->centre[0], ray->ground[1] - ray->centre[1], ray->ground[2] - ray->centre[2]};
    Lanes u[3];
    for (int axis = 0; axis < 3; axis++)
        u[axis] = rotation[axis] * v[0] + rotation[3 + axis] * v[1] + rotation[6 + axis] * v[2];
    Projected image;
    if (is_equidistant)
        equidistant(u, &image, found->in_front);
    else
        perspective(u, &image, found->in_front);
    const Lanes *direction = image.direction;
    const Lanes ideal[2] = {camera[0] * direction[0], camera[0] * direction[1]};

    Distorted d;
    for (int row = 0; row < 2; row++)
        found->residual[row] = ideal[row];
    if (at_measured) {
        correction(camera + COEFFICIENTS, ray->xy[0] - camera[1], ray->xy[1] - camera[2], &d);
        for (int row = 0; row < 2; row++)
            found->residual[row] -= d.value[row];
    } else {
        distortion(camera + COEFFICIENTS, ideal[0], ideal[1], &d);
        for (int row = 0; row < 2; row++)
            found->residual[row] += camera[1 + row] + d.value[row] - ray->xy[row];
    }
    Lanes by_place[2][2] = {{ALL(0.0), ALL(0.0)}, {ALL(0.0), ALL(0.0)}};
    if (set && at_measured) {
        deform(set, ray->xy[0], ray->xy[1], linear, found, by_place);
        for (int row = 0; row < 2; row++)
            by_place[row][0] = by_place[row][1] = ALL(0.0);
    } else if (set)
        deform(set, camera[1] + ideal[0], camera[2] + ideal[1], linear, found, by_place);
    if (!linear)
        return;

    Lanes of_ideal[2][3];
    for (int row = 0; row < 2; row++)
        for (int axis = 0; axis < 3; axis++) {
            const Lanes *by_u = image.by_u[row], *turn = rotation + 3 * axis;
            of_ideal[row][axis] = by_u[row] * turn[row] + by_u[2] * turn[2];
            if (is_equidistant)
                of_ideal[row][axis] += by_u[1 - row] * turn[1 - row];
            of_ideal[row][axis] *= camera[0];
        }
    for (int row = 0; row < 2; row++) {
        Lanes *p = found->partials[row], by_ideal[2];
        for (int column = 0; column < 2; column++) {
            by_ideal[column] = by_place[row][column] + (row == column ? 1.0 : 0.0);
            p[1 + column] = at_measured ? d.by_xy[row][column] : by_ideal[column];
            if (!at_measured)
                by_ideal[column] += d.by_xy[row][column];
        }
        p[0] = by_ideal[0] * direction[0] + by_ideal[1] * direction[1];
        for (int term = 0; term < COEFFICIENT_COUNT; term++)
            p[COEFFICIENTS + term] = at_measured ? -d.by_coefficients[row][term] : d.by_coefficients[row][term];
        Lanes *g = p + POINT, *turn = p + ROTATION;
        for (int axis = 0; axis < 3; axis++) {
            g[axis] = by_ideal[0] * of_ideal[0][axis] + by_ideal[1] * of_ideal[1][axis];
            p[PHOTO + axis] = -g[axis];
        }
        turn[0] = g[1] * v[2] - g[2] * v[1];
        turn[1] = g[2] * v[0] - g[0] * v[2];
        turn[2] = g[0] * v[1] - g[1] * v[0];
        p[READOUT] = ALL(0.0);
        for (int axis = 0; moving && axis < 3; axis++) {
            const Lanes *j = ray->by_turns + axis, shift = -ray->row * g[axis];
            const Lanes of_turn = ray->row * (turn[0] * j[0] + turn[1] * j[3] + turn[2] * j[6]);
            p[READOUT] += shift * ray->motion[axis] + of_turn * ray->motion[3 + axis];
#if MOTION_UNKNOWNS > 0
            p[MOTION + axis] = shift;
#endif
#if MOTION_UNKNOWNS > 3
            p[MOTION + 3 + axis] = of_turn;
#endif
        }
        if (turned) {
            const Lanes axes[3] = {turn[0], turn[1], turn[2]}, *basis = ray->basis;
            for (int axis = 0; axis < 3; axis++)
                turn[axis] = axes[0] * basis[axis] + axes[1] * basis[3 + axis] + axes[2] * basis[6 + axis];
        }
    }
}
