/* The loops over all photo points of a block for Python: residuals, normal equations, solving, precision.
 *
 * Called by orip/bundle/compiled/photo_loop.py alone, which says what the arrays hold. The contents of index arrays are
 * checked once, when the layout of a block is made; the sizes of all other arrays before each loop. The design matrix is
 * never stored: partials are computed where they are needed.
 */

/* What the loops need at most is what those with motions need. */
#define MOTION_UNKNOWNS 6

#include "layout.h"
#include "turns.h"

/* The arguments that all loops have in common, in this order, after the layout and the turns and before their own. */
enum {
    CAMERAS, DEFORMATION, CENTRES, ROTATIONS, BASES, GROUND, SET_POLYNOMIALS, TERM_FACTORS, XY, ERROR, MOTIONS,
    MOVED, ROWS_A_MM,
    OBSERVATION_END,
    CAMERA_PLACES = OBSERVATION_END, PHOTO_PLACES, PATTERN_END
};
#define OBSERVATIONS "dddddd" "dddd" "ddd"
#define PATTERN "ii"

typedef struct {
    Arguments a;
    Block block;
    Pattern pattern;
    int64_t points;
    int32_t *numbers;
    double *room, *rooms;
    int room_count; /* of `rooms`, the one in use is `room`; the panels come after them */
    void *memory;
    Turns *turns;
    const Loops *loops;
} Call;

#define LINE_OF_CACHE 64

/* Numbers that all rooms of a thread have together, unless one alone has more: 16 MB. */
#define NUMBERS_OF_ROOMS (INT64_C(1) << 21)

/* What is done with a share. */
typedef void (*Step)(const Call *c, int64_t share, const void *arrays);

/* With so many times three motions of photos as unknowns. */
static const Loops *loops[] = {&plain_loops, &shifting_plain_loops, &moving_plain_loops};

static int are_all_within(const Arguments *a, int array, int64_t least, int64_t end)
{
    return are_within(a->views[array].buf, length_of(a, array), least, end);
}

/* The indices of the layout with the values of this call. */
static int take_block(Call *call)
{
    const Arguments *a = &call->a;
    const Py_buffer *v = a->views;
    Block *b = &call->block;
    b->cameras = v[CAMERAS].buf, b->deformation = v[DEFORMATION].buf, b->centres = v[CENTRES].buf;
    b->rotations = v[ROTATIONS].buf, b->bases = v[BASES].buf, b->ground = v[GROUND].buf;
    b->by_powers = v[SET_POLYNOMIALS].buf, call->pattern.term_factors = v[TERM_FACTORS].buf;
    b->xy = v[XY].buf, b->error = v[ERROR].buf;
    b->motions = v[MOTIONS].len > 0 ? v[MOTIONS].buf : NULL, b->moved = v[MOVED].buf, b->rows_a_mm = v[ROWS_A_MM].buf;
    b->turned = v[BASES].len > 0, b->moving = v[ROWS_A_MM].len > 0;
    const int64_t cameras = b->camera_count, photos = b->photo_count;
    return HAVE(a, CAMERAS, CAMERA_PARAMETERS * cameras, 2 * PRODUCTS * cameras, 3 * photos, 9 * photos,
                b->turned ? 9 * photos : 0)
        && length_of(a, GROUND) / 3 >= call->points
        && HAVE(a, SET_POLYNOMIALS, POLYNOMIALS * POLYNOMIALS * cameras, 2 * MOST_CAMERA_UNKNOWNS * cameras, 2 * b->count,
                2 * b->count, b->motions ? 6 * photos : 0, b->moving ? 6 * photos : 0, b->moving ? 2 * cameras : 0);
}

/* The first address from `memory` on at which a line of the cache begins: vectors do not cross lines then. */
static double *line_from(void *memory)
{
    return (double *)(((uintptr_t)memory + LINE_OF_CACHE - 1) / LINE_OF_CACHE * LINE_OF_CACHE);
}

