/* The loops over all photo points of a block: residuals, normal equations with eliminated points, precision.
 *
 * Called by orip/bundle/photo_loop.py alone, which says what the arrays hold; the sizes that follow from one another are
 * checked here, what the index arrays say is not. The design matrix is never stored: partials are computed point by
 * point where they are needed.
 */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <stdint.h>
#include <string.h>

#include "collinearity.h"
#include "normals.h"

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("avx2", "default")))
#else
#define FOR_EACH_PROCESSOR
#endif

#define MOST_UNKNOWNS POINT

/* The arguments that all loops have in common, in this order, and then their own. */
enum {
    CAMERAS, CENTRES, ROTATIONS, BASES, GROUND, OF_CAMERA, OF_PHOTO, OF_POINT, AT_MEASURED, XY, ERROR, OBSERVATION_END,
    ORDER = OBSERVATION_END, START, CAMERA_AT, PHOTO_AT, RUN_FIRST, RUN_COUNT, RUN_ELEMENTS, RUNS_START, RUNS,
    COUPLING_START, PATTERN_END
};

typedef struct {
    const double *cameras, *centres, *rotations, *bases, *ground, *xy, *error;
    const int64_t *camera, *photo, *point;
    const uint8_t *at_measured;
    int64_t count, camera_count;
    /* observations of eliminated point b: order[start[b]] to order[start[b + 1] - 1] */
    const int64_t *order, *start, *camera_at, *photo_at, *run_first, *run_count, *run_elements, *runs_start, *runs;
    const int64_t *coupling_start;
    int64_t blocks;
} Block;

static inline __attribute__((always_inline)) int linearise(
    const Block *b, int64_t row, double *residual, double (*partials)[ELEMENTS])
{
    const int64_t photo = b->photo[row];
    return photo_point(
        b->cameras + 11 * b->camera[row], b->centres + 3 * photo, b->rotations + 9 * photo, b->bases + 9 * photo,
        b->ground + 3 * b->point[row], b->xy + 2 * row, b->at_measured[row], residual, partials);
}

static inline __attribute__((always_inline)) Run run_of(const Block *b, int64_t number)
{
    const Run run = {b->run_first[number], b->run_count[number], b->run_elements + 11 * number};
    return run;
}

/* Take the partials of a run's unknowns out of a photo point's two rows: unknown by unknown, x and y. */
static inline __attribute__((always_inline)) void gather(const Run *run, double (*partials)[ELEMENTS], double *pairs)
{
    for (int64_t k = 0; k < run->count; k++) {
        pairs[2 * k] = partials[0][run->elements[k]];
        pairs[2 * k + 1] = partials[1][run->elements[k]];
    }
}

FOR_EACH_PROCESSOR
static void residual_loop(const Block *b, double *residual, uint8_t *in_front)
{
    for (int64_t row = 0; row < b->count; row++) {
        double mm[2] = {0.0, 0.0};
        in_front[row] = (uint8_t)linearise(b, row, mm, NULL);
        residual[2 * row] = mm[0] / b->error[2 * row];
        residual[2 * row + 1] = mm[1] / b->error[2 * row + 1];
    }
}

typedef struct {
    const double *factor, *misclosure;
    const uint8_t *fixed;
    double max_lost_digits;
    double *blocks, *block_right, *diagonal, *right;
    double *half, *lost, *coupling;
    uint8_t *removed;
    Reduced reduced;
} Normals;

