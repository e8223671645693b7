/* The whole refinement of a block: which rays take part, and steps until none helps. */

#include "band_order.h"
#include "refinement.h"
#include <stdlib.h>

/* In place of a number of iterations: the user wants to end the program, or there is not enough memory. */
enum { REFINEMENT_INTERRUPTED = -1, REFINEMENT_WITHOUT_ROOM = -2 };

/* All rays of a block, in any order, and what is known of it. */
typedef struct {
    const int64_t *photo, *point, *camera_of_photo;
    const double *vectors, *error;
    const uint8_t *oriented, *held, *unknown;
    int64_t count, photos, points, cameras;
} BlockRays;

/* As `_rules` of refinement.py lists them. */
typedef struct {
    double median, limit, floor, largest_turn, uphill, uphill_steps, most_steps, first_damping, least_damping, gain,
        enough, expected[OF_CAMERA];
} RefinementRules;

/* A system of the block's own size, in which damping treats angles and lengths alike. */
typedef struct {
    double base[3], size;
} OwnSystem;

/* What a refinement needs: the rays that take part, point by point; `row` are their places among all. */
typedef struct {
    const BlockRays *all;
    const RefinementRules *rules;
    RefinementProblem n;
    PhotoGraph graph;
    int64_t *start, *row, *photo, *camera, *order, *place;
    uint8_t *photo_free, *point_free;
    double *error, *by_camera, unit;
    OwnSystem own;
    BlockState states[3];
} Refinement;

/* Memory in which arrays lie one after the other; without a base they are only counted. */
typedef struct {
    char *base;
    size_t used;
} Room;

static void *take(Room *room, int64_t count, size_t size)
{
    void *taken = room->base ? room->base + room->used : NULL;
    room->used += ((size_t)count * size + 15) & ~(size_t)15;
    return taken;
}

static double *take_numbers(Room *room, int64_t count) { return take(room, count, sizeof(double)); }
static int64_t *take_places(Room *room, int64_t count) { return take(room, count, sizeof(int64_t)); }

/* Room for the selection of the rays and the order of the photos. */
static void place_selection(Refinement *r, Room *room)
{
    const BlockRays *all = r->all;
    r->start = take_places(room, all->points + 1), r->row = take_places(room, all->count);
    r->photo = take_places(room, all->count), r->order = take_places(room, all->photos);
    r->place = take_places(room, all->photos);
    r->photo_free = take(room, all->photos, 1), r->point_free = take(room, all->points, 1);
    int64_t *lists = take_places(room, photo_graph_space(all->count, all->photos));
    r->graph.count = all->count, r->graph.photos = all->photos, r->graph.points = all->points;
    if (room->base)
        place_lists(&r->graph, lists);
}

/* Whether a ray may take part: that of an oriented photo and of a point that has a position. */
static int may_be_used(const BlockRays *all, const double *points, int64_t row)
{
    return all->oriented[all->photo[row]] && is_known(points + 3 * all->point[row]);
}

/* Choose the rays of points that two photos see, or that are held, and return how many they are. */
static int64_t choose_rays(Refinement *r, const double *points)
{
    const BlockRays *all = r->all;
    int64_t *next = r->start, used = 0;
    memset(next, 0, (size_t)(all->points + 1) * sizeof(int64_t));
    memset(r->photo_free, 0, (size_t)all->photos);
    for (int64_t row = 0; row < all->count; row++)
        next[all->point[row]] += may_be_used(all, points, row);
    for (int64_t point = 0; point < all->points; point++) {
        const int64_t number = next[point] >= 2 || all->held[point] ? next[point] : 0;
        r->point_free[point] = number > 0 && !all->held[point];
        next[point] = number ? used : -1, used += number;
    }
    for (int64_t row = 0; row < all->count; row++) {
        const int64_t point = all->point[row], photo = all->photo[row];
        if (next[point] < 0 || !may_be_used(all, points, row))
            continue;
        r->row[next[point]] = row, r->photo[next[point]++] = photo;
        r->photo_free[photo] = 1;
    }
    /* each has moved on to where the rays of the next one begin */
    int64_t end = 0;
    for (int64_t point = 0; point <= all->points; point++) {
        const int64_t next_end = point < all->points && next[point] >= 0 ? next[point] : end;
        r->start[point] = end, end = next_end;
    }
    return used;
}

