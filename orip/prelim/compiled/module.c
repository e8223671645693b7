/* Inner loops of preliminary values: intersection, relative orientation, resection,
 * similarity, refinement.
 *
 * The headers are in the folders of the Python modules that they serve. The sizes of arrays
 * that follow from one another are checked here, the contents of index arrays are not.
 */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <stdint.h>
#include <string.h>

#include "../intersection/intersection.h"
#include "../refinement/refinement.h"
#include "../relative/solution.h"
#include "../resection/resection.h"
#include "../similarity/adjustment.h"
#include "../similarity/start.h"

#define MOST_BUFFERS 24
#define MOST_NUMBERS 12

typedef struct {
    Py_buffer views[MOST_BUFFERS];
    double numbers[MOST_NUMBERS];
    int opened;
} Arguments;

static void release(Arguments *a)
{
    while (a->opened > 0)
        PyBuffer_Release(&a->views[--a->opened]);
}

/* Take `inputs` readable arrays, `outputs` writable ones and then numbers from the arguments. */
static int taken(Arguments *a, PyObject *const *arguments, Py_ssize_t given, int inputs, int outputs, int numbers)
{
    a->opened = 0;
    if (given != inputs + outputs + numbers) {
        PyErr_SetString(PyExc_TypeError, "wrong number of arguments");
        return 0;
    }
    for (int k = 0; k < inputs + outputs; k++) {
        const int flags = k < inputs ? PyBUF_C_CONTIGUOUS : PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE;
        if (PyObject_GetBuffer(arguments[k], &a->views[k], flags) < 0) {
            release(a);
            return 0;
        }
        a->opened++;
    }
    for (int k = 0; k < numbers; k++)
        a->numbers[k] = PyFloat_AsDouble(arguments[inputs + outputs + k]);
    if (PyErr_Occurred()) {
        release(a);
        return 0;
    }
    return 1;
}

static PyObject *refused(Arguments *a)
{
    release(a);
    PyErr_SetString(PyExc_ValueError, "arrays do not belong together");
    return NULL;
}

static PyObject *done(Arguments *a)
{
    release(a);
    Py_RETURN_NONE;
}

static int has(const Arguments *a, int view, int64_t numbers) { return a->views[view].len == 8 * numbers; }

static int known_from(const Arguments *a, Known *k)
{
    const Known known = {a->views[0].buf, a->views[1].buf, a->views[2].buf, a->numbers[0],
                         a->views[2].len / 8, (int64_t)a->numbers[1]};
    *k = known;
    return has(a, 0, 3 * k->count) && has(a, 1, 3 * k->count) && 0 < k->least && k->least <= k->count;
}

static PyObject *py_rank_triples(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { TRIPLES = 3, ROTATIONS, CENTRES, QUANTILES, SCRATCH };
    Arguments a;
    Known k;
    if (!taken(&a, arguments, given, 4, 4, 3))
        return NULL;
    const int64_t number = a.views[TRIPLES].len / 24, kept = a.views[QUANTILES].len / 8;
    if (!known_from(&a, &k) || !has(&a, ROTATIONS, 9 * kept) || !has(&a, CENTRES, 3 * kept)
        || !has(&a, SCRATCH, k.count))
        return refused(&a);
    rank_triples(&k, a.views[TRIPLES].buf, number, a.numbers[2], kept, a.views[ROTATIONS].buf, a.views[CENTRES].buf,
                 a.views[QUANTILES].buf, a.views[SCRATCH].buf);
    return done(&a);
}

static PyObject *py_best_orientations(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { ROTATIONS = 3, CENTRES, SQUARES, FACTORS, RESIDUAL, NORMALS, SPACE };
    Arguments a;
    Known k;
    if (!taken(&a, arguments, given, 3, 7, 12))
        return NULL;
    const double *n = a.numbers;
    const int64_t number = a.views[CENTRES].len / 24;
    const OrientationChoice choice = {n[2], n[3], n[4], n[5], n[11], (int64_t)n[6],
                                      {n[2], n[7], n[8], n[9], n[11], (int64_t)n[10]}};
    if (!known_from(&a, &k) || number < 1 || number > MOST_ORIENTATIONS || !has(&a, ROTATIONS, 9 * number)
        || !has(&a, SQUARES, number * k.count) || !has(&a, FACTORS, number * k.count)
        || !has(&a, RESIDUAL, 2 * k.count) || !has(&a, NORMALS, 36) || !has(&a, SPACE, 2 * NUMBERS_OF_A_POINT * k.count))
        return refused(&a);
    const int64_t left = choose_orientations(&k, &choice, number, a.views[ROTATIONS].buf, a.views[CENTRES].buf,
                                a.views[SQUARES].buf, a.views[FACTORS].buf, a.views[RESIDUAL].buf,
                                a.views[NORMALS].buf, a.views[SPACE].buf);
    release(&a);
    return PyLong_FromLongLong(left);
}