/* Take the places in a reduced system of `size` unknowns, and get the room that the largest share needs. */
static int take_pattern(Call *call, int64_t size)
{
    const Arguments *a = &call->a;
    const Block *b = &call->block;
    Pattern *p = &call->pattern;
    p->camera_places = a->views[CAMERA_PLACES].buf, p->photo_places = a->views[PHOTO_PLACES].buf;
    if (!has(a, CAMERA_PLACES, MOST_CAMERA_UNKNOWNS * b->camera_count)
        || !are_all_within(a, CAMERA_PLACES, INT32_MIN, size) || !has(a, PHOTO_PLACES, b->photo_unknowns * b->photo_count)
        || !are_all_within(a, PHOTO_PLACES, INT32_MIN, size))
        return 0;
    const int64_t rooms = NUMBERS_OF_ROOMS / (p->room + 1);
    call->room_count = rooms < 1 ? 1 : rooms < MOST_ROOMS ? (int)rooms : MOST_ROOMS;
    const size_t room = (size_t)(call->room_count * p->room + numbers_of_panels(p));
    call->numbers = PyMem_Malloc((ARRAYS_OF_LOCAL + 3) * sizeof(int32_t) * (size_t)(p->longest + 1));
    call->memory = PyMem_Malloc(sizeof(double) * room + LINE_OF_CACHE);
    if (!call->numbers || !call->memory) {
        PyErr_NoMemory();
        return 0;
    }
    call->room = call->rooms = line_from(call->memory);
#ifdef ORIP_ROOM_OF_NANS /* for tests: what is read before it is written shows in the results */
    for (size_t k = 0; k < room; k++)
        call->room[k] = NAN;
#endif
    return 1;
}

static void finish(Call *call)
{
    release(&call->a);
    PyMem_Free(call->numbers);
    PyMem_Free(call->memory);
}

static PyObject *refuse(Call *call)
{
    finish(call);
    return PyErr_Occurred() ? NULL : refused(&call->a);
}

/* Open the arguments of a loop, the first of which are layout and turns; `kinds` are those of its arrays. */
static int begin(Call *call, PyObject *const *arguments, Py_ssize_t given, const char *kinds, int numbers)
{
    memset(call, 0, sizeof *call);
    if (given < 2 || !PyCapsule_IsValid(arguments[0], LAYOUT_NAME) || !PyCapsule_IsValid(arguments[1], TURNS_NAME)) {
        PyErr_SetString(PyExc_TypeError, "the first arguments have to be what layout() and turns() returned");
        return 0;
    }
    const Layout *l = PyCapsule_GetPointer(arguments[0], LAYOUT_NAME);
    call->block = l->block, call->pattern = l->pattern, call->points = l->points;
    call->loops = loops[(l->block.photo_unknowns - ORIENTATION_UNKNOWNS) / MOTION_STEP];
    call->turns = PyCapsule_GetPointer(arguments[1], TURNS_NAME);
    return take_arguments(&call->a, arguments + 2, given - 2, kinds, numbers);
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

static Share rows_of(const Call *c, int64_t share)
{
    const int64_t first = share * ROWS_OF_SHARE, rest = c->block.count - first;
    return (Share){first, first + (rest < ROWS_OF_SHARE ? rest : ROWS_OF_SHARE)};
}

static Share groups_of(const Call *c, int64_t share)
{
    return (Share){c->pattern.share_start[share], c->pattern.share_start[share + 1]};
}

/* Add the sums of the shares that wait while it is their turn; when more wait than may, wait for their turns. */
static void add_sums(Call *c, Waiting *w, int may_wait, Step add, const void *arrays)
{
    while (w->count && is_turn(c->turns, w->share[w->first], w->count > may_wait)) {
        c->room = c->rooms + w->first * c->pattern.room;
        add(c, w->share[w->first], arrays);
        end_turn(c->turns, w->share[w->first]);
        w->first = --w->count ? (w->first + 1) % c->room_count : 0;
    }
}

/* Work together with the other threads; `add`, or NULL: what is done in the order of the shares. */
static PyObject *work(Call *c, int64_t shares, Step step, Step add, const void *arrays)
{
    Waiting w = {.count = 0};
    if (!enter(c->turns))
        return refuse(c);
    Py_BEGIN_ALLOW_THREADS
    for (int64_t share = next_share(c->turns); share < shares; share = next_share(c->turns)) {
        if (add) {
            const int room = (w.first + w.count++) % c->room_count;
            w.share[room] = share, c->room = c->rooms + room * c->pattern.room;
        }
        step(c, share, arrays);
        add_sums(c, &w, c->room_count - 1, add, arrays);
    }
    add_sums(c, &w, 0, add, arrays);
    leave(c->turns, add ? shares : 0);
    Py_END_ALLOW_THREADS
    finish(c);
    Py_RETURN_NONE;
}

typedef struct {
    double *residual;
    uint8_t *in_front;
} Residuals;

static void compute_residuals(const Call *c, int64_t share, const void *arrays)
{
    const Residuals *r = arrays;
    c->loops->residuals(&c->block, rows_of(c, share), r->residual, r->in_front);
}

static PyObject *residuals(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { RESIDUAL = OBSERVATION_END, IN_FRONT };
    Call c;
    if (!begin(&c, arguments, given, OBSERVATIONS "DB", 0))
        return NULL;
    if (!take_block(&c) || !has(&c.a, RESIDUAL, 2 * c.block.count) || !has(&c.a, IN_FRONT, 2 * c.block.count))
        return refuse(&c);
    const Residuals r = {c.a.views[RESIDUAL].buf, c.a.views[IN_FRONT].buf};
    return work(&c, (c.block.count + ROWS_OF_SHARE - 1) / ROWS_OF_SHARE, compute_residuals, NULL, &r);
}

static void form_points(const Call *c, int64_t share, const void *arrays)
{
    c->loops->points(&c->block, &c->pattern, groups_of(c, share), arrays);
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
    if (!HAVE(&c.a, FACTOR, rows, rows, 9 * blocks, 3 * blocks, blocks))
        return refuse(&c);
    const PointNormals n = {v[FACTOR].buf, v[MISCLOSURE].buf, v[BLOCKS].buf, v[BLOCK_RIGHT].buf, v[SQUARES].buf};
    return work(&c, c.pattern.shares, form_points, NULL, &n);
}

static void form_normals(const Call *c, int64_t share, const void *arrays)
{
    c->loops->normals(&c->block, &c->pattern, groups_of(c, share), arrays, c->numbers, c->room,
                      c->rooms + c->room_count * c->pattern.room);
}

/* What most loops do with a share of the points. */
#define STEP(name, loop) \
    static void name(const Call *c, int64_t share, const void *arrays) \
    { \
        c->loops->loop(&c->block, &c->pattern, groups_of(c, share), arrays, c->numbers, c->room); \
    }
STEP(add_normals_of, add_normals)
STEP(compute_precision, precision)
STEP(sum_movements, movements)
STEP(add_movements_of, add_movements)
STEP(sum_forward, forward)
STEP(add_forward_of, add_forward)
STEP(substitute_back, backward)
STEP(form_right, right)

static PyObject *eliminate(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum {
        WEIGHT = PATTERN_END, RESIDUAL, FIXED, BLOCKS, FACTOR, BLOCK_RIGHT, DIAGONAL, RIGHT, HALF, PIVOTS, REMOVED, BAND,
        BORDER
    };
    Call c;
    Normals n;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "ddbd" "DDDDDDBDD", 5))
        return NULL;
    if (!take_reduced(&c.a, BAND, BORDER, c.a.numbers + 2, &n.reduced) || !take_block(&c)
        || !take_pattern(&c, n.reduced.size))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks, size = n.reduced.size;
    if (!HAVE(&c.a, WEIGHT, rows, rows, 3 * blocks, 9 * blocks, rows, 3 * blocks, size, size, 9 * blocks, 3 * blocks,
              3 * blocks))
        return refuse(&c);
    n.weight = v[WEIGHT].buf, n.residual = v[RESIDUAL].buf, n.factor = v[FACTOR].buf, n.fixed = v[FIXED].buf;
    n.blocks = v[BLOCKS].buf, n.block_right = v[BLOCK_RIGHT].buf, n.diagonal = v[DIAGONAL].buf, n.right = v[RIGHT].buf;
    n.half = v[HALF].buf, n.pivots = v[PIVOTS].buf, n.removed = v[REMOVED].buf;
    n.least_pivot = c.a.numbers[0], n.on_diagonal = c.a.numbers[1];
    return work(&c, c.pattern.shares, form_normals, add_normals_of, &n);
}

