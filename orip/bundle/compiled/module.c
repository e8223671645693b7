/* The loops over all photo points of a block for Python: residuals, normal equations, solving, precision.
 *
 * Called by orip/bundle/compiled/photo_loop.py alone, which says what the arrays hold. The contents of index arrays are
 * checked once, when the layout of a block is made; the sizes of all other arrays before each loop. The design matrix is
 * never stored: partials are computed where they are needed.
 */

#include "../../array_arguments.h"

#include "loops.h"

/* The index arrays of a block, from which a layout is made. */
enum {
    KIND, OF_SET, FORM, OF_CAMERA, OF_PHOTO, OF_POINT,
    ORDER, START, BLOCK, GROUP_START, RUNS_START, RUNS, CAMERA_UNKNOWNS, CAMERA_ELEMENTS, LAYOUT_END
};
#define LAYOUT "iibiii" "iiiiii" "ii"
#define LAYOUT_NAME "orip.bundle.compiled.layout"

/* The arguments that all loops have in common, in this order, after the layout and before their own. */
enum {
    CAMERAS, ADDITIONAL_VALUES, CENTRES, ROTATIONS, BASES, GROUND, SET_POLYNOMIALS, FACTORS, XY, ERROR, OBSERVATION_END,
    CAMERA_PLACES = OBSERVATION_END, PHOTO_PLACES, PATTERN_END
};
#define OBSERVATIONS "dddddd" "dddd"
#define PATTERN "ii"

/* Unknowns of the reduced system, or of a group; products of two such sizes still are numbers of 64 bits. */
#define LARGEST_SYSTEM (INT64_C(1) << 28)

/* Copies of index arrays, which were checked when they were made and cannot be changed from outside: what a loop is
 * called with need not be checked index by index. */
typedef struct {
    Block block;
    Pattern pattern;
    int64_t points;
} Layout;

typedef struct {
    Arguments a;
    Block block;
    Pattern pattern;
    int64_t points;
    int32_t *numbers;
    double *room;
} Call;

static const Loops *loops = &plain_loops;

static int are_all_within(const Arguments *a, int array, int64_t least, int64_t end)
{
    return are_within(a->views[array].buf, length_of(a, array), least, end);
}

/* Whether the sizes of the index arrays belong together. */
static int do_indices_fit(const Arguments *a)
{
    const int64_t cameras = length_of(a, FORM), photos = length_of(a, OF_CAMERA), count = length_of(a, OF_PHOTO);
    const int64_t groups = length_of(a, GROUP_START) - 1;
    return count <= INT32_MAX && cameras + photos <= INT32_MAX && groups >= 0 && groups < INT32_MAX
        && has(a, KIND, cameras) && has(a, OF_SET, 2 * MOST_ADDITIONAL * cameras) && has(a, OF_POINT, count)
        && has(a, START, length_of(a, BLOCK) + 1) && has(a, RUNS_START, groups + 1) && has(a, CAMERA_UNKNOWNS, cameras)
        && has(a, CAMERA_ELEMENTS, MOST_CAMERA_UNKNOWNS * cameras);
}

/* Whether no index of a layout leads elsewhere; `a` has the arrays that it was copied from, for their lengths. */
static int are_indices_sound(const Arguments *a, const Block *b, const Pattern *p)
{
    const int64_t in_order = length_of(a, ORDER), runs = length_of(a, RUNS);
    return are_within(b->products, length_of(a, OF_SET), 0, POLYNOMIALS * POLYNOMIALS)
        && are_within(b->camera_of_photo, b->photo_count, 0, b->camera_count)
        && are_within(b->photo, b->count, 0, b->photo_count) && are_within(b->point, b->count, 0, INT32_MAX)
        && are_starts(p->start, p->blocks, in_order) && are_starts(p->group_start, p->groups, p->blocks)
        && are_starts(p->runs_start, p->groups, runs) && are_within(p->order, in_order, 0, b->count)
        && are_within(p->block, p->blocks, 0, p->blocks)
        && are_within(p->runs, runs, 0, b->camera_count + b->photo_count)
        && are_within(p->camera_unknowns, b->camera_count, 0, MOST_CAMERA_UNKNOWNS + 1)
        && are_within(p->camera_elements, length_of(a, CAMERA_ELEMENTS), 0, ELEMENTS);
}