enum { PHOTO, OF_POINT, VECTORS, ERROR, TURNED, AT, GROUND, PROBLEM_END };

static int problem_from(const Arguments *a, RefinementProblem *n)
{
    memset(n, 0, sizeof *n);
    n->photo = a->views[PHOTO].buf, n->start = a->views[OF_POINT].buf, n->vectors = a->views[VECTORS].buf;
    n->error = a->views[ERROR].buf, n->rotations = a->views[TURNED].buf, n->centres = a->views[AT].buf;
    n->points = a->views[GROUND].buf;
    n->count = a->views[ERROR].len / 8, n->point_count = a->views[OF_POINT].len / 8 - 1;
    return n->point_count >= 0 && has(a, PHOTO, n->count) && has(a, VECTORS, 3 * n->count)
        && has(a, GROUND, 3 * n->point_count) && 3 * a->views[TURNED].len == 9 * a->views[AT].len
        && n->start[n->point_count] == n->count;
}

static PyObject *py_intersect(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { ORIENTED = 6, POINTS, DEVIATIONS, FACTORS, ANGLES, SPACE, INDICES };
    Arguments a;
    if (!taken(&a, arguments, given, 7, 6, 9))
        return NULL;
    const AllRays rays = {a.views[PHOTO].buf,     a.views[OF_POINT].buf, a.views[VECTORS].buf,
                          a.views[ERROR].buf,     a.views[TURNED].buf,   a.views[AT].buf,
                          a.views[ORIENTED].buf,  a.views[ERROR].len / 8, a.views[OF_POINT].len / 8 - 1};
    const int64_t photos = a.views[ORIENTED].len;
    if (rays.points < 0 || !has(&a, PHOTO, rays.count) || !has(&a, VECTORS, 3 * rays.count)
        || !has(&a, TURNED, 9 * photos) || !has(&a, AT, 3 * photos) || rays.start[rays.points] != rays.count
        || !has(&a, POINTS, 3 * rays.points) || !has(&a, DEVIATIONS, 3 * rays.points) || !has(&a, FACTORS, rays.count)
        || !has(&a, ANGLES, rays.points) || !has(&a, SPACE, NUMBERS_OF_A_RAY * rays.count)
        || !has(&a, INDICES, rays.count + rays.points + 1))
        return refused(&a);
    const double *n = a.numbers;
    Intersecting how = {n[0], n[1], n[2], {1.0, 0.0, n[3], n[4], n[5], (int64_t)n[6], (int64_t)n[7], (int64_t)n[8]}};
    const double s0 = intersect_all(&rays, &how, a.views[POINTS].buf, a.views[DEVIATIONS].buf, a.views[FACTORS].buf,
                                    a.views[ANGLES].buf, a.views[SPACE].buf, a.views[INDICES].buf);
    release(&a);
    return PyFloat_FromDouble(s0);
}

static PyObject *py_refinement_residuals(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { RESIDUAL = PROBLEM_END, IN_FRONT };
    Arguments a;
    RefinementProblem n;
    if (!taken(&a, arguments, given, PROBLEM_END, 2, 0))
        return NULL;
    if (!problem_from(&a, &n) || !has(&a, RESIDUAL, 2 * n.count) || a.views[IN_FRONT].len != n.count)
        return refused(&a);
    block_residuals(&n, a.views[RESIDUAL].buf, a.views[IN_FRONT].buf);
    return done(&a);
}

