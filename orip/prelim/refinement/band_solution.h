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

/* Rows of L below the diagonal in column k. */
static inline int64_t rows_below(int64_t size, int64_t width, int64_t k)
{
    return width - 1 < size - 1 - k ? width - 1 : size - 1 - k;
}

/* Replace a vector by L^-1 of it. */
static void reduce_vector(const double *band, int64_t size, int64_t width, double *vector)
{
    for (int64_t k = 0; k < size; k++) {
        const double *L = band + k * width;
        vector[k] /= L[0];
        subtract_column(vector + k + 1, L + 1, vector[k], rows_below(size, width, k));
    }
}

/* Replace rows (size, `count` numbers each) by L^-1 of them. */
static void reduce_rows(const double *band, int64_t size, int64_t width, double *rows, int64_t count)
{
    for (int64_t k = 0; k < size; k++) {
        const double *L = band + k * width;
        double *row = rows + k * count;
        for (int64_t i = 0; i < count; i++)
            row[i] /= L[0];
        const int64_t below = rows_below(size, width, k);
        for (int64_t next = 1; next <= below; next++)
            subtract_column(row + next * count, row, L[next], count);
    }
}

/* Replace a vector by L^-T of it; four sums at a time, as a sum waits for the one before. */
static void substitute_by_band(const double *band, int64_t size, int64_t width, double *vector)
{
    for (int64_t k = size - 1; k >= 0; k--) {
        const double *L = band + k * width + 1, *solved = vector + k + 1;
        const int64_t below = rows_below(size, width, k);
        double sums[4] = {0.0};
        int64_t i = 0;
        for (; i + 4 <= below; i += 4)
            for (int of = 0; of < 4; of++)
                sums[of] += L[i + of] * solved[i + of];
        for (; i < below; i++)
            sums[0] += L[i] * solved[i];
        vector[k] = (vector[k] - (sums[0] + sums[1] + sums[2] + sums[3])) / L[-1];
    }
}
