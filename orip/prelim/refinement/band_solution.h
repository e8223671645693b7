/* Symmetric equations whose matrix is a band, solved by Cholesky's method (Brown 1976 arranges photos so).
 *
 * A band has the columns of the lower half one after the other, `width` numbers of each from the diagonal on; what
 * would lie below the last row is 0. It is factored by LAPACK, which SciPy offers to compiled code.
 */

#include <stdint.h>

/* dpbtrf of LAPACK; in some builds of SciPy its integers are long. */
static struct {
    void *routine;
    int is_long;
} factorising;

/* Look for dpbtrf; 0 where there is none, with an exception. */
static int find_lapack(void)
{
    PyObject *library = factorising.routine ? NULL : PyImport_ImportModule("scipy.linalg.cython_lapack");
    PyObject *routines = library ? PyObject_GetAttrString(library, "__pyx_capi__") : NULL;
    PyObject *capsule = routines ? PyMapping_GetItemString(routines, "dpbtrf") : NULL;
    const char *types = capsule ? PyCapsule_GetName(capsule) : NULL;
    if (types) {
        factorising.is_long = !strstr(types, ", int *");
        factorising.routine = PyCapsule_GetPointer(capsule, types);
    }
    Py_XDECREF(capsule);
    Py_XDECREF(routines);
    Py_XDECREF(library);
    return factorising.routine != NULL;
}

#define FACTORISE(integer)                                                                                             \
    do {                                                                                                               \
        integer n = (integer)size, below = (integer)(width - 1), stored = (integer)width, info = 0;                    \
        ((void (*)(char *, integer *, integer *, double *, integer *, integer *))factorising.routine)(                 \
            &lower, &n, &below, band, &stored, &info);                                                                 \
        return info == 0;                                                                                              \
    } while (0)

/* Replace a band by its factor L; 0 where it is not positive definite. */
static int factorise_band(double *band, int64_t size, int64_t width)
{
    char lower = 'L';
    if (size == 0)
        return 1;
    if (factorising.is_long)
        FACTORISE(int64_t);
    else
        FACTORISE(int);
}

static inline void subtract_column(double *to, const double *column, double factor, int64_t count)
{
    for (int64_t i = 0; i < count; i++)
        to[i] -= factor * column[i];
}

/* Replace rows (size, `count` numbers each) by L^-1 of them. */
static void reduce_by_band(const double *band, int64_t size, int64_t width, double *rows, int64_t count)
{
    for (int64_t k = 0; k < size; k++) {
        const double *L = band + k * width;
        double *row = rows + k * count;
        for (int64_t i = 0; i < count; i++)
            row[i] /= L[0];
        for (int64_t below = 1; below < width && k + below < size; below++)
            subtract_column(row + below * count, row, L[below], count);
    }
}

/* Replace a vector by L^-T of it. */
static void substitute_by_band(const double *band, int64_t size, int64_t width, double *vector)
{
    for (int64_t k = size - 1; k >= 0; k--) {
        const double *L = band + k * width;
        for (int64_t below = 1; below < width && k + below < size; below++)
            vector[k] -= L[below] * vector[k + below];
        vector[k] /= L[0];
    }
}