static PyObject *py_refinement_normals(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum {
        PLACE = PROBLEM_END, FREE, FACTORS, CAMERA, BY_CAMERA,
        PHOTO_NORMALS, COUPLING, INVERSE, POINT_RIGHT, BAND, RIGHT,
        BORDER, POINT_BORDER, CAMERA_NORMALS, CAMERA_RIGHT, SEEN
    };
    Arguments a;
    RefinementProblem n;
    if (!taken(&a, arguments, given, PROBLEM_END + 5, 11, 1))
        return NULL;
    const int64_t cameras = a.views[CAMERA_RIGHT].len / (8 * OF_CAMERA), width = OF_CAMERA * cameras;
    if (!problem_from(&a, &n) || 3 * a.views[PLACE].len != a.views[AT].len || a.views[FREE].len != n.point_count
        || !has(&a, FACTORS, n.count) || !has(&a, CAMERA, cameras ? n.count : 0)
        || !has(&a, BY_CAMERA, cameras ? 2 * OF_CAMERA * n.count : 0)
        || !has(&a, COUPLING, 18 * n.count) || !has(&a, INVERSE, 9 * n.point_count)
        || !has(&a, POINT_RIGHT, 3 * n.point_count) || a.views[PHOTO_NORMALS].len != 6 * a.views[RIGHT].len
        || (a.views[RIGHT].len && a.views[BAND].len % a.views[RIGHT].len)
        || a.views[BORDER].len != width * a.views[RIGHT].len || !has(&a, POINT_BORDER, 3 * width * n.point_count)
        || !has(&a, CAMERA_NORMALS, width * width) || !has(&a, CAMERA_RIGHT, width) || !has(&a, SEEN, cameras))
        return refused(&a);
    n.place = a.views[PLACE].buf, n.is_free = a.views[FREE].buf, n.factors = a.views[FACTORS].buf;
    n.size = a.views[RIGHT].len / 8, n.width = n.size ? a.views[BAND].len / a.views[RIGHT].len : 0;
    n.damping = a.numbers[0];
    n.photo_normals = a.views[PHOTO_NORMALS].buf, n.coupling = a.views[COUPLING].buf;
    n.inverse = a.views[INVERSE].buf, n.point_right = a.views[POINT_RIGHT].buf;
    n.band = a.views[BAND].buf, n.right = a.views[RIGHT].buf;
    n.cameras = cameras, n.camera = a.views[CAMERA].buf, n.by_camera = a.views[BY_CAMERA].buf;
    n.border = a.views[BORDER].buf, n.point_border = a.views[POINT_BORDER].buf;
    n.camera_normals = a.views[CAMERA_NORMALS].buf, n.camera_right = a.views[CAMERA_RIGHT].buf;
    n.seen = a.views[SEEN].buf;
    block_normals(&n);
    return done(&a);
}

static PyObject *py_refinement_points(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { PHOTO_OF, POINT_OF, PLACE, COUPLING, INVERSE, RIGHT, POINT_BORDER, SOLUTION, OF_CAMERAS, POINTS };
    Arguments a;
    RefinementProblem n;
    if (!taken(&a, arguments, given, 9, 1, 0))
        return NULL;
    memset(&n, 0, sizeof n);
    n.count = a.views[PHOTO_OF].len / 8, n.point_count = a.views[POINT_OF].len / 8 - 1;
    n.cameras = a.views[OF_CAMERAS].len / (8 * OF_CAMERA);
    if (n.point_count < 0 || !has(&a, COUPLING, 18 * n.count) || !has(&a, INVERSE, 9 * n.point_count)
        || !has(&a, RIGHT, 3 * n.point_count) || !has(&a, POINTS, 3 * n.point_count)
        || !has(&a, POINT_BORDER, 3 * OF_CAMERA * n.cameras * n.point_count))
        return refused(&a);
    n.photo = a.views[PHOTO_OF].buf, n.start = a.views[POINT_OF].buf, n.place = a.views[PLACE].buf;
    n.coupling = a.views[COUPLING].buf, n.inverse = a.views[INVERSE].buf, n.point_right = a.views[RIGHT].buf;
    n.point_border = a.views[POINT_BORDER].buf;
    point_corrections(&n, a.views[SOLUTION].buf, a.views[OF_CAMERAS].buf, a.views[POINTS].buf);
    return done(&a);
}

static PyObject *py_orient_pair(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { LEFT, RIGHT, ERROR, SAMPLES, SETS, RULES, FOUND, PARALLAX, WEIGHTS, REDUNDANCY, COORDINATES, DEVIATIONS,
           IN_FRONT, USABLE };
    Arguments a;
    if (!taken(&a, arguments, given, 6, 8, 0))
        return NULL;
    const RelativeRules *rules = a.views[RULES].buf;
    const Pairs p = {a.views[LEFT].buf, a.views[RIGHT].buf, a.views[ERROR].buf, a.views[ERROR].len / 8};
    const RelativePoints points = {a.views[PARALLAX].buf,    a.views[WEIGHTS].buf,    a.views[REDUNDANCY].buf,
                                   a.views[COORDINATES].buf, a.views[DEVIATIONS].buf, a.views[IN_FRONT].buf,
                                   a.views[USABLE].buf};
    const int64_t samples = a.views[SAMPLES].len / 40;
    if (p.count < 5 || !has(&a, LEFT, 3 * p.count) || !has(&a, RIGHT, 3 * p.count) || !has(&a, SETS, p.count - 5)
        || a.views[RULES].len != sizeof(RelativeRules) || a.views[FOUND].len != sizeof(RelativeFound)
        || !has(&a, PARALLAX, p.count) || !has(&a, WEIGHTS, p.count) || !has(&a, REDUNDANCY, p.count)
        || !has(&a, COORDINATES, 3 * p.count) || !has(&a, DEVIATIONS, 3 * p.count)
        || a.views[IN_FRONT].len != p.count || a.views[USABLE].len != p.count)
        return refused(&a);
    double *space = PyMem_Malloc((size_t)relative_space(rules, p.count) * sizeof(double));
    if (!space) {
        release(&a);
        return PyErr_NoMemory();
    }
    const int oriented = orient_relatively(&p, rules, a.views[SAMPLES].buf, samples, a.views[SETS].buf, space, &points,
                                           a.views[FOUND].buf);
    PyMem_Free(space);
    release(&a);
    return PyBool_FromLong(oriented);
}

