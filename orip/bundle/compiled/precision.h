/* Cofactors of the eliminated points, and the leverages of photo points. */

#ifndef ORIP_PRECISION_H
#define ORIP_PRECISION_H

#include "normals.h"

typedef struct {
    /* factor: root of the weight over the error (2 n); scale: one over the error */
    const double *factor, *scale, *half;
    double *cofactors, *leverage;
    Reduced inverse;
} Precision;

/* The part of the inverse Q that a group needs: whole columns, each `stride` long; B: coupling of a point with the
 * group's unknowns, three rows; product: B times Q. */
typedef struct {
    int64_t stride;
    double *inverse, *coupling, *product;
} Part;

static int64_t numbers_of_part(int64_t size)
{
    return (size + 6) * stride_of(size);
}

/* Take the elements of a column of the inverse at a stretch of consecutive places, from the i-th local unknown on. */
INLINE void take_stretch(const Reduced *inverse, const Local *local, int64_t own, int64_t i, int64_t length, double *column)
{
    const int64_t place = local->place[i];
    if (has_both_triangles(inverse))
        memcpy(column + i, inverse->band + own * inverse->stride + place, sizeof(double) * (size_t)length);
    else
        for (int64_t k = 0; k < length; k++)
            if (is_stored(inverse, own, place + k))
                column[i + k] = *element_at(inverse, own, place + k);
}

INLINE void take_part(const Reduced *inverse, const Local *local, int32_t *stretch, double *room, Part *part)
{
    const int64_t size = local->size;
    part->stride = stride_of(size);
    part->coupling = room;
    part->product = room + 3 * part->stride;
    part->inverse = room + 6 * part->stride;
    find_stretches(local, stretch);
    for (int64_t j = 0; j < size; j++) {
        double *column = part->inverse + j * part->stride;
        memset(column, 0, sizeof(double) * (size_t)part->stride);
        for (int64_t i = 0; local->place[j] >= 0 && i < size; i += stretch[i])
            if (local->place[i] >= 0)
                take_stretch(inverse, local, local->place[j], i, stretch[i], column);
    }
}

#define MOST_COLUMNS 2

/* Add what some columns of Q, from the j-th on, contribute to B Q. A part of many unknowns does not stay in the nearest
 * cache: it is read once, column after column. */
INLINE void add_columns(const Part *part, int64_t size, const double *const *b, int64_t j, int count, double *const *q)
{
    const double *column = part->inverse + j * part->stride;
    Lanes of_column[MOST_COLUMNS][3], elements[MOST_COLUMNS], sums[3];
    for (int c = 0; c < count; c++)
        for (int k = 0; k < 3; k++)
            of_column[c][k] = ALL(b[k][j + c]);
    for (int64_t i = 0; i < size; i += LANES) {
        for (int c = 0; c < count; c++)
            elements[c] = AT(column + c * part->stride + i);
        for (int k = 0; k < 3; k++) {
            sums[k] = AT(q[k] + i);
            for (int c = 0; c < count; c++)
                sums[k] += of_column[c][k] * elements[c];
        }
        for (int k = 0; k < 3; k++)
            AT(q[k] + i) = sums[k];
    }
}

INLINE int is_coupled(const double *const *b, int64_t j)
{
    return b[0][j] != 0.0 || b[1][j] != 0.0 || b[2][j] != 0.0;
}

/* product = B Q; unknowns of photos that do not show the point are passed over. */
INLINE void times_inverse(const Part *part, int64_t size, const double *const *b, double *const *q)
{
    memset(part->product, 0, sizeof(double) * 3 * (size_t)part->stride);
    for (int64_t j = 0; j < size; j++)
        if (is_coupled(b, j)) {
            const int is_pair = j + 1 < size && is_coupled(b, j + 1);
            if (is_pair)
                add_columns(part, size, b, j, 2, q);
            else
                add_columns(part, size, b, j, 1, q);
            j += is_pair;
        }
}

/* Multiply B by H from the left; then product = B Q, and inner = I + B Q B^T. */
INLINE void with_inverse(const Part *part, int64_t size, const double *H, double *inner)
{
    double *b[3], *q[3];
    for (int k = 0; k < 3; k++)
        b[k] = part->coupling + k * part->stride, q[k] = part->product + k * part->stride;
    for (int64_t i = 0; i < size; i += LANES) {
        const Lanes given[3] = {AT(b[0] + i), AT(b[1] + i), AT(b[2] + i)};
        for (int k = 0; k < 3; k++)
            AT(b[k] + i) = H[3 * k] * given[0] + H[3 * k + 1] * given[1] + H[3 * k + 2] * given[2];
    }
    times_inverse(part, size, (const double *const *)b, q);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = i == j;
            for (int64_t k = 0; k < size; k++)
                sum += b[i][k] * q[j][k];
            inner[3 * i + j] = sum;
        }
}

INLINE double sum_of(Lanes lanes)
{
    double sum = 0.0;
    for (int lane = 0; lane < LANES; lane++)
        sum += LANE(lanes, lane);
    return sum;
}