/* Copy the next index array into a layout; the bytes of the flags come last, so that all numbers are aligned. */
static const void *copied(const Arguments *a, int array, char **room)
{
    const Py_buffer *view = &a->views[array];
    char *to = *room;
    if (view->len)
        memcpy(to, view->buf, (size_t)view->len);
    *room += view->len;
    return to;
}

static Layout *copy_of_indices(const Arguments *a)
{
    size_t size = sizeof(Layout);
    for (int array = 0; array < LAYOUT_END; array++)
        size += (size_t)a->views[array].len;
    Layout *l = PyMem_Calloc(1, size);
    if (!l)
        return NULL;
    Block *b = &l->block;
    Pattern *p = &l->pattern;
    char *room = (char *)(l + 1);
    b->kind = copied(a, KIND, &room), b->products = copied(a, OF_SET, &room);
    b->camera_of_photo = copied(a, OF_CAMERA, &room), b->photo = copied(a, OF_PHOTO, &room);
    b->point = copied(a, OF_POINT, &room);
    p->order = copied(a, ORDER, &room), p->start = copied(a, START, &room), p->block = copied(a, BLOCK, &room);
    p->group_start = copied(a, GROUP_START, &room), p->runs_start = copied(a, RUNS_START, &room);
    p->runs = copied(a, RUNS, &room), p->camera_unknowns = copied(a, CAMERA_UNKNOWNS, &room);
    p->camera_elements = copied(a, CAMERA_ELEMENTS, &room);
    b->form = copied(a, FORM, &room);
    b->count = length_of(a, OF_PHOTO), b->camera_count = length_of(a, FORM);
    b->photo_count = length_of(a, OF_CAMERA);
    p->blocks = length_of(a, BLOCK), p->groups = length_of(a, GROUP_START) - 1;
    return l;
}

/* Whether each photo point of a group has its photo and its camera among the runs of the group, cameras first. */
static int has_runs_of_all(const Block *b, const Pattern *p, int32_t *seen)
{
    for (int64_t group = 0; group < p->groups; group++) {
        const int32_t mark = (int32_t)group + 1;
        int is_photo = 0;
        for (int32_t r = p->runs_start[group]; r < p->runs_start[group + 1]; r++) {
            if (is_photo && p->runs[r] < b->camera_count)
                return 0;
            is_photo = p->runs[r] >= b->camera_count;
            seen[p->runs[r]] = mark;
        }
        for (int32_t k = p->start[p->group_start[group]]; k < p->start[p->group_start[group + 1]]; k++) {
            const int32_t photo = b->photo[p->order[k]];
            if (seen[b->camera_count + photo] != mark || seen[b->camera_of_photo[photo]] != mark)
                return 0;
        }
    }
    return 1;
}

static int is_pattern_sound(const Block *b, const Pattern *p)
{
    int32_t *seen = PyMem_Calloc((size_t)(b->camera_count + b->photo_count + 1), sizeof(int32_t));
    const int sound = seen && has_runs_of_all(b, p, seen);
    if (!seen)
        PyErr_NoMemory();
    PyMem_Free(seen);
    return sound;
}

/* The unknowns of the largest group. A run of constants alone has a place among the first ones, too. */
static int64_t longest_group(const Block *b, const Pattern *p)
{
    int64_t longest = 0;
    for (int64_t group = 0; group < p->groups; group++) {
        const int64_t runs = p->runs_start[group + 1] - p->runs_start[group];
        int64_t size = 0;
        for (int32_t r = p->runs_start[group]; r < p->runs_start[group + 1]; r++)
            size += p->runs[r] < b->camera_count ? p->camera_unknowns[p->runs[r]] : PHOTO_UNKNOWNS;
        size = size > runs ? size : runs;
        longest = size > longest ? size : longest;
    }
    return longest;
}

