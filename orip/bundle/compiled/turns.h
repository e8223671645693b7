/* Threads that go through a block together, each calling the same loop with the same arguments.
 *
 * The work is cut into shares, which do not depend on the number of threads. A thread takes the next one that nobody has
 * taken; what it adds to sums of all it adds when its turn comes, in the order of the shares. So the result is the same to
 * the last bit, however many threads there are. Until its turn comes it keeps what it has found in a room, and goes on with
 * another share in the next room: a faster processor does not wait for a slower one.
 */

#include "../../array_arguments.h"

#define TURNS_NAME "orip.bundle.compiled.turns"
#define MOST_THREADS 256
#define MOST_ROOMS 8

/* At most MOST_ROOMS shares a thread are taken and not added, and these are consecutive: so many locks, one after the
 * other, are enough for their turns. Share k waits for lock k % locks, and then opens that of the next share. */
typedef struct {
    PyThread_type_lock entrance;
    int64_t next;
    int threads, entered, left, locks;
    PyThread_type_lock open[MOST_THREADS * MOST_ROOMS];
} Turns;

/* The shares of a thread that wait for their turns, in their order; each is in a room of its own, one after the other. */
typedef struct {
    int64_t share[MOST_ROOMS];
    int first, count;
} Waiting;

static void free_turns(PyObject *capsule)
{
    Turns *t = PyCapsule_GetPointer(capsule, TURNS_NAME);
    if (t->entrance)
        PyThread_free_lock(t->entrance);
    for (int k = 0; k < t->locks && t->open[k]; k++)
        PyThread_free_lock(t->open[k]);
    PyMem_Free(t);
}

/* Get the locks; all are closed but that of the first share. */
static int has_locks(Turns *t)
{
    t->entrance = PyThread_allocate_lock();
    for (int k = 0; k < t->locks; k++) {
        t->open[k] = PyThread_allocate_lock();
        if (!t->open[k])
            return 0;
        if (k)
            PyThread_acquire_lock(t->open[k], WAIT_LOCK);
    }
    return t->entrance != NULL;
}

static PyObject *turns(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t given)
{
    Arguments a;
    if (!take_arguments(&a, arguments, given, "", 1))
        return NULL;
    if (!is_whole(a.numbers[0], 1.0, MOST_THREADS))
        return refused(&a);
    Turns *t = PyMem_Calloc(1, sizeof(Turns));
    if (!t)
        return PyErr_NoMemory();
    t->threads = (int)a.numbers[0], t->locks = t->threads * MOST_ROOMS;
    PyObject *found = PyCapsule_New(t, TURNS_NAME, free_turns);
    if (!found)
        PyMem_Free(t);
    else if (!has_locks(t)) {
        Py_DECREF(found);
        return PyErr_NoMemory();
    }
    return found;
}

/* Enter as one of the threads; there may be as many as the turns were made for. */
static int enter(Turns *t)
{
    PyThread_acquire_lock(t->entrance, WAIT_LOCK);
    const int may_enter = t->entered < t->threads;
    t->entered += may_enter;
    PyThread_release_lock(t->entrance);
    return may_enter;
}

static int64_t next_share(Turns *t)
{
    PyThread_acquire_lock(t->entrance, WAIT_LOCK);
    const int64_t share = t->next++;
    PyThread_release_lock(t->entrance);
    return share;
}

/* Whether it is the turn of a share; with `wait`, when it is. */
static int is_turn(const Turns *t, int64_t share, int wait)
{
    return PyThread_acquire_lock(t->open[share % t->locks], wait ? WAIT_LOCK : NOWAIT_LOCK);
}

static void end_turn(const Turns *t, int64_t share)
{
    PyThread_release_lock(t->open[(share + 1) % t->locks]);
}

/* Leave; when all threads have, the turns are as they were when they were made. */
static void leave(Turns *t, int64_t turns_taken)
{
    PyThread_acquire_lock(t->entrance, WAIT_LOCK);
    if (++t->left == t->threads) {
        is_turn(t, turns_taken, 1);
        PyThread_release_lock(t->open[0]);
        t->entered = t->left = 0;
        t->next = 0;
    }
    PyThread_release_lock(t->entrance);
}