/* Add a photo point to the normal equations; W: the point's coupling, three numbers for each of its unknowns. */
static inline __attribute__((always_inline)) void add_photo_point(const Block *b, Normals *n, int64_t row, double *V,
                                                                 double *g, double *W)
{
    double mm[2], partials[2][ELEMENTS], pairs[2][2 * MOST_UNKNOWNS];
    const double *f = n->factor + 2 * row, *y = n->misclosure + 2 * row;
    if ((f[0] == 0.0 && f[1] == 0.0) || !linearise(b, row, mm, partials))
        return;
    for (int element = 0; element < ELEMENTS; element++) {
        partials[0][element] *= f[0];
        partials[1][element] *= f[1];
    }
    const double *px = partials[0] + POINT, *py = partials[1] + POINT;
    for (int i = 0; i < 3; i++) {
        g[i] += px[i] * y[0] + py[i] * y[1];
        for (int j = 0; j < 3; j++)
            V[3 * i + j] += px[i] * px[j] + py[i] * py[j];
    }
    const Run runs[2] = {run_of(b, b->camera[row]), run_of(b, b->camera_count + b->photo[row])};
    const int64_t places[2] = {b->camera_at[row], b->photo_at[row]};
    for (int r = 0; r < 2; r++) {
        gather(&runs[r], partials, pairs[r]);
        for (int64_t k = 0; k < runs[r].count; k++) {
            const double x = pairs[r][2 * k], z = pairs[r][2 * k + 1];
            double *w = W + 3 * (places[r] + k);
            for (int i = 0; i < 3; i++)
                w[i] += x * px[i] + z * py[i];
            n->right[runs[r].first + k] += x * y[0] + z * y[1];
            n->diagonal[runs[r].first + k] += x * x + z * z;
        }
        for (int s = 0; s <= r; s++)
            add_products(&n->reduced, runs[r].first, runs[r].count, pairs[r], runs[s].first, runs[s].count, pairs[s], 2,
                         1.0);
    }
}

FOR_EACH_PROCESSOR
static void normals_loop(const Block *b, Normals *n)
{
    for (int64_t block = 0; block < b->blocks; block++) {
        double *V = n->blocks + 9 * block, *g = n->block_right + 3 * block, *H = n->half + 9 * block;
        double *W = n->coupling + 3 * b->coupling_start[block];
        const int64_t unknowns = b->coupling_start[block + 1] - b->coupling_start[block];
        for (int64_t k = b->start[block]; k < b->start[block + 1]; k++)
            add_photo_point(b, n, b->order[k], V, g, W);
        factorise_block(V, n->fixed + 3 * block, n->max_lost_digits, H, n->lost + 3 * block, n->removed + 3 * block);
        const double given[3] = {g[0], g[1], g[2]};
        multiply(H, given, g);
        for (int64_t k = 0; k < unknowns; k++) {
            const double w[3] = {W[3 * k], W[3 * k + 1], W[3 * k + 2]};
            multiply(H, w, W + 3 * k);
        }
        const double *a = W;
        for (int64_t r = b->runs_start[block]; r < b->runs_start[block + 1]; r++) {
            const Run run = run_of(b, b->runs[r]);
            for (int64_t k = 0; k < run.count; k++)
                n->right[run.first + k] -= a[3 * k] * g[0] + a[3 * k + 1] * g[1] + a[3 * k + 2] * g[2];
            const double *c = W;
            for (int64_t s = b->runs_start[block]; s <= r; s++) {
                const Run other = run_of(b, b->runs[s]);
                add_products(&n->reduced, run.first, run.count, a, other.first, other.count, c, 3, -1.0);
                c += 3 * other.count;
            }
            a += 3 * run.count;
        }
    }
}

typedef struct {
    const double *half, *coupling;
    double *cofactors, *leverage, *product;
    Reduced inverse;
} Precision;

/* Add Q a to `of_b` and Q b to `of_a`, for the part of Q between the unknowns of two runs; three numbers for each. */
static inline __attribute__((always_inline)) void add_inverse_times(
    const Reduced *Q, int64_t first_i, int64_t count_i, const double *a, double *of_a, int64_t first_j, int64_t count_j,
    const double *b, double *of_b)
{
    const int same = a == b, is_border = first_i >= Q->banded;
    for (int64_t j = 0; j < count_j; j++)
        for (int64_t i = same ? j : 0; i < count_i; i++) {
            const double q = is_border ? Q->border[(first_i + i - Q->banded) * Q->size + first_j + j]
                                       : Q->band[(first_j + j) * Q->stride + first_i + i];
            for (int k = 0; k < 3; k++)
                of_a[3 * i + k] += q * b[3 * j + k];
            if (!same || i != j)
                for (int k = 0; k < 3; k++)
                    of_b[3 * j + k] += q * a[3 * i + k];
        }
}

