/* The photo points of a block, and how they are loaded so that several are computed at once. */

#ifndef ORIP_BLOCK_H
#define ORIP_BLOCK_H

#include <string.h>

#include "collinearity.h"

#define MOST_CAMERA_UNKNOWNS (CAMERA_PARAMETERS + MOST_ADDITIONAL)
#define PHOTO_UNKNOWNS 6
/* Kinds of cameras without a set: two bits. */
#define IS_MEASURED 1
#define IS_EQUIDISTANT 2
#define KINDS 4

/* What orip/bundle/compiled/photo_loop.py passes; the arrays are described there. */
typedef struct {
    /* the state */
    const double *cameras, *additional, *centres, *rotations, *bases, *ground;
    /* cameras: those of the same kind are linearised together; each camera with a set is a kind of its own, and its form
     * has the two bits */
    const int32_t *kind, *products;
    const uint8_t *form;
    const double *polynomials, *factors;
    /* photo points */
    const int32_t *camera_of_photo, *photo, *point;
    const double *xy, *error;
    int64_t count, additional_count, camera_count, photo_count;
    int turned;
} Block;

/* How the photo points of eliminated points go into the normal equations. */
typedef struct {
    /* groups of points measured in the same photos; photo points of the p-th point: order[start[p]] ... */
    const int32_t *order, *start, *block, *group_start, *runs_start, *runs;
    /* unknowns of cameras: how many, which partials, which places in the reduced system; photo_places: -1 is a constant */
    const int32_t *camera_unknowns, *camera_elements, *camera_places, *photo_places;
    int64_t groups, blocks, longest;
    /* groups that a thread takes at a time: share_start[s] ...; room: numbers that the largest share needs */
    const int32_t *share_start;
    int64_t shares, room;
} Pattern;

/* Groups, or rows, from the first one to that before the end. */
typedef struct {
    int64_t first, end;
} Share;

/* Photo points that a thread takes at a time where groups do not matter. */
#define ROWS_OF_SHARE 4096

/* Partials by the unknowns of a photo in the order of its columns: X0, Y0, Z0, KAPPA, OMEGA, PHI. */
static const int32_t photo_elements[PHOTO_UNKNOWNS] = {PHOTO, PHOTO + 1, PHOTO + 2, ROTATION + 2, ROTATION, ROTATION + 1};

/* Length of a photo point's row of partials: by the unknowns of the photo, padded to whole lanes, then of the camera. */
#define PHOTO_ROW PADDED(PHOTO_UNKNOWNS)
#define ROW (PHOTO_ROW + PADDED(MOST_CAMERA_UNKNOWNS))

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

INLINE void take_cameras(const Block *b, const int32_t *cameras, Ray *ray)
{
    const double *camera[LANES];
    for (int lane = 0; lane < LANES; lane++)
        camera[lane] = b->cameras + CAMERA_PARAMETERS * (int64_t)cameras[lane];
    for (int k = 0; k < CAMERA_PARAMETERS; k++)
        ray->camera[k] = GATHERED(camera, k);
}

/* Linearise photo points of cameras of one form; without a set it is compiled for each form, so that none waits for
 * what another needs. */
INLINE void linearise_kind(const Block *b, int32_t camera, const Ray *ray, int linear, Linearised *found)
{
    const int form = b->form[camera], is_equidistant = form & IS_EQUIDISTANT;
    if (b->kind[camera] < KINDS) {
        if (form == 0)
            collinearity(ray, 0, 0, 0, b->turned, linear, found);
        else if (form == IS_MEASURED)
            collinearity(ray, 0, 1, 0, b->turned, linear, found);
        else if (form == IS_EQUIDISTANT)
            collinearity(ray, 1, 0, 0, b->turned, linear, found);
        else
            collinearity(ray, 1, 1, 0, b->turned, linear, found);
        return;
    }
    const Set set = {
        b->additional_count, b->additional + camera * b->additional_count,
        b->polynomials + POLYNOMIALS * POLYNOMIALS * camera, b->factors + 2 * MOST_ADDITIONAL * camera,
        b->products + 2 * MOST_ADDITIONAL * camera,
    };
    if (form & IS_MEASURED)
        collinearity(ray, is_equidistant, 1, &set, b->turned, linear, found);
    else
        collinearity(ray, is_equidistant, 0, &set, b->turned, linear, found);
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
    }
}

