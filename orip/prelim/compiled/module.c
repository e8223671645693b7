/* Inner loops of preliminary values: intersection, relative orientation, resection,
 * similarity, refinement.
 *
 * The headers stand beside the Python modules that they serve; the compiled package binds them. The sizes of arrays and
 * the contents of index arrays are checked here.
 */

#include "../../array_arguments.h"

#include "../intersection/intersection.h"
#include "../refinement/robust_iterations.h"
#include "../relative/pair_loops.h"
#include "../resection/resection_loops.h"
#include "../similarity/adjustment.h"
#include "../similarity/joining.h"

static const PairLoops *pairs = &plain_pairs;
static const ResectionLoops *resections = &plain_resections;

#define NUMBERS_IN(type) (sizeof(type) / sizeof(double))

#define MOST_ITERATIONS 1e6

/* Numbers that rules allow of samples, matrices and starts: what is kept of them has to find room. */
#define MOST_KEPT 1e4

/* Triples of points; so many, and all that is kept of each point for each, still are a number of bytes. */
#define MOST_TRIPLES (INT64_C(1) << 20)

static int are_rows(const Arguments *a, int array, int64_t end)
{
    return are_within64(a->views[array].buf, length_of(a, array), 0, end);
}

static int known_from(const Arguments *a, Known *k)
{
    *k = (Known){a->views[0].buf, a->views[1].buf, a->views[2].buf, a->numbers[0], length_of(a, 2), 0};
    if (!is_whole(a->numbers[1], 1.0, (double)k->count))
        return 0;
    k->least = (int64_t)a->numbers[1];
    return HAVE(a, 0, 3 * k->count, 3 * k->count);
}

static PyObject *py_rank_triples(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { TRIPLES = 3, ROTATIONS, CENTRES, QUANTILES };
    Arguments a;
    Known k;
    if (!take_arguments(&a, arguments, given, "dddl" "DDD", 3))
        return NULL;
    const int64_t number = length_of(&a, TRIPLES) / 3, kept = length_of(&a, QUANTILES);
    if (!known_from(&a, &k) || !are_rows(&a, TRIPLES, k.count) || !HAVE(&a, ROTATIONS, 9 * kept, 3 * kept))
        return refused(&a);
    double *space = room_of(&a, (size_t)(SPACE_TO_RANK * k.count) * sizeof(double));
    if (!space)
        return NULL;
    resections->rank_triples(&k, a.views[TRIPLES].buf, number, a.numbers[2], kept, a.views[ROTATIONS].buf,
                             a.views[CENTRES].buf, a.views[QUANTILES].buf, space);
    return done(&a);
}

static PyObject *py_best_orientations(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { ROTATIONS = 3, CENTRES, SQUARES, FACTORS, RESIDUAL, NORMALS, SPACE };
    Arguments a;
    Known k;
    if (!take_arguments(&a, arguments, given, "ddd" "DDDDDDD", 12))
        return NULL;
    const double *n = a.numbers;
    const int64_t number = length_of(&a, CENTRES) / 3;
    if (!known_from(&a, &k) || number < 1 || number > MOST_ORIENTATIONS || !(n[3] >= 0.0)
        || !is_whole(n[6], 0.0, MOST_ITERATIONS) || !is_whole(n[10], 0.0, MOST_ITERATIONS)
        || !HAVE(&a, ROTATIONS, 9 * number, 3 * number, number * k.count, number * k.count, 2 * k.count, 36,
                 2 * NUMBERS_OF_A_POINT * k.count))
        return refused(&a);
    const OrientationChoice choice = {n[2], n[3], n[4], n[5], n[11], (int64_t)n[6],
                                      {n[2], n[7], n[8], n[9], n[11], (int64_t)n[10]}};
    const int64_t left = resections->choose_orientations(&k, &choice, number, a.views[ROTATIONS].buf, a.views[CENTRES].buf,
                                a.views[SQUARES].buf, a.views[FACTORS].buf, a.views[RESIDUAL].buf,
                                a.views[NORMALS].buf, a.views[SPACE].buf);
    return done_with(&a, PyLong_FromLongLong(left));
}

