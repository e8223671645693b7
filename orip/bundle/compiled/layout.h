/* The layout of a block: its index arrays, copied and checked once, and how its groups are shared out among threads. */

#include "../../array_arguments.h"

#include "loops.h"

/* The index arrays of a block, from which a layout is made. */
enum {
    KIND, SET_DEGREE, FORM, OF_CAMERA, OF_PHOTO, OF_POINT,
    ORDER, START, BLOCK, GROUP_START, RUNS_START, RUNS,
    CAMERA_PRODUCTS, CAMERA_OWN, CAMERA_ELEMENTS, CAMERA_UNKNOWNS, CAMERA_TERMS, LAYOUT_END
};
#define LAYOUT "iibiii" "iiiiii" "iiiii"
/* After them: the unknowns of a photo. */
#define LAYOUT_NAME "orip.bundle.compiled.layout"

/* Numbers that the groups of a share need together, if there are several of them: 512 KB. With more of them a thread seldom
 * adds to what another one has just changed, which its processor would have to fetch. */
#define NUMBERS_OF_SHARE (1 << 16)

/* Unknowns of the reduced system, or of a group; products of two such sizes still are numbers of 64 bits. */
#define LARGEST_SYSTEM (INT64_C(1) << 28)

/* Copies of index arrays, which were checked when they were made and cannot be changed from outside: what a loop is
 * called with need not be checked index by index. */
typedef struct {
    Block block;
    Pattern pattern;
    int64_t points;
    int32_t *share_start;
} Layout;

/* Whether the sizes of the index arrays belong together. */
static int do_indices_fit(const Arguments *a)
{
    const int64_t cameras = length_of(a, FORM), photos = length_of(a, OF_CAMERA), count = length_of(a, OF_PHOTO);
    const int64_t groups = length_of(a, GROUP_START) - 1;
    return count <= INT32_MAX && cameras + photos <= INT32_MAX && groups >= 0 && groups < INT32_MAX
        && HAVE(a, KIND, cameras, cameras) && has(a, OF_POINT, count) && has(a, START, length_of(a, BLOCK) + 1)
        && has(a, RUNS_START, groups + 1)
        && HAVE(a, CAMERA_PRODUCTS, cameras, cameras, CAMERA_PARAMETERS * cameras, cameras,
                2 * MOST_CAMERA_UNKNOWNS * cameras)
        && is_whole(a->numbers[0], ORIENTATION_UNKNOWNS, PHOTO_UNKNOWNS)
        && (int)a->numbers[0] % MOTION_STEP == 0;
}

/* Whether each camera has the columns that its unknowns are sums of: without products, those of its elements. */
static int are_columns_sound(const Block *b, const Pattern *p)
{
    for (int64_t camera = 0; camera < b->camera_count; camera++) {
        const int32_t degree = b->polynomials[camera], products = p->camera_products[camera];
        const int32_t own = p->camera_own[camera], unknowns = p->camera_unknowns[camera];
        const int has_products = products > 0;
        if (own < 0 || own > CAMERA_PARAMETERS || products < 0 || unknowns < 0 || unknowns > MOST_CAMERA_UNKNOWNS
            || (has_products && (products > MOST_PRODUCTS || products != degree * degree - 1 || products % 4))
            || unknowns > own + 2 * products || (!has_products && unknowns != own)
            || !are_within(p->camera_terms + 2 * MOST_CAMERA_UNKNOWNS * camera, 2 * unknowns, 0, own + 2 * products))
            return 0;
    }
    return 1;
}

