/* Cofactors of the eliminated points, and the leverages of photo points. */

#ifndef ORIP_PRECISION_H
#define ORIP_PRECISION_H

#include "inner_constraints.h"

typedef struct {
    /* factor: root of the weight over the error (2 n); scale: one over the error */
    const double *factor, *scale, *half;
    double *cofactors, *leverage;
    Reduced inverse;
    Amounts amounts;
} Precision;

/* Points of a group whose products with the inverse are formed together, where most of its photos show them. */
#define POINTS_AT_ONCE 4

/* The part of the inverse Q that a group needs: whole columns, each `stride` long; B: couplings of points with the group's
 * columns, three rows for each; product: B times Q; amounts: what a free network needs of its columns. */
typedef struct {
    int64_t stride;
    double *inverse, *coupling, *product, *amounts;
} Part;

/* The part of the inverse by the columns of some cameras, which most groups that follow each other have in common. */
typedef struct {
    const int32_t *runs;
    int32_t count;
    double *inverse;
} CameraPart;

/* Numbers that the part of a group of so many columns needs, so many of them of cameras. */
static int64_t numbers_of_part(int64_t size, int64_t of_cameras)
{
    return (size + 6 * POINTS_AT_ONCE + MOST_MOVEMENTS) * stride_of(size) + of_cameras * stride_of(of_cameras);
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

/* Take some rows of some columns of the inverse, from the first one on; there are as many rows. */
INLINE void take_columns(const Reduced *inverse, const Local *local, const int32_t *stretch, int64_t first, int64_t end,
                         int64_t rows, double *columns, int64_t stride)
{
    for (int64_t j = first; j < end; j++) {
        double *column = columns + j * stride;
        memset(column, 0, sizeof(double) * (size_t)stride);
        for (int64_t i = 0, length; local->place[j] >= 0 && i < rows; i += length) {
            length = stretch[i] < rows - i ? stretch[i] : rows - i;
            if (local->place[i] >= 0)
                take_stretch(inverse, local, local->place[j], i, length, column);
        }
    }
}

/* Take what the inverse has for the cameras of a group, which they may have been taken for already. */
INLINE void take_cameras_part(const Pattern *p, const Reduced *inverse, const Local *local, const int32_t *stretch,
                              CameraPart *cameras)
{
    const int64_t size = camera_columns(local);
    const int is_same = cameras->count == local->camera_runs
        && !memcmp(cameras->runs, local->runs, sizeof(int32_t) * (size_t)cameras->count);
    if (is_same)
        return;
    cameras->runs = local->runs, cameras->count = local->camera_runs;
    take_columns(inverse, local, stretch, 0, size, size, cameras->inverse, stride_of(size));
    matrix_to_columns(p, local, size, cameras->inverse, stride_of(size));
}

/* Take the part of the inverse for a group, by columns. */
INLINE void take_part(const Pattern *p, const Reduced *inverse, const Local *local, int32_t *stretch, double *room,
                      CameraPart *cameras, Part *part)
{
    const int64_t size = local->size, of_cameras = camera_columns(local), stride = stride_of(size);
    part->stride = stride;
    part->coupling = room;
    part->product = room + 3 * POINTS_AT_ONCE * stride;
    part->amounts = room + 6 * POINTS_AT_ONCE * stride;
    part->inverse = room + (6 * POINTS_AT_ONCE + MOST_MOVEMENTS) * stride;
    /* behind the strips that are written, lanes are read, and multiplied by zero: what stands there has to be a number */
    memset(part->product, 0, sizeof(double) * 3 * POINTS_AT_ONCE * (size_t)stride);
    find_stretches(local, stretch);
    take_cameras_part(p, inverse, local, stretch, cameras);
    for (int64_t j = 0; j < of_cameras; j++)
        memcpy(part->inverse + j * stride, cameras->inverse + j * stride_of(of_cameras), sizeof(double) * (size_t)of_cameras);
    take_columns(inverse, local, stretch, of_cameras, size, size, part->inverse, stride);
    for (int64_t j = of_cameras; j < size; j++) {
        double *column = part->inverse + j * stride;
        vector_to_columns(p, local, column);
        for (int64_t i = 0; i < of_cameras; i++)
            part->inverse[i * stride + j] = column[i];
    }
    for (int64_t j = 0; j < of_cameras; j++)
        memset(part->inverse + j * stride + size, 0, sizeof(double) * (size_t)(stride - size));
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

/* product = B Q for one point; columns of photos that do not show it are passed over. */
INLINE void times_inverse(const Part *part, int64_t size, const double *const *b, double *const *q)
{
    memset(q[0], 0, sizeof(double) * 3 * (size_t)part->stride);
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

#define ROWS_AT_ONCE 6

/* product = B Q for several points of a group, a strip of the inverse at a time, and sums in registers. */
INLINE void times_inverse_together(const Part *part, int64_t size, int64_t points)
{
    if (3 * points % ROWS_AT_ONCE)
        memset(part->coupling + 3 * points * part->stride, 0, sizeof(double) * 3 * (size_t)part->stride);
    for (int64_t i = 0; i < size; i += 2 * LANES)
        for (int64_t row = 0; row < 3 * points; row += ROWS_AT_ONCE) {
            const double *b = part->coupling + row * part->stride;
            Lanes sums[ROWS_AT_ONCE][2];
            for (int r = 0; r < ROWS_AT_ONCE; r++)
                sums[r][0] = sums[r][1] = ALL(0.0);
            for (int64_t j = 0; j < size; j++) {
                const double *column = part->inverse + j * part->stride + i;
                const Lanes one = AT(column), other = AT(column + LANES);
                for (int r = 0; r < ROWS_AT_ONCE; r++) {
                    sums[r][0] += b[r * part->stride + j] * one;
                    sums[r][1] += b[r * part->stride + j] * other;
                }
            }
            for (int r = 0; r < ROWS_AT_ONCE; r++) {
                double *q = part->product + (row + r) * part->stride + i;
                AT(q) = sums[r][0], AT(q + LANES) = sums[r][1];
            }
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

/* The rows of B and B Q of one of the points. */
INLINE void rows_of_point(const Part *part, int64_t point, double **b, double **q)
{
    for (int k = 0; k < 3; k++) {
        b[k] = part->coupling + (3 * point + k) * part->stride;
        q[k] = part->product + (3 * point + k) * part->stride;
    }
}

/* Multiply the coupling of a point by H from the left. */
INLINE void times_half(double *const *b, int64_t size, const double *H)
{
    for (int64_t i = 0; i < size; i += LANES) {
        const Lanes given[3] = {AT(b[0] + i), AT(b[1] + i), AT(b[2] + i)};
        for (int k = 0; k < 3; k++)
            AT(b[k] + i) = H[3 * k] * given[0] + H[3 * k + 1] * given[1] + H[3 * k + 2] * given[2];
    }
}

/* inner = I + B Q B^T for one point. */
INLINE void find_inner(double *const *b, double *const *q, int64_t size, double *inner)
{
    Lanes sums[9];
    for (int k = 0; k < 9; k++)
        sums[k] = ALL(0.0);
    for (int64_t i = 0; i < size; i += LANES)
        for (int k = 0; k < 9; k++)
            sums[k] += AT(b[k / 3] + i) * AT(q[k % 3] + i);
    for (int k = 0; k < 9; k++)
        inner[k] = sum_of(sums[k]) + (k % 4 == 0);
}

#define VECTORS_AT_ONCE 8

/* Add some rows of partials a, times columns of a part of the inverse Q from the k-th row on, times rows b, to what is
 * found; so many vectors of each column at once. */
INLINE void add_strip(const double *inverse, int64_t stride, int coordinates, int vectors, const double *const *a,
                      int64_t count, const double *const *b, int64_t k, double times, double *found)
{
    Lanes sums[2][VECTORS_AT_ONCE];
    for (int c = 0; c < coordinates; c++)
        for (int v = 0; v < vectors; v++)
            sums[c][v] = ALL(0.0);
    for (int64_t u = 0; u < count; u++)
        for (int v = 0; v < vectors; v++) {
            const Lanes elements = AT(inverse + u * stride + k + v * LANES);
            for (int c = 0; c < coordinates; c++)
                sums[c][v] += a[c][u] * elements;
        }
    for (int c = 0; c < coordinates; c++) {
        Lanes sum = ALL(0.0);
        for (int v = 0; v < vectors; v++)
            sum += sums[c][v] * AT(b[c] + k + v * LANES);
        found[c] += times * sum_of(sum);
    }
}

/* Add a Q b^T, for the rows a and b of partials of some coordinates, with a part of the inverse Q, to what is found. */
INLINE void add_quadratic(const double *inverse, int64_t stride, int coordinates, const double *const *a, int64_t count,
                          const double *const *b, int64_t width, double times, double *found)
{
    int64_t k = 0;
    for (; k + VECTORS_AT_ONCE * LANES <= width; k += VECTORS_AT_ONCE * LANES)
        add_strip(inverse, stride, coordinates, VECTORS_AT_ONCE, a, count, b, k, times, found);
    for (; k < width; k += 2 * LANES)
        add_strip(inverse, stride, coordinates, 2, a, count, b, k, times, found);
}

/* Add to a Q a^T what the columns of the camera contribute, for rows a with the same ones, from the first one on. */
INLINE void add_of_camera(const Part *part, const Places *at, int64_t first, int coordinates, const double *const *camera,
                          const double *const *photo, double *found)
{
    const double *inverse = part->inverse + first * part->stride;
    const int64_t count = at->camera_columns;
    add_quadratic(inverse + first, part->stride, coordinates, camera, count, camera, PADDED(count), 1.0, found);
    add_quadratic(inverse + at->photo, part->stride, coordinates, camera, count, photo, PHOTO_ROW, 2.0, found);
}

/* Find a Q a^T for both rows a of a photo point. */
INLINE void of_unknowns(const Part *part, const Places *at, const double (*row)[ROW], double *found)
{
    const double *photo[2] = {row[0], row[1]}, *camera[2] = {row[0] + PHOTO_ROW, row[1] + PHOTO_ROW};
    const double *of_photo = part->inverse + at->photo * part->stride;
    found[0] = found[1] = 0.0;
    if (has_common_columns(at))
        add_of_camera(part, at, at->camera[0], 2, camera, photo, found);
    else
        for (int c = 0; c < 2; c++)
            add_of_camera(part, at, at->camera[c], 1, camera + c, photo + c, found + c);
    add_quadratic(of_photo + at->photo, part->stride, 2, photo, PHOTO_UNKNOWNS, photo, PHOTO_ROW, 1.0, found);
}

/* Return - 2 a (Q B^T) t + t (I + B Q B^T) t with t = H p, for a row a, p of a photo point, whose columns of the camera
 * are from the first one on; q: B Q of the point. */
INLINE double of_point(double *const *q, const Places *at, int64_t first, const double *row, const double *p,
                       const double *H, const double *inner)
{
    double t[3], with_inner[3], sum = 0.0;
    multiply(H, p, t);
    multiply(inner, t, with_inner);
    for (int k = 0; k < 3; k++) {
        const Lanes of_row = products(q[k] + first, row + PHOTO_ROW, at->camera_columns)
            + products(q[k] + at->photo, row, PHOTO_UNKNOWNS);
        sum += t[k] * (with_inner[k] - 2.0 * sum_of(of_row));
    }
    return sum;
}

/* Sum up the coupling of the point at a place of the pattern, times H. */
INLINE void couple(const Block *b, const Pattern *p, const Local *local, const Precision *c, int64_t place,
                   double *const *coupling, const Part *part, Ahead *a)
{
    int32_t last[2] = {0, 0};
    memset(coupling[0], 0, sizeof(double) * 3 * (size_t)part->stride);
    for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
        const int lane = ahead(b, p, c->factor, k, a);
        double px[3], py[3];
        if (!a->found.in_front[lane])
            continue;
        const Places at = places_of(b, p, local, p->order[k], a->cameras[lane], last);
        for (int i = 0; i < 3; i++)
            px[i] = LANE(a->of_point[0][i], lane), py[i] = LANE(a->of_point[1][i], lane);
        if (has_common_columns(&at))
            add_coupling(coupling[0], part->stride, &at, 1, a->row[lane], px, py);
        else
            add_coupling(coupling[0], part->stride, &at, 0, a->row[lane], px, py);
    }
    times_half(coupling, local->size, c->half + 9 * p->block[place]);
}

/* Find cofactors of the point at a place of the pattern, H^T (I + B Q B^T) H, and leverages of its photo points. */
INLINE void find_precision(const Block *b, const Pattern *p, const Local *local, const Precision *c, int64_t place,
                           double *const *coupling, double *const *q, const Part *part, Ahead *again)
{
    const double *H = c->half + 9 * p->block[place];
    double *cofactors = c->cofactors + 9 * p->block[place], inner[9];
    int32_t last[2] = {0, 0};
    find_inner(coupling, q, local->size, inner);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0.0;
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 3; l++)
                    sum += H[3 * k + i] * inner[3 * k + l] * H[3 * l + j];
            cofactors[3 * i + j] = sum;
        }
    if (c->amounts.is_free)
        transform_cofactors(&c->amounts, part->amounts, local->size, (const double *const *)coupling, H, p->block[place],
                            cofactors);
    for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
        const int lane = ahead(b, p, c->scale, k, again);
        if (!again->found.in_front[lane])
            continue;
        const Places at = places_of(b, p, local, p->order[k], again->cameras[lane], last);
        double *leverage = c->leverage + 2 * (int64_t)p->order[k];
        of_unknowns(part, &at, again->row[lane], leverage);
        for (int i = 0; i < 2; i++) {
            double partials[3];
            for (int axis = 0; axis < 3; axis++)
                partials[axis] = LANE(again->of_point[i][axis], lane);
            leverage[i] += of_point(q, &at, at.camera[i], again->row[lane][i], partials, H, inner);
        }
    }
}

/* Whether most photos of a group show most of its points, so that these are coupled with most of its columns. */
INLINE int is_dense(const Pattern *p, const Local *local, int64_t group)
{
    const int64_t first = p->group_start[group], end = p->group_start[group + 1];
    return 4 * (p->start[end] - p->start[first]) >= 3 * (end - first) * local->photo_runs;
}

static void precision_loop(const Block *b, const Pattern *p, Share share, const Precision *c, int32_t *numbers,
                           double *room)
{
    Ahead a, again;
    Local local = local_in(p, numbers);
    CameraPart cameras = {.count = -1, .inverse = room};
    begin_ahead(&a);
    begin_ahead(&again);
    room += p->most_camera_columns * stride_of(p->most_camera_columns);
    for (int64_t group = share.first; group < share.end; group++) {
        Part part;
        double *coupling[3], *q[3];
        local_unknowns(b, p, group, &local);
        take_part(p, &c->inverse, &local, numbers + ARRAYS_OF_LOCAL * p->longest, room, &cameras, &part);
        if (c->amounts.is_free)
            take_amounts(p, &local, &c->amounts, part.amounts);
        const int64_t end = p->group_start[group + 1], most = is_dense(p, &local, group) ? POINTS_AT_ONCE : 1;
        for (int64_t place = p->group_start[group], count; place < end; place += count) {
            count = end - place < most ? end - place : most;
            for (int64_t point = 0; point < count; point++) {
                rows_of_point(&part, point, coupling, q);
                couple(b, p, &local, c, place + point, coupling, &part, &a);
            }
            if (count > 1)
                times_inverse_together(&part, local.size, count);
            else
                times_inverse(&part, local.size, (const double *const *)coupling, q);
            for (int64_t point = 0; point < count; point++) {
                rows_of_point(&part, point, coupling, q);
                find_precision(b, p, &local, c, place + point, coupling, q, &part, &again);
            }
        }
    }
}

#endif