INLINE Lanes products(const double *a, const double *b, int64_t count)
{
    Lanes sum = ALL(0.0);
    for (int64_t k = 0; k < count; k += LANES)
        sum += AT(a + k) * AT(b + k);
    return sum;
}

/* Add a Q b^T, for each coordinate's rows a and b of partials, with a part of the inverse Q, to what is found. */
INLINE void add_quadratic(const double *inverse, int64_t stride, const double *const *a, int64_t count,
                          const double *const *b, int64_t width, double times, double *found)
{
    for (int64_t k = 0; k < width; k += 2 * LANES) {
        Lanes sums[2][2] = {{ALL(0.0), ALL(0.0)}, {ALL(0.0), ALL(0.0)}};
        for (int64_t u = 0; u < count; u++) {
            const Lanes one = AT(inverse + u * stride + k), other = AT(inverse + u * stride + k + LANES);
            for (int c = 0; c < 2; c++)
                sums[c][0] += a[c][u] * one, sums[c][1] += a[c][u] * other;
        }
        for (int c = 0; c < 2; c++)
            found[c] += times * sum_of(sums[c][0] * AT(b[c] + k) + sums[c][1] * AT(b[c] + k + LANES));
    }
}

/* Find a Q a^T for both rows a of a photo point. */
INLINE void of_unknowns(const Part *part, const Places *at, const double (*row)[ROW], double *found)
{
    const double *photo[2] = {row[0], row[1]}, *camera[2] = {row[0] + PHOTO_ROW, row[1] + PHOTO_ROW};
    const double *of_camera = part->inverse + at->camera * part->stride, *of_photo = part->inverse + at->photo * part->stride;
    const int64_t unknowns = at->camera_unknowns;
    found[0] = found[1] = 0.0;
    add_quadratic(of_camera + at->camera, part->stride, camera, unknowns, camera, PADDED(unknowns), 1.0, found);
    add_quadratic(of_camera + at->photo, part->stride, camera, unknowns, photo, PHOTO_ROW, 2.0, found);
    add_quadratic(of_photo + at->photo, part->stride, photo, PHOTO_UNKNOWNS, photo, PHOTO_ROW, 1.0, found);
}

/* Return - 2 a (Q B^T) t + t (I + B Q B^T) t with t = H p, for a row a, p of a photo point. */
INLINE double of_point(const Part *part, const Places *at, const double *row, const double *p, const double *H,
                       const double *inner)
{
    double t[3], with_inner[3], sum = 0.0;
    multiply(H, p, t);
    multiply(inner, t, with_inner);
    for (int k = 0; k < 3; k++) {
        const double *q = part->product + k * part->stride;
        const Lanes of_row = products(q + at->camera, row + PHOTO_ROW, at->camera_unknowns)
            + products(q + at->photo, row, PHOTO_UNKNOWNS);
        sum += t[k] * (with_inner[k] - 2.0 * sum_of(of_row));
    }
    return sum;
}

static void precision_loop(const Block *b, const Pattern *p, Share share, const Precision *c, int32_t *numbers,
                           double *room)
{
    Ahead a, again;
    Local local = local_in(p, numbers);
    begin_ahead(&a);
    begin_ahead(&again);
    for (int64_t group = share.first; group < share.end; group++) {
        Part part;
        local_unknowns(b, p, group, &local);
        take_part(&c->inverse, &local, numbers + ARRAYS_OF_LOCAL * p->longest, room, &part);
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++) {
            const double *H = c->half + 9 * p->block[place];
            double *cofactors = c->cofactors + 9 * p->block[place], inner[9];
            int32_t last[2] = {0, 0};
            memset(part.coupling, 0, sizeof(double) * 3 * (size_t)part.stride);
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                const int lane = ahead(b, p, c->factor, k, &a);
                double px[3], py[3];
                if (!a.found.in_front[lane])
                    continue;
                const Places at = places_of(b, p, &local, p->order[k], a.cameras[lane], last);
                for (int i = 0; i < 3; i++)
                    px[i] = LANE(a.of_point[0][i], lane), py[i] = LANE(a.of_point[1][i], lane);
                add_coupling(part.coupling, part.stride, &at, a.row[lane], px, py);
            }
            with_inverse(&part, local.size, H, inner);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    double sum = 0.0;
                    for (int k = 0; k < 3; k++)
                        for (int l = 0; l < 3; l++)
                            sum += H[3 * k + i] * inner[3 * k + l] * H[3 * l + j];
                    cofactors[3 * i + j] = sum;
                }
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                const int lane = ahead(b, p, c->scale, k, &again);
                if (!again.found.in_front[lane])
                    continue;
                const Places at = places_of(b, p, &local, p->order[k], again.cameras[lane], last);
                double *leverage = c->leverage + 2 * (int64_t)p->order[k];
                of_unknowns(&part, &at, again.row[lane], leverage);
                for (int i = 0; i < 2; i++) {
                    double partials[3];
                    for (int axis = 0; axis < 3; axis++)
                        partials[axis] = LANE(again.of_point[i][axis], lane);
                    leverage[i] += of_point(&part, &at, again.row[lane][i], partials, H, inner);
                }
            }
        }
    }
}

#endif
