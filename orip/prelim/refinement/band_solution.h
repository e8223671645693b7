/* Symmetric equations whose matrix is a band, solved by Cholesky's method (Brown 1976 arranges photos so).
 *
 * A band has the columns of the lower half one after the other, `width` numbers of each from the diagonal on; what
 * would lie below the last row is 0.
 */

#include <math.h>
#include <stdint.h>

static inline void subtract_column(double *to, const double *column, double factor, int64_t count)
{
    for (int64_t i = 0; i < count; i++)
        to[i] -= factor * column[i];
}

/* Subtract the products with the columns of a photo, the first of which is `from`, of a later column `to` of the band. */
static void subtract_photo(const double *band, int64_t width, int64_t from, int64_t to, double *column)
{
    const double *L[6];
    double f[6];
    for (int k = 0; k < 6; k++) {
        L[k] = band + (from + k) * width + to - from - k;
        f[k] = L[k][0];
    }
    if (f[0] == 0.0 && f[1] == 0.0 && f[2] == 0.0 && f[3] == 0.0 && f[4] == 0.0 && f[5] == 0.0)
        return;
    /* each column reaches one row further than the one before */
    const int64_t common = width - to + from;
    for (int64_t i = 0; i < common; i++)
        column[i] -= f[0] * L[0][i] + f[1] * L[1][i] + f[2] * L[2][i] + f[3] * L[3][i] + f[4] * L[4][i] + f[5] * L[5][i];
    for (int k = 1; k < 6; k++)
        subtract_column(column + common, L[k] + common, f[k], k);
}

/* Replace a band by its factor L; 0 where it is not positive definite. `column` has room for one. */
static int factorise_band(double *band, int64_t size, int64_t width, double *column)
{
    for (int64_t k = 0; k < size; k++) {
        double *own = band + k * width;
        memcpy(column, own, (size_t)width * sizeof(double));
        for (int64_t j = k < width ? 0 : k - width + 1; j < k;) {
            if (j % 6 == 0 && j + 6 <= k) {
                subtract_photo(band, width, j, k, column);
                j += 6;
                continue;
            }
            const double *L = band + j * width + k - j;
            subtract_column(column, L, L[0], width - k + j);
            j++;
        }
        if (!(column[0] > 0.0))
            return 0;
        const double root = sqrt(column[0]);
        for (int64_t i = 0; i < width; i++)
            own[i] = column[i] / root;
    }
    return 1;
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