/* Check a layout, and find out what its loops need; all is read in the copies, which nobody else can change. */
static int is_layout_sound(const Arguments *a, Layout *l)
{
    if (!are_indices_sound(a, &l->block, &l->pattern) || !is_pattern_sound(&l->block, &l->pattern))
        return 0;
    for (int64_t k = 0; k < l->block.count; k++)
        l->points = l->block.point[k] >= l->points ? (int64_t)l->block.point[k] + 1 : l->points;
    l->pattern.longest = longest_group(&l->block, &l->pattern);
    return l->pattern.longest <= LARGEST_SYSTEM;
}

static void free_layout(PyObject *capsule)
{
    PyMem_Free(PyCapsule_GetPointer(capsule, LAYOUT_NAME));
}

static PyObject *layout(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    Arguments a;
    if (!take_arguments(&a, arguments, given, LAYOUT, 0))
        return NULL;
    if (!do_indices_fit(&a))
        return refused(&a);
    Layout *l = copy_of_indices(&a);
    const int sound = l && is_layout_sound(&a, l);
    release(&a);
    if (!l)
        return PyErr_NoMemory();
    PyObject *found = sound ? PyCapsule_New(l, LAYOUT_NAME, free_layout) : NULL;
    if (!found)
        PyMem_Free(l);
    return found || PyErr_Occurred() ? found : refused(&a);
}

/* The indices of the layout with the values of this call. */
static int take_block(Call *call)
{
    const Arguments *a = &call->a;
    const Py_buffer *v = a->views;
    Block *b = &call->block;
    b->cameras = v[CAMERAS].buf, b->additional = v[ADDITIONAL_VALUES].buf, b->centres = v[CENTRES].buf;
    b->rotations = v[ROTATIONS].buf, b->bases = v[BASES].buf, b->ground = v[GROUND].buf;
    b->polynomials = v[SET_POLYNOMIALS].buf, b->factors = v[FACTORS].buf;
    b->xy = v[XY].buf, b->error = v[ERROR].buf;
    b->additional_count = b->camera_count ? length_of(a, ADDITIONAL_VALUES) / b->camera_count : 0;
    b->turned = v[BASES].len > 0;
    return has(a, CAMERAS, CAMERA_PARAMETERS * b->camera_count)
        && has(a, ADDITIONAL_VALUES, b->additional_count * b->camera_count) && b->additional_count <= MOST_ADDITIONAL
        && has(a, CENTRES, 3 * b->photo_count) && has(a, ROTATIONS, 9 * b->photo_count)
        && (!b->turned || has(a, BASES, 9 * b->photo_count)) && length_of(a, GROUND) / 3 >= call->points
        && has(a, SET_POLYNOMIALS, POLYNOMIALS * POLYNOMIALS * b->camera_count)
        && has(a, FACTORS, 2 * MOST_ADDITIONAL * b->camera_count) && has(a, XY, 2 * b->count)
        && has(a, ERROR, 2 * b->count);
}

/* Take the places in a reduced system of `size` unknowns, and get the room that sums of its largest group need. */
static int take_pattern(Call *call, int64_t size)
{
    const Arguments *a = &call->a;
    const Block *b = &call->block;
    Pattern *p = &call->pattern;
    p->camera_places = a->views[CAMERA_PLACES].buf, p->photo_places = a->views[PHOTO_PLACES].buf;
    if (!has(a, CAMERA_PLACES, MOST_CAMERA_UNKNOWNS * b->camera_count)
        || !are_all_within(a, CAMERA_PLACES, INT32_MIN, size) || !has(a, PHOTO_PLACES, PHOTO_UNKNOWNS * b->photo_count)
        || !are_all_within(a, PHOTO_PLACES, INT32_MIN, size))
        return 0;
    const int64_t rows = p->longest + 6 < MOST_VECTORS ? MOST_VECTORS : p->longest + 6;
    const size_t room = (size_t)(rows * stride_of(p->longest));
    call->numbers = PyMem_Malloc(3 * sizeof(int32_t) * (size_t)(p->longest + 1));
    call->room = PyMem_Malloc(sizeof(double) * room);
    if (!call->numbers || !call->room)
        PyErr_NoMemory();
    return call->numbers && call->room;
}