/* Photo points that were linearised before they are needed, as many as there are lanes, and their rows of partials. */
typedef struct {
    int64_t begin, end;
    Ray ray;
    int32_t cameras[LANES];
    Linearised found;
    Lanes of_point[2][3];
    double row[LANES][2][ROW];
} Ahead;

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

/* The same for the unknowns of cameras, which mostly are of the same one. */
INLINE void spread_partials_by_cameras(const Pattern *p, const Lanes *partials, Lanes f, Ahead *a, int c)
{
    double *rows[LANES], elsewhere[LANES][PADDED(MOST_CAMERA_UNKNOWNS)];
    for (int first = 0; first < LANES; first++) {
        const int32_t camera = a->cameras[first];
        int is_first = 1;
        for (int lane = 0; lane < LANES; lane++) {
            is_first &= lane >= first || a->cameras[lane] != camera;
            rows[lane] = a->cameras[lane] == camera ? a->row[lane][c] + PHOTO_ROW : elsewhere[lane];
        }
        if (is_first)
            spread_partials(partials, f, p->camera_elements + MOST_CAMERA_UNKNOWNS * camera, p->camera_unknowns[camera], rows);
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
        spread_partials_by_cameras(p, a->found.partials[c], f, a, c);
    }
}

/* Return the lane of the k-th photo point, which is linearised if it has not been. */
INLINE int ahead(const Block *b, const Pattern *p, const double *factor, int64_t k, Ahead *a)
{
    if (k >= a->end)
        go_ahead(b, p, factor, k, a);
    return (int)(k - a->begin);
}

/* The unknowns that the points of a group are coupled with: those of its cameras, then six of each photo, in the order
 * of their places. first: of each run; sorted: the runs in the order of their unknowns. */
typedef struct {
    int64_t size;
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

/* Places of a run's unknowns; *unknowns: how many there are. */
INLINE const int32_t *places_of_run(const Block *b, const Pattern *p, int32_t run, int32_t *unknowns)
{
    const int is_camera = run < b->camera_count;
    *unknowns = is_camera ? p->camera_unknowns[run] : PHOTO_UNKNOWNS;
    return is_camera ? p->camera_places + MOST_CAMERA_UNKNOWNS * (int64_t)run
                     : p->photo_places + PHOTO_UNKNOWNS * (run - b->camera_count);
}

/* Insert a photo's run into those that are sorted by their places; they mostly come in order. */
INLINE void insert_run(const Block *b, const Pattern *p, Local *local, int32_t r)
{
    int32_t unknowns, at = r;
    const int32_t place = *places_of_run(b, p, local->runs[r], &unknowns);
    for (; at > local->camera_runs && *places_of_run(b, p, local->runs[local->sorted[at - 1]], &unknowns) > place; at--)
        local->sorted[at] = local->sorted[at - 1];
    local->sorted[at] = r;
}

INLINE void local_unknowns(const Block *b, const Pattern *p, int64_t group, Local *local)
{
    const int32_t *runs = p->runs + p->runs_start[group];
    const int32_t count = p->runs_start[group + 1] - p->runs_start[group];
    local->runs = runs;
    local->size = 0;
    local->camera_runs = 0;
    for (int32_t r = 0; r < count; r++) {
        local->camera_runs += runs[r] < b->camera_count;
        local->sorted[r] = r;
        if (runs[r] >= b->camera_count)
            insert_run(b, p, local, r);
    }
    local->photo_runs = count - local->camera_runs;
    for (int32_t s = 0; s < count; s++) {
        int32_t unknowns;
        const int32_t *places = places_of_run(b, p, runs[local->sorted[s]], &unknowns);
        local->first[local->sorted[s]] = (int32_t)local->size;
        for (int32_t u = 0; u < unknowns; u++)
            local->place[local->size++] = places[u];
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

/* A photo point's first local unknowns of photo and camera, and the number of unknowns of the camera. */
typedef struct {
    int32_t photo, camera, camera_unknowns;
} Places;

INLINE Places places_of(const Block *b, const Pattern *p, const Local *local, int32_t row, int32_t camera, int32_t *last)
{
    const Places places = {
        first_of_run(local, (int32_t)b->camera_count + b->photo[row], 0, &last[0]),
        first_of_run(local, camera, 1, &last[1]), p->camera_unknowns[camera],
    };
    return places;
}

#endif
