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

INLINE void take_part(const Reduced *inverse, const Local *local, double *room, Part *part)
{
    const int64_t size = local->size;
    part->stride = stride_of(size);
    part->coupling = room;
    part->product = room + 3 * part->stride;
    part->inverse = room + 6 * part->stride;
    memset(room, 0, sizeof(double) * (size_t)numbers_of_part(size));
    for (int64_t j = 0; j < size; j++)
        for (int64_t i = j; i < size; i++) {
            const int32_t one = local->place[i], other = local->place[j];
            if (one >= 0 && other >= 0 && is_stored(inverse, one, other))
                part->inverse[i * part->stride + j] = part->inverse[j * part->stride + i] = *element_at(inverse, one, other);
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
        for (int k = 0; k < 3; k++) {
            AT(b[k] + i) = H[3 * k] * given[0] + H[3 * k + 1] * given[1] + H[3 * k + 2] * given[2];
            AT(q[k] + i) = ALL(0.0);
        }
    }
    for (int64_t j = 0; j < size; j++) {
        const double *column = part->inverse + j * part->stride;
        if (b[0][j] == 0.0 && b[1][j] == 0.0 && b[2][j] == 0.0)
            continue;
        const Lanes x = ALL(b[0][j]), y = ALL(b[1][j]), z = ALL(b[2][j]);
        for (int64_t i = 0; i < size; i += LANES) {
            AT(q[0] + i) += x * AT(column + i);
            AT(q[1] + i) += y * AT(column + i);
            AT(q[2] + i) += z * AT(column + i);
        }
    }
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

/* Return a Q a^T for a row a of a photo point. */
INLINE double of_unknowns(const Part *part, const Places *at, const double *row)
{
    const double *of_camera = row + PHOTO_ROW;
    double sum = 0.0;
    for (int64_t u = 0; u < at->camera_unknowns; u++) {
        const double *column = part->inverse + (at->camera + u) * part->stride;
        sum += of_camera[u] * sum_of(products(column + at->camera, of_camera, at->camera_unknowns)
                                     + 2.0 * products(column + at->photo, row, PHOTO_UNKNOWNS));
    }
    for (int64_t u = 0; u < PHOTO_UNKNOWNS; u++)
        sum += row[u] * sum_of(products(part->inverse + (at->photo + u) * part->stride + at->photo, row, PHOTO_UNKNOWNS));
    return sum;
}

/* Return a Q a^T - 2 a (Q B^T) t + t (I + B Q B^T) t with t = H p, for a row a, p of a photo point. */
INLINE double leverage_of(const Part *part, const Places *at, const double *row, const double *p, const double *H,
                          const double *inner)
{
    double t[3], with_inner[3], sum = of_unknowns(part, at, row);
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
    Local local = {.first = numbers, .place = numbers + p->longest};
    begin_ahead(&a);
    begin_ahead(&again);
    for (int64_t group = share.first; group < share.end; group++) {
        Part part;
        local_unknowns(b, p, group, &local);
        take_part(&c->inverse, &local, room, &part);
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
                for (int i = 0; i < 2; i++) {
                    const double of_point[3] = {LANE(again.of_point[i][0], lane), LANE(again.of_point[i][1], lane),
                                                LANE(again.of_point[i][2], lane)};
                    c->leverage[2 * p->order[k] + i] = leverage_of(&part, &at, again.row[lane][i], of_point, H, inner);
                }
            }
        }
    }
}

#endif