/* Add a Q a^T for the part of Q between the unknowns of two runs, for x and y; `a`, `b` hold pairs. */
static inline __attribute__((always_inline)) void add_quadratic(
    const Reduced *Q, const Run *one, const double *a, const Run *other, const double *b, double *sums)
{
    const int same = a == b, swapped = one->first < other->first;
    const Run *high = swapped ? other : one, *low = swapped ? one : other;
    const double *of_high = swapped ? b : a, *of_low = swapped ? a : b;
    const int is_border = high->first >= Q->banded;
    for (int64_t j = 0; j < low->count; j++) {
        double x = 0.0, y = 0.0;
        for (int64_t i = same ? j + 1 : 0; i < high->count; i++) {
            const double q = is_border ? Q->border[(high->first + i - Q->banded) * Q->size + low->first + j]
                                       : Q->band[(low->first + j) * Q->stride + high->first + i];
            x += q * of_high[2 * i];
            y += q * of_high[2 * i + 1];
        }
        sums[0] += 2.0 * x * of_low[2 * j];
        sums[1] += 2.0 * y * of_low[2 * j + 1];
        if (same) {
            const double q = *at(Q, low->first + j, low->first + j);
            sums[0] += q * of_low[2 * j] * of_low[2 * j];
            sums[1] += q * of_low[2 * j + 1] * of_low[2 * j + 1];
        }
    }
}

/* Leverages of a photo point: a_r Q a_r^T - 2 a_r (Q B^T) t + t (I + B Q B^T) t with t = H a_p. */
static inline __attribute__((always_inline)) void photo_point_leverage(
    const Block *b, const Precision *p, int64_t row, const double *H, const double *QB, const double *inner)
{
    double mm[2], partials[2][ELEMENTS], pairs[2][2 * MOST_UNKNOWNS], sums[2] = {0.0, 0.0}, t[2][3];
    if (!linearise(b, row, mm, partials))
        return;
    for (int c = 0; c < 2; c++) {
        double with_inner[3];
        multiply(H, partials[c] + POINT, t[c]);
        multiply(inner, t[c], with_inner);
        for (int k = 0; k < 3; k++)
            sums[c] += t[c][k] * with_inner[k];
    }
    const Run runs[2] = {run_of(b, b->camera[row]), run_of(b, b->camera_count + b->photo[row])};
    const int64_t places[2] = {b->camera_at[row], b->photo_at[row]};
    for (int r = 0; r < 2; r++) {
        gather(&runs[r], partials, pairs[r]);
        for (int64_t i = 0; i < runs[r].count; i++) {
            const double *qb = QB + 3 * (places[r] + i);
            for (int c = 0; c < 2; c++)
                sums[c] -= 2.0 * pairs[r][2 * i + c] * (qb[0] * t[c][0] + qb[1] * t[c][1] + qb[2] * t[c][2]);
        }
        for (int s = 0; s <= r; s++)
            if (runs[r].count && runs[s].count)
                add_quadratic(&p->inverse, &runs[r], pairs[r], &runs[s], pairs[s], sums);
    }
    for (int c = 0; c < 2; c++)
        p->leverage[2 * row + c] = sums[c] / (b->error[2 * row + c] * b->error[2 * row + c]);
}

