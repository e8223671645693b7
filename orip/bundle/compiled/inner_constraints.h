/* Points of a free network: their part in the inner constraints, and their cofactors after the S-transformation.
 *
 * For the formulas and their source see orip/adjustment/factorisation/null_space.py.
 */

#include "normals.h"

#define MOST_MOVEMENTS 8
#define VECTORS (MOST_MOVEMENTS / LANES)

/* Movements G of the points: each changes a coordinate by a linear function of the homogeneous coordinates (4 for each
 * block). coefficients: (3, 4, MOST_MOVEMENTS), zero behind the last movement; free, defining: which coordinates (3 for each
 * block) are unknowns, and which of these define the datum. */
typedef struct {
    const double *homogeneous, *coefficients;
    const uint8_t *free, *defining;
} Movements;

/* What the points contribute to the normal equations of the amounts of the movements: reduced, C^T H B for each unknown of
 * the reduced system, MOST_MOVEMENTS numbers each; own, B^T H^T H B, as many rows. */
typedef struct {
    const double *factor, *half;
    Movements movements;
    double *reduced, *own;
} MovementSums;

/* Cofactors of the amounts t of the movements: with the reduced unknowns, Q_rt, MOST_MOVEMENTS numbers each; half of their
 * own, which have no covariances. There are none where control defines the datum. */
typedef struct {
    Movements movements;
    const double *with_reduced, *half_of_own;
    int is_free;
} Amounts;

/* Numbers by the movements for each of three rows. */
typedef Lanes ThreeRows[3][VECTORS];

/* Find the rows of a point in G, and in B: those of the coordinates that define the datum, and zero. */
INLINE void rows_of_movements(const Movements *m, int64_t block, ThreeRows g, ThreeRows defining)
{
    const double *h = m->homogeneous + 4 * block;
    for (int axis = 0; axis < 3; axis++)
        for (int v = 0; v < VECTORS; v++) {
            const double *c = m->coefficients + 4 * MOST_MOVEMENTS * axis + v * LANES;
            const Lanes moved = h[0] * AT(c) + h[1] * AT(c + MOST_MOVEMENTS) + h[2] * AT(c + 2 * MOST_MOVEMENTS)
                + h[3] * AT(c + 3 * MOST_MOVEMENTS);
            g[axis][v] = m->free[3 * block + axis] ? moved : ALL(0.0);
            defining[axis][v] = m->defining[3 * block + axis] ? moved : ALL(0.0);
        }
}

/* found = H rows, or H^T rows, whose elements are `next` apart in a row of H, and `row` from one row to the next. */
INLINE void times_matrix(const double *H, int row, int next, ThreeRows rows, ThreeRows found)
{
    for (int i = 0; i < 3; i++)
        for (int v = 0; v < VECTORS; v++)
            found[i][v] = H[row * i] * rows[0][v] + H[row * i + next] * rows[1][v] + H[row * i + 2 * next] * rows[2][v];
}

/* Add numbers of some rows of partials, times numbers by the movements, to sums by columns. */
INLINE void add_by_columns(double *sums, int rows, const double *const *row, int64_t count, Lanes (*along)[VECTORS])
{
    for (int64_t u = 0; u < count; u++)
        for (int v = 0; v < VECTORS; v++) {
            Lanes sum = AT(sums + u * MOST_MOVEMENTS + v * LANES);
            for (int r = 0; r < rows; r++)
                sum += row[r][u] * along[r][v];
            AT(sums + u * MOST_MOVEMENTS + v * LANES) = sum;
        }
}

/* Replace the numbers by the movements of a group's columns, of cameras by columns, by those by unknowns, or the other
 * way. */
INLINE void replace_movements(const Pattern *p, const Local *local, double *numbers,
                              void (*replace)(const Terms *, double *, int64_t))
{
    Terms t;
    for (int32_t r = 0; r < local->camera_runs; r++)
        for (int v = 0; has_terms(p, local->runs[r], &t) && v < VECTORS; v++)
            replace(&t, numbers + local->first[r] * MOST_MOVEMENTS + v * LANES, MOST_MOVEMENTS);
}

