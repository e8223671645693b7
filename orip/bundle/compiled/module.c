/* The loops over all photo points of a block for Python: residuals, normal equations, solving, precision.
 *
 * Called by orip/bundle/compiled/photo_loop.py alone, where the arrays are described. Sizes that follow from one another
 * are checked here, the contents of index arrays are not. The design matrix is never stored: partials are computed where
 * they are needed.
 */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include "loops.h"

/* The arguments that all loops have in common, in this order; those of each loop follow. */
enum {
    CAMERAS, ADDITIONAL_VALUES, CENTRES, ROTATIONS, BASES, GROUND, KIND, OF_SET, SET_POLYNOMIALS, FACTORS, AT_MEASURED,
    OF_CAMERA, OF_PHOTO, OF_POINT, XY, ERROR, OBSERVATION_END,
    ORDER = OBSERVATION_END, START, BLOCK, GROUP_START, RUNS_START, RUNS, CAMERA_UNKNOWNS, CAMERA_ELEMENTS, CAMERA_PLACES,
    PHOTO_PLACES, PATTERN_END
};

#define MOST_ARGUMENTS 64

typedef struct {
    Py_buffer view[MOST_ARGUMENTS];
    int count, sound;
    Block block;
    Pattern pattern;
    int32_t *numbers;
    double *room;
} Call;

static const Loops *loops = &plain_loops;

static int has_length(const Py_buffer *view, int64_t numbers, int64_t bytes)
{
    return view->len == numbers * bytes;
}

static void take_block(Call *call)
{
    const Py_buffer *v = call->view;
    Block *b = &call->block;
    b->cameras = v[CAMERAS].buf, b->additional = v[ADDITIONAL_VALUES].buf, b->centres = v[CENTRES].buf;
    b->rotations = v[ROTATIONS].buf, b->bases = v[BASES].buf, b->ground = v[GROUND].buf;
    b->kind = v[KIND].buf, b->products = v[OF_SET].buf, b->at_measured = v[AT_MEASURED].buf;
    b->polynomials = v[SET_POLYNOMIALS].buf, b->factors = v[FACTORS].buf;
    b->camera_of_photo = v[OF_CAMERA].buf, b->photo = v[OF_PHOTO].buf, b->point = v[OF_POINT].buf;
    b->xy = v[XY].buf, b->error = v[ERROR].buf;
    b->count = v[OF_PHOTO].len / 4;
    b->camera_count = v[AT_MEASURED].len;
    b->photo_count = v[OF_CAMERA].len / 4;
    b->additional_count = b->camera_count ? v[ADDITIONAL_VALUES].len / 8 / b->camera_count : 0;
    b->turned = v[BASES].len > 0;
    call->sound = has_length(&v[CAMERAS], CAMERA_PARAMETERS * b->camera_count, 8)
        && has_length(&v[ADDITIONAL_VALUES], b->additional_count * b->camera_count, 8)
        && b->additional_count <= MOST_ADDITIONAL && has_length(&v[CENTRES], 3 * b->photo_count, 8)
        && has_length(&v[ROTATIONS], 9 * b->photo_count, 8)
        && (!b->turned || has_length(&v[BASES], 9 * b->photo_count, 8)) && has_length(&v[KIND], b->camera_count, 4)
        && has_length(&v[OF_SET], 2 * MOST_ADDITIONAL * b->camera_count, 4)
        && has_length(&v[SET_POLYNOMIALS], POLYNOMIALS * POLYNOMIALS * b->camera_count, 8)
        && has_length(&v[FACTORS], 2 * MOST_ADDITIONAL * b->camera_count, 8) && has_length(&v[OF_POINT], b->count, 4)
        && has_length(&v[XY], 2 * b->count, 8) && has_length(&v[ERROR], 2 * b->count, 8) && b->count <= INT32_MAX;
}

