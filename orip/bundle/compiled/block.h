/* The photo points of a block, and how they are loaded so that several are computed at once. */

#ifndef ORIP_BLOCK_H
#define ORIP_BLOCK_H

#include <string.h>

#include "collinearity.h"

#define MOST_CAMERA_UNKNOWNS (CAMERA_PARAMETERS + MOST_ADDITIONAL)
/* Of a set, without the shift. */
#define MOST_PRODUCTS (PRODUCTS - 1)
#define MOST_CAMERA_COLUMNS (CAMERA_PARAMETERS + 2 * MOST_PRODUCTS)
/* Of the orientation, and of the motion. */
#define ORIENTATION_UNKNOWNS 6
#define PHOTO_UNKNOWNS (ORIENTATION_UNKNOWNS + MOTION_UNKNOWNS)
/* Kinds of cameras without a set: two bits. */
#define IS_MEASURED 1
#define IS_EQUIDISTANT 2
#define KINDS 4

/* What orip/bundle/compiled/photo_loop.py passes; the arrays are described there. */
typedef struct {
    /* the state */
    const double *cameras, *deformation, *centres, *rotations, *bases, *ground;
    /* cameras: those of the same kind are linearised together; each camera with a set is a kind of its own, and its form
     * has the two bits */
    const int32_t *kind, *polynomials;
    const uint8_t *form;
    const double *by_powers;
    /* photo points */
    const int32_t *camera_of_photo, *photo, *point;
    const double *xy, *error;
    /* with `moving`: of photos, motions a second, or none where no readout is unknown, and during the whole readout; of
     * cameras, the part of the readout that passes in a mm along x and y */
    const double *motions, *moved, *rows_a_mm;
    int64_t count, camera_count, photo_count, photo_unknowns;
    int turned, moving;
} Block;

/* How the photo points of eliminated points go into the normal equations. */
typedef struct {
    /* groups of points measured in the same photos; photo points of the p-th point: order[start[p]] ... */
    const int32_t *order, *start, *block, *group_start, *runs_start, *runs;
    /* columns of cameras: see columns_of; unknowns: how many, and their places in the reduced system; photo_places: -1
     * is a constant */
    const int32_t *camera_products, *camera_own, *camera_elements, *camera_unknowns, *camera_terms;
    const double *term_factors;
    const int32_t *camera_places, *photo_places;
    /* longest, most_camera_columns: of the columns of a group; most_rays: of the photo points of a point */
    int64_t groups, blocks, longest, most_camera_columns, most_rays;
    /* groups that a thread takes at a time: share_start[s] ...; room: numbers that the largest share needs */
    const int32_t *share_start;
    int64_t shares, room;
} Pattern;

/* The loops compute with columns in place of the unknowns of a camera. Those of a camera with a set are the coefficients of
 * the products in dx, then the elements (C, DX, ...), then the coefficients of the products in dy: few in each row, and
 * the same products in both. Each unknown is the sum of two columns times factors; see columns.h. */
INLINE int32_t columns_of(const Pattern *p, int32_t camera)
{
    return p->camera_own[camera] + 2 * p->camera_products[camera];
}

/* Groups, or rows, from the first one to that before the end. */
typedef struct {
    int64_t first, end;
} Share;

/* Photo points that a thread takes at a time where groups do not matter. */
#define ROWS_OF_SHARE 4096

/* Partials by the unknowns of a photo in the order of its columns: X0, Y0, Z0, KAPPA, OMEGA, PHI, and its motion. */
static const int32_t photo_elements[ORIENTATION_UNKNOWNS + MOST_MOTION_UNKNOWNS] = {
    PHOTO, PHOTO + 1, PHOTO + 2, ROTATION + 2, ROTATION, ROTATION + 1,
    MOTION, MOTION + 1, MOTION + 2, MOTION + 3, MOTION + 4, MOTION + 5,
};

/* Length of a photo point's row of partials: by the unknowns of the photo, padded to whole lanes, then of the camera. */
#define PHOTO_ROW PADDED(PHOTO_UNKNOWNS)
#define CAMERA_ROW (PADDED(CAMERA_PARAMETERS + MOST_PRODUCTS) + PADDED(1))
#define ROW (PHOTO_ROW + CAMERA_ROW)

