/* Collinearity of one photo point: residuals in mm and partials.
 *
 * The formulas and their sources stand in orip/geometry/perspective.py and orip/interior/distortion.py; this is the same
 * for one point at a time, and tests compare the two.
 */

#ifndef ORIP_COLLINEARITY_H
#define ORIP_COLLINEARITY_H

#include <math.h>

enum { CAMERA = 0, COEFFICIENTS = 3, CENTRE = 11, ROTATION = 14, POINT = 17, ELEMENTS = 20 };

typedef struct {
    double value[2], by_xy[2][2], by_coefficients[2][8];
} Distorted;

/* k: A1 A3 A5 A7 P1 P2 B1 B2; x, y: mm from the principal point. */
static inline __attribute__((always_inline)) void distortion(const double *k, double x, double y, Distorted *d)
{
    const double s = x * x + y * y;
    const double radial = k[0] + s * (k[1] + s * (k[2] + s * k[3]));
    const double by_s = k[1] + s * (2.0 * k[2] + s * 3.0 * k[3]);
    const double p1 = k[4], p2 = k[5], b1 = k[6], b2 = k[7];
    d->value[0] = x * radial + p1 * (s + 2.0 * x * x) + 2.0 * p2 * x * y + b1 * x + b2 * y;
    d->value[1] = y * radial + p2 * (s + 2.0 * y * y) + 2.0 * p1 * x * y;
    d->by_xy[0][0] = radial + 2.0 * x * x * by_s + 6.0 * p1 * x + 2.0 * p2 * y + b1;
    d->by_xy[0][1] = 2.0 * x * y * by_s + 2.0 * p1 * y + 2.0 * p2 * x + b2;
    d->by_xy[1][0] = 2.0 * x * y * by_s + 2.0 * p2 * x + 2.0 * p1 * y;
    d->by_xy[1][1] = radial + 2.0 * y * y * by_s + 6.0 * p2 * y + 2.0 * p1 * x;
    double power = 1.0;
    for (int term = 0; term < 4; term++, power *= s) {
        d->by_coefficients[0][term] = x * power;
        d->by_coefficients[1][term] = y * power;
    }
    d->by_coefficients[0][4] = s + 2.0 * x * x;
    d->by_coefficients[1][4] = d->by_coefficients[0][5] = 2.0 * x * y;
    d->by_coefficients[1][5] = s + 2.0 * y * y;
    d->by_coefficients[0][6] = x;
    d->by_coefficients[0][7] = y;
    d->by_coefficients[1][6] = d->by_coefficients[1][7] = 0.0;
}

/* Corrected coordinates of measured ones, for a polynomial at "measured" coordinates. */
static inline __attribute__((always_inline)) void correction(const double *k, double x, double y, Distorted *d)
{
    const double b1 = k[6], b2 = k[7];
    const double without_affinity[8] = {k[0], k[1], k[2], k[3], k[4], k[5], 0.0, 0.0};
    const double freed = x - (b1 * x + b2 * y);
    distortion(without_affinity, freed, y, d);
    d->value[0] = freed - d->value[0];
    d->value[1] = y - d->value[1];
    for (int row = 0; row < 2; row++) {
        const double by_x = (row == 0) - d->by_xy[row][0], by_y = (row == 1) - d->by_xy[row][1];
        d->by_xy[row][0] = by_x * (1.0 - b1);
        d->by_xy[row][1] = by_y - by_x * b2;
        for (int term = 0; term < 6; term++)
            d->by_coefficients[row][term] = -d->by_coefficients[row][term];
        d->by_coefficients[row][6] = -by_x * x;
        d->by_coefficients[row][7] = -by_x * y;
    }
}

/* Return whether the point is in front of the camera; if not, nothing is written.
 *
 * camera: 11 parameters; rotation: photo to ground, by rows; basis: from the photo's rotation unknowns to rotations about
 * the ground axes; partials (2 rows of ELEMENTS): NULL when they are not wanted.
 */
static inline __attribute__((always_inline)) int photo_point(
    const double *camera, const double *centre, const double *rotation, const double *basis, const double *ground,
    const double *measured, int at_measured, double *residual, double (*partials)[ELEMENTS])
{
    const double v[3] = {ground[0] - centre[0], ground[1] - centre[1], ground[2] - centre[2]};
    double u[3];
    for (int axis = 0; axis < 3; axis++)
        u[axis] = rotation[axis] * v[0] + rotation[3 + axis] * v[1] + rotation[6 + axis] * v[2];
    /* depth < -1e-6 |u| without the root */
    if (!(u[2] < 0.0 && u[2] * u[2] > 1e-12 * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])))
        return 0;
    const double inverse = -1.0 / u[2];
    const double direction[2] = {u[0] * inverse, u[1] * inverse};
    const double ideal[2] = {camera[0] * direction[0], camera[0] * direction[1]};

    Distorted d;
    if (at_measured) {
        correction(camera + COEFFICIENTS, measured[0] - camera[1], measured[1] - camera[2], &d);
        for (int row = 0; row < 2; row++)
            residual[row] = ideal[row] - d.value[row];
    } else {
        distortion(camera + COEFFICIENTS, ideal[0], ideal[1], &d);
        for (int row = 0; row < 2; row++)
            residual[row] = camera[1 + row] + ideal[row] + d.value[row] - measured[row];
    }
    if (!partials)
        return 1;

    const double scale = camera[0] * inverse;
    const double by_depth[2] = {ideal[0] * inverse, ideal[1] * inverse};
    double of_ideal[2][3];
    for (int axis = 0; axis < 3; axis++) {
        of_ideal[0][axis] = scale * rotation[3 * axis] + by_depth[0] * rotation[3 * axis + 2];
        of_ideal[1][axis] = scale * rotation[3 * axis + 1] + by_depth[1] * rotation[3 * axis + 2];
    }
    for (int row = 0; row < 2; row++) {
        double *p = partials[row];
        const double by_x = (row == 0) + (at_measured ? 0.0 : d.by_xy[row][0]);
        const double by_y = (row == 1) + (at_measured ? 0.0 : d.by_xy[row][1]);
        p[0] = by_x * direction[0] + by_y * direction[1];
        p[1] = at_measured ? d.by_xy[row][0] : (row == 0);
        p[2] = at_measured ? d.by_xy[row][1] : (row == 1);
        for (int term = 0; term < 8; term++)
            p[COEFFICIENTS + term] = at_measured ? -d.by_coefficients[row][term] : d.by_coefficients[row][term];
        double *g = p + POINT;
        for (int axis = 0; axis < 3; axis++) {
            g[axis] = by_x * of_ideal[0][axis] + by_y * of_ideal[1][axis];
            p[CENTRE + axis] = -g[axis];
        }
        const double turn[3] = {g[1] * v[2] - g[2] * v[1], g[2] * v[0] - g[0] * v[2], g[0] * v[1] - g[1] * v[0]};
        for (int axis = 0; axis < 3; axis++)
            p[ROTATION + axis] = turn[0] * basis[axis] + turn[1] * basis[3 + axis] + turn[2] * basis[6 + axis];
    }
    return 1;
}

#endif