static void finish(Call *call)
{
    release(&call->a);
    PyMem_Free(call->numbers);
    PyMem_Free(call->room);
}

static PyObject *refuse(Call *call)
{
    finish(call);
    return PyErr_Occurred() ? NULL : refused(&call->a);
}

static PyObject *finished(Call *call)
{
    finish(call);
    Py_RETURN_NONE;
}

/* Open the arguments of a loop, the first of which is the layout; `kinds` are those of its arrays. */
static int begin(Call *call, PyObject *const *arguments, Py_ssize_t given, const char *kinds, int numbers)
{
    memset(call, 0, sizeof *call);
    if (!given || !PyCapsule_IsValid(arguments[0], LAYOUT_NAME)) {
        PyErr_SetString(PyExc_TypeError, "the first argument has to be what layout() returned");
        return 0;
    }
    const Layout *l = PyCapsule_GetPointer(arguments[0], LAYOUT_NAME);
    call->block = l->block, call->pattern = l->pattern, call->points = l->points;
    return take_arguments(&call->a, arguments + 1, given - 1, kinds, numbers);
}

/* The reduced matrix from its arrays and three numbers: stride, banded places, size. */
static int take_reduced(const Arguments *a, int band, int border, const double *numbers, Reduced *m)
{
    for (int k = 0; k < 3; k++)
        if (!is_whole(numbers[k], 0.0, (double)LARGEST_SYSTEM))
            return 0;
    m->band = a->views[band].buf, m->border = a->views[border].buf;
    m->stride = (int64_t)numbers[0], m->banded = (int64_t)numbers[1], m->size = (int64_t)numbers[2];
    const int64_t last = m->banded > 0 ? (m->banded - 1) * (m->stride + 1) : -1;
    return m->banded <= m->size && length_of(a, band) >= last + 1 && has(a, border, (m->size - m->banded) * m->size);
}

static PyObject *residuals(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { RESIDUAL = OBSERVATION_END, IN_FRONT };
    Call c;
    if (!begin(&c, arguments, given, OBSERVATIONS "DB", 0))
        return NULL;
    if (!take_block(&c) || !has(&c.a, RESIDUAL, 2 * c.block.count) || !has(&c.a, IN_FRONT, c.block.count))
        return refuse(&c);
    Py_BEGIN_ALLOW_THREADS
    loops->residuals(&c.block, c.a.views[RESIDUAL].buf, c.a.views[IN_FRONT].buf);
    Py_END_ALLOW_THREADS
    return finished(&c);
}

static PyObject *points(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, MISCLOSURE, BLOCKS, BLOCK_RIGHT, SQUARES };
    Call c;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "dd" "DDD", 0))
        return NULL;
    if (!take_block(&c) || !take_pattern(&c, LARGEST_SYSTEM))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!has(&c.a, FACTOR, rows) || !has(&c.a, MISCLOSURE, rows) || !has(&c.a, BLOCKS, 9 * blocks)
        || !has(&c.a, BLOCK_RIGHT, 3 * blocks) || !has(&c.a, SQUARES, blocks))
        return refuse(&c);
    const PointNormals n = {v[FACTOR].buf, v[MISCLOSURE].buf, v[BLOCKS].buf, v[BLOCK_RIGHT].buf, v[SQUARES].buf};
    Py_BEGIN_ALLOW_THREADS
    loops->points(&c.block, &c.pattern, &n);
    Py_END_ALLOW_THREADS
    return finished(&c);
}