/* Whether no index of a layout leads elsewhere; `a` has the arrays that it was copied from, for their lengths. */
static int are_indices_sound(const Arguments *a, const Block *b, const Pattern *p)
{
    const int64_t in_order = length_of(a, ORDER), runs = length_of(a, RUNS);
    return are_within(b->polynomials, b->camera_count, 0, POLYNOMIALS + 1) && are_columns_sound(b, p)
        && are_within(b->camera_of_photo, b->photo_count, 0, b->camera_count)
        && are_within(b->photo, b->count, 0, b->photo_count) && are_within(b->point, b->count, 0, INT32_MAX)
        && are_starts(p->start, p->blocks, in_order) && are_starts(p->group_start, p->groups, p->blocks)
        && are_starts(p->runs_start, p->groups, runs) && are_within(p->order, in_order, 0, b->count)
        && are_within(p->block, p->blocks, 0, p->blocks)
        && are_within(p->runs, runs, 0, b->camera_count + b->photo_count)
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
    size_t size = sizeof(Layout) + sizeof(int32_t) * (size_t)length_of(a, GROUP_START);
    for (int array = 0; array < LAYOUT_END; array++)
        size += (size_t)a->views[array].len;
    Layout *l = PyMem_Calloc(1, size);
    if (!l)
        return NULL;
    Block *b = &l->block;
    Pattern *p = &l->pattern;
    char *room = (char *)(l + 1);
    l->share_start = (int32_t *)room;
    room += sizeof(int32_t) * (size_t)length_of(a, GROUP_START);
    b->kind = copied(a, KIND, &room), b->polynomials = copied(a, SET_DEGREE, &room);
    b->camera_of_photo = copied(a, OF_CAMERA, &room), b->photo = copied(a, OF_PHOTO, &room);
    b->point = copied(a, OF_POINT, &room);
    p->order = copied(a, ORDER, &room), p->start = copied(a, START, &room), p->block = copied(a, BLOCK, &room);
    p->group_start = copied(a, GROUP_START, &room), p->runs_start = copied(a, RUNS_START, &room);
    p->runs = copied(a, RUNS, &room), p->camera_products = copied(a, CAMERA_PRODUCTS, &room);
    p->camera_own = copied(a, CAMERA_OWN, &room), p->camera_elements = copied(a, CAMERA_ELEMENTS, &room);
    p->camera_unknowns = copied(a, CAMERA_UNKNOWNS, &room), p->camera_terms = copied(a, CAMERA_TERMS, &room);
    b->form = copied(a, FORM, &room);
    b->count = length_of(a, OF_PHOTO), b->camera_count = length_of(a, FORM);
    b->photo_count = length_of(a, OF_CAMERA), b->photo_unknowns = (int64_t)a->numbers[0];
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

/* The columns of a group, or those of its cameras, which are padded. A run of constants alone has a place among the first ones, too. */
static int64_t size_of_group(const Block *b, const Pattern *p, int64_t group, int only_cameras)
{
    const int64_t runs = p->runs_start[group + 1] - p->runs_start[group];
    int64_t size = 0, of_photos = 0;
    for (int32_t r = p->runs_start[group]; r < p->runs_start[group + 1]; r++)
        if (p->runs[r] < b->camera_count)
            size += columns_of(p, p->runs[r]);
        else if (!only_cameras)
            of_photos += b->photo_unknowns;
    size = PADDED(size) + of_photos;
    return only_cameras || size > runs ? size : runs;
}

static int64_t most_columns(const Block *b, const Pattern *p, int only_cameras)
{
    int64_t most = 0;
    for (int64_t group = 0; group < p->groups; group++) {
        const int64_t size = size_of_group(b, p, group, only_cameras);
        most = size > most ? size : most;
    }
    return most;
}

/* Numbers that the sums of a group need, or vectors; is_first: with those of its cameras. */
static int64_t numbers_of_group(const Block *b, const Pattern *p, int64_t group, int is_first)
{
    const int64_t size = size_of_group(b, p, group, 0);
    const int64_t vectors = numbers_of_vectors(size, MOST_VECTORS) + (is_first ? NUMBERS_OF_OWN : 0);
    const int64_t cameras = size_of_group(b, p, group, 1);
    const int64_t sums = numbers_of_sums(size, cameras) + (is_first ? numbers_of_cameras(cameras) : 0);
    return sums > vectors ? sums : vectors;
}

/* Cut the groups into shares of about the same room, which stays in a processor's cache. */
static void cut_into_shares(const Block *b, Pattern *p, int32_t *share_start)
{
    int64_t numbers = 0;
    p->share_start = share_start;
    for (int64_t group = 0; group < p->groups; group++) {
        int64_t of_group = numbers_of_group(b, p, group, !group || !has_same_cameras(b, p, group));
        if (!group || numbers + of_group > NUMBERS_OF_SHARE) {
            share_start[p->shares++] = (int32_t)group;
            numbers = 0;
            of_group = numbers_of_group(b, p, group, 1);
        }
        numbers += of_group;
        p->room = numbers > p->room ? numbers : p->room;
    }
    share_start[p->shares] = (int32_t)p->groups;
    const int64_t of_precision = numbers_of_parts(p->longest, p->most_camera_columns)
        + numbers_of_points(p->most_rays, p->longest, p->most_camera_columns) + MOST_MOVEMENTS * p->longest;
    p->room = of_precision > p->room ? of_precision : p->room;
}

/* Check a layout, and find out what its loops need; all is read in the copies, which nobody else can change. */
static int is_layout_sound(const Arguments *a, Layout *l)
{
    if (!are_indices_sound(a, &l->block, &l->pattern) || !is_pattern_sound(&l->block, &l->pattern))
        return 0;
    for (int64_t k = 0; k < l->block.count; k++)
        l->points = l->block.point[k] >= l->points ? (int64_t)l->block.point[k] + 1 : l->points;
    l->pattern.longest = most_columns(&l->block, &l->pattern, 0);
    l->pattern.most_camera_columns = most_columns(&l->block, &l->pattern, 1);
    for (int64_t k = 0; k < l->pattern.blocks; k++) {
        const int64_t rays = l->pattern.start[k + 1] - l->pattern.start[k];
        l->pattern.most_rays = rays > l->pattern.most_rays ? rays : l->pattern.most_rays;
    }
    if (l->pattern.longest > LARGEST_SYSTEM)
        return 0;
    cut_into_shares(&l->block, &l->pattern, l->share_start);
    return 1;
}

static void free_layout(PyObject *capsule)
{
    PyMem_Free(PyCapsule_GetPointer(capsule, LAYOUT_NAME));
}

static PyObject *layout(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    Arguments a;
    if (!take_arguments(&a, arguments, given, LAYOUT, 1))
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