/* Take the pattern, and find the number of unknowns of its largest group, from which the work space follows. */
static void take_pattern(Call *call)
{
    const Py_buffer *v = call->view;
    const Block *b = &call->block;
    Pattern *p = &call->pattern;
    p->order = v[ORDER].buf, p->start = v[START].buf, p->block = v[BLOCK].buf, p->group_start = v[GROUP_START].buf;
    p->runs_start = v[RUNS_START].buf, p->runs = v[RUNS].buf;
    p->camera_unknowns = v[CAMERA_UNKNOWNS].buf, p->camera_elements = v[CAMERA_ELEMENTS].buf;
    p->camera_places = v[CAMERA_PLACES].buf, p->photo_places = v[PHOTO_PLACES].buf;
    p->blocks = v[BLOCK].len / 4;
    p->groups = v[GROUP_START].len / 4 - 1;
    call->sound = call->sound && p->groups >= 0 && has_length(&v[START], p->blocks + 1, 4)
        && has_length(&v[ORDER], p->start[p->blocks], 4) && p->group_start[p->groups] == p->blocks
        && has_length(&v[RUNS_START], p->groups + 1, 4) && has_length(&v[RUNS], p->runs_start[p->groups], 4)
        && has_length(&v[CAMERA_UNKNOWNS], b->camera_count, 4)
        && has_length(&v[CAMERA_ELEMENTS], MOST_CAMERA_UNKNOWNS * b->camera_count, 4)
        && has_length(&v[CAMERA_PLACES], MOST_CAMERA_UNKNOWNS * b->camera_count, 4)
        && has_length(&v[PHOTO_PLACES], PHOTO_UNKNOWNS * b->photo_count, 4);
    if (!call->sound)
        return;
    for (int64_t group = 0; group < p->groups; group++) {
        int64_t size = 0;
        for (int32_t r = p->runs_start[group]; r < p->runs_start[group + 1]; r++)
            size += p->runs[r] < b->camera_count ? p->camera_unknowns[p->runs[r]] : PHOTO_UNKNOWNS;
        /* a run of constants has no unknown, but an element of Local.first */
        size = size > p->runs_start[group + 1] - p->runs_start[group] ? size : p->runs_start[group + 1] - p->runs_start[group];
        p->longest = size > p->longest ? size : p->longest;
    }
}

static void finish(Call *call)
{
    while (call->count)
        PyBuffer_Release(&call->view[--call->count]);
    PyMem_Free(call->numbers);
    PyMem_Free(call->room);
}

static PyObject *refused(Call *call)
{
    finish(call);
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "arrays of the observation loop do not belong together");
    return NULL;
}

/* Open the buffers of `count` arguments, the last `writable` of them for writing, and take block and pattern from them. */
static int begin(Call *call, PyObject *const *arguments, Py_ssize_t given, int count, int others, int writable, int pattern)
{
    memset(call, 0, sizeof *call);
    if (given != count + others) {
        PyErr_SetString(PyExc_TypeError, "wrong number of arguments");
        return 0;
    }
    for (; call->count < count; call->count++)
        if (PyObject_GetBuffer(arguments[call->count], &call->view[call->count],
                               call->count < count - writable ? PyBUF_SIMPLE : PyBUF_WRITABLE))
            return 0;
    take_block(call);
    if (pattern)
        take_pattern(call);
    if (!call->sound || !pattern)
        return call->sound;
    const size_t room = (size_t)((call->pattern.longest + 6) * stride_of(call->pattern.longest));
    call->numbers = PyMem_Malloc(3 * sizeof(int32_t) * (size_t)(call->pattern.longest + 1));
    call->room = PyMem_Malloc(sizeof(double) * room);
    if (!call->numbers || !call->room)
        PyErr_NoMemory();
    return call->numbers && call->room;
}