static PyObject *py_adjust_similarity(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { SOURCE, TARGET, SOURCE_DEVIATION, TARGET_DEVIATION, TRUSTED, RULES, FOUND, FACTORS, RESIDUALS, SPACE };
    Arguments a;
    if (!taken(&a, arguments, given, 6, 4, 1))
        return NULL;
    const int64_t count = a.views[TRUSTED].len;
    Common common = {NULL, a.views[TARGET].buf, NULL, a.views[TRUSTED].buf, count, (int64_t)a.numbers[0]};
    if (!has(&a, SOURCE, 3 * count) || !has(&a, TARGET, 3 * count) || !has(&a, SOURCE_DEVIATION, 3 * count)
        || !has(&a, TARGET_DEVIATION, 3 * count) || a.views[RULES].len != sizeof(SimilarityRules)
        || a.views[FOUND].len != sizeof(SimilarityFound) || !has(&a, FACTORS, 3 * count)
        || !has(&a, RESIDUALS, 3 * count) || !has(&a, SPACE, 12 * count) || common.unknowns < 1
        || common.unknowns > MOST_UNKNOWNS)
        return refused(&a);
    const int regular = adjust_similarity(&common, a.views[SOURCE].buf, a.views[SOURCE_DEVIATION].buf,
                                          a.views[TARGET_DEVIATION].buf, a.views[RULES].buf, a.views[FACTORS].buf,
                                          a.views[RESIDUALS].buf, a.views[SPACE].buf, a.views[FOUND].buf);
    release(&a);
    return PyBool_FromLong(regular);
}

static PyObject *py_best_triple(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { SOURCE, TARGET, SOURCE_DEVIATION, TARGET_DEVIATION, TRIPLES, START };
    Arguments a;
    if (!taken(&a, arguments, given, 5, 1, 4))
        return NULL;
    const double *n = a.numbers;
    const int64_t count = a.views[SOURCE].len / 24, triples = a.views[TRIPLES].len / 24, rank = (int64_t)n[0];
    if (!has(&a, SOURCE, 3 * count) || !has(&a, TARGET, 3 * count) || !has(&a, SOURCE_DEVIATION, 3 * count)
        || !has(&a, TARGET_DEVIATION, 3 * count) || !has(&a, TRIPLES, 3 * triples) || rank < 1 || rank > count
        || a.views[START].len != sizeof(At))
        return refused(&a);
    double *space = PyMem_Malloc((size_t)((5 + triples) * count) * sizeof(double) + (size_t)triples * sizeof(At));
    if (!space) {
        release(&a);
        return PyErr_NoMemory();
    }
    const Judges judges = {a.views[SOURCE].buf, a.views[TARGET].buf, space, space + count, space + 2 * count, count};
    prepare_judges(&judges, a.views[SOURCE_DEVIATION].buf, a.views[TARGET_DEVIATION].buf);
    const double most = best_triple(&judges, a.views[TRIPLES].buf, triples, rank, n[1], n[2], n[3], space + 3 * count,
                                    a.views[START].buf);
    PyMem_Free(space);
    release(&a);
    return PyFloat_FromDouble(most);
}

#define METHOD(name, text) {#name, (PyCFunction)(void (*)(void))py_##name, METH_FASTCALL, text}

static PyMethodDef methods[] = {
    METHOD(intersect, "Positions of points, wrong rays down-weighted."),
    METHOD(rank_triples, "The orientations of triples that fit all points best."),
    METHOD(best_orientations, "Orientations improved, and the likeliest adjusted."),
    METHOD(orient_pair, "The relative orientation of two photos."),
    METHOD(best_triple, "The spatial similarity of three points that most others agree with."),
    METHOD(adjust_similarity, "A spatial similarity with Danish weights."),
    METHOD(refinement_residuals, "Residuals of a refinement."),
    METHOD(refinement_normals, "Reduced normal equations of a refinement."),
    METHOD(refinement_points, "Corrections of the points of a refinement."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_kernels", "Inner loops of preliminary values.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__kernels(void) { return PyModule_Create(&definition); }
