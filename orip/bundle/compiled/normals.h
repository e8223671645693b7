/* Normal equations: formed group by group, each point's three unknowns eliminated. */

#ifndef ORIP_NORMALS_H
#define ORIP_NORMALS_H

#include "point_panel.h"
#include "ray_panel.h"

typedef struct {
    /* of each row; factor: root of the weight over the error, for the loops that come after */
    const double *weight, *residual;
    double *factor;
    const uint8_t *fixed;
    /* on_diagonal: the diagonals of the blocks are multiplied by it */
    double least_pivot, on_diagonal;
    const double *blocks;
    double *block_right, *diagonal, *right;
    double *half, *pivots;
    uint8_t *removed;
    Reduced reduced;
} Normals;

/* Numbers that the panels need. */
static int64_t numbers_of_panels(const Pattern *p)
{
    return numbers_of_ray_panel(p) + numbers_of_point_panel(p->longest);
}

/* Weigh the photo points from the k-th of the pattern on that are linearised at once; fetch those that come later. */
INLINE void weigh(const Block *b, const Pattern *p, const Normals *n, int64_t k, double (*roots)[2])
{
    const int64_t rest = p->start[p->blocks] - k;
    for (int64_t lane = 0; lane < LANES && lane < rest; lane++) {
        const int64_t first = 2 * (int64_t)p->order[k + lane];
        for (int c = 0; c < 2; c++) {
            roots[lane][c] = sqrt(n->weight[first + c]);
            n->factor[first + c] = roots[lane][c] / b->error[first + c];
        }
        if (lane + FETCHED_BEFORE < rest) {
            const int64_t later = 2 * (int64_t)p->order[k + lane + FETCHED_BEFORE];
            FETCH(n->weight + later);
            FETCH(n->residual + later);
            FETCH(b->error + later);
        }
    }
}

/* Fetch what a point has and gets. */
INLINE void fetch_point(const Normals *n, int64_t block)
{
    fetch_block(n->blocks + 9 * block);
    fetch_block(n->half + 9 * block);
    FETCH(n->block_right + 3 * block);
    FETCH(n->pivots + 3 * block);
}

/* Form the sums of each group of a share, one after the other in `room`. */
static void normals_loop(const Block *b, const Pattern *p, Share share, const Normals *n, int32_t *numbers, double *room,
                         double *of_panels)
{
    Ahead a;
    double roots[LANES][2];
    Local local = local_in(p, numbers);
    RayPanel rays = ray_panel_in(p, of_panels, numbers + ARRAYS_OF_LOCAL * p->longest);
    PointPanel points = {.rows = of_panels + numbers_of_ray_panel(p), .seen = numbers + (ARRAYS_OF_LOCAL + 1) * p->longest,
                         .of_strip = numbers + (ARRAYS_OF_LOCAL + 2) * p->longest};
    Sums s = {.by_cameras = room};
    begin_ahead(&a);
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        double *const next = place_sums(b, p, share, group, &local, room, &s);
        double *const coupling[3] = {s.coupling, s.coupling + s.stride, s.coupling + 2 * s.stride};
        const double *const by_photos[3] = {coupling[0] + local.cameras, coupling[1] + local.cameras, coupling[2] + local.cameras};
        begin_group(&local, &rays);
        memset(points.seen, 0, sizeof(int32_t) * (size_t)local.photo_runs);
        memset(room, 0, sizeof(double) * (size_t)(next - room));
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++) {
            const int64_t block = p->block[place];
            double V[9] = {0.0}, full[3], *g = n->block_right + 3 * block, *H = n->half + 9 * block;
            const double *given_block = n->blocks + 9 * block;
            if (place + POINTS_FETCHED_BEFORE < p->blocks)
                fetch_point(n, p->block[place + POINTS_FETCHED_BEFORE]);
            const int64_t first = rays.count;
            int32_t last[2] = {0, 0};
            memset(s.coupling, 0, sizeof(double) * 3 * (size_t)s.stride);
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                if (k >= a.end)
                    weigh(b, p, n, k, roots);
                const int lane = ahead(b, p, n->factor, k, &a);
                const int32_t row = p->order[k];
                const double *root = roots[lane], *residual = n->residual + 2 * (int64_t)row;
                const double y[2] = {-residual[0] * root[0], -residual[1] * root[1]};
                if (!a.found.in_front[lane] || (root[0] == 0.0 && root[1] == 0.0))
                    continue;
                const Places at = places_of(b, p, &local, row, a.cameras[lane], last);
                double px[3], py[3];
                for (int i = 0; i < 3; i++)
                    px[i] = LANE(a.of_point[0][i], lane), py[i] = LANE(a.of_point[1][i], lane);
                for (int i = 0; i < 3; i++) {
                    g[i] += px[i] * y[0] + py[i] * y[1];
                    for (int j = 0; j < 3; j++)
                        V[3 * i + j] += px[i] * px[j] + py[i] * py[j];
                }
                points.seen[last[0]] |= 1 << points.points;
                if (has_common_columns(&at))
                    add_coupling(s.coupling, s.stride, &at, 1, a.row[lane], px, py);
                else
                    add_coupling(s.coupling, s.stride, &at, 0, a.row[lane], px, py);
                take_ray(&rays, &at, last[0], a.row[lane], px, py, y);
            }
            /* every ray counts for all three coordinates, other observations for their own */
            const double of_rays = V[0] + V[4] + V[8];
            for (int i = 0; i < 9; i++)
                V[i] += given_block[i];
            for (int i = 0; i < 3; i++) {
                full[i] = of_rays + given_block[4 * i];
                V[4 * i] *= n->on_diagonal;
            }
            const uint8_t *fixed = n->fixed + 3 * block;
            double *pivots = n->pivots + 3 * block;
            memset(n->removed + 3 * block, 0, 3);
            if (!factorise_in_order(V, full, fixed, n->least_pivot, H, pivots))
                factorise_by_size(V, full, fixed, n->least_pivot, H, pivots, n->removed + 3 * block);
            const double given[3] = {g[0], g[1], g[2]};
            multiply(H, given, g);
            find_elimination(&s, local.size, H, g, coupling);
            eliminate_from_rays(&rays, first, H, (const double *const *)coupling);
            take_point(&points, local.size - local.cameras, by_photos);
            if (rays.count >= RAYS_OF_PANEL)
                add_rays(&local, &s, &rays);
            if (points.points == PANEL_POINTS)
                eliminate_points(&local, &s, &points);
        }
        add_rays(&local, &s, &rays);
        eliminate_points(&local, &s, &points);
        end_group(&rays, &local, &s);
        if (ends_cameras(b, p, share, group))
            matrix_to_unknowns(p, &local, s.by_cameras, s.of_cameras);
        rows_to_unknowns(p, &local, s.matrix, s.of_photos, s.right, s.diagonal);
        room = next;
    }
}

/* Add the sums of a share's groups to the reduced system; with the last ones it is complete. */
static void add_normals(const Block *b, const Pattern *p, Share share, const Normals *n, int32_t *numbers, double *room)
{
    Local local = local_in(p, numbers);
    Sums s = {.by_cameras = room};
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        room = place_sums(b, p, share, group, &local, room, &s);
        scatter(&s, &local, &n->reduced, n->right, n->diagonal, numbers + ARRAYS_OF_LOCAL * p->longest, ends_cameras(b, p, share, group));
    }
    if (share.end == p->groups && has_both_triangles(&n->reduced))
        mirror(&n->reduced);
}

#endif