/* Whether what these rules repeat and choose from are numbers that there is time and room for. */
static int are_resection_rules_sound(const ResectionRules *r)
{
    return r->alike >= 0.0 && is_whole(r->improvements, 0.0, MOST_ITERATIONS)
        && is_whole(r->iterations, 0.0, MOST_ITERATIONS);
}

static PyObject *py_resect(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { IMAGE, KNOWN, DEVIATIONS, TRIPLES, RULES, ROTATIONS, CENTRES, FACTORS, RESIDUAL, FOUND };
    Arguments a;
    Known k;
    if (!take_arguments(&a, arguments, given, "dddld" "DDDDD", 2))
        return NULL;
    const int64_t candidates = length_of(&a, CENTRES) / 3, number = length_of(&a, TRIPLES) / 3;
    if (!known_from(&a, &k) || k.count <= 3 || !are_rows(&a, TRIPLES, k.count) || candidates < 1
        || candidates > MOST_ORIENTATIONS
        || !HAVE(&a, TRIPLES, 3 * number, NUMBERS_IN(ResectionRules), 9 * candidates, 3 * candidates,
                 candidates * k.count, 2 * k.count, NUMBERS_IN(ResectionFound))
        || !are_resection_rules_sound(a.views[RULES].buf))
        return refused(&a);
    double *space = room_of(&a, (size_t)resections->space(k.count, candidates) * sizeof(double));
    if (!space)
        return NULL;
    const int64_t left = resections->resect_photo(a.views[KNOWN].buf, a.views[DEVIATIONS].buf, k, a.views[RULES].buf,
                                      a.views[TRIPLES].buf, number, candidates, a.views[ROTATIONS].buf,
                                      a.views[CENTRES].buf, a.views[FACTORS].buf, a.views[RESIDUAL].buf, space,
                                      a.views[FOUND].buf);
    return done_with(&a, PyLong_FromLongLong(left));
}

static PyObject *py_fitting_points(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { STARTS, IMAGE, KNOWN, DEVIATIONS, ERRORS, EXTENTS, LEAST, TRIPLES, CORNERS, RULES, JUDGEMENT, ROTATIONS,
           CENTRES, FITS, FOUND };
    Arguments a;
    if (!take_arguments(&a, arguments, given, "ldddddlll" "ddDDBB", 1))
        return NULL;
    const int64_t photos = length_of(&a, LEAST), count = length_of(&a, DEVIATIONS), all = length_of(&a, TRIPLES) / 3;
    const int64_t *starts = a.views[STARTS].buf, *least = a.views[LEAST].buf, *corners = a.views[CORNERS].buf;
    const double *errors = a.views[ERRORS].buf, *extents = a.views[EXTENTS].buf;
    int sound = HAVE(&a, STARTS, photos + 1, 3 * count, 3 * count, count, photos, photos, photos, 3 * all, 2 * photos,
                     NUMBERS_IN(ResectionRules), NUMBERS_IN(PhotoJudgement), 9 * photos, 3 * photos, count, photos)
        && are_starts64(starts, photos, count) && are_resection_rules_sound(a.views[RULES].buf)
        && is_whole(a.numbers[0], 1.0, MOST_ORIENTATIONS) && are_within64(corners, 2 * photos, 0, all + 1);
    int64_t most = 0;
    for (int64_t photo = 0; sound && photo < photos; photo++) {
        const int64_t n = starts[photo + 1] - starts[photo], first = corners[2 * photo], end = corners[2 * photo + 1];
        sound = n > 3 && least[photo] >= 1 && least[photo] <= n && first <= end
            && are_within64((const int64_t *)a.views[TRIPLES].buf + 3 * first, 3 * (end - first), 0, n);
        most = n > most ? n : most;
    }
    if (!sound)
        return refused(&a);
    const int64_t candidates = (int64_t)a.numbers[0];
    double *space = room_of(&a, (size_t)(resections->fitting_space(most, candidates) + 1) * sizeof(double));
    if (!space)
        return NULL;
    for (int64_t photo = 0; photo < photos; photo++) {
        const int64_t first = starts[photo], n = starts[photo + 1] - first;
        const PhotoToFit to_fit = {
            {(const double *)a.views[IMAGE].buf + 3 * first, NULL, NULL, errors[photo], n, least[photo]},
            (const double *)a.views[KNOWN].buf + 3 * first, (const double *)a.views[DEVIATIONS].buf + first,
            (const int64_t *)a.views[TRIPLES].buf + 3 * corners[2 * photo],
            corners[2 * photo + 1] - corners[2 * photo], extents[photo]};
        ((uint8_t *)a.views[FOUND].buf)[photo] =
            (uint8_t)resections->mark_fitting(&to_fit, a.views[RULES].buf, a.views[JUDGEMENT].buf, candidates, space,
                                  (double *)a.views[ROTATIONS].buf + 9 * photo,
                                  (double *)a.views[CENTRES].buf + 3 * photo, (uint8_t *)a.views[FITS].buf + first);
    }
    return done(&a);
}

