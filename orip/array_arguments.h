/* Arguments of compiled functions: arrays of a kind, layout and length that are checked, numbers after them, and room to
 * work in.
 *
 * What is checked here and what is checked of the contents of index arrays is all that stands between a wrong call and
 * memory of somebody else: no function computes before all of its arguments have been checked.
 */

#ifndef ORIP_ARRAY_ARGUMENTS_H
#define ORIP_ARRAY_ARGUMENTS_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <ctype.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#define MOST_ARRAYS 40
#define MOST_NUMBERS 12

typedef struct {
    Py_buffer views[MOST_ARRAYS];
    double numbers[MOST_NUMBERS];
    int opened;
    void *room;
} Arguments;

static void release(Arguments *a)
{
    PyMem_Free(a->room);
    a->room = NULL;
    while (a->opened > 0)
        PyBuffer_Release(&a->views[--a->opened]);
}

/* Kinds of elements: d double, i int32, l int64, b one byte. */
static int is_of_kind(const Py_buffer *view, char kind)
{
    const int one = 1, is_little = *(const char *)&one;
    const char *format = view->format ? view->format : "B";
    if (*format == '@' || *format == '=' || *format == (is_little ? '<' : '>'))
        format++;
    if (format[0] == '\0' || format[1] != '\0')
        return 0;
    switch (kind) {
    case 'd': return format[0] == 'd' && view->itemsize == 8;
    case 'i': return strchr("il", format[0]) && view->itemsize == 4;
    case 'l': return strchr("lq", format[0]) && view->itemsize == 8;
    default: return strchr("bB?", format[0]) && view->itemsize == 1;
    }
}

static const char *name_of_kind(char kind)
{
    return kind == 'd' ? "float64" : kind == 'i' ? "int32" : kind == 'l' ? "int64" : "bool or uint8";
}

/* Open the next array. `kind` is a capital letter for one that is written. */
static int open_array(Arguments *a, PyObject *given, char kind)
{
    Py_buffer *view = &a->views[a->opened];
    const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (isupper((unsigned char)kind) ? PyBUF_WRITABLE : 0);
    const char read = (char)tolower((unsigned char)kind);
    if (PyObject_GetBuffer(given, view, flags) < 0)
        return 0;
    a->opened++;
    if (!is_of_kind(view, read) || (uintptr_t)view->buf % (uintptr_t)view->itemsize) {
        PyErr_Format(PyExc_TypeError, "argument %d has to be an aligned array of %s in the byte order of this machine",
                     a->opened, name_of_kind(read));
        return 0;
    }
    return 1;
}

/* Whether an array that is written shares no memory with another one: index arrays must stay as they were checked. */
static int stand_apart(const Arguments *a, const char *kinds)
{
    for (int k = 0; k < a->opened; k++)
        for (int other = 0; isupper((unsigned char)kinds[k]) && other < a->opened; other++) {
            const Py_buffer *one = &a->views[k], *two = &a->views[other];
            const char *from = one->buf, *start = two->buf;
            if (other != k && one->len && two->len && from < start + two->len && start < from + one->len)
                return 0;
        }
    return 1;
}

/* Take arrays, one of each letter of `kinds`, and then numbers; else an exception is set, and nothing stays open. */
static int take_arguments(Arguments *a, PyObject *const *given, Py_ssize_t count, const char *kinds, int numbers)
{
    const int arrays = (int)strlen(kinds);
    a->opened = 0, a->room = NULL;
    if (count != arrays + numbers) {
        PyErr_Format(PyExc_TypeError, "%d arguments are needed, not %zd", arrays + numbers, count);
        return 0;
    }
    int sound = 1;
    for (int k = 0; k < arrays && sound; k++)
        sound = open_array(a, given[k], kinds[k]);
    for (int k = 0; k < numbers && sound; k++) {
        a->numbers[k] = PyFloat_AsDouble(given[arrays + k]);
        sound = !PyErr_Occurred();
        if (sound && isnan(a->numbers[k])) {
            PyErr_Format(PyExc_ValueError, "argument %d is no number", arrays + k + 1);
            sound = 0;
        }
    }
    if (sound && !stand_apart(a, kinds)) {
        PyErr_SetString(PyExc_ValueError, "an array that is written shares memory with another one");
        sound = 0;
    }
    if (!sound)
        release(a);
    return sound;
}

static PyObject *refused(Arguments *a)
{
    release(a);
    PyErr_SetString(PyExc_ValueError, "arrays or numbers do not belong together");
    return NULL;
}

/* Room that the arguments own; where there is none, they are released. */
static inline void *room_of(Arguments *a, size_t bytes)
{
    a->room = PyMem_Malloc(bytes);
    if (!a->room) {
        release(a);
        PyErr_NoMemory();
    }
    return a->room;
}

static inline PyObject *done(Arguments *a)
{
    release(a);
    Py_RETURN_NONE;
}

static inline PyObject *done_with(Arguments *a, PyObject *found)
{
    release(a);
    return found;
}

static inline int64_t length_of(const Arguments *a, int array)
{
    return a->views[array].len / a->views[array].itemsize;
}

static inline int has(const Arguments *a, int array, int64_t length) { return length_of(a, array) == length; }

static inline int have(const Arguments *a, int first, size_t count, const int64_t *lengths)
{
    int sound = 1;
    for (size_t k = 0; k < count; k++)
        sound &= has(a, first + (int)k, lengths[k]);
    return sound;
}

/* Whether arrays that follow one another have these lengths. */
#define HAVE(a, first, ...) \
    have(a, first, sizeof((int64_t[]){__VA_ARGS__}) / sizeof(int64_t), (const int64_t[]){__VA_ARGS__})

/* Whether all integers of an array are at least `least` and below `end`, without a branch, so that many go at once; and
 * whether an array tells where each of `count` parts of a list of `length` begins, and where the last one ends.
 */
#define INDEX_CHECKS(integer, are_within, are_starts) \
    static inline int are_within(const integer *numbers, int64_t count, int64_t least, int64_t end) \
    { \
        int outside = 0; \
        for (int64_t k = 0; k < count; k++) \
            outside |= (numbers[k] < least) | (numbers[k] >= end); \
        return !outside; \
    } \
    static inline int are_starts(const integer *starts, int64_t count, int64_t length) \
    { \
        int falling = starts[0] != 0 || starts[count] != length; \
        for (int64_t k = 0; k < count; k++) \
            falling |= starts[k] > starts[k + 1]; \
        return !falling; \
    }
INDEX_CHECKS(int32_t, are_within, are_starts)
INDEX_CHECKS(int64_t, are_within64, are_starts64)

/* Whether a number is a whole one between two others. */
static inline int is_whole(double number, double least, double most)
{
    return number >= least && number <= most && number == floor(number);
}

#endif