/* The movements of the points of a free network, from four arrays. */
static int take_movements(const Call *c, int first, Movements *m)
{
    enum { HOMOGENEOUS, COEFFICIENTS, FREE, DEFINING };
    const Py_buffer *v = c->a.views + first;
    const int64_t blocks = c->pattern.blocks;
    m->homogeneous = v[HOMOGENEOUS].buf, m->coefficients = v[COEFFICIENTS].buf;
    m->free = v[FREE].buf, m->defining = v[DEFINING].buf;
    return HAVE(&c->a, first, 4 * blocks, 12 * MOST_MOVEMENTS, 3 * blocks, 3 * blocks);
}

static PyObject *movements(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, HALF, MOVEMENTS, REDUCED = MOVEMENTS + 4, OWN };
    Call c;
    MovementSums s;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "dd" "ddbb" "DD", 0))
        return NULL;
    const int64_t size = length_of(&c.a, REDUCED) / MOST_MOVEMENTS;
    if (!take_block(&c) || !take_pattern(&c, size) || !take_movements(&c, MOVEMENTS, &s.movements)
        || !HAVE(&c.a, FACTOR, 2 * c.block.count, 9 * c.pattern.blocks)
        || !HAVE(&c.a, REDUCED, size * MOST_MOVEMENTS, NUMBERS_OF_OWN))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    s.factor = v[FACTOR].buf, s.half = v[HALF].buf, s.reduced = v[REDUCED].buf, s.own = v[OWN].buf;
    return work(&c, c.pattern.shares, sum_movements, add_movements_of, &s);
}