/* Photo points, and the orientations of their photos. */
enum { PHOTO, OF_POINT, VECTORS, ERROR, TURNED, AT };

/* The rays of a block, whose points stand in the order of `point`, or in any; a third index says what is oriented. */
static int rays_from(const Arguments *a, int64_t points, OrientedRays *r)
{
    const Py_buffer *v = a->views;
    const int64_t n = length_of(a, ERROR), photos = length_of(a, AT) / 3;
    *r = (OrientedRays){v[PHOTO].buf, v[OF_POINT].buf, v[VECTORS].buf, v[ERROR].buf, v[TURNED].buf, v[AT].buf, NULL, n,
                        points};
    return has(a, PHOTO, n) && are_rows(a, PHOTO, photos) && HAVE(a, VECTORS, 3 * n, n, 9 * photos, 3 * photos);
}

static PyObject *py_intersect(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { ORIENTED = 6, POINTS, DEVIATIONS, FACTORS, ANGLES };
    Arguments a;
    OrientedRays rays;
    if (!take_arguments(&a, arguments, given, "lldd" "ddb" "DDDD", 9))
        return NULL;
    const double *n = a.numbers;
    const int64_t points = length_of(&a, ANGLES);
    if (!rays_from(&a, points, &rays) || !has(&a, OF_POINT, rays.count) || !are_rows(&a, OF_POINT, points)
        || !HAVE(&a, ORIENTED, length_of(&a, AT) / 3, 3 * points, 3 * points, rays.count)
        || !(n[0] >= 0.0 && n[0] <= 1.0) || !is_whole(n[6], 0.0, MOST_ITERATIONS)
        || !is_whole(n[7], 0.0, MOST_ITERATIONS) || !is_whole(n[8], 0.0, MOST_ITERATIONS))
        return refused(&a);
    rays.oriented = a.views[ORIENTED].buf;
    void *space = room_of(&a, bundle_space(rays.count, points));
    if (!space)
        return NULL;
    Intersecting how = {n[0], n[1], n[2], {1.0, 0.0, n[3], n[4], n[5], (int64_t)n[6], (int64_t)n[7], (int64_t)n[8]}};
    const double s0 = intersect_all(&rays, &how, a.views[POINTS].buf, a.views[DEVIATIONS].buf, a.views[FACTORS].buf,
                                    a.views[ANGLES].buf, space);
    return done_with(&a, PyFloat_FromDouble(s0));
}

