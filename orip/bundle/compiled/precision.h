/* Cofactors of the eliminated points, and the leverages of photo points.
 *
 * A row a of partials of a photo point and the coupling B of its ground point have products a Q a^T, a Q B^T and B Q B^T
 * with the inverse Q. Columns of cameras are many and the same for all points, those of photos few: with the half H of Q by
 * cameras, H + H^T, and its part R by cameras and photos, each row of partials a = (c, p) has v = H c + R p, which is linear
 * in a, and its form is 2 c v + p Q p^T with the part of Q by photos.
 */

#include "inner_constraints.h"
#include "inverse_parts.h"

typedef struct {
    /* factor: root of the weight over the error (2 n); scale: one over the error */
    const double *factor, *scale, *half;
    double *cofactors, *leverage;
    Reduced inverse;
    Amounts amounts;
} Precision;

/* Points of a group whose products with the inverse are formed together, where most of its photos show them. */
#define POINTS_AT_ONCE 4

/* A photo point: its rows of partials over the errors, H times those by the ground point, the weights of the rows, and
 * where its leverages go. */
typedef struct {
    double row[2][ROW], of_point[2][3], weight[2], *leverage;
    Places at;
} IN_LINES RayRows;

/* Points that are computed together. rays: theirs, those of the k-th one from start[k] on; of_rays: v of both rows of each,
 * `length` long; coupling: B, three rows for each point, `stride` long; product: in its place, the sum of v that belongs to B,
 * and B Q by photos; of_photos: B Q of one point by the photo of each of its photo points, row after row. */
typedef struct {
    RayRows *rays;
    double *of_rays, *coupling, *product, *of_photos;
    int64_t length, stride, start[POINTS_AT_ONCE + 1];
} Points;

/* Numbers that the points need in a group of so many columns, so many of them of cameras. */
static int64_t numbers_of_points(int64_t most_rays, int64_t size, int64_t of_cameras)
{
    const int64_t of_ray = (int64_t)(sizeof(RayRows) / sizeof(double)) + 2 * stride_of(of_cameras);
    return POINTS_AT_ONCE * (most_rays * of_ray + 6 * (PADDED(of_cameras) + stride_of(size))) + 3 * PHOTO_ROW * most_rays;
}

INLINE void begin_points(const Pattern *p, const Part *part, double *room, Points *points)
{
    const int64_t rays = POINTS_AT_ONCE * p->most_rays;
    points->rays = (RayRows *)room;
    points->length = part->of_cameras;
    points->of_rays = (double *)(points->rays + rays);
    points->stride = part->cameras + part->of_photos;
    points->coupling = points->of_rays + 2 * rays * points->length;
    points->product = points->coupling + 3 * POINTS_AT_ONCE * points->stride;
    points->of_photos = points->product + 3 * POINTS_AT_ONCE * points->stride;
    /* behind the strips that are written, lanes are read, and multiplied by zero: what stands there has to be a number */
    memset(points->coupling, 0, sizeof(double) * 6 * POINTS_AT_ONCE * (size_t)points->stride);
}

/* Fetch what comes later of the weights and leverages: the photo points of a point lie apart. */
INLINE void fetch_weights(const Block *b, const Pattern *p, const Precision *c, int64_t k)
{
    if (k + FETCHED_BEFORE >= p->start[p->blocks])
        return;
    const int64_t later = 2 * (int64_t)p->order[k + FETCHED_BEFORE];
    FETCH(c->factor + later);
    FETCH(b->error + later);
    FETCH(c->leverage + later);
}