/* Cofactors of the amounts of the movements from six arrays, all of them empty where control defines the datum. */
static int take_amounts_of(const Call *c, int first, int64_t size, Amounts *amounts)
{
    enum { MOVEMENTS, WITH_REDUCED = MOVEMENTS + 4, HALF_OF_OWN };
    const Py_buffer *v = c->a.views + first;
    amounts->is_free = v[HALF_OF_OWN].len > 0;
    amounts->with_reduced = v[WITH_REDUCED].buf, amounts->half_of_own = v[HALF_OF_OWN].buf;
    if (amounts->is_free)
        return take_movements(c, first + MOVEMENTS, &amounts->movements)
            && HAVE(&c->a, first + WITH_REDUCED, size * MOST_MOVEMENTS, MOST_MOVEMENTS);
    return HAVE(&c->a, first, 0, 0, 0, 0, 0, 0);
}

static PyObject *precision(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, SCALE, HALF, BAND, BORDER, AMOUNTS, COFACTORS = AMOUNTS + 6, LEVERAGE };
    Call c;
    Precision p;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "ddddd" "ddbbdd" "DD", 3))
        return NULL;
    if (!take_reduced(&c.a, BAND, BORDER, c.a.numbers, &p.inverse) || !take_block(&c)
        || !take_pattern(&c, p.inverse.size) || !take_amounts_of(&c, AMOUNTS, p.inverse.size, &p.amounts))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const int64_t rows = 2 * c.block.count, blocks = c.pattern.blocks;
    if (!HAVE(&c.a, FACTOR, rows, rows, 9 * blocks) || !HAVE(&c.a, COFACTORS, 9 * blocks, rows))
        return refuse(&c);
    p.factor = v[FACTOR].buf, p.scale = v[SCALE].buf, p.half = v[HALF].buf;
    p.cofactors = v[COFACTORS].buf, p.leverage = v[LEVERAGE].buf;
    return work(&c, c.pattern.shares, compute_precision, NULL, &p);
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
    if (!take_block(&c) || !take_pattern(&c, size)
        || !HAVE(&c.a, FACTOR, 2 * c.block.count, 9 * c.pattern.blocks, vectors * size, vectors * 3 * c.pattern.blocks))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const Coupling found = {v[FACTOR].buf, v[HALF].buf, v[REDUCED].buf, v[POINTS].buf, vectors, size};
    return forward ? work(&c, c.pattern.shares, sum_forward, add_forward_of, &found)
                   : work(&c, c.pattern.shares, substitute_back, NULL, &found);
}

static PyObject *forward(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    return coupling(arguments, given, 1);
}

static PyObject *backward(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    return coupling(arguments, given, 0);
}

static PyObject *right(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { FACTOR = PATTERN_END, MISCLOSURE, REDUCED, POINTS };
    Call c;
    if (!begin(&c, arguments, given, OBSERVATIONS PATTERN "dd" "DD", 0))
        return NULL;
    const int64_t size = length_of(&c.a, REDUCED), rows = 2 * c.block.count;
    if (!take_block(&c) || !take_pattern(&c, size) || !HAVE(&c.a, FACTOR, rows, rows, size, 3 * c.pattern.blocks))
        return refuse(&c);
    const Py_buffer *v = c.a.views;
    const RightSide r = {{v[FACTOR].buf, NULL, v[REDUCED].buf, v[POINTS].buf, 1, size}, v[MISCLOSURE].buf};
    return work(&c, c.pattern.shares, form_right, add_forward_of, &r);
}

static PyMethodDef methods[] = {
    {"layout", (PyCFunction)(void (*)(void))layout, METH_FASTCALL, "Index arrays of a block, copied and checked."},
    {"turns", (PyCFunction)(void (*)(void))turns, METH_FASTCALL, "Turns of a number of threads."},
    {"residuals", (PyCFunction)(void (*)(void))residuals, METH_FASTCALL, "Residuals of all photo points."},
    {"points", (PyCFunction)(void (*)(void))points, METH_FASTCALL, "Normal equations of each point by itself."},
    {"eliminate", (PyCFunction)(void (*)(void))eliminate, METH_FASTCALL, "Normal equations, points eliminated."},
    {"right", (PyCFunction)(void (*)(void))right, METH_FASTCALL, "Right-hand side of the normal equations."},
    {"movements", (PyCFunction)(void (*)(void))movements, METH_FASTCALL, "Points in the inner constraints."},
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
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        loops[0] = &avx2_loops, loops[1] = &shifting_avx2_loops, loops[2] = &moving_avx2_loops;
#endif
    return PyModule_Create(&definition);
}