static PyObject *py_consensus(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { ORIENTED = 6, DOUBTFUL, POINTS };
    Arguments a;
    OrientedRays rays;
    if (!take_arguments(&a, arguments, given, "lldd" "ddbb" "D", 2))
        return NULL;
    const int64_t points = length_of(&a, OF_POINT) - 1;
    if (points < 0 || !rays_from(&a, points, &rays) || !are_starts64(rays.point, points, rays.count)
        || !HAVE(&a, ORIENTED, length_of(&a, AT) / 3, points, 3 * points))
        return refused(&a);
    rays.oriented = a.views[ORIENTED].buf;
    find_consensus(&rays, a.views[DOUBTFUL].buf, a.numbers[0], a.numbers[1], a.views[POINTS].buf);
    return done(&a);
}

static PyObject *py_residual_lengths(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { POINTS = 6, LENGTHS };
    Arguments a;
    OrientedRays rays;
    if (!take_arguments(&a, arguments, given, "lldd" "ddd" "D", 0))
        return NULL;
    const int64_t points = length_of(&a, POINTS) / 3;
    if (!rays_from(&a, points, &rays) || !has(&a, OF_POINT, rays.count) || !are_rows(&a, OF_POINT, points)
        || !HAVE(&a, POINTS, 3 * points, rays.count))
        return refused(&a);
    int64_t *together = room_of(&a, (size_t)points * sizeof(int64_t));
    if (!together)
        return NULL;
    residual_lengths(&rays, a.views[POINTS].buf, together, a.views[LENGTHS].buf);
    return done(&a);
}

static PyObject *py_refine(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { POINT = 1, CAMERA = 4, UNKNOWN, ORIENTED, HELD, RULES, ROTATIONS, CENTRES, POINTS, CORRECTIONS, WEIGHTS, SCALE };
    Arguments a;
    if (!take_arguments(&a, arguments, given, "lldd" "lbbbd" "DDDDDD", 0))
        return NULL;
    const RefinementRules *rules = a.views[RULES].buf;
    const BlockRays all = {a.views[PHOTO].buf,       a.views[POINT].buf,   a.views[CAMERA].buf,
                           a.views[VECTORS].buf,     a.views[ERROR].buf,   a.views[ORIENTED].buf,
                           a.views[HELD].buf,        a.views[UNKNOWN].buf, length_of(&a, ERROR),
                           length_of(&a, ORIENTED),  length_of(&a, HELD),  length_of(&a, CORRECTIONS) / OF_CAMERA};
    if (!HAVE(&a, PHOTO, all.count, all.count, 3 * all.count, all.count, all.cameras ? all.photos : 0,
              OF_CAMERA * all.cameras, all.photos, all.points, NUMBERS_IN(RefinementRules), 9 * all.photos,
              3 * all.photos, 3 * all.points, OF_CAMERA * all.cameras, all.count, 1)
        || !are_rows(&a, PHOTO, all.photos) || !are_rows(&a, POINT, all.points)
        || !are_within64(all.camera_of_photo, length_of(&a, CAMERA), INT64_MIN, all.cameras)
        || !is_whole(rules->most_steps, 0.0, MOST_ITERATIONS))
        return refused(&a);
    if (!find_lapack())
        return done_with(&a, NULL);
    BlockState block = {.rotations = a.views[ROTATIONS].buf, .centres = a.views[CENTRES].buf,
                        .points = a.views[POINTS].buf, .corrections = a.views[CORRECTIONS].buf,
                        .weights = a.views[WEIGHTS].buf};
    const int64_t iterations = refine_block(&all, rules, &block);
    *(double *)a.views[SCALE].buf = block.scale;
    release(&a);
    if (iterations == REFINEMENT_WITHOUT_ROOM)
        return PyErr_NoMemory();
    return iterations == REFINEMENT_INTERRUPTED ? NULL : PyLong_FromLongLong(iterations);
}