/* Linearise the photo points of the point at a place of the pattern; return where those of the next one begin. */
INLINE int64_t keep_rays(const Block *b, const Pattern *p, const Local *local, const Precision *c, int64_t place,
                         Ahead *a, RayRows *rays, int64_t count)
{
    const double *H = c->half + 9 * p->block[place];
    int32_t last[2] = {0, 0};
    if (place + POINTS_FETCHED_BEFORE < p->blocks) {
        const int64_t later = 9 * (int64_t)p->block[place + POINTS_FETCHED_BEFORE];
        fetch_block(c->half + later);
        fetch_block(c->cofactors + later);
    }
    for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
        const int lane = ahead(b, p, c->scale, k, a);
        const int64_t row = p->order[k];
        RayRows *ray = rays + count;
        fetch_weights(b, p, c, k);
        if (!a->found.in_front[lane])
            continue;
        ray->at = places_of(b, p, local, (int32_t)row, a->cameras[lane], last);
        ray->leverage = c->leverage + 2 * row;
        for (int i = 0; i < 2; i++) {
            const double root = c->factor[2 * row + i] * b->error[2 * row + i];
            double partials[3];
            for (int axis = 0; axis < 3; axis++)
                partials[axis] = LANE(a->of_point[i][axis], lane);
            multiply(H, partials, ray->of_point[i]);
            ray->weight[i] = root * root;
            for (int64_t u = 0; u < PHOTO_ROW + PADDED(ray->at.camera_columns); u += LANES)
                AT(ray->row[i] + u) = AT(a->row[lane][i] + u);
        }
        count++;
    }
    return count;
}

#define RAYS_AT_ONCE 4

/* v of the rows of x (c = 0) or y of some photo points in the same camera, a strip at a time. */
INLINE void multiply_rows(const Part *part, const RayRows *const *rays, int c, double *const *found)
{
    const int64_t first = rays[0]->at.camera[c], end = first + rays[0]->at.camera_columns;
    const double *of_photo[RAYS_AT_ONCE], *of_camera[RAYS_AT_ONCE];
    for (int r = 0; r < RAYS_AT_ONCE; r++) {
        of_photo[r] = part->by_both + (rays[r]->at.photo - part->cameras) * part->of_cameras;
        of_camera[r] = rays[r]->row[c] + PHOTO_ROW - first;
    }
    for (int64_t i = 0; i < part->cameras; i += STRIP) {
        Lanes sums[RAYS_AT_ONCE][STRIP / LANES];
        for (int r = 0; r < RAYS_AT_ONCE; r++)
            for (int v = 0; v < STRIP / LANES; v++)
                sums[r][v] = ALL(0.0);
        for (int64_t k = i > first ? i : first; k < end; k++)
            for (int r = 0; r < RAYS_AT_ONCE; r++)
                for (int v = 0; v < STRIP / LANES; v++)
                    sums[r][v] += of_camera[r][k] * AT(part->half + k * part->of_cameras + i + v * LANES);
        for (int64_t u = 0; u < PHOTO_UNKNOWNS; u++)
            for (int r = 0; r < RAYS_AT_ONCE; r++)
                for (int v = 0; v < STRIP / LANES; v++)
                    sums[r][v] += rays[r]->row[c][u] * AT(of_photo[r] + u * part->of_cameras + i + v * LANES);
        for (int r = 0; r < RAYS_AT_ONCE; r++)
            for (int v = 0; v < STRIP / LANES; v++)
                AT(found[r] + i + v * LANES) = sums[r][v];
    }
    for (int r = 0; r < RAYS_AT_ONCE; r++)
        memset(found[r] + part->cameras, 0, sizeof(double) * (size_t)(part->of_cameras - part->cameras));
}

INLINE int have_same_columns(const RayRows *one, const RayRows *other)
{
    return one->at.camera[0] == other->at.camera[0] && one->at.camera_columns == other->at.camera_columns;
}

/* v of all rows of the points. */
INLINE void multiply_rays(const Part *part, const Points *points, int64_t count)
{
    const int64_t rays = points->start[count];
    for (int64_t ray = 0, end; ray < rays; ray = end) {
        for (end = ray + 1; end < rays && end < ray + RAYS_AT_ONCE; end++)
            if (!have_same_columns(points->rays + ray, points->rays + end))
                break;
        const RayRows *some[RAYS_AT_ONCE];
        for (int c = 0; c < 2; c++) {
            double *found[RAYS_AT_ONCE];
            for (int r = 0; r < RAYS_AT_ONCE; r++) {
                /* fewer than there is room for: the last one again */
                const int64_t of_room = ray + r < end ? ray + r : end - 1;
                some[r] = points->rays + of_room;
                found[r] = points->of_rays + (2 * of_room + c) * points->length;
            }
            multiply_rows(part, some, c, found);
        }
    }
}