/* Add what the point at a place of the pattern contributes to the sums of its group, and to its own. */
INLINE void add_point(const Block *b, const Pattern *p, const Local *local, const MovementSums *c, int64_t place, Ahead *a,
                      double *by_columns, double *own)
{
    const double *H = c->half + 9 * p->block[place];
    int32_t last[2] = {0, 0};
    ThreeRows g, defining, reduced, weighted;
    rows_of_movements(&c->movements, p->block[place], g, defining);
    times_matrix(H, 3, 1, defining, reduced);
    times_matrix(H, 1, 3, reduced, weighted);
    const double *const rows[3] = {(const double *)reduced[0], (const double *)reduced[1], (const double *)reduced[2]};
    add_by_columns(own, 3, rows, MOST_MOVEMENTS, reduced);
    for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
        const int lane = ahead(b, p, c->factor, k, a);
        if (!a->found.in_front[lane])
            continue;
        const Places at = places_of(b, p, local, p->order[k], a->cameras[lane], last);
        const double *const photo[2] = {a->row[lane][0], a->row[lane][1]};
        const double *const camera[2] = {photo[0] + PHOTO_ROW, photo[1] + PHOTO_ROW};
        Lanes along[2][VECTORS];
        for (int i = 0; i < 2; i++)
            for (int v = 0; v < VECTORS; v++)
                along[i][v] = LANE(a->of_point[i][0], lane) * weighted[0][v]
                    + LANE(a->of_point[i][1], lane) * weighted[1][v] + LANE(a->of_point[i][2], lane) * weighted[2][v];
        add_by_columns(by_columns + at.photo * MOST_MOVEMENTS, 2, photo, PHOTO_UNKNOWNS, along);
        if (has_common_columns(&at))
            add_by_columns(by_columns + at.camera[0] * MOST_MOVEMENTS, 2, camera, at.camera_columns, along);
        else
            for (int i = 0; i < 2; i++)
                add_by_columns(by_columns + at.camera[i] * MOST_MOVEMENTS, 1, camera + i, at.camera_columns, along + i);
    }
}

/* Numbers that the sums of the points themselves need in the room of a share, before those of its groups. */
#define NUMBERS_OF_OWN (MOST_MOVEMENTS * MOST_MOVEMENTS)

/* Form the sums of a share in the room: those of the points themselves, then those of each group. */
static void movements_loop(const Block *b, const Pattern *p, Share share, const MovementSums *c, int32_t *numbers,
                           double *room)
{
    Ahead a;
    Local local = local_in(p, numbers);
    double *own = room;
    begin_ahead(&a);
    memset(own, 0, sizeof(double) * NUMBERS_OF_OWN);
    room += NUMBERS_OF_OWN;
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        memset(room, 0, sizeof(double) * MOST_MOVEMENTS * (size_t)local.size);
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++)
            add_point(b, p, &local, c, place, &a, room, own);
        replace_movements(p, &local, room, lanes_to_unknowns);
        room += MOST_MOVEMENTS * local.size;
    }
}

static void add_movements(const Block *b, const Pattern *p, Share share, const MovementSums *c, int32_t *numbers,
                          const double *room)
{
    Local local = local_in(p, numbers);
    for (int64_t k = 0; k < NUMBERS_OF_OWN; k++)
        c->own[k] += room[k];
    room += NUMBERS_OF_OWN;
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        for (int64_t u = 0; u < local.size; u++, room += MOST_MOVEMENTS)
            for (int64_t v = 0; local.place[u] >= 0 && v < MOST_MOVEMENTS; v++)
                c->reduced[local.place[u] * MOST_MOVEMENTS + v] += room[v];
    }
}

/* Take the cofactors of the amounts with the columns of a group. */
INLINE void take_amounts(const Pattern *p, const Local *local, const Amounts *amounts, double *of_columns)
{
    memset(of_columns, 0, sizeof(double) * MOST_MOVEMENTS * (size_t)local->size);
    for (int64_t u = 0; u < local->size; u++)
        if (local->place[u] >= 0)
            memcpy(of_columns + u * MOST_MOVEMENTS, amounts->with_reduced + local->place[u] * MOST_MOVEMENTS,
                   sizeof(double) * MOST_MOVEMENTS);
    replace_movements(p, local, of_columns, lanes_to_columns);
}

/* Transform the cofactors of a point: Q_pp - G Z^T - Z G^T with Z = H^T (H B - C Q_rt) - G Q_tt / 2; coupling: C, three rows
 * of so many columns, each `stride` long. */
INLINE void transform_cofactors(const Amounts *amounts, const double *of_columns, int64_t size, const double *coupling,
                                int64_t stride, const double *H, int64_t block, double *cofactors)
{
    ThreeRows g, defining, with_amounts, z;
    rows_of_movements(&amounts->movements, block, g, defining);
    times_matrix(H, 3, 1, defining, with_amounts);
    for (int64_t u = 0; u < size; u++)
        for (int k = 0; k < 3; k++)
            for (int v = 0; v < VECTORS; v++)
                with_amounts[k][v] -= coupling[k * stride + u] * AT(of_columns + u * MOST_MOVEMENTS + v * LANES);
    times_matrix(H, 1, 3, with_amounts, z);
    for (int k = 0; k < 3; k++)
        for (int v = 0; v < VECTORS; v++)
            z[k][v] -= g[k][v] * AT(amounts->half_of_own + v * LANES);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) {
            Lanes products = ALL(0.0);
            for (int v = 0; v < VECTORS; v++)
                products += g[i][v] * z[j][v] + z[i][v] * g[j][v];
            const double sum = sum_of(products);
            cofactors[3 * i + j] -= sum;
            if (i != j)
                cofactors[3 * j + i] -= sum;
        }
}
