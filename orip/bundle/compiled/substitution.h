/* Forward and backward substitution: the coupling of eliminated points with reduced unknowns, H N_pr, times vectors, some of them at once. */

#include "precision.h"

#define MOST_VECTORS 8

typedef struct {
    const double *factor, *half;
    /* reduced: (vectors, size), in the order of places; points: (vectors, 3 for each block) */
    double *reduced, *points;
    int64_t vectors, size;
} Coupling;

INLINE void of_ground_point(const Ahead *a, int lane, double (*of_point)[3])
{
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < 3; i++)
            of_point[c][i] = LANE(a->of_point[c][i], lane);
}

static int64_t numbers_of_vectors(int64_t size, int64_t vectors)
{
    return vectors * stride_of(size);
}

/* points = H N_pr reduced, or with `transposed` the sums (H N_pr)^T points of each group of a share, one after the other
 * in `room`; photo points are linearised once for all vectors. */
INLINE void coupling_loop(const Block *b, const Pattern *p, Share share, const Coupling *c, int transposed, int32_t *numbers,
                          double *room)
{
    Ahead a;
    Local local = local_in(p, numbers);
    begin_ahead(&a);
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        const int64_t stride = stride_of(local.size);
        memset(room, 0, sizeof(double) * (size_t)numbers_of_vectors(local.size, c->vectors));
        for (int64_t v = 0; !transposed && v < c->vectors; v++)
            for (int64_t u = 0; u < local.size; u++)
                room[v * stride + u] = local.place[u] < 0 ? 0.0 : c->reduced[v * c->size + local.place[u]];
        for (int64_t v = 0; !transposed && v < c->vectors; v++)
            replace_vector(p, &local, room + v * stride, to_columns);
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++) {
            const double *H = c->half + 9 * p->block[place];
            double *of_block = c->points + 3 * p->block[place], point[MOST_VECTORS][3] = {{0.0}}, of_point[2][3];
            int32_t last[2] = {0, 0};
            if (place + POINTS_FETCHED_BEFORE < p->blocks) {
                const int64_t later = p->block[place + POINTS_FETCHED_BEFORE];
                fetch_block(c->half + 9 * later);
                FETCH(c->points + 3 * later);
            }
            for (int64_t v = 0; transposed && v < c->vectors; v++)
                for (int i = 0; i < 3; i++)
                    for (int k = 0; k < 3; k++)
                        point[v][i] += H[3 * k + i] * of_block[3 * v * p->blocks + k];
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                const int lane = ahead(b, p, c->factor, k, &a);
                if (!a.found.in_front[lane])
                    continue;
                const Places at = places_of(b, p, &local, p->order[k], a.cameras[lane], last);
                const double(*row)[ROW] = a.row[lane];
                of_ground_point(&a, lane, of_point);
                for (int64_t v = 0; v < c->vectors; v++) {
                    double *mine = room + v * stride, along[2];
                    for (int i = 0; i < 2; i++)
                        along[i] = transposed
                            ? of_point[i][0] * point[v][0] + of_point[i][1] * point[v][1] + of_point[i][2] * point[v][2]
                            : sum_of(products(mine + at.photo, row[i], PHOTO_UNKNOWNS)
                                     + products(mine + at.camera[i], row[i] + PHOTO_ROW, at.camera_columns));
                    if (transposed) {
                        add_to_camera(mine, &at, has_common_columns(&at), along[0], along[1], row);
                        add_to(mine + at.photo, along[0], row[0], along[1], row[1], PHOTO_UNKNOWNS);
                    } else
                        for (int i = 0; i < 3; i++)
                            point[v][i] += along[0] * of_point[0][i] + along[1] * of_point[1][i];
                }
            }
            for (int64_t v = 0; !transposed && v < c->vectors; v++)
                multiply(H, point[v], of_block + 3 * v * p->blocks);
        }
        for (int64_t v = 0; transposed && v < c->vectors; v++)
            replace_vector(p, &local, room + v * stride, to_unknowns);
        if (transposed)
            room += numbers_of_vectors(local.size, c->vectors);
    }
}

static void forward_loop(const Block *b, const Pattern *p, Share share, const Coupling *c, int32_t *numbers, double *room)
{
    coupling_loop(b, p, share, c, 1, numbers, room);
}

/* Add the sums of a share's groups to the vectors of the reduced system. */
static void add_forward(const Block *b, const Pattern *p, Share share, const Coupling *c, int32_t *numbers, double *room)
{
    Local local = local_in(p, numbers);
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        const int64_t stride = stride_of(local.size);
        for (int64_t v = 0; v < c->vectors; v++)
            for (int64_t u = 0; u < local.size; u++)
                if (local.place[u] >= 0)
                    c->reduced[v * c->size + local.place[u]] += room[v * stride + u];
        room += numbers_of_vectors(local.size, c->vectors);
    }
}

/* Misclosures, times roots of the weights, of each row; the sums are added to those of `of`, a single vector. */
typedef struct {
    Coupling of;
    const double *misclosure;
} RightSide;

/* The right-hand side of the normal equations, points not eliminated: the sums A^T l of each group of a share, one after
 * the other in `room`, and those of points where they stay. */
static void right_loop(const Block *b, const Pattern *p, Share share, const RightSide *r, int32_t *numbers, double *room)
{
    Ahead a;
    Local local = local_in(p, numbers);
    begin_ahead(&a);
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        memset(room, 0, sizeof(double) * (size_t)numbers_of_vectors(local.size, 1));
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++) {
            double *of_block = r->of.points + 3 * p->block[place], of_point[2][3];
            int32_t last[2] = {0, 0};
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                const int lane = ahead(b, p, r->of.factor, k, &a);
                if (!a.found.in_front[lane])
                    continue;
                const Places at = places_of(b, p, &local, p->order[k], a.cameras[lane], last);
                const double *y = r->misclosure + 2 * (int64_t)p->order[k];
                add_to_camera(room, &at, has_common_columns(&at), y[0], y[1], a.row[lane]);
                add_to(room + at.photo, y[0], a.row[lane][0], y[1], a.row[lane][1], PHOTO_UNKNOWNS);
                of_ground_point(&a, lane, of_point);
                for (int i = 0; i < 3; i++)
                    of_block[i] += y[0] * of_point[0][i] + y[1] * of_point[1][i];
            }
        }
        replace_vector(p, &local, room, to_unknowns);
        room += numbers_of_vectors(local.size, 1);
    }
}

static void backward_loop(const Block *b, const Pattern *p, Share share, const Coupling *c, int32_t *numbers, double *room)
{
    coupling_loop(b, p, share, c, 0, numbers, room);
}