/* The rows of B, or of its product, of one of the points. */
INLINE void rows_of_point(const Points *points, double *rows, int64_t point, double **found)
{
    for (int k = 0; k < 3; k++)
        found[k] = rows + (3 * point + k) * points->stride;
}

/* Sum up the rows of the photo points of a point, times H of the point: B, and v of B. */
INLINE void couple(const Part *part, const Points *points, int64_t point)
{
    const int64_t first = points->start[point], end = points->start[point + 1];
    double *coupling[3], *product[3];
    rows_of_point(points, points->coupling, point, coupling);
    rows_of_point(points, points->product, point, product);
    memset(coupling[0], 0, sizeof(double) * 3 * (size_t)points->stride);
    for (int64_t ray = first; ray < end; ray++) {
        const RayRows *r = points->rays + ray;
        double weighted[2][3];
        for (int k = 0; k < 6; k++)
            weighted[k / 3][k % 3] = r->weight[k / 3] * r->of_point[k / 3][k % 3];
        add_coupling(coupling[0], points->stride, &r->at, has_common_columns(&r->at), r->row, weighted[0], weighted[1]);
    }
    for (int64_t i = 0; i < part->cameras; i += STRIP) {
        Lanes sums[3][STRIP / LANES] = {{ALL(0.0)}};
        for (int64_t row = 2 * first; row < 2 * end; row++) {
            const RayRows *r = points->rays + row / 2;
            const double *of_row = points->of_rays + row * points->length + i, weight = r->weight[row % 2];
            for (int k = 0; k < 3; k++) {
                const double times = weight * r->of_point[row % 2][k];
                for (int v = 0; v < STRIP / LANES; v++)
                    sums[k][v] += times * AT(of_row + v * LANES);
            }
        }
        for (int k = 0; k < 3; k++)
            for (int v = 0; v < STRIP / LANES; v++)
                AT(product[k] + i + v * LANES) = sums[k][v];
    }
}

/* Add what the columns of Q of one photo contribute to B Q at another photo; b: the rows of B from its columns on. */
INLINE void add_of_photo(const double *const *b, const double *column, int64_t stride, double *found)
{
    Lanes sums[3][PHOTO_ROW / LANES];
    for (int k = 0; k < 3; k++)
        for (int v = 0; v < PHOTO_ROW / LANES; v++)
            sums[k][v] = AT(found + k * PHOTO_ROW + v * LANES);
    for (int64_t u = 0; u < PHOTO_UNKNOWNS; u++)
        for (int k = 0; k < 3; k++)
            for (int v = 0; v < PHOTO_ROW / LANES; v++)
                sums[k][v] += b[k][u] * AT(column + u * stride + v * LANES);
    for (int k = 0; k < 3; k++)
        for (int v = 0; v < PHOTO_ROW / LANES; v++)
            AT(found + k * PHOTO_ROW + v * LANES) = sums[k][v];
}

/* product = B Q by photos for one point, at the photos that show it, of which a large group has many more. */
INLINE void times_photos(const Part *part, const Points *points)
{
    const int64_t rays = points->start[1];
    memset(points->of_photos, 0, sizeof(double) * 3 * PHOTO_ROW * (size_t)rays);
    for (int64_t from = 0; from < rays; from++) {
        const int64_t photo = points->rays[from].at.photo;
        const double *b[3];
        if (from && photo == points->rays[from - 1].at.photo)
            continue;
        for (int k = 0; k < 3; k++)
            b[k] = points->coupling + k * points->stride + photo;
        for (int64_t to = 0; to < rays; to++)
            add_of_photo(b, part->by_photos + (photo - part->cameras) * part->of_photos + points->rays[to].at.photo - part->cameras,
                         part->of_photos, points->of_photos + 3 * PHOTO_ROW * to);
    }
    for (int k = 0; k < 3; k++)
        memset(points->product + k * points->stride + part->cameras, 0, sizeof(double) * (size_t)part->of_photos);
    for (int64_t to = 0; to < rays; to++)
        for (int k = 0; k < 3; k++)
            memcpy(points->product + k * points->stride + points->rays[to].at.photo,
                   points->of_photos + 3 * PHOTO_ROW * to + k * PHOTO_ROW, sizeof(double) * PHOTO_UNKNOWNS);
}

