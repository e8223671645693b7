/* Forward and backward substitution: the coupling of eliminated points with reduced unknowns, H N_pr, times vectors. */

#ifndef ORIP_SUBSTITUTION_H
#define ORIP_SUBSTITUTION_H

#include "precision.h"

typedef struct {
    const double *factor, *half;
    /* reduced: (m,), in the order of places; points: 3 numbers for each block */
    double *reduced, *points;
} Coupling;

INLINE void of_ground_point(const Ahead *a, int lane, double (*of_point)[3])
{
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < 3; i++)
            of_point[c][i] = LANE(a->of_point[c][i], lane);
}

/* points = H N_pr reduced, or with `transposed` reduced += (H N_pr)^T points. */
INLINE void coupling_loop(const Block *b, const Pattern *p, const Coupling *c, int transposed, int32_t *numbers, double *room)
{
    Ahead a;
    Local local = {.first = numbers, .place = numbers + p->longest};
    begin_ahead(&a);
    for (int64_t group = 0; group < p->groups; group++) {
        local_unknowns(b, p, group, &local);
        memset(room, 0, sizeof(double) * (size_t)stride_of(local.size));
        for (int64_t u = 0; !transposed && u < local.size; u++)
            room[u] = local.place[u] < 0 ? 0.0 : c->reduced[local.place[u]];
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++) {
            const double *H = c->half + 9 * p->block[place];
            double *of_block = c->points + 3 * p->block[place], point[3] = {0.0, 0.0, 0.0}, of_point[2][3];
            int32_t last[2] = {0, 0};
            for (int i = 0; transposed && i < 3; i++)
                for (int k = 0; k < 3; k++)
                    point[i] += H[3 * k + i] * of_block[k];
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                const int lane = ahead(b, p, c->factor, k, &a);
                if (!a.found.in_front[lane])
                    continue;
                const Places at = places_of(b, p, &local, p->order[k], a.cameras[lane], last);
                const double(*row)[ROW] = a.row[lane];
                of_ground_point(&a, lane, of_point);
                double along[2];
                for (int i = 0; i < 2; i++)
                    along[i] = transposed
                        ? of_point[i][0] * point[0] + of_point[i][1] * point[1] + of_point[i][2] * point[2]
                        : sum_of(products(room + at.photo, row[i], PHOTO_UNKNOWNS)
                                 + products(room + at.camera, row[i] + PHOTO_ROW, at.camera_unknowns));
                if (transposed) {
                    add_to(room + at.camera, along[0], row[0] + PHOTO_ROW, along[1], row[1] + PHOTO_ROW, at.camera_unknowns);
                    add_to(room + at.photo, along[0], row[0], along[1], row[1], PHOTO_UNKNOWNS);
                } else
                    for (int i = 0; i < 3; i++)
                        point[i] += along[0] * of_point[0][i] + along[1] * of_point[1][i];
            }
            if (!transposed)
                multiply(H, point, of_block);
        }
        for (int64_t u = 0; transposed && u < local.size; u++)
            if (local.place[u] >= 0)
                c->reduced[local.place[u]] += room[u];
    }
}

static void forward_loop(const Block *b, const Pattern *p, const Coupling *c, int32_t *numbers, double *room)
{
    coupling_loop(b, p, c, 1, numbers, room);
}

static void backward_loop(const Block *b, const Pattern *p, const Coupling *c, int32_t *numbers, double *room)
{
    coupling_loop(b, p, c, 0, numbers, room);
}

#endif