FOR_EACH_PROCESSOR
static void precision_loop(const Block *b, const Precision *p)
{
    for (int64_t block = 0; block < b->blocks; block++) {
        const double *H = p->half + 9 * block, *B = p->coupling + 3 * b->coupling_start[block];
        const int64_t unknowns = b->coupling_start[block + 1] - b->coupling_start[block];
        double *QB = p->product;
        memset(QB, 0, sizeof(double) * 3 * (size_t)unknowns);
        int64_t at_r = 0;
        for (int64_t r = b->runs_start[block]; r < b->runs_start[block + 1]; r++) {
            const Run run = run_of(b, b->runs[r]);
            int64_t at_s = 0;
            for (int64_t s = b->runs_start[block]; s <= r; s++) {
                const Run other = run_of(b, b->runs[s]);
                if (run.count && other.count && run.first >= other.first)
                    add_inverse_times(&p->inverse, run.first, run.count, B + at_r, QB + at_r, other.first, other.count,
                                      B + at_s, QB + at_s);
                else if (run.count && other.count)
                    add_inverse_times(&p->inverse, other.first, other.count, B + at_s, QB + at_s, run.first, run.count,
                                      B + at_r, QB + at_r);
                at_s += 3 * other.count;
            }
            at_r += 3 * run.count;
        }
        double inner[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
        for (int64_t k = 0; k < unknowns; k++)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    inner[3 * i + j] += B[3 * k + i] * QB[3 * k + j];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double sum = 0.0;
                for (int k = 0; k < 3; k++)
                    for (int l = 0; l < 3; l++)
                        sum += H[3 * k + i] * inner[3 * k + l] * H[3 * l + j];
                p->cofactors[9 * block + 3 * i + j] = sum;
            }
        for (int64_t k = b->start[block]; k < b->start[block + 1]; k++)
            photo_point_leverage(b, p, b->order[k], H, QB, inner);
    }
}

/* Open the buffers of all arguments; `writable` counts from the end. On failure none stays open. */
static int open_buffers(PyObject *const *arguments, int count, int writable, Py_buffer *views)
{
    for (int k = 0; k < count; k++)
        if (PyObject_GetBuffer(arguments[k], &views[k], k < count - writable ? PyBUF_SIMPLE : PyBUF_WRITABLE)) {
            while (k--)
                PyBuffer_Release(&views[k]);
            return 0;
        }
    return 1;
}

static void release_buffers(Py_buffer *views, int count)
{
    while (count--)
        PyBuffer_Release(&views[count]);
}

static PyObject *refused(Py_buffer *views, int count)
{
    release_buffers(views, count);
    PyErr_SetString(PyExc_ValueError, "arrays of the observation loop do not belong together");
    return NULL;
}

static int has_length(const Py_buffer *view, int64_t numbers, int64_t bytes)
{
    return view->len == numbers * bytes;
}