/* Load photo, ground point and measured coordinates of the photo point in each lane. */
INLINE void take_rays(const Block *b, const int32_t *rows, Ray *ray)
{
    const double *centre[LANES], *rotation[LANES], *basis[LANES], *ground[LANES], *xy[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        const int64_t row = rows[lane], photo = b->photo[row];
        centre[lane] = b->centres + 3 * photo, rotation[lane] = b->rotations + 9 * photo;
        basis[lane] = b->bases + 9 * photo, ground[lane] = b->ground + 3 * (int64_t)b->point[row], xy[lane] = b->xy + 2 * row;
    }
    for (int k = 0; k < 3; k++) {
        ray->centre[k] = GATHERED(centre, k);
        ray->ground[k] = GATHERED(ground, k);
    }
    for (int k = 0; k < 9; k++)
        ray->rotation[k] = GATHERED(rotation, k);
    for (int k = 0; b->turned && k < 9; k++)
        ray->basis[k] = GATHERED(basis, k);
    for (int k = 0; k < 2; k++)
        ray->xy[k] = GATHERED(xy, k);
}

/* Take rays to the time of their rows, with the cameras that are loaded. */
INLINE void move_rays(const Block *b, const int32_t *rows, int linear, Ray *ray)
{
    const double *moved[LANES], *motion[LANES];
    for (int lane = 0; lane < LANES; lane++)
        moved[lane] = b->moved + 6 * (int64_t)b->photo[rows[lane]];
    for (int k = 0; k < 6; k++)
        ray->moved[k] = GATHERED(moved, k);
    for (int lane = 0; lane < LANES && b->motions; lane++)
        motion[lane] = b->motions + 6 * (int64_t)b->photo[rows[lane]];
    for (int k = 0; linear && b->motions && k < 6; k++)
        ray->motion[k] = GATHERED(motion, k);
    ray->row = ray->xy[0] * ray->row_a_mm[0] + ray->xy[1] * ray->row_a_mm[1];
    move_ray(ray, b->turned, linear);
}

INLINE void take_cameras(const Block *b, const int32_t *cameras, Ray *ray)
{
    const double *camera[LANES];
    for (int lane = 0; lane < LANES; lane++)
        camera[lane] = b->cameras + CAMERA_PARAMETERS * (int64_t)cameras[lane];
    for (int k = 0; k < CAMERA_PARAMETERS; k++)
        ray->camera[k] = GATHERED(camera, k);
    if (b->moving) {
        for (int lane = 0; lane < LANES; lane++)
            camera[lane] = b->rows_a_mm + 2 * (int64_t)cameras[lane];
        for (int k = 0; k < 2; k++)
            ray->row_a_mm[k] = GATHERED(camera, k);
    }
}

/* Linearise photo points of cameras of one form; without a set it is compiled for each form, so that none waits for
 * what another needs. */
INLINE void linearise_kind(const Block *b, int32_t camera, const Ray *ray, int linear, Linearised *found)
{
    const int form = b->form[camera], is_equidistant = form & IS_EQUIDISTANT;
    const int turned = b->turned || b->moving;
    if (b->kind[camera] < KINDS) {
        if (form == 0)
            collinearity(ray, 0, 0, 0, turned, b->moving, linear, found);
        else if (form == IS_MEASURED)
            collinearity(ray, 0, 1, 0, turned, b->moving, linear, found);
        else if (form == IS_EQUIDISTANT)
            collinearity(ray, 1, 0, 0, turned, b->moving, linear, found);
        else
            collinearity(ray, 1, 1, 0, turned, b->moving, linear, found);
        return;
    }
    const Set set = {
        b->polynomials[camera], b->by_powers + POLYNOMIALS * POLYNOMIALS * camera,
        {b->deformation + 2 * PRODUCTS * camera, b->deformation + 2 * PRODUCTS * camera + PRODUCTS},
    };
    if (form & IS_MEASURED)
        collinearity(ray, is_equidistant, 1, &set, turned, b->moving, linear, found);
    else
        collinearity(ray, is_equidistant, 0, &set, turned, b->moving, linear, found);
}

/* Linearise the photo points in `rows`, one in each lane. The ray keeps its cameras from one call to the next; `cameras`
 * has their numbers, -1 if none is loaded. */
