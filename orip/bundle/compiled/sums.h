/* The sums of a group of points, and the reduced system that they are added to. */

#ifndef ORIP_SUMS_H
#define ORIP_SUMS_H

#include "columns.h"

/* Unknowns of a strip of the sums, and columns of them that are in registers at the same time, of cameras and of photos. */
#define STRIP 8
#define COLUMNS_OF_PANEL 6
#define PHOTO_COLUMNS (PHOTO_UNKNOWNS % COLUMNS_OF_PANEL ? COLUMNS_OF_PANEL / 2 : COLUMNS_OF_PANEL)

/* Lower triangle of a symmetric matrix of `size` unknowns in the order of their places. Element (i, j) of the first
 * `banded` rows is band[j * stride + i]; a full matrix has stride = size. The rows after them are full, in `border`.
 */
typedef struct {
    double *band, *border;
    int64_t stride, banded, size;
} Reduced;

INLINE double *element_at(const Reduced *m, int64_t one, int64_t other)
{
    const int64_t i = one > other ? one : other, j = one > other ? other : one;
    return i < m->banded ? m->band + j * m->stride + i : m->border + (i - m->banded) * m->size + j;
}

/* Whether the matrix has an element. Points of a group are not all in all its photos: those may be too far apart. */
INLINE int is_stored(const Reduced *m, int64_t one, int64_t other)
{
    const int64_t i = one > other ? one : other, j = one > other ? other : one;
    return i >= m->banded || i - j <= m->stride;
}

/* Whether both triangles of a full matrix are there, so that its rows are its columns. */
INLINE int has_both_triangles(const Reduced *m)
{
    return m->stride == m->size && m->banded == m->size;
}

/* Normal equations of a group. by_cameras: the triangle of the columns of cameras, column j from its element j, every column
 * `of_cameras` long; matrix: the rows of photos, column j from its element j or from the first of them, every column
 * `of_photos` long; coupling: the three rows that couple a point with the group's columns, each `stride` long. */
typedef struct {
    int64_t stride, of_cameras, of_photos, cameras;
    double *by_cameras, *matrix, *right, *diagonal, *coupling;
} Sums;

/* Length of a column of the sums of a group; it is padded, as additions are by whole lanes. */
static int64_t stride_of(int64_t size)
{
    return PADDED(size) + 2 * LANES;
}

static int64_t numbers_of_sums(int64_t size, int64_t cameras)
{
    return 5 * stride_of(size) + size * stride_of(size - cameras);
}

static int64_t numbers_of_cameras(int64_t cameras)
{
    return cameras * stride_of(cameras);
}

/* Place the sums of a group in the room, after those of its cameras, which it may share with the groups before it; return
 * where the room goes on. */
INLINE double *place_sums(const Block *b, const Pattern *p, Share share, int64_t group, const Local *local, double *room,
                          Sums *sums)
{
    const int64_t size = local->size, cameras = local->cameras;
    if (group == share.first || !has_same_cameras(b, p, group)) {
        sums->by_cameras = room;
        room += numbers_of_cameras(cameras);
    }
    sums->cameras = cameras;
    sums->stride = stride_of(size);
    sums->of_cameras = stride_of(cameras);
    sums->of_photos = stride_of(size - cameras);
    sums->right = room;
    sums->diagonal = room + sums->stride;
    sums->coupling = room + 2 * sums->stride;
    sums->matrix = room + 5 * sums->stride;
    return room + numbers_of_sums(size, cameras);
}

/* Whether no group after this one adds to the sums of its cameras. */
INLINE int ends_cameras(const Block *b, const Pattern *p, Share share, int64_t group)
{
    return group + 1 == share.end || !has_same_cameras(b, p, group + 1);
}

/* The rows of photos of a column of the sums. */
INLINE double *photos_of(const Sums *s, int64_t column)
{
    return s->matrix + column * s->of_photos;
}

INLINE double sum_of(Lanes lanes)
{
    double sum = 0.0;
    for (int lane = 0; lane < LANES; lane++)
        sum += LANE(lanes, lane);
    return sum;
}

INLINE void add_to(double *sums, double x, const double *of_x, double y, const double *of_y, int64_t count)
{
    for (int64_t k = 0; k < count; k += LANES)
        AT(sums + k) += x * AT(of_x + k) + y * AT(of_y + k);
}

