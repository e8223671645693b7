/* Lines of a measurement log that are a name and two ordinary numbers: nearly all lines of a large one.
 *
 * What is no such line, keywords among them, ends the run; Python reads it field by field, as messages need it.
 */

#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdint.h>
#include <string.h>

#define MOST_WORDS 64
#define LONGEST_NUMBER 64

/* Powers of ten that double precision holds exactly: one division or multiplication rounds as the text says. */
static const double TENS[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                              1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
#define MOST_TENS 22
#define MOST_EXACT (INT64_C(1) << 53)

typedef struct {
    const char *text;
    Py_ssize_t length;
} Word;

static int is_blank(char c) { return c == ' ' || c == '\t'; }
static int is_digit(char c) { return c >= '0' && c <= '9'; }
static char upper(char c) { return c >= 'a' && c <= 'z' ? (char)(c - 'a' + 'A') : c; }

static const char *after_blanks(const char *at, const char *end)
{
    while (at < end && is_blank(*at))
        at++;
    return at;
}

static int is_word(const char *name, Py_ssize_t length, const Word *words, int count)
{
    for (int i = 0; i < count; i++) {
        if (words[i].length != length)
            continue;
        Py_ssize_t same = 0;
        while (same < length && upper(name[same]) == words[i].text[same])
            same++;
        if (same == length)
            return 1;
    }
    return 0;
}

/* Return the end of a number, NULL where there is none; one that is not exact so far is left to Python's conversion. */
static const char *read_number(const char *at, const char *end, double *value)
{
    const char *const start = at;
    const int is_negative = at < end && *at == '-';
    if (at < end && (*at == '-' || *at == '+'))
        at++;
    int64_t mantissa = 0, exponent = 0;
    int digits = 0, is_exact = 1;
    for (int behind_point = 0; at < end; at++) {
        if (*at == '.' && !behind_point) {
            behind_point = 1;
            continue;
        }
        if (!is_digit(*at))
            break;
        digits++;
        is_exact &= mantissa < MOST_EXACT / 10;
        if (is_exact) {
            mantissa = 10 * mantissa + (*at - '0');
            exponent -= behind_point;
        }
    }
    if (!digits)
        return NULL;
    if (at < end && (*at == 'e' || *at == 'E')) {
        const char *power = at + 1;
        const int is_below = power < end && *power == '-';
        if (power < end && (*power == '-' || *power == '+'))
            power++;
        int written = 0;
        const char *const first = power;
        for (; power < end && is_digit(*power); power++)
            written = written < 1000 ? 10 * written + (*power - '0') : written;
        if (power == first)
            return NULL;
        exponent += is_below ? -written : written;
        at = power;
    }
    if (is_exact && exponent >= -MOST_TENS && exponent <= MOST_TENS) {
        const double size = exponent < 0 ? (double)mantissa / TENS[-exponent] : (double)mantissa * TENS[exponent];
        *value = is_negative ? -size : size;
        return at;
    }
    char copy[LONGEST_NUMBER];
    if (at - start >= LONGEST_NUMBER)
        return NULL;
    memcpy(copy, start, (size_t)(at - start));
    copy[at - start] = 0;
    *value = PyOS_string_to_double(copy, NULL, NULL);
    if (*value == -1.0 && PyErr_Occurred()) {
        PyErr_Clear();
        return NULL;
    }
    return at;
}

/* Read one line; return where the next one begins, or NULL. */
static const char *read_line(const char *at, const char *end, const Word *words, int count, double largest, Word *name,
                             double *xy)
{
    name->text = at = after_blanks(at, end);
    while (at < end && *at > ' ' && *at <= '~')
        at++;
    name->length = at - name->text;
    if (!name->length || *name->text == '!' || *name->text == '#' || is_word(name->text, name->length, words, count))
        return NULL;
    for (int i = 0; i < 2; i++) {
        const char *const number = after_blanks(at, end);
        if (number == at || !(at = read_number(number, end, &xy[i])) || !(xy[i] <= largest && xy[i] >= -largest))
            return NULL;
    }
    at = after_blanks(at, end);
    return at < end && *at == '\n' ? at + 1 : NULL;
}

static int take_words(PyObject *given, Word *words)
{
    const Py_ssize_t count = PyTuple_Size(given);
    if (count < 0 || count > MOST_WORDS) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_ValueError, "too many words");
        return -1;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        char *text;
        if (PyBytes_AsStringAndSize(PyTuple_GetItem(given, i), &text, &words[i].length) < 0)
            return -1;
        words[i].text = text;
    }
    return (int)count;
}

static PyObject *py_plain_lines(PyObject *Py_UNUSED(module), PyObject *given)
{
    PyObject *data, *keywords;
    Py_ssize_t place, most, size;
    double largest;
    char *text;
    Word words[MOST_WORDS], name;
    if (!PyArg_ParseTuple(given, "SnnO!d", &data, &place, &most, &PyTuple_Type, &keywords, &largest)
        || PyBytes_AsStringAndSize(data, &text, &size) < 0)
        return NULL;
    const int count = take_words(keywords, words);
    if (count < 0)
        return NULL;
    if (place < 0 || place > size || most < 1) {
        PyErr_SetString(PyExc_ValueError, "no place in the text, or no number of lines");
        return NULL;
    }
    if (most > size)
        most = size + 1;
    double *coordinates = PyMem_Malloc(2 * (size_t)most * sizeof(double));
    PyObject *names = PyList_New(0), *result = NULL;
    if (!coordinates || !names) {
        PyErr_NoMemory();
        goto done;
    }
    const char *at = text + place;
    for (Py_ssize_t lines = 0;; lines++) {
        const char *const next = lines < most ? read_line(at, text + size, words, count, largest, &name,
                                                          &coordinates[2 * lines]) : NULL;
        if (!next) {
            result = Py_BuildValue("nOy#", (Py_ssize_t)(at - text), names, (const char *)coordinates,
                                   2 * lines * (Py_ssize_t)sizeof(double));
            break;
        }
        PyObject *word = PyUnicode_FromStringAndSize(name.text, name.length);
        const int is_appended = word && !PyList_Append(names, word);
        Py_XDECREF(word);
        if (!is_appended)
            break;
        at = next;
    }
done:
    Py_XDECREF(names);
    PyMem_Free(coordinates);
    return result;
}

static PyMethodDef methods[] = {
    {"plain_lines", py_plain_lines, METH_VARARGS, "Names and coordinates of a run of lines, and where it ends."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_plain_lines", "Plain lines of a measurement log.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__plain_lines(void) { return PyModule_Create(&definition); }