/* The reduced matrix from its buffers and three numbers after them: stride, banded places, size. */
static int take_reduced(const Py_buffer *band, const Py_buffer *border, PyObject *const *numbers, Reduced *m)
{
    m->band = band->buf, m->border = border->buf;
    m->stride = PyLong_AsLongLong(numbers[0]), m->banded = PyLong_AsLongLong(numbers[1]);
    m->size = PyLong_AsLongLong(numbers[2]);
    if (PyErr_Occurred())
        return 0;
    const int64_t last = m->banded > 0 ? (m->banded - 1) * (m->stride + 1) : -1;
    return m->stride >= 0 && m->banded >= 0 && m->banded <= m->size && band->len >= 8 * (last + 1)
        && has_length(border, (m->size - m->banded) * m->size, 8);
}

static PyObject *residuals(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { RESIDUAL = OBSERVATION_END, IN_FRONT, COUNT };
    Call c;
    if (!begin(&c, arguments, given, COUNT, 0, COUNT - RESIDUAL, 0) || !has_length(&c.view[RESIDUAL], 2 * c.block.count, 8)
        || !has_length(&c.view[IN_FRONT], c.block.count, 1))
        return refused(&c);
    Py_BEGIN_ALLOW_THREADS
    loops->residuals(&c.block, c.view[RESIDUAL].buf, c.view[IN_FRONT].buf);
    Py_END_ALLOW_THREADS
    finish(&c);
    Py_RETURN_NONE;
}

static PyObject *points(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, MISCLOSURE, BLOCKS, BLOCK_RIGHT, SQUARES, COUNT };
    Call c;
    if (!begin(&c, arguments, given, COUNT, 0, COUNT - BLOCKS, 1))
        return refused(&c);
    const Py_buffer *v = c.view;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!has_length(&v[FACTOR], rows, 8) || !has_length(&v[MISCLOSURE], rows, 8) || !has_length(&v[BLOCKS], 9 * blocks, 8)
        || !has_length(&v[BLOCK_RIGHT], 3 * blocks, 8) || !has_length(&v[SQUARES], blocks, 8))
        return refused(&c);
    const PointNormals n = {v[FACTOR].buf, v[MISCLOSURE].buf, v[BLOCKS].buf, v[BLOCK_RIGHT].buf, v[SQUARES].buf};
    Py_BEGIN_ALLOW_THREADS
    loops->points(&c.block, &c.pattern, &n);
    Py_END_ALLOW_THREADS
    finish(&c);
    Py_RETURN_NONE;
}

static PyObject *eliminate(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum {
        FACTOR = PATTERN_END, MISCLOSURE, FIXED, BLOCKS, BLOCK_RIGHT, DIAGONAL, RIGHT, HALF, PIVOTS, REMOVED, BAND, BORDER,
        COUNT
    };
    Call c;
    Normals n;
    if (!begin(&c, arguments, given, COUNT, 5, COUNT - BLOCK_RIGHT, 1)
        || !take_reduced(&c.view[BAND], &c.view[BORDER], arguments + COUNT + 2, &n.reduced))
        return refused(&c);
    const Py_buffer *v = c.view;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!has_length(&v[FACTOR], rows, 8) || !has_length(&v[MISCLOSURE], rows, 8) || !has_length(&v[FIXED], 3 * blocks, 1)
        || !has_length(&v[BLOCKS], 9 * blocks, 8) || !has_length(&v[BLOCK_RIGHT], 3 * blocks, 8)
        || !has_length(&v[DIAGONAL], n.reduced.size, 8) || !has_length(&v[RIGHT], n.reduced.size, 8)
        || !has_length(&v[HALF], 9 * blocks, 8) || !has_length(&v[PIVOTS], 3 * blocks, 8)
        || !has_length(&v[REMOVED], 3 * blocks, 1))
        return refused(&c);
    n.factor = v[FACTOR].buf, n.misclosure = v[MISCLOSURE].buf, n.fixed = v[FIXED].buf;
    n.blocks = v[BLOCKS].buf, n.block_right = v[BLOCK_RIGHT].buf, n.diagonal = v[DIAGONAL].buf, n.right = v[RIGHT].buf;
    n.half = v[HALF].buf, n.pivots = v[PIVOTS].buf, n.removed = v[REMOVED].buf;
    n.least_pivot = PyFloat_AsDouble(arguments[COUNT]);
    n.on_diagonal = PyFloat_AsDouble(arguments[COUNT + 1]);
    if (PyErr_Occurred())
        return refused(&c);
    Py_BEGIN_ALLOW_THREADS
    loops->normals(&c.block, &c.pattern, &n, c.numbers, c.room);
    Py_END_ALLOW_THREADS
    finish(&c);
    Py_RETURN_NONE;
}

