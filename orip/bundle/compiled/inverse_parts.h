/* The parts of the inverse of the reduced system that a group needs: of its photos, of its cameras, and of both. */

#include "normals.h"

/* Half of the inverse by the columns of some cameras, H + H^T being all of it: its columns, each to the diagonal, which is
 * halved, and zeros behind. Most groups that follow each other have it in common. */
typedef struct {
    const int32_t *runs;
    int32_t count;
    double *half;
} CameraPart;

/* cameras, photos: how many columns the group has of them, those of cameras padded, for with their strips of lanes photos
 * begin; by_photos: of each column of the photos the rows of the photos, each `of_photos` long; by_both: the rows of the
 * cameras, each `of_cameras` long, as those of `half`. */
typedef struct {
    int64_t cameras, photos, of_cameras, of_photos;
    const double *half;
    double *by_photos, *by_both;
} Part;

/* Numbers that the parts of a group of so many columns need, so many of them of cameras. */
static int64_t numbers_of_parts(int64_t size, int64_t of_cameras)
{
    return (size + of_cameras) * (stride_of(size) + stride_of(of_cameras));
}

/* Take the elements of a column of the inverse at a stretch of consecutive places, from the i-th local unknown on. */
INLINE void take_stretch(const Reduced *inverse, const Local *local, int64_t own, int64_t i, int64_t length, double *column)
{
    const int64_t place = local->place[i];
    if (has_both_triangles(inverse))
        memcpy(column, inverse->band + own * inverse->stride + place, sizeof(double) * (size_t)length);
    else if (own >= inverse->banded && place + length <= own)
        memcpy(column, inverse->border + (own - inverse->banded) * inverse->size + place, sizeof(double) * (size_t)length);
    else if (place >= own && place + length <= inverse->banded && place + length - 1 - own <= inverse->stride)
        memcpy(column, inverse->band + own * inverse->stride + place, sizeof(double) * (size_t)length);
    else
        for (int64_t k = 0; k < length; k++)
            if (is_stored(inverse, own, place + k))
                column[k] = *element_at(inverse, own, place + k);
}

/* Take some rows of the j-th column of the inverse, and zeros behind them. */
INLINE void take_column(const Reduced *inverse, const Local *local, const int32_t *stretch, int64_t j, int64_t first,
                        int64_t end, double *column, int64_t stride)
{
    memset(column, 0, sizeof(double) * (size_t)stride);
    for (int64_t i = first, length; local->place[j] >= 0 && i < end; i += length) {
        length = stretch[i] < end - i ? stretch[i] : end - i;
        if (local->place[i] >= 0)
            take_stretch(inverse, local, local->place[j], i, length, column + i - first);
    }
}

/* Take what the inverse has for the cameras of a group, which they may have been taken for already. */
INLINE void take_cameras_part(const Pattern *p, const Reduced *inverse, const Local *local, const int32_t *stretch,
                              CameraPart *cameras)
{
    const int64_t size = local->cameras, stride = stride_of(size);
    const int is_same = cameras->count == local->camera_runs
        && !memcmp(cameras->runs, local->runs, sizeof(int32_t) * (size_t)cameras->count);
    if (is_same)
        return;
    cameras->runs = local->runs, cameras->count = local->camera_runs;
    for (int64_t j = 0; j < size; j++)
        take_column(inverse, local, stretch, j, 0, size, cameras->half + j * stride, stride);
    matrix_to_columns(p, local, size, cameras->half, stride);
    for (int64_t j = 0; j < size; j++) {
        cameras->half[j * stride + j] *= 0.5;
        memset(cameras->half + j * stride + j + 1, 0, sizeof(double) * (size_t)(stride - j - 1));
    }
}

/* Replace rows of cameras by unknowns, of so many columns of a group's photos, by those by columns. */
INLINE void rows_to_columns(const Pattern *p, const Local *local, double *rows, int64_t columns, int64_t stride)
{
    Terms t;
    for (int32_t r = 0; r < local->camera_runs; r++)
        if (has_terms(p, local->runs[r], &t))
            for (int64_t j = 0; j < columns; j += LANES)
                lanes_to_columns(&t, rows + local->first[r] * stride + j, stride);
}

/* Take what the inverse has for the cameras and the photos of a group, from rows of the cameras, which a border stores. */
INLINE void take_part_of_both(const Pattern *p, const Reduced *inverse, const Local *local, const int32_t *stretch,
                              double *rows, const Part *part)
{
    const int64_t of_cameras = local->cameras, stride = part->of_photos;
    for (int64_t i = 0; i < of_cameras; i++)
        take_column(inverse, local, stretch, i, of_cameras, local->size, rows + i * stride, stride);
    rows_to_columns(p, local, rows, part->photos, stride);
    for (int64_t j = 0; j < part->photos; j++) {
        double *column = part->by_both + j * part->of_cameras;
        for (int64_t i = 0; i < of_cameras; i++)
            column[i] = rows[i * stride + j];
        memset(column + of_cameras, 0, sizeof(double) * (size_t)(part->of_cameras - of_cameras));
    }
}

/* Take the parts of the inverse for a group, by columns, in a room that begins with that of the cameras. */
INLINE void take_parts(const Pattern *p, const Reduced *inverse, const Local *local, int32_t *stretch, double *room,
                       CameraPart *cameras, Part *part)
{
    const int64_t size = local->size, of_cameras = local->cameras;
    part->cameras = of_cameras;
    part->photos = size - of_cameras;
    part->of_cameras = stride_of(part->cameras);
    part->of_photos = stride_of(part->photos);
    part->by_photos = room + p->most_camera_columns * stride_of(p->most_camera_columns);
    part->by_both = part->by_photos + part->photos * part->of_photos;
    cameras->half = room;
    part->half = room;
    find_stretches(local, stretch);
    take_cameras_part(p, inverse, local, stretch, cameras);
    for (int64_t j = 0; j < part->photos; j++) {
        /* the columns of the band are stored from the diagonal on, and photos are in the order of their places */
        double *const own = part->by_photos + j * part->of_photos;
        for (int64_t i = 0; i < j; i++)
            own[i] = part->by_photos[i * part->of_photos + j];
        take_column(inverse, local, stretch, of_cameras + j, of_cameras + j, size, own + j, part->of_photos - j);
    }
    take_part_of_both(p, inverse, local, stretch, part->by_both + part->photos * part->of_cameras, part);
}