/* Whether what these rules keep and repeat are numbers that there is room and time for. */
static int are_rules_sound(const RelativeRules *r)
{
    return is_whole(r->sampling.at_once, 1.0, MOST_KEPT) && is_whole(r->sampling.kept, 1.0, MOST_KEPT)
        && is_whole(r->sampling.starts, 1.0, MOST_KEPT) && is_whole(r->danish.held, 0.0, MOST_ITERATIONS)
        && is_whole(r->choice.to_compare, 1.0, MOST_ITERATIONS) && is_whole(r->choice.most, 1.0, MOST_ITERATIONS)
        && is_whole(r->choice.rotation_steps, 0.0, MOST_ITERATIONS);
}

/* The arrays of an orientation of two photos; after them come samples, and redundancy numbers without a scale. */
enum { LEFT, RIGHT, ERRORS, SETS, RULES, FOUND, PARALLAX, WEIGHTS, COORDINATES, DEVIATIONS, IN_FRONT, USABLE, SAMPLES,
       REDUNDANCY };
#define OF_PAIR "ddddd" "DDDDDBB"

typedef struct {
    Arguments a;
    Pairs p;
    RelativePoints points;
    const RelativeRules *rules;
    const int64_t *sample;
    int64_t samples;
    double *space;
} PairCall;

/* What is given of two photos, with room for what is found of their points; else an exception is set. */
static int take_pair(PairCall *c, PyObject *const *arguments, Py_ssize_t given, const char *kinds, int numbers)
{
    Arguments *a = &c->a;
    if (!take_arguments(a, arguments, given, kinds, numbers))
        return 0;
    const Py_buffer *v = a->views;
    const int sampled = a->opened > SAMPLES, free_scale = a->opened > REDUNDANCY;
    const int64_t n = length_of(a, ERRORS);
    c->p = (Pairs){v[LEFT].buf, v[RIGHT].buf, v[ERRORS].buf, n};
    c->points = (RelativePoints){v[PARALLAX].buf, v[WEIGHTS].buf, free_scale ? v[REDUNDANCY].buf : NULL,
                                 v[COORDINATES].buf, v[DEVIATIONS].buf, v[IN_FRONT].buf, v[USABLE].buf};
    c->rules = v[RULES].buf, c->sample = sampled ? v[SAMPLES].buf : NULL;
    c->samples = sampled ? length_of(a, SAMPLES) / 5 : 0;
    if (n < 5 || !HAVE(a, LEFT, 3 * n, 3 * n, n, n - 5, NUMBERS_IN(RelativeRules), NUMBERS_IN(RelativeFound), n, n,
                       3 * n, 3 * n, n, n)
        || !are_rules_sound(c->rules) || (sampled && !are_rows(a, SAMPLES, n)) || (free_scale && !has(a, REDUNDANCY, n))
        || (sampled && !free_scale && (double)c->samples > c->rules->sampling.at_once)) {
        refused(a);
        return 0;
    }
    c->space = room_of(a, (size_t)pairs->space(c->rules, n) * sizeof(double));
    return c->space != NULL;
}

static PyObject *py_orient_pair(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    PairCall c;
    if (!take_pair(&c, arguments, given, OF_PAIR "l" "D", 0))
        return NULL;
    return done_with(&c.a, PyBool_FromLong(pairs->orient(&c.p, c.rules, c.sample, c.samples, c.a.views[SETS].buf,
                                                         c.space, &c.points, c.a.views[FOUND].buf)));
}

static PyObject *py_orient_at_scale(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    PairCall c;
    if (!take_pair(&c, arguments, given, OF_PAIR "l", 1))
        return NULL;
    const int oriented = pairs->orient_at_scale(&c.p, c.rules, c.sample, c.samples, c.a.views[SETS].buf, c.a.numbers[0],
                                                c.space, &c.points, c.a.views[FOUND].buf);
    return done_with(&c.a, PyBool_FromLong(oriented));
}

static PyObject *py_adjust_at_scale(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    PairCall c;
    if (!take_pair(&c, arguments, given, OF_PAIR, 1))
        return NULL;
    return done_with(&c.a, PyBool_FromLong(pairs->adjust_at_scale(&c.p, c.rules, c.a.views[SETS].buf, c.a.numbers[0],
                                                                  c.space, &c.points, c.a.views[FOUND].buf)));
}