/* Take the observations, and with `pattern` the pattern of the normal equations, from the arguments. */
static int block_from(const Py_buffer *v, int pattern, Block *b)
{
    memset(b, 0, sizeof *b);
    b->cameras = v[CAMERAS].buf, b->centres = v[CENTRES].buf, b->rotations = v[ROTATIONS].buf;
    b->bases = v[BASES].buf, b->ground = v[GROUND].buf;
    b->camera = v[OF_CAMERA].buf, b->photo = v[OF_PHOTO].buf, b->point = v[OF_POINT].buf;
    b->at_measured = v[AT_MEASURED].buf, b->xy = v[XY].buf, b->error = v[ERROR].buf;
    b->count = v[AT_MEASURED].len;
    b->camera_count = v[CAMERAS].len / (11 * 8);
    const int64_t photos = v[CENTRES].len / (3 * 8);
    int sound = has_length(&v[OF_CAMERA], b->count, 8) && has_length(&v[OF_PHOTO], b->count, 8)
        && has_length(&v[OF_POINT], b->count, 8) && has_length(&v[XY], 2 * b->count, 8)
        && has_length(&v[ERROR], 2 * b->count, 8) && has_length(&v[ROTATIONS], 9 * photos, 8)
        && has_length(&v[BASES], 9 * photos, 8);
    if (!pattern || !sound)
        return sound;
    b->order = v[ORDER].buf, b->start = v[START].buf, b->camera_at = v[CAMERA_AT].buf, b->photo_at = v[PHOTO_AT].buf;
    b->run_first = v[RUN_FIRST].buf, b->run_count = v[RUN_COUNT].buf, b->run_elements = v[RUN_ELEMENTS].buf;
    b->runs_start = v[RUNS_START].buf, b->runs = v[RUNS].buf, b->coupling_start = v[COUPLING_START].buf;
    b->blocks = v[START].len / 8 - 1;
    const int64_t runs = b->camera_count + photos;
    return b->blocks >= 0 && has_length(&v[CAMERA_AT], b->count, 8) && has_length(&v[PHOTO_AT], b->count, 8)
        && has_length(&v[RUN_FIRST], runs, 8) && has_length(&v[RUN_COUNT], runs, 8)
        && has_length(&v[RUN_ELEMENTS], 11 * runs, 8) && has_length(&v[RUNS_START], b->blocks + 1, 8)
        && has_length(&v[COUPLING_START], b->blocks + 1, 8) && has_length(&v[ORDER], b->start[b->blocks], 8)
        && has_length(&v[RUNS], b->runs_start[b->blocks], 8);
}

static int reduced_from(const Py_buffer *band, const Py_buffer *border, int64_t stride, int64_t banded, int64_t size,
                        Reduced *m)
{
    const Reduced made = {band->buf, border->buf, stride, banded, size};
    *m = made;
    const int64_t last = banded > 0 ? (banded - 1) * (stride + 1) : -1;
    return stride >= 0 && banded >= 0 && banded <= size && band->len >= 8 * (last + 1)
        && has_length(border, (size - banded) * size, 8);
}

static PyObject *residuals(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { RESIDUAL = OBSERVATION_END, IN_FRONT, COUNT };
    Py_buffer v[COUNT];
    Block b;
    if (given != COUNT) {
        PyErr_SetString(PyExc_TypeError, "residuals: wrong number of arguments");
        return NULL;
    }
    if (!open_buffers(arguments, COUNT, COUNT - RESIDUAL, v))
        return NULL;
    if (!block_from(v, 0, &b) || !has_length(&v[RESIDUAL], 2 * b.count, 8) || !has_length(&v[IN_FRONT], b.count, 1))
        return refused(v, COUNT);
    Py_BEGIN_ALLOW_THREADS
    residual_loop(&b, v[RESIDUAL].buf, v[IN_FRONT].buf);
    Py_END_ALLOW_THREADS
    release_buffers(v, COUNT);
    Py_RETURN_NONE;
}