#define ROWS_AT_ONCE 6

/* product = B Q by photos for several points of a group, a strip of the inverse at a time, and sums in registers. */
INLINE void times_photos_together(const Part *part, const Points *points, int64_t count)
{
    const int64_t stride = points->stride;
    if (3 * count % ROWS_AT_ONCE)
        memset(points->coupling + 3 * count * stride, 0, sizeof(double) * 3 * (size_t)stride);
    for (int64_t i = 0; i < part->photos; i += 2 * LANES)
        for (int64_t row = 0; row < 3 * count; row += ROWS_AT_ONCE) {
            const double *b = points->coupling + row * stride + part->cameras;
            Lanes sums[ROWS_AT_ONCE][2];
            for (int r = 0; r < ROWS_AT_ONCE; r++)
                sums[r][0] = sums[r][1] = ALL(0.0);
            for (int64_t j = 0; j < part->photos; j++) {
                const double *column = part->by_photos + j * part->of_photos + i;
                const Lanes one = AT(column), other = AT(column + LANES);
                for (int r = 0; r < ROWS_AT_ONCE; r++) {
                    sums[r][0] += b[r * stride + j] * one;
                    sums[r][1] += b[r * stride + j] * other;
                }
            }
            for (int r = 0; r < ROWS_AT_ONCE; r++) {
                double *q = points->product + (row + r) * stride + part->cameras + i;
                AT(q) = sums[r][0], AT(q + LANES) = sums[r][1];
            }
        }
}

INLINE Lanes products(const double *a, const double *b, int64_t count)
{
    Lanes sum = ALL(0.0);
    for (int64_t k = 0; k < count; k += LANES)
        sum += AT(a + k) * AT(b + k);
    return sum;
}

/* inner += B product^T, of some columns of a point. */
INLINE void add_to_inner(const double *const *b, const double *const *q, int64_t first, int64_t end, double *inner)
{
    Lanes sums[9] = {ALL(0.0)};
    for (int64_t i = first; i < end; i += LANES)
        for (int k = 0; k < 9; k++)
            sums[k] += AT(b[k / 3] + i) * AT(q[k % 3] + i);
    for (int k = 0; k < 9; k++)
        inner[k] += sum_of(sums[k]);
}

/* inner = I + B Q B^T for one point. */
INLINE void find_inner(const Part *part, const double *const *b, const double *const *q, double *inner)
{
    double of_cameras[9] = {0.0};
    add_to_inner(b, q, 0, part->cameras, of_cameras);
    for (int k = 0; k < 9; k++)
        inner[k] = of_cameras[k] + of_cameras[3 * (k % 3) + k / 3] + (k % 4 == 0);
    add_to_inner(b, q, part->cameras, part->cameras + part->photos, inner);
}

/* Find p Q p^T for the rows p of a photo point by the unknowns of its photo. */
INLINE void of_photo(const Part *part, const RayRows *ray, double *found)
{
    const int64_t photo = ray->at.photo - part->cameras;
    Lanes sums[2][PHOTO_ROW / LANES] = {{ALL(0.0)}};
    for (int64_t u = 0; u < PHOTO_UNKNOWNS; u++)
        for (int v = 0; v < PHOTO_ROW / LANES; v++) {
            const Lanes elements = AT(part->by_photos + (photo + u) * part->of_photos + photo + v * LANES);
            for (int c = 0; c < 2; c++)
                sums[c][v] += ray->row[c][u] * elements;
        }
    for (int c = 0; c < 2; c++) {
        Lanes sum = ALL(0.0);
        for (int v = 0; v < PHOTO_ROW / LANES; v++)
            sum += sums[c][v] * AT(ray->row[c] + v * LANES);
        found[c] = sum_of(sum);
    }
}

/* Return (a - t B) Q (a - t B)^T + t t less p Q p^T, for a row a = (c, p) with v, and t = H times its partials by the
 * point; b, q: B and its product, inner: I + B Q B^T. */