static int are_similarity_rules_sound(const SimilarityRules *r)
{
    return is_whole(r->steps, 0.0, MOST_ITERATIONS) && is_whole(r->free_steps, 0.0, MOST_ITERATIONS);
}

static PyObject *py_adjust_similarity(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { SOURCE, TARGET, SOURCE_DEVIATION, TARGET_DEVIATION, TRUSTED, RULES, FOUND, FACTORS, RESIDUALS, SPACE };
    Arguments a;
    if (!take_arguments(&a, arguments, given, "ddddbd" "DDDD", 1))
        return NULL;
    const int64_t count = length_of(&a, TRUSTED);
    const SimilarityRules *rules = a.views[RULES].buf;
    if (!is_whole(a.numbers[0], 1.0, MOST_UNKNOWNS)
        || !HAVE(&a, SOURCE, 3 * count, 3 * count, 3 * count, 3 * count, count, NUMBERS_IN(SimilarityRules),
                 NUMBERS_IN(SimilarityFound), 3 * count, 3 * count, 12 * count)
        || !are_similarity_rules_sound(rules))
        return refused(&a);
    Common common = {NULL, a.views[TARGET].buf, NULL, a.views[TRUSTED].buf, count, (int64_t)a.numbers[0]};
    const int regular = adjust_similarity(&common, a.views[SOURCE].buf, a.views[SOURCE_DEVIATION].buf,
                                          a.views[TARGET_DEVIATION].buf, rules, a.views[FACTORS].buf,
                                          a.views[RESIDUALS].buf, a.views[SPACE].buf, a.views[FOUND].buf);
    return done_with(&a, PyBool_FromLong(regular));
}

static PyObject *py_best_triple(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { SOURCE, TARGET, SOURCE_DEVIATION, TARGET_DEVIATION, TRIPLES, START };
    Arguments a;
    if (!take_arguments(&a, arguments, given, "ddddl" "D", 4))
        return NULL;
    const double *n = a.numbers;
    const int64_t count = length_of(&a, SOURCE) / 3, triples = length_of(&a, TRIPLES) / 3;
    if (!is_whole(n[0], 1.0, (double)count) || triples > MOST_TRIPLES || !are_rows(&a, TRIPLES, count)
        || !HAVE(&a, SOURCE, 3 * count, 3 * count, 3 * count, 3 * count, 3 * triples, NUMBERS_IN(At)))
        return refused(&a);
    double *space = room_of(&a, (size_t)((5 + triples) * count) * sizeof(double) + (size_t)triples * sizeof(At));
    if (!space)
        return NULL;
    const Judges judges = {a.views[SOURCE].buf, a.views[TARGET].buf, space, space + count, space + 2 * count, count};
    prepare_judges(&judges, a.views[SOURCE_DEVIATION].buf, a.views[TARGET_DEVIATION].buf);
    const Judgement judgement = {(int64_t)n[0], n[1], n[2], n[3]};
    const double most = best_triple(&judges, &judgement, a.views[TRIPLES].buf, triples, space + 3 * count,
                                    a.views[START].buf);
    return done_with(&a, PyFloat_FromDouble(most));
}

