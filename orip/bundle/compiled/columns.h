/* From the columns of cameras with sets to their unknowns and back: what the loops sum up is by columns, what goes into
 * the reduced system, and comes from it, by unknowns.
 *
 * Each unknown of a camera is a sum of two columns times factors, u = T c: a parameter of a set, of its products in dx and
 * in dy; an element, of its own column and nothing. N_u = T N_c T^T, and the solution and the inverse by columns are T^T x
 * and T^T Q T.
 */

#include "block.h"

/* Rows of T: two columns and their factors each. */
typedef struct {
    int32_t unknowns, columns;
    const int32_t *terms;
    const double *factors;
} Terms;

/* Find the terms of a camera's unknowns; return whether it has a set: else columns are unknowns. */
INLINE int has_terms(const Pattern *p, int32_t camera, Terms *t)
{
    t->unknowns = p->camera_unknowns[camera], t->columns = columns_of(p, camera);
    t->terms = p->camera_terms + 2 * MOST_CAMERA_UNKNOWNS * (int64_t)camera;
    t->factors = p->term_factors + 2 * MOST_CAMERA_UNKNOWNS * (int64_t)camera;
    return p->camera_products[camera] > 0;
}

/* Replace numbers by columns by T times them. */
INLINE void to_unknowns(const Terms *t, double *numbers)
{
    double given[MOST_CAMERA_COLUMNS];
    memcpy(given, numbers, sizeof(double) * (size_t)t->columns);
    for (int32_t u = 0; u < t->unknowns; u++)
        numbers[u] = t->factors[2 * u] * given[t->terms[2 * u]] + t->factors[2 * u + 1] * given[t->terms[2 * u + 1]];
}

/* Replace numbers by unknowns by T^T times them. */
INLINE void to_columns(const Terms *t, double *numbers)
{
    double given[MOST_CAMERA_UNKNOWNS];
    memcpy(given, numbers, sizeof(double) * (size_t)t->unknowns);
    memset(numbers, 0, sizeof(double) * (size_t)t->columns);
    for (int32_t k = 0; k < 2 * t->unknowns; k++)
        numbers[t->terms[k]] += t->factors[k] * given[k / 2];
}

/* The same with lanes of numbers, which are `stride` apart. */
INLINE void lanes_to_unknowns(const Terms *t, double *numbers, int64_t stride)
{
    Lanes given[MOST_CAMERA_COLUMNS];
    for (int32_t k = 0; k < t->columns; k++)
        given[k] = AT(numbers + k * stride);
    for (int32_t u = 0; u < t->unknowns; u++)
        AT(numbers + u * stride)
            = t->factors[2 * u] * given[t->terms[2 * u]] + t->factors[2 * u + 1] * given[t->terms[2 * u + 1]];
}

INLINE void lanes_to_columns(const Terms *t, double *numbers, int64_t stride)
{
    Lanes found[MOST_CAMERA_COLUMNS];
    for (int32_t k = 0; k < t->columns; k++)
        found[k] = ALL(0.0);
    for (int32_t k = 0; k < 2 * t->unknowns; k++)
        found[t->terms[k]] += t->factors[k] * AT(numbers + k / 2 * stride);
    for (int32_t k = 0; k < t->columns; k++)
        AT(numbers + k * stride) = found[k];
}

/* Replace the lower triangle of the symmetric matrix of the cameras of a group by columns, column j from its element j and
 * each `stride` long, by that by unknowns. */
static void matrix_to_unknowns(const Pattern *p, const Local *local, double *matrix, int64_t stride)
{
    for (int32_t r = 0; r < local->camera_runs; r++) {
        const int64_t first = local->first[r];
        Terms t;
        if (!has_terms(p, local->runs[r], &t))
            continue;
        for (int64_t j = first; j < first + t.columns; j++)
            for (int64_t i = first; i < j; i++)
                matrix[j * stride + i] = matrix[i * stride + j];
        for (int64_t j = 0; j < first; j++)
            to_unknowns(&t, matrix + j * stride + first);
        for (int64_t i = first; i < local->cameras; i += LANES)
            lanes_to_unknowns(&t, matrix + first * stride + i, stride);
        for (int64_t j = first; j < first + t.unknowns; j++)
            to_unknowns(&t, matrix + j * stride + first);
    }
}

/* The same of rows of other unknowns, of which each column has `stride`, with a vector `right` and the sums of squares on
 * the diagonal. */
static void rows_to_unknowns(const Pattern *p, const Local *local, double *matrix, int64_t stride, double *right,
                             double *diagonal)
{
    for (int32_t r = 0; r < local->camera_runs; r++) {
        const int64_t first = local->first[r];
        double squares[MOST_CAMERA_COLUMNS];
        Terms t;
        if (!has_terms(p, local->runs[r], &t))
            continue;
        for (int64_t i = 0; i < local->size - local->cameras; i += LANES)
            lanes_to_unknowns(&t, matrix + first * stride + i, stride);
        memcpy(squares, diagonal + first, sizeof(double) * (size_t)t.columns);
        for (int32_t u = 0; u < t.unknowns; u++) {
            const double *f = t.factors + 2 * u;
            /* no row has both columns */
            diagonal[first + u] = f[0] * f[0] * squares[t.terms[2 * u]] + f[1] * f[1] * squares[t.terms[2 * u + 1]];
        }
        to_unknowns(&t, right + first);
    }
}

/* Replace both triangles of a symmetric matrix, of the cameras of a group, by unknowns by those by columns. */
static void matrix_to_columns(const Pattern *p, const Local *local, int64_t size, double *matrix, int64_t stride)
{
    for (int32_t r = 0; r < local->camera_runs; r++) {
        const int64_t first = local->first[r];
        Terms t;
        if (!has_terms(p, local->runs[r], &t))
            continue;
        for (int64_t j = 0; j < size; j++)
            to_columns(&t, matrix + j * stride + first);
        for (int64_t i = 0; i < size; i += LANES)
            lanes_to_columns(&t, matrix + first * stride + i, stride);
    }
}

/* Replace a vector of a group by columns by that by unknowns, or the other way. */
INLINE void replace_vector(const Pattern *p, const Local *local, double *vector, void (*replace)(const Terms *, double *))
{
    Terms t;
    for (int32_t r = 0; r < local->camera_runs; r++)
        if (has_terms(p, local->runs[r], &t))
            replace(&t, vector + local->first[r]);
}