static PyObject *eliminate(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum {
        FACTOR = PATTERN_END, MISCLOSURE, FIXED, BLOCKS, BLOCK_RIGHT, DIAGONAL, RIGHT, HALF, LOST, REMOVED, COUPLING, BAND,
        BORDER, COUNT
    };
    Py_buffer v[COUNT];
    Block b;
    Normals n;
    if (given != COUNT + 3) {
        PyErr_SetString(PyExc_TypeError, "eliminate: wrong number of arguments");
        return NULL;
    }
    const double max_lost_digits = PyFloat_AsDouble(arguments[COUNT]);
    const int64_t stride = PyLong_AsLongLong(arguments[COUNT + 1]), banded = PyLong_AsLongLong(arguments[COUNT + 2]);
    if (PyErr_Occurred() || !open_buffers(arguments, COUNT, COUNT - BLOCKS, v))
        return NULL;
    const int64_t size = v[RIGHT].len / 8;
    if (!block_from(v, 1, &b) || !has_length(&v[FACTOR], 2 * b.count, 8) || !has_length(&v[MISCLOSURE], 2 * b.count, 8)
        || !has_length(&v[FIXED], 3 * b.blocks, 1) || !has_length(&v[BLOCKS], 9 * b.blocks, 8)
        || !has_length(&v[BLOCK_RIGHT], 3 * b.blocks, 8) || !has_length(&v[DIAGONAL], size, 8)
        || !has_length(&v[HALF], 9 * b.blocks, 8) || !has_length(&v[LOST], 3 * b.blocks, 8)
        || !has_length(&v[REMOVED], 3 * b.blocks, 1) || !has_length(&v[COUPLING], 3 * b.coupling_start[b.blocks], 8)
        || !reduced_from(&v[BAND], &v[BORDER], stride, banded, size, &n.reduced))
        return refused(v, COUNT);
    n.factor = v[FACTOR].buf, n.misclosure = v[MISCLOSURE].buf, n.fixed = v[FIXED].buf;
    n.max_lost_digits = max_lost_digits;
    n.blocks = v[BLOCKS].buf, n.block_right = v[BLOCK_RIGHT].buf, n.diagonal = v[DIAGONAL].buf, n.right = v[RIGHT].buf;
    n.half = v[HALF].buf, n.lost = v[LOST].buf, n.removed = v[REMOVED].buf, n.coupling = v[COUPLING].buf;
    Py_BEGIN_ALLOW_THREADS
    memset(n.coupling, 0, (size_t)v[COUPLING].len);
    normals_loop(&b, &n);
    Py_END_ALLOW_THREADS
    release_buffers(v, COUNT);
    Py_RETURN_NONE;
}

static PyObject *precision(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    enum { HALF = PATTERN_END, COUPLING, BAND, BORDER, COFACTORS, LEVERAGE, PRODUCT, COUNT };
    Py_buffer v[COUNT];
    Block b;
    Precision p;
    if (given != COUNT + 3) {
        PyErr_SetString(PyExc_TypeError, "precision: wrong number of arguments");
        return NULL;
    }
    const int64_t stride = PyLong_AsLongLong(arguments[COUNT]), banded = PyLong_AsLongLong(arguments[COUNT + 1]);
    const int64_t size = PyLong_AsLongLong(arguments[COUNT + 2]);
    if (PyErr_Occurred() || !open_buffers(arguments, COUNT, COUNT - COFACTORS, v))
        return NULL;
    if (!block_from(v, 1, &b) || !has_length(&v[HALF], 9 * b.blocks, 8) || !has_length(&v[COFACTORS], 9 * b.blocks, 8)
        || !has_length(&v[COUPLING], 3 * b.coupling_start[b.blocks], 8) || !has_length(&v[LEVERAGE], 2 * b.count, 8)
        || !reduced_from(&v[BAND], &v[BORDER], stride, banded, size, &p.inverse))
        return refused(v, COUNT);
    for (int64_t block = 0; block < b.blocks; block++)
        if (8 * 3 * (b.coupling_start[block + 1] - b.coupling_start[block]) > v[PRODUCT].len)
            return refused(v, COUNT);
    p.half = v[HALF].buf, p.coupling = v[COUPLING].buf, p.cofactors = v[COFACTORS].buf, p.leverage = v[LEVERAGE].buf;
    p.product = v[PRODUCT].buf;
    Py_BEGIN_ALLOW_THREADS
    precision_loop(&b, &p);
    Py_END_ALLOW_THREADS
    release_buffers(v, COUNT);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"residuals", (PyCFunction)(void (*)(void))residuals, METH_FASTCALL, "Residuals of all photo points."},
    {"eliminate", (PyCFunction)(void (*)(void))eliminate, METH_FASTCALL, "Normal equations, points eliminated."},
    {"precision", (PyCFunction)(void (*)(void))precision, METH_FASTCALL, "Cofactors of points, leverages."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_observation_loop", "Loops over the photo points of a block.", -1, methods, NULL, NULL, NULL,
    NULL,
};

PyMODINIT_FUNC PyInit__observation_loop(void)
{
    return PyModule_Create(&definition);
}