static PyObject *py_assemble(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { POINTS, PHOTOS, COORDINATES, DEVIATIONS, ROTATIONS, CENTRES, STARTS, WHOLE };
    Arguments a;
    if (!take_arguments(&a, arguments, given, "lldddd" "l" "LLDDDD", 1))
        return NULL;
    const Py_buffer *v = a.views, *w = v + WHOLE;
    const BlocksOfOneSystem blocks = {v[POINTS].buf, v[PHOTOS].buf, v[COORDINATES].buf, v[DEVIATIONS].buf,
                                      v[ROTATIONS].buf, v[CENTRES].buf, v[STARTS].buf, length_of(&a, STARTS) - 1,
                                      length_of(&a, POINTS), length_of(&a, PHOTOS)};
    const AssembledBlock whole = {w[0].buf, w[1].buf, w[2].buf, w[3].buf, w[4].buf, w[5].buf};
    const int64_t lengths[] = {blocks.count, blocks.photo_count, 3 * blocks.count, 3 * blocks.count,
                               9 * blocks.photo_count, 3 * blocks.photo_count};
    if (blocks.blocks < 0 || !are_starts64(blocks.starts, blocks.blocks, blocks.count) || !have(&a, POINTS, 6, lengths)
        || !have(&a, WHOLE, 6, lengths))
        return refused(&a);
    double *space = room_of(&a, space_to_assemble(blocks.count, blocks.photo_count));
    if (!space)
        return NULL;
    int64_t *places = (int64_t *)(space + 4 * blocks.count);
    const int64_t photos = assemble_photos(&blocks, places, &whole);
    const int64_t points = assemble_points(&blocks, a.numbers[0], space, places, &whole);
    return done_with(&a, Py_BuildValue("LL", (long long)photos, (long long)points));
}

/* The arrays of one of two partial blocks, of which four follow one another and the two of places stand apart. */
static int part_from(const Arguments *a, int first, int places, PartOfTwo *p)
{
    const Py_buffer *v = a->views + first, *at = a->views + places;
    const int64_t count = length_of(a, first) / 3, photos = length_of(a, first + 3) / 3;
    *p = (PartOfTwo){v[0].buf, v[1].buf, v[2].buf, v[3].buf, at[0].buf, at[1].buf, count};
    return HAVE(a, first, 3 * count, 3 * count, 9 * photos, 3 * photos) && are_rows(a, places, count)
        && are_rows(a, places + 1, photos);
}

static PyObject *py_common_places(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { SOURCE, TARGET = 4, AT_SOURCE = 8, PHOTOS, AT_TARGET, PHOTOS_OF_TARGET, PLACES, START = 16 };
    Arguments a;
    PartOfTwo source, target;
    if (!take_arguments(&a, arguments, given, "dddd" "dddd" "llll" "DDDDD", 5))
        return NULL;
    const double *n = a.numbers;
    const int64_t points = length_of(&a, AT_SOURCE), photos = length_of(&a, PHOTOS), count = points + photos;
    if (!part_from(&a, SOURCE, AT_SOURCE, &source) || !part_from(&a, TARGET, AT_TARGET, &target)
        || !HAVE(&a, AT_TARGET, points, photos, 3 * count, 3 * count, 3 * count, 3 * count, NUMBERS_IN(At))
        || photos > MOST_TRIPLES || !is_whole(n[1], 1.0, (double)count))
        return refused(&a);
    const int64_t larger_part = source.count > target.count ? source.count : target.count;
    double *space = room_of(&a, (size_t)(larger_part + (8 + photos) * count) * sizeof(double)
                                 + (size_t)photos * sizeof(At));
    if (!space)
        return NULL;
    double *from = a.views[PLACES].buf, *to = a.views[PLACES + 1].buf;
    double *source_deviations = a.views[PLACES + 2].buf, *target_deviations = a.views[PLACES + 3].buf;
    common_places(&source, points, photos, n[0], from, source_deviations, space);
    common_places(&target, points, photos, n[0], to, target_deviations, space);
    const Judges judges = {from, to, space, space + count, space + 2 * count, count};
    const Judgement judgement = {(int64_t)n[1], n[2], n[3], n[4]};
    start_from_photos(&source, &target, photos, &judges, source_deviations, target_deviations, &judgement, space,
                      a.views[START].buf);
    const double extent = extent_of(to, count);
    return done_with(&a, PyFloat_FromDouble(extent));
}

/* The arrays of a partial block, of which there are six. */
static int block_from(const Arguments *a, int first, PartialBlock *b)
{
    const Py_buffer *v = a->views + first;
    const int64_t count = length_of(a, first), photos = length_of(a, first + 1);
    *b = (PartialBlock){v[0].buf, v[1].buf, v[2].buf, v[3].buf, v[4].buf, v[5].buf, count, photos};
    return HAVE(a, first + 2, 3 * count, 3 * count, 9 * photos, 3 * photos) && photos <= MOST_TRIPLES;
}