/* Room for a state of the block. */
static void place_state(const Refinement *r, BlockState *at, Room *room)
{
    const BlockRays *all = r->all;
    const int64_t count = r->n.count;
    at->rotations = take_numbers(room, 9 * all->photos), at->centres = take_numbers(room, 3 * all->photos);
    at->points = take_numbers(room, 3 * all->points), at->corrections = take_numbers(room, OF_CAMERA * all->cameras);
    at->vectors = take_numbers(room, 3 * count), at->squares = take_numbers(room, count);
    at->lengths = take_numbers(room, count), at->weights = take_numbers(room, count);
}

/* Room for the equations and three states: the best, the one from which the next step is taken, and where it leads. */
static void place_equations(Refinement *r, Room *room)
{
    RefinementProblem *n = &r->n;
    const int64_t cameras = n->cameras, width = OF_CAMERA * cameras;
    r->error = take_numbers(room, n->count), r->by_camera = take_numbers(room, cameras ? 2 * OF_CAMERA * n->count : 0);
    r->camera = take_places(room, cameras ? n->count : 0);
    n->seen = take_places(room, cameras);
    n->photo_normals = take_numbers(room, 6 * n->size), n->coupling = take_numbers(room, 18 * n->count);
    n->inverse = take_numbers(room, 9 * n->point_count), n->point_right = take_numbers(room, 3 * n->point_count);
    n->band = take_numbers(room, n->size * n->width), n->right = take_numbers(room, n->size);
    n->border = take_numbers(room, n->size * width), n->point_border = take_numbers(room, 3 * n->point_count * width);
    n->camera_normals = take_numbers(room, width * width), n->camera_right = take_numbers(room, width);
    for (int k = 0; k < 3; k++)
        place_state(r, r->states + k, room);
}

/* Partials of a residual, computed minus measured, by the corrections of its camera; those by the first are the
 * computed coordinates, for which 1 stands. See camera_corrections.py.
 */
static void partials_by_camera(const double *v, const uint8_t *unknown, double *partials)
{
    const double radial = (v[0] * v[0] + v[1] * v[1]) / (v[2] * v[2]);
    const double rows[2][OF_CAMERA] = {{1.0, v[2], 0.0, -radial * v[0]}, {1.0, 0.0, v[2], -radial * v[1]}};
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < OF_CAMERA; k++)
            partials[OF_CAMERA * i + k] = unknown[k] ? rows[i][k] : 0.0;
}

static void take_rays(Refinement *r)
{
    const BlockRays *all = r->all;
    for (int64_t k = 0; k < r->n.count; k++) {
        r->error[k] = all->error[r->row[k]];
        if (!all->cameras)
            continue;
        r->camera[k] = all->camera_of_photo[r->photo[k]];
        if (r->camera[k] >= 0)
            partials_by_camera(all->vectors + 3 * r->row[k], all->unknown + OF_CAMERA * r->camera[k],
                               r->by_camera + 2 * OF_CAMERA * k);
    }
}

/* The rays of a state: image vectors with the cameras corrected, residuals, and what the corrections add. */
static void see_rays(Refinement *r, BlockState *at)
{
    for (int64_t k = 0; k < r->n.count; k++) {
        const double *v = r->all->vectors + 3 * r->row[k];
        double *to = at->vectors + 3 * k;
        memcpy(to, v, 3 * sizeof(double));
        if (!r->n.cameras || r->camera[k] < 0)
            continue;
        const double *c = at->corrections + OF_CAMERA * r->camera[k];
        const double factor = 1.0 + c[3] * (v[0] * v[0] + v[1] * v[1]) / (v[2] * v[2]);
        to[0] = factor * v[0] - c[1] * v[2], to[1] = factor * v[1] - c[2] * v[2], to[2] = v[2] * exp(c[0]);
    }
    block_residuals(&r->n, at);
    at->of_cameras = 0.0;
    for (int64_t k = 0; k < OF_CAMERA * r->n.cameras; k++) {
        const double u = at->corrections[k] / r->rules->expected[k % OF_CAMERA];
        at->of_cameras += u * u;
    }
}

/* Danish weights of the residuals of a state, whose scale is their median over that of good ones, at least 1. */
static void weigh(const Refinement *r, BlockState *at)
{
    const int64_t count = r->n.count;
    at->scale = 0.0;
    if (r->unit > 0.0) {
        memcpy(at->weights, at->lengths, (size_t)count * sizeof(double));
        at->scale = median_of(at->weights, count) / r->unit;
    }
    for (int64_t row = 0; row < count; row++)
        at->weights[row] = danish_weight(at->lengths[row] / larger(at->scale, 1.0), r->rules->limit, r->rules->floor);
}