INLINE void linearise(const Block *b, const int32_t *rows, int linear, Ray *ray, int32_t *cameras, Linearised *found)
{
    int same = 1, kept = 1;
    for (int lane = 0; lane < LANES; lane++) {
        const int32_t camera = b->camera_of_photo[b->photo[rows[lane]]];
        kept &= camera == cameras[lane];
        cameras[lane] = camera;
        same &= b->kind[camera] == b->kind[cameras[0]];
    }
    if (!kept)
        take_cameras(b, cameras, ray);
    take_rays(b, rows, ray);
    if (b->moving)
        move_rays(b, rows, linear, ray);
    linearise_kind(b, cameras[0], ray, linear, found);
    for (int lane = 1; !same && lane < LANES; lane++) {
        Linearised other;
        if (b->kind[cameras[lane]] == b->kind[cameras[0]])
            continue;
        linearise_kind(b, cameras[lane], ray, linear, &other);
        for (int c = 0; c < 2; c++) {
            LANE(found->residual[c], lane) = LANE(other.residual[c], lane);
            for (int element = 0; linear && element < ELEMENTS; element++)
                LANE(found->partials[c][element], lane) = LANE(other.partials[c][element], lane);
        }
        const int32_t polynomials = b->polynomials[cameras[lane]];
        for (int32_t product = 0; linear && product < polynomials * polynomials; product++)
            LANE(found->product[product], lane) = LANE(other.product[product], lane);
    }
}

/* Photo points that were linearised before they are needed, as many as there are lanes, and their rows of partials. */
typedef struct {
    Ray ray;
    Linearised found;
    Lanes of_point[2][3];
    double row[LANES][2][ROW];
    int64_t begin, end;
    int32_t cameras[LANES];
} IN_LINES Ahead;

INLINE void begin_ahead(Ahead *a)
{
    memset(a, 0, sizeof *a);
    for (int lane = 0; lane < LANES; lane++)
        a->cameras[lane] = -1;
}

/* Write partials by some elements to the row of each lane, multiplied by f, and padded. */
INLINE void spread_partials(const Lanes *partials, Lanes f, const int32_t *elements, int32_t count, double *const *rows)
{
    for (int32_t u = 0; u < PADDED(count); u += LANES) {
        Lanes scaled[LANES];
        double *to[LANES];
        for (int32_t k = 0; k < LANES; k++) {
            scaled[k] = ALL(0.0);
            if (u + k < count)
                scaled[k] = f * partials[elements[u + k]];
            to[k] = rows[k] + u;
        }
        spread(scaled, to);
    }
}

/* Write the products of a set to the row of each lane, multiplied by f, and zeros behind them, to end the padding. */
INLINE void spread_products(const Lanes *products, Lanes f, int32_t count, double *const *rows)
{
    for (int32_t k = 0; k < count + PADDED(1); k += LANES) {
        Lanes scaled[LANES];
        double *to[LANES];
        for (int32_t lane = 0; lane < LANES; lane++) {
            scaled[lane] = ALL(0.0);
            if (k < count)
                scaled[lane] = f * products[k + lane];
            to[lane] = rows[lane] + k;
        }
        spread(scaled, to);
    }
}

/* Write partials of x (c = 0) or y by the columns of a camera: the products in dx and the elements, or the elements and
 * the products in dy. */
INLINE void spread_camera(const Pattern *p, int32_t camera, const Linearised *found, Lanes f, int c, double *const *rows)
{
    const int32_t own = p->camera_own[camera], products = p->camera_products[camera];
    const int32_t *elements = p->camera_elements + CAMERA_PARAMETERS * camera;
    if (!products) {
        spread_partials(found->partials[c], f, elements, own, rows);
        return;
    }
    double *of_own[LANES], *of_products[LANES];
    for (int lane = 0; lane < LANES; lane++)
        of_own[lane] = rows[lane] + (c ? 0 : products), of_products[lane] = rows[lane] + (c ? own : 0);
    if (c)
        spread_partials(found->partials[c], f, elements, own, of_own);
    spread_products(found->product + 1, f, products, of_products);
    if (!c)
        spread_partials(found->partials[c], f, elements, own, of_own);
}