static PyObject *py_join_by_photos(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { SOURCE, TARGET = 6, RULES = 12, JOINING, AT_SOURCE, TARGETS, RESIDUALS, FACTORS, COORDINATES, DEVIATIONS,
           ROTATIONS, CENTRES, FOUND };
    Arguments a;
    PartialBlock source, target;
    if (!take_arguments(&a, arguments, given, "lldddd" "lldddd" "dd" "LDDDDDDDD", 0))
        return NULL;
    const SimilarityRules *rules = a.views[RULES].buf;
    if (!block_from(&a, SOURCE, &source) || !block_from(&a, TARGET, &target))
        return refused(&a);
    const int64_t n = source.count, photos = source.photo_count, room = n + photos;
    if (!HAVE(&a, RULES, NUMBERS_IN(SimilarityRules), NUMBERS_IN(JoiningRules), n, 3 * n, 3 * room, 3 * room, 3 * n,
              3 * n, 9 * photos, 3 * photos, NUMBERS_IN(SimilarityFound))
        || !are_similarity_rules_sound(rules))
        return refused(&a);
    double *space = room_of(&a, space_to_join(&source, &target));
    if (!space)
        return NULL;
    const Py_buffer *v = a.views;
    JoinedBlock joint = {.at_source = v[AT_SOURCE].buf, .targets = v[TARGETS].buf, .residuals = v[RESIDUALS].buf,
                         .factors = v[FACTORS].buf, .coordinates = v[COORDINATES].buf, .deviations = v[DEVIATIONS].buf,
                         .rotations = v[ROTATIONS].buf, .centres = v[CENTRES].buf, .found = v[FOUND].buf};
    const int how = join_by_photos(&source, &target, rules, a.views[JOINING].buf, space, &joint);
    if (how != JOINED)
        return done_with(&a, PyBool_FromLong(how == DISAGREEING));
    return done_with(&a, Py_BuildValue("LLLL", (long long)joint.points, (long long)joint.photos,
                                       (long long)joint.first_photo, (long long)joint.unfit));
}

#define METHOD(name, text) {#name, (PyCFunction)(void (*)(void))py_##name, METH_FASTCALL, text}

static PyMethodDef methods[] = {
    METHOD(intersect, "Positions of points, wrong rays down-weighted."),
    METHOD(consensus, "Positions of points where most of their rays meet."),
    METHOD(residual_lengths, "Lengths of the residuals of rays."),
    METHOD(rank_triples, "The orientations of triples that fit all points best."),
    METHOD(best_orientations, "Orientations improved, and the likeliest adjusted."),
    METHOD(resect, "The orientation of a photo by known points."),
    METHOD(fitting_points, "Which known points fit their photos."),
    METHOD(orient_pair, "The relative orientation of two photos."),
    METHOD(orient_at_scale, "The relative orientation of two photos that most points fit at a scale."),
    METHOD(assemble, "Several partial blocks of one system as one."),
    METHOD(common_places, "What two partial blocks have in common, and a start from their common photos."),
    METHOD(join_by_photos, "A partial block in the system of another one, from their common photos."),
    METHOD(adjust_at_scale, "The relative orientation of two photos at a scale from one that is nearly right."),
    METHOD(best_triple, "The spatial similarity of three points that most others agree with."),
    METHOD(adjust_similarity, "A spatial similarity with Danish weights."),
    METHOD(refine, "Photos and points of a block adjusted together with Danish weights."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_kernels", "Inner loops of preliminary values.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__kernels(void)
{
#ifdef HAS_AVX2_LOOPS
    if (__builtin_cpu_supports("avx2"))
        pairs = &avx2_pairs, resections = &avx2_resections;
#endif
    return PyModule_Create(&definition);
}