INLINE double of_rest(const Part *part, const RayRows *ray, int c, const double *v, const double *const *b,
                      const double *const *q, const double *inner)
{
    const double *t = ray->of_point[c], *camera = ray->row[c] + PHOTO_ROW;
    const int64_t first = ray->at.camera[c], photo = ray->at.photo;
    double with_inner[3];
    multiply(inner, t, with_inner);
    Lanes sum = ALL(0.0);
    for (int64_t i = 0; i < part->cameras; i += LANES)
        sum -= AT(v + i) * (t[0] * AT(b[0] + i) + t[1] * AT(b[1] + i) + t[2] * AT(b[2] + i));
    for (int64_t i = 0; i < ray->at.camera_columns; i += LANES) {
        const double *const at[3] = {q[0] + first + i, q[1] + first + i, q[2] + first + i};
        sum += AT(camera + i) * (AT(v + first + i) - (t[0] * AT(at[0]) + t[1] * AT(at[1]) + t[2] * AT(at[2])));
    }
    for (int k = 0; k < 3; k++)
        sum -= t[k] * products(q[k] + photo, ray->row[c], PHOTO_UNKNOWNS);
    return t[0] * with_inner[0] + t[1] * with_inner[1] + t[2] * with_inner[2] + 2.0 * sum_of(sum);
}

/* Find cofactors of one of the points, H^T (I + B Q B^T) H, and leverages of its photo points. */
INLINE void find_precision(const Part *part, const Points *points, int64_t point, const double *H, double *cofactors)
{
    double *coupling[3], *product[3], inner[9];
    rows_of_point(points, points->coupling, point, coupling);
    rows_of_point(points, points->product, point, product);
    const double *const b[3] = {coupling[0], coupling[1], coupling[2]};
    const double *const q[3] = {product[0], product[1], product[2]};
    find_inner(part, b, q, inner);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0.0;
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 3; l++)
                    sum += H[3 * k + i] * inner[3 * k + l] * H[3 * l + j];
            cofactors[3 * i + j] = sum;
        }
    for (int64_t ray = points->start[point]; ray < points->start[point + 1]; ray++) {
        const RayRows *r = points->rays + ray;
        of_photo(part, r, r->leverage);
        for (int c = 0; c < 2; c++)
            r->leverage[c] += of_rest(part, r, c, points->of_rays + (2 * ray + c) * points->length, b, q, inner);
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
    double *const of_points = room + numbers_of_parts(p->longest, p->most_camera_columns);
    double *const of_movements = of_points + numbers_of_points(p->most_rays, p->longest, p->most_camera_columns);
    Ahead a;
    Local local = local_in(p, numbers);
    CameraPart cameras = {.count = -1};
    begin_ahead(&a);
    for (int64_t group = share.first; group < share.end; group++) {
        Part part;
        Points points;
        local_unknowns(b, p, group, &local);
        take_parts(p, &c->inverse, &local, numbers + ARRAYS_OF_LOCAL * p->longest, room, &cameras, &part);
        begin_points(p, &part, of_points, &points);
        if (c->amounts.is_free)
            take_amounts(p, &local, &c->amounts, of_movements);
        const int64_t end = p->group_start[group + 1], most = is_dense(p, &local, group) ? POINTS_AT_ONCE : 1;
        for (int64_t place = p->group_start[group], count; place < end; place += count) {
            count = end - place < most ? end - place : most;
            points.start[0] = 0;
            for (int64_t point = 0; point < count; point++)
                points.start[point + 1]
                    = keep_rays(b, p, &local, c, place + point, &a, points.rays, points.start[point]);
            multiply_rays(&part, &points, count);
            for (int64_t point = 0; point < count; point++)
                couple(&part, &points, point);
            if (count > 1)
                times_photos_together(&part, &points, count);
            else
                times_photos(&part, &points);
            for (int64_t point = 0; point < count; point++) {
                const int64_t block = p->block[place + point];
                const double *H = c->half + 9 * block, *coupling = points.coupling + 3 * point * points.stride;
                find_precision(&part, &points, point, H, c->cofactors + 9 * block);
                if (c->amounts.is_free)
                    transform_cofactors(&c->amounts, of_movements, local.size, coupling, points.stride, H, block,
                                        c->cofactors + 9 * block);
            }
        }
    }
}