static PyObject *eliminate(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum {
        FACTOR = PATTERN_END, MISCLOSURE, FIXED, BLOCKS, BLOCK_RIGHT, DIAGONAL, RIGHT, HALF, PIVOTS, REMOVED, BAND, BORDER
    };
    Call c;
    Normals n;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "ddbd" "DDDDDBDD", 5))
        return NULL;
    if (!take_reduced(&c.a, BAND, BORDER, c.a.numbers + 2, &n.reduced) || !take_block(&c)
        || !take_pattern(&c, n.reduced.size))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!has(&c.a, FACTOR, rows) || !has(&c.a, MISCLOSURE, rows) || !has(&c.a, FIXED, 3 * blocks)
        || !has(&c.a, BLOCKS, 9 * blocks) || !has(&c.a, BLOCK_RIGHT, 3 * blocks) || !has(&c.a, DIAGONAL, n.reduced.size)
        || !has(&c.a, RIGHT, n.reduced.size) || !has(&c.a, HALF, 9 * blocks) || !has(&c.a, PIVOTS, 3 * blocks)
        || !has(&c.a, REMOVED, 3 * blocks))
        return refuse(&c);
    n.factor = v[FACTOR].buf, n.misclosure = v[MISCLOSURE].buf, n.fixed = v[FIXED].buf;
    n.blocks = v[BLOCKS].buf, n.block_right = v[BLOCK_RIGHT].buf, n.diagonal = v[DIAGONAL].buf, n.right = v[RIGHT].buf;
    n.half = v[HALF].buf, n.pivots = v[PIVOTS].buf, n.removed = v[REMOVED].buf;
    n.least_pivot = c.a.numbers[0], n.on_diagonal = c.a.numbers[1];
    Py_BEGIN_ALLOW_THREADS
    loops->normals(&c.block, &c.pattern, &n, c.numbers, c.room);
    Py_END_ALLOW_THREADS
    return finished(&c);
}

static PyObject *precision(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, SCALE, HALF, BAND, BORDER, COFACTORS, LEVERAGE };
    Call c;
    Precision p;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "ddddd" "DD", 3))
        return NULL;
    if (!take_reduced(&c.a, BAND, BORDER, c.a.numbers, &p.inverse) || !take_block(&c)
        || !take_pattern(&c, p.inverse.size))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!has(&c.a, FACTOR, rows) || !has(&c.a, SCALE, rows) || !has(&c.a, HALF, 9 * blocks)
        || !has(&c.a, COFACTORS, 9 * blocks) || !has(&c.a, LEVERAGE, rows))
        return refuse(&c);
    p.factor = v[FACTOR].buf, p.scale = v[SCALE].buf, p.half = v[HALF].buf;
    p.cofactors = v[COFACTORS].buf, p.leverage = v[LEVERAGE].buf;
    Py_BEGIN_ALLOW_THREADS
    loops->precision(&c.block, &c.pattern, &p, c.numbers, c.room);
    Py_END_ALLOW_THREADS
    return finished(&c);
}

static PyObject *coupling(PyObject *const *arguments, Py_ssize_t given, int forward)
{
    enum { FACTOR = PATTERN_END, HALF, REDUCED, POINTS };
    Call c;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "dd" "DD", 1))
        return NULL;
    if (!is_whole(c.a.numbers[0], 1.0, MOST_VECTORS))
        return refuse(&c);
    const int64_t vectors = (int64_t)c.a.numbers[0], size = length_of(&c.a, REDUCED) / vectors;
    if (!take_block(&c) || !take_pattern(&c, size) || !has(&c.a, REDUCED, vectors * size)
        || !has(&c.a, FACTOR, 2 * c.block.count) || !has(&c.a, HALF, 9 * c.pattern.blocks)
        || !has(&c.a, POINTS, vectors * 3 * c.pattern.blocks))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const Coupling found = {v[FACTOR].buf, v[HALF].buf, v[REDUCED].buf, v[POINTS].buf, vectors, size};
    Py_BEGIN_ALLOW_THREADS
    (forward ? loops->forward : loops->backward)(&c.block, &c.pattern, &found, c.numbers, c.room);
    Py_END_ALLOW_THREADS
    return finished(&c);
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
    {"layout", (PyCFunction)(void (*)(void))layout, METH_FASTCALL, "Index arrays of a block, copied and checked."},
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