static PyObject *precision(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, SCALE, HALF, BAND, BORDER, COFACTORS, LEVERAGE, COUNT };
    Call c;
    Precision p;
    if (!begin(&c, arguments, given, COUNT, 3, COUNT - COFACTORS, 1)
        || !take_reduced(&c.view[BAND], &c.view[BORDER], arguments + COUNT, &p.inverse))
        return refused(&c);
    const Py_buffer *v = c.view;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!has_length(&v[FACTOR], rows, 8) || !has_length(&v[SCALE], rows, 8) || !has_length(&v[HALF], 9 * blocks, 8)
        || !has_length(&v[COFACTORS], 9 * blocks, 8) || !has_length(&v[LEVERAGE], rows, 8))
        return refused(&c);
    p.factor = v[FACTOR].buf, p.scale = v[SCALE].buf, p.half = v[HALF].buf;
    p.cofactors = v[COFACTORS].buf, p.leverage = v[LEVERAGE].buf;
    Py_BEGIN_ALLOW_THREADS
    loops->precision(&c.block, &c.pattern, &p, c.numbers, c.room);
    Py_END_ALLOW_THREADS
    finish(&c);
    Py_RETURN_NONE;
}

static PyObject *coupling(PyObject *const *arguments, Py_ssize_t given, int forward)
{
    enum { FACTOR = PATTERN_END, HALF, REDUCED, POINTS, COUNT };
    Call c;
    if (!begin(&c, arguments, given, COUNT, 0, COUNT - REDUCED, 1))
        return refused(&c);
    const Py_buffer *v = c.view;
    if (!has_length(&v[FACTOR], 2 * c.block.count, 8) || !has_length(&v[HALF], 9 * c.pattern.blocks, 8)
        || !has_length(&v[POINTS], 3 * c.pattern.blocks, 8))
        return refused(&c);
    const Coupling found = {v[FACTOR].buf, v[HALF].buf, v[REDUCED].buf, v[POINTS].buf};
    Py_BEGIN_ALLOW_THREADS
    (forward ? loops->forward : loops->backward)(&c.block, &c.pattern, &found, c.numbers, c.room);
    Py_END_ALLOW_THREADS
    finish(&c);
    Py_RETURN_NONE;
}

static PyObject *forward(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    return coupling(arguments, given, 1);
}

static PyObject *backward(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    return coupling(arguments, given, 0);
}

static PyMethodDef methods[] = {
    {"residuals", (PyCFunction)(void (*)(void))residuals, METH_FASTCALL, "Residuals of all photo points."},
    {"points", (PyCFunction)(void (*)(void))points, METH_FASTCALL, "Normal equations of each point by itself."},
    {"eliminate", (PyCFunction)(void (*)(void))eliminate, METH_FASTCALL, "Normal equations, points eliminated."},
    {"precision", (PyCFunction)(void (*)(void))precision, METH_FASTCALL, "Cofactors of points, leverages."},
    {"forward", (PyCFunction)(void (*)(void))forward, METH_FASTCALL, "Transposed coupling of points times a vector."},
    {"backward", (PyCFunction)(void (*)(void))backward, METH_FASTCALL, "Coupling of points times a vector."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_observation_loop", "Loops over the photo points of a block.", -1, methods, NULL, NULL, NULL,
    NULL,
};

PyMODINIT_FUNC PyInit__observation_loop(void)
{
#ifdef HAS_AVX2_LOOPS
    if (__builtin_cpu_supports("avx2"))
        loops = &avx2_loops;
#endif
    return PyModule_Create(&definition);
}