/* The square sum of a state with the weights of a state. */
static double cost_of(const Refinement *r, const BlockState *at, const BlockState *weights)
{
    double sum = 0.0;
    for (int64_t row = 0; row < r->n.count; row++)
        sum += weights->weights[row] * at->squares[row];
    return sum + at->of_cameras;
}

static int has_converged(const Refinement *r, const BlockState *before, const BlockState *after)
{
    const double cost = cost_of(r, before, before), scale = larger(before->scale, 1.0);
    const double gain = cost - cost_of(r, after, before), reweighted = fabs(cost - cost_of(r, after, after));
    const double relative = r->rules->enough * cost;
    return (reweighted < gain ? reweighted : gain) <= (relative != 0.0 ? relative : r->rules->gain * scale * scale);
}

static int step_from(Refinement *r, const BlockState *at, double damping, BlockState *to)
{
    r->n.at = at, r->n.damping = damping;
    block_normals(&r->n);
    if (!solve_block(&r->n, at->corrections))
        return 0;
    move_block(&r->n, at, r->rules->largest_turn, r->all->photos, to);
    see_rays(r, to);
    return 1;
}

static void exchange(BlockState **one, BlockState **other)
{
    BlockState *kept = *one;
    *one = *other, *other = kept;
}

/* Steps with Marquardt's damping, of which some may lead uphill: along a curved valley a full step often does, and the
 * next one leads far down. If two such steps do not help, the iterations go back to the best estimate with more damping,
 * and no further uphill steps are taken. Returns how many were made, `REFINEMENT_INTERRUPTED` if the user interrupted
 * them; `found` is the best state.
 */
static int64_t iterate(Refinement *r, BlockState **found)
{
    const RefinementRules *rules = r->rules;
    BlockState *best = r->states, *trusted = r->states + 1, *tried = r->states + 2;
    double damping = rules->first_damping, steps_left = rules->uphill_steps;
    int on_trust = 0, refused = 0, done = 0;
    int64_t iteration = 0;
    while (!done && (double)iteration < rules->most_steps) {
        if (PyErr_CheckSignals())
            return REFINEMENT_INTERRUPTED;
        iteration++;
        if (!step_from(r, on_trust ? trusted : best, damping, tried)) {
            damping *= 10.0, on_trust = 0;
            continue;
        }
        const double before = cost_of(r, best, best), after = cost_of(r, tried, best);
        const int was_on_trust = on_trust, is_better = after <= before;
        on_trust = !is_better && steps_left > 0.0 && after <= rules->uphill * before;
        if (is_better || on_trust)
            weigh(r, tried);
        if (is_better) {
            damping = larger(damping * (refused ? 1.0 : 0.1), rules->least_damping), refused = 0;
            steps_left = steps_left >= 0.0 ? rules->uphill_steps : steps_left;
            done = has_converged(r, best, tried);
            exchange(&best, &tried);
        } else if (on_trust) {
            steps_left -= 1.0;
            exchange(&trusted, &tried);
        } else {
            /* two steps uphill that led nowhere are not tried again */
            steps_left = was_on_trust ? -1.0 : steps_left;
            damping *= 10.0, refused = 1;
        }
    }
    *found = best;
    return iteration;
}

/* The middle of the oriented photos, and the mean distance of points from photos. */
static OwnSystem own_system(const Refinement *r, const double *centres, const double *points)
{
    OwnSystem own = {{0.0}, 0.0};
    double oriented = 0.0;
    for (int64_t photo = 0; photo < r->all->photos; photo++)
        for (int i = 0; i < 3 && r->all->oriented[photo]; i++)
            own.base[i] += centres[3 * photo + i], oriented += i == 0;
    for (int i = 0; i < 3; i++)
        own.base[i] /= oriented;
    for (int64_t point = 0; point < r->all->points; point++)
        for (int64_t row = r->start[point]; row < r->start[point + 1]; row++) {
            const double *X = points + 3 * point, *O = centres + 3 * r->photo[row];
            const double d[3] = {X[0] - O[0], X[1] - O[1], X[2] - O[2]};
            own.size += sqrt(dot3(d, d)) / (double)r->n.count;
        }
    return own;
}

static void to_own_system(const OwnSystem *own, const double *from, int64_t count, double *to)
{
    for (int64_t k = 0; k < 3 * count; k++)
        to[k] = (from[k] - own->base[k % 3]) / own->size;
}