INLINE void add_multiple(double *sums, double x, const double *of_x, int64_t count)
{
    for (int64_t k = 0; k < count; k += LANES)
        AT(sums + k) += x * AT(of_x + k);
}

/* Add a photo point's rows by the columns of its camera, times x and y; common: whether both have the same columns. */
INLINE void add_to_camera(double *sums, const Places *at, int common, double x, double y, const double (*row)[ROW])
{
    const double *of_x = row[0] + PHOTO_ROW, *of_y = row[1] + PHOTO_ROW;
    if (common)
        add_to(sums + at->camera[0], x, of_x, y, of_y, at->camera_columns);
    else {
        add_multiple(sums + at->camera[0], x, of_x, at->camera_columns);
        add_multiple(sums + at->camera[1], y, of_y, at->camera_columns);
    }
}

/* Add the coupling of a photo point with its ground point, of partials px, py. */
INLINE void add_coupling(double *coupling, int64_t stride, const Places *at, int common, const double (*row)[ROW],
                         const double *px, const double *py)
{
    for (int i = 0; i < 3; i++) {
        double *w = coupling + i * stride;
        add_to_camera(w, at, common, px[i], py[i], row);
        add_to(w + at->photo, px[i], row[0], py[i], row[1], PHOTO_UNKNOWNS);
    }
}

/* Find how many unknowns, from each local unknown on, have consecutive places. */
INLINE void find_stretches(const Local *local, int32_t *stretch)
{
    for (int64_t i = local->size - 1; i >= 0; i--) {
        const int goes_on = i + 1 < local->size && local->place[i] >= 0 && local->place[i + 1] == local->place[i] + 1;
        stretch[i] = goes_on ? stretch[i + 1] + 1 : 1;
    }
}

/* Add a part of column j of a group's sums, from the i-th row on, to the reduced system, one stretch of consecutive places
 * after the other. Cameras with the same lens have common places: where two unknowns of the group are one, both triangles
 * of the sums go to the diagonal. */
INLINE void scatter_column(const double *column, int64_t j, int64_t i, int64_t end, const Local *local, const Reduced *m,
                           const int32_t *stretch)
{
    const int64_t own = local->place[j];
    for (int64_t length; i < end; i += length) {
        const int64_t place = local->place[i], room = own + m->stride + 1 - place;
        length = stretch[i] < end - i ? stretch[i] : end - i;
        if (place >= own && place + length <= m->banded) {
            double *banded = m->band + own * m->stride + place;
            const int64_t stored = length < room ? length : room;
            for (int64_t k = 0; k < stored; k++)
                banded[k] += column[i + k];
        } else if (own >= m->banded && place >= 0 && place + length <= own) {
            double *row = m->border + (own - m->banded) * m->size + place;
            for (int64_t k = 0; k < length; k++)
                row[k] += column[i + k];
        } else
            for (int64_t k = 0; place >= 0 && k < length; k++)
                if (is_stored(m, own, place + k))
                    *element_at(m, own, place + k) += column[i + k];
        if (i != j && place >= 0 && place <= own && own < place + length)
            *element_at(m, own, own) += column[i + own - place];
    }
}

/* Add a group's sums to the reduced system; with_cameras: those that it shares with other groups, too. */
INLINE void scatter(const Sums *s, const Local *local, const Reduced *m, double *right, double *diagonal, int32_t *stretch,
                    int with_cameras)
{
    find_stretches(local, stretch);
    for (int64_t j = 0; j < local->size; j++) {
        const int64_t own = local->place[j], from = j < s->cameras ? s->cameras : j;
        if (own < 0)
            continue;
        right[own] += s->right[j];
        diagonal[own] += s->diagonal[j];
        if (with_cameras && j < s->cameras)
            scatter_column(s->by_cameras + j * s->of_cameras, j, j, s->cameras, local, m, stretch);
        scatter_column(photos_of(s, j) - s->cameras, j, from, local->size, local, m, stretch);
    }
}

/* Copy the lower triangle of a full matrix to the upper one. */
INLINE void mirror(const Reduced *m)
{
    for (int64_t i = 0; i < m->size; i++)
        for (int64_t j = 0; j < i; j++)
            m->band[i * m->stride + j] = m->band[j * m->stride + i];
}

#endif