/* The same for the cameras of all lanes, which mostly are the same one. */
INLINE void spread_partials_by_cameras(const Pattern *p, const Linearised *found, Lanes f, Ahead *a, int c)
{
    double *rows[LANES], elsewhere[LANES][CAMERA_ROW];
    for (int first = 0; first < LANES; first++) {
        const int32_t camera = a->cameras[first];
        int is_first = 1;
        for (int lane = 0; lane < LANES; lane++) {
            is_first &= lane >= first || a->cameras[lane] != camera;
            rows[lane] = a->cameras[lane] == camera ? a->row[lane][c] + PHOTO_ROW : elsewhere[lane];
        }
        if (is_first)
            spread_camera(p, camera, found, f, c, rows);
    }
}

/* How long before they are linearised photo points are fetched: mostly they lie together by photos, those of a point apart. */
#define FETCHED_BEFORE 32

/* The same of points, whose blocks lie in another order. */
#define POINTS_FETCHED_BEFORE 8

/* Fetch the nine numbers of a block, which mostly lie in two lines. */
INLINE void fetch_block(const double *block)
{
    FETCH(block);
    FETCH(block + 8);
}

/* Fetch as many photo points of the pattern as there are lanes, of the next ones. */
INLINE void fetch_ahead(const Block *b, const Pattern *p, const double *factor, int64_t k)
{
    const int64_t first = k + FETCHED_BEFORE, end = p->start[p->blocks];
    for (int64_t next = first; next < first + LANES && next < end; next++) {
        const int64_t row = p->order[next];
        FETCH(b->xy + 2 * row);
        FETCH(factor + 2 * row);
        FETCH(b->photo + row);
        FETCH(b->point + row);
        FETCH(b->ground + 3 * (int64_t)b->point[p->order[next - FETCHED_BEFORE / 2]]);
    }
}

/* Linearise the photo points from the k-th of the pattern on; their rows are multiplied by `factor` (2 n). */
static void go_ahead(const Block *b, const Pattern *p, const double *factor, int64_t k, Ahead *a)
{
    const int64_t rest = p->start[p->blocks] - k;
    const int count = rest < LANES ? (int)rest : LANES;
    int32_t rows[LANES];
    for (int lane = 0; lane < LANES; lane++)
        rows[lane] = p->order[k + (lane < count ? lane : 0)];
    fetch_ahead(b, p, factor, k);
    linearise(b, rows, 1, &a->ray, a->cameras, &a->found);
    a->begin = k;
    a->end = k + count;
    for (int c = 0; c < 2; c++) {
        const double *factors[LANES];
        for (int lane = 0; lane < LANES; lane++)
            factors[lane] = factor + 2 * (int64_t)rows[lane];
        const Lanes f = GATHERED(factors, c);
        for (int i = 0; i < 3; i++)
            a->of_point[c][i] = f * a->found.partials[c][POINT + i];
        double *rows_of_photos[LANES];
        for (int lane = 0; lane < LANES; lane++)
            rows_of_photos[lane] = a->row[lane][c];
        spread_partials(a->found.partials[c], f, photo_elements, PHOTO_UNKNOWNS, rows_of_photos);
        spread_partials_by_cameras(p, &a->found, f, a, c);
    }
}

/* Return the lane of the k-th photo point, which is linearised if it has not been. */
INLINE int ahead(const Block *b, const Pattern *p, const double *factor, int64_t k, Ahead *a)
{
    if (k >= a->end)
        go_ahead(b, p, factor, k, a);
    return (int)(k - a->begin);
}

/* The columns that the points of a group are coupled with: those of its cameras, then six of each photo, in the order of
 * their places. The unknowns of a camera take the first places of its columns, and those behind them have none. first: of
 * each run; sorted: the runs in the order of their columns; cameras: how many columns are those of cameras, padded. */
typedef struct {
    int64_t size, cameras;
    const int32_t *runs;
    int32_t camera_runs, photo_runs;
    int32_t *first, *place, *sorted;
} Local;

/* Arrays of integers that a group needs, each as long as the longest group. */
#define ARRAYS_OF_LOCAL 3

INLINE Local local_in(const Pattern *p, int32_t *numbers)
{
    return (Local){.first = numbers, .place = numbers + p->longest, .sorted = numbers + 2 * p->longest};
}

INLINE int32_t columns_of_run(const Block *b, const Pattern *p, int32_t run)
{
    return run < b->camera_count ? columns_of(p, run) : PHOTO_UNKNOWNS;
}