/* Take over what has been free; all else keeps its last digit. */
static void from_own_system(const OwnSystem *own, const double *from, const uint8_t *is_free, int64_t count, double *to)
{
    for (int64_t k = 0; k < 3 * count; k++)
        to[k] = is_free[k / 3] ? own->base[k % 3] + own->size * from[k] : to[k];
}

/* The median length of residuals that are as large as expected: the fewer are redundant the shorter they are. */
static double expected_median(const Refinement *r)
{
    int64_t redundant = 2 * r->n.count - r->n.size;
    for (int64_t point = 0; point < r->all->points; point++)
        redundant -= r->point_free[point] ? 3 : 0;
    return redundant > 0 ? r->rules->median * sqrt((double)redundant / (double)(2 * r->n.count)) : 0.0;
}

/* Order the photos, and say how large the equations are. */
static void size_equations(Refinement *r)
{
    RefinementProblem *n = &r->n;
    PhotoGraph *g = &r->graph;
    g->photo = r->photo, g->start = r->start, g->photo_free = r->photo_free, g->point_free = r->point_free;
    g->count = n->count;
    order_photos(g, r->order, r->place);
    const int64_t places = places_of_a_point(g, r->place);
    n->width = 6 * (places > 1 ? places : 1), n->size = 0;
    for (int64_t photo = 0; photo < r->all->photos; photo++)
        n->size += 6 * r->photo_free[photo];
    n->point_count = r->all->points, n->cameras = r->all->cameras, n->expected = r->rules->expected;
    n->photo = r->photo, n->start = r->start, n->place = r->place, n->is_free = r->point_free;
}

/* Refine what stands in `to`, the rays of which take part; `weights` are those of all rays. */
static int64_t refine_chosen(Refinement *r, BlockState *to)
{
    const int64_t photos = r->all->photos, points = r->all->points;
    BlockState *at = r->states;
    r->n.error = r->error, r->n.camera = r->camera, r->n.by_camera = r->by_camera;
    take_rays(r);
    r->own = own_system(r, to->centres, to->points), r->unit = expected_median(r);
    memcpy(at->rotations, to->rotations, (size_t)(9 * photos) * sizeof(double));
    memcpy(at->corrections, to->corrections, (size_t)(OF_CAMERA * r->all->cameras) * sizeof(double));
    to_own_system(&r->own, to->centres, photos, at->centres);
    to_own_system(&r->own, to->points, points, at->points);
    see_rays(r, at);
    weigh(r, at);
    const int64_t iterations = iterate(r, &at);
    if (iterations < 0)
        return iterations;
    memcpy(to->corrections, at->corrections, (size_t)(OF_CAMERA * r->all->cameras) * sizeof(double));
    for (int64_t photo = 0; photo < photos; photo++)
        if (r->photo_free[photo])
            memcpy(to->rotations + 9 * photo, at->rotations + 9 * photo, 9 * sizeof(double));
    from_own_system(&r->own, at->centres, r->photo_free, photos, to->centres);
    from_own_system(&r->own, at->points, r->point_free, points, to->points);
    for (int64_t k = 0; k < r->n.count; k++)
        to->weights[r->row[k]] = at->weights[k];
    to->scale = at->scale;
    return iterations;
}

/* Refine rotations, centres, points and corrections, and say how many steps were made; `scale` is that of the
 * residuals, 0 without redundancy.
 */
static int64_t refine_block(const BlockRays *all, const RefinementRules *rules, BlockState *to)
{
    Refinement r = {.all = all, .rules = rules};
    Room selection = {0}, equations = {0};
    place_selection(&r, &selection);
    selection = (Room){malloc(selection.used), 0};
    if (!selection.base)
        return REFINEMENT_WITHOUT_ROOM;
    place_selection(&r, &selection);
    int64_t iterations = 0;
    to->scale = 0.0;
    memset(to->weights, 0, (size_t)all->count * sizeof(double));
    r.n.count = choose_rays(&r, to->points);
    if (r.n.count) {
        size_equations(&r);
        place_equations(&r, &equations);
        equations = (Room){malloc(equations.used), 0};
        iterations = REFINEMENT_WITHOUT_ROOM;
        if (equations.base) {
            place_equations(&r, &equations);
            iterations = refine_chosen(&r, to);
        }
        free(equations.base);
    }
    free(selection.base);
    return iterations;
}
