/* Two photos: by how much the rays of a point miss each other, and where they meet; prelim_references/relative.py does
 * the same and names the sources.
 */

#ifndef ORIP_PRELIM_PARALLAX_H
#define ORIP_PRELIM_PARALLAX_H

#include "../compiled/linear.h"
#include "pair_loops.h"
#include <string.h>

/* [base]x R */
static void essential_of(const double *base, const double *R, double *E)
{
    for (int j = 0; j < 3; j++) {
        const double column[3] = {R[j], R[3 + j], R[6 + j]};
        double turned[3];
        cross3(base, column, turned);
        for (int i = 0; i < 3; i++)
            E[3 * i + j] = turned[i];
    }
}

/* F, its gradients by the left and the right image vector, and the square of them by the photo coordinates. */
static inline double condition(const double *E, const double *left, const double *right, double *by_left,
                               double *by_right, double *square)
{
    times3(E, right, by_left);
    transposed_times3(E, left, by_right);
    *square = larger(by_left[0] * by_left[0] + by_left[1] * by_left[1] + by_right[0] * by_right[0]
                         + by_right[1] * by_right[1],
                     1e-300);
    return dot3(by_left, left);
}

static void parallaxes_at(const Pairs *p, const double *E, double *value)
{
    for (int64_t row = 0; row < p->count; row++) {
        double by_left[3], by_right[3], square;
        const double f = condition(E, p->left + 3 * row, p->right + 3 * row, by_left, by_right, &square);
        value[row] = f * sqrt(2.0 / square);
    }
}

/* Orientations with what partials need of them, and two directions across each base. */
typedef struct {
    Lanes E[9], base[3], R[9], across[2][3];
} Orientations;

/* Parallaxes, and their partials by the base across itself and by a small rotation. */
INLINE Lanes parallaxes_with_partials(const Orientations *o, const Lanes *left, const Lanes *right, Lanes *design)
{
    Lanes by_left[3], by_right[3], turned[3], turned_gradient[3], of_left[3], of_right[3];
    turn_lanes(o->E, right, by_left);
    for (int i = 0; i < 3; i++)
        by_right[i] = o->E[i] * left[0] + o->E[3 + i] * left[1] + o->E[6 + i] * left[2];
    const Lanes square = larger_of_each(by_left[0] * by_left[0] + by_left[1] * by_left[1] + by_right[0] * by_right[0]
                                            + by_right[1] * by_right[1],
                                        ALL(1e-300));
    const Lanes f = dot_lanes(by_left, left), inverse = ALL(1.0) / square, root = root_of_each(ALL(2.0) * inverse);
    const Lanes value = f * root, shrinking = value * inverse;
    by_left[2] = by_right[2] = ALL(0.0);
    turn_lanes(o->R, right, turned);
    turn_lanes(o->R, by_right, turned_gradient);
    for (int i = 0; i < 3; i++) {
        of_left[i] = root * left[i] - shrinking * by_left[i];
        of_right[i] = -shrinking * turned_gradient[i];
    }
    Lanes a[3], b[3], c[3], d[3], by_base[3];
    cross_lanes(turned, of_left, a);
    cross_lanes(of_right, left, b);
    for (int i = 0; i < 3; i++)
        by_base[i] = a[i] + b[i];
    design[0] = dot_lanes(by_base, o->across[0]), design[1] = dot_lanes(by_base, o->across[1]);
    cross_lanes(o->base, of_left, c);
    cross_lanes(c, turned, a);
    cross_lanes(o->base, left, d);
    cross_lanes(d, of_right, b);
    for (int i = 0; i < 3; i++)
        design[2 + i] = a[i] + b[i];
    return value;
}

/* How far along both rays, times a positive number, they come nearest to each other; 0 where they are parallel.
 * Products of sums of vectors are written out: (b × t) · (l × t) = (b · l) (t · t) - (b · t) (l · t).
 */
static inline void along_rays(const double *base, const double *R, const double *left, const double *right,
                              double along[2])
{
    double turned[3];
    times3(R, right, turned);
    const double ll = dot3(left, left), tt = dot3(turned, turned), lt = dot3(left, turned);
    const double bl = dot3(base, left), bt = dot3(base, turned);
    const int parallel = !(ll * tt - lt * lt > 0.0);
    along[0] = parallel ? 0.0 : bl * tt - bt * lt;
    along[1] = parallel ? 0.0 : bl * lt - bt * ll;
}

/* Where two rays come nearest to each other, halfway between them, in units of the base, and its distance along each as a
 * multiple of the image vector; not finite where they are parallel.
 */
static inline void meeting_of(const double *base, const double *R, const double *left, const double *right,
                              double *coordinates, double along[2])
{
    double turned[3], normal[3], by_right[3], by_left[3];
    times3(R, right, turned);
    cross3(left, turned, normal);
    cross3(base, turned, by_right);
    cross3(base, left, by_left);
    const double square = dot3(normal, normal);
    along[0] = dot3(by_right, normal) / square, along[1] = dot3(by_left, normal) / square;
    for (int i = 0; i < 3; i++)
        coordinates[i] = 0.5 * (along[0] * left[i] + base[i] + along[1] * turned[i]);
}

#endif