INLINE const int32_t *places_of_run(const Block *b, const Pattern *p, int32_t run)
{
    return run < b->camera_count ? p->camera_places + MOST_CAMERA_UNKNOWNS * (int64_t)run
                                 : p->photo_places + PHOTO_UNKNOWNS * (run - b->camera_count);
}

/* Insert a photo's run into those that are sorted by their places; they mostly come in order. */
INLINE void insert_run(const Block *b, const Pattern *p, Local *local, int32_t r)
{
    const int32_t place = *places_of_run(b, p, local->runs[r]);
    int32_t at = r;
    for (; at > local->camera_runs && *places_of_run(b, p, local->runs[local->sorted[at - 1]]) > place; at--)
        local->sorted[at] = local->sorted[at - 1];
    local->sorted[at] = r;
}

/* Pad the columns of cameras, so that their sums are whole strips of the columns. */
INLINE void end_cameras(Local *local)
{
    while (local->size % PADDED(1))
        local->place[local->size++] = -1;
    local->cameras = local->size;
}

INLINE void local_unknowns(const Block *b, const Pattern *p, int64_t group, Local *local)
{
    const int32_t *runs = p->runs + p->runs_start[group];
    const int32_t count = p->runs_start[group + 1] - p->runs_start[group];
    local->runs = runs;
    local->size = local->cameras = 0;
    local->camera_runs = 0;
    for (int32_t r = 0; r < count; r++) {
        local->camera_runs += runs[r] < b->camera_count;
        local->sorted[r] = r;
        if (runs[r] >= b->camera_count)
            insert_run(b, p, local, r);
    }
    local->photo_runs = count - local->camera_runs;
    for (int32_t at = 0; at < count; at++) {
        const int32_t run = runs[local->sorted[at]], columns = columns_of_run(b, p, run);
        const int32_t unknowns = run < b->camera_count ? p->camera_unknowns[run] : PHOTO_UNKNOWNS;
        const int32_t *places = places_of_run(b, p, run);
        local->first[local->sorted[at]] = (int32_t)local->size;
        for (int32_t u = 0; u < columns; u++)
            local->place[local->size++] = u < unknowns ? places[u] : -1;
        if (at + 1 == local->camera_runs)
            end_cameras(local);
    }
}

/* Whether a group has the same cameras as that before it. */
INLINE int has_same_cameras(const Block *b, const Pattern *p, int64_t group)
{
    const int32_t *runs = p->runs + p->runs_start[group], *before = p->runs + p->runs_start[group - 1];
    const int32_t count = p->runs_start[group + 1] - p->runs_start[group];
    const int32_t of_before = p->runs_start[group] - p->runs_start[group - 1];
    for (int32_t r = 0;; r++) {
        const int is_camera = r < count && runs[r] < b->camera_count;
        const int was_camera = r < of_before && before[r] < b->camera_count;
        if (!is_camera || !was_camera)
            return is_camera == was_camera;
        if (runs[r] != before[r])
            return 0;
    }
}

/* First local unknown of a run. The search begins at the last hit: runs are asked for nearly in their order. */
INLINE int32_t first_of_run(const Local *local, int32_t run, int is_camera, int32_t *last)
{
    const int32_t from = is_camera ? 0 : local->camera_runs;
    const int32_t count = is_camera ? local->camera_runs : local->photo_runs;
    while (local->runs[from + *last] != run)
        *last = *last + 1 == count ? 0 : *last + 1;
    return local->first[from + *last];
}

/* A photo point's first local columns of photo and, for x and for y, of camera, and how many of the camera's its rows
 * have. */
typedef struct {
    int32_t photo, camera[2], camera_columns;
} Places;

INLINE Places places_of(const Block *b, const Pattern *p, const Local *local, int32_t row, int32_t camera, int32_t *last)
{
    const int32_t first = first_of_run(local, camera, 1, &last[1]), products = p->camera_products[camera];
    return (Places){
        first_of_run(local, (int32_t)b->camera_count + b->photo[row], 0, &last[0]), {first, first + products},
        p->camera_own[camera] + products,
    };
}

/* Whether the rows of x and of y have the same columns of the camera. */
INLINE int has_common_columns(const Places *at)
{
    return at->camera[0] == at->camera[1];
}

#endif
