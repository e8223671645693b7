/* Normal equations while they are formed: the reduced matrix, and the elimination of a point's three unknowns. */

#ifndef ORIP_NORMALS_H
#define ORIP_NORMALS_H

#include <math.h>
#include <stdint.h>

#define LOST_ALL 99.0
#define AS_LARGE 1e-9

/* Lower triangle of a symmetric matrix of `size` unknowns in their places. Of the first `banded` of them element (i, j)
 * stands at band[j * stride + i]; a full matrix has stride = size. Those that follow have full rows in `border`.
 */
typedef struct {
    double *band, *border;
    int64_t stride, banded, size;
} Reduced;

/* The unknowns of a camera or photo: `count` of them in places from `first`; each element's number among the partials. */
typedef struct {
    int64_t first, count;
    const int64_t *elements;
} Run;

static inline __attribute__((always_inline)) double *at(const Reduced *m, int64_t i, int64_t j)
{
    return i < m->banded ? m->band + j * m->stride + i : m->border + (i - m->banded) * m->size + j;
}

#define MOST_IN_RUN 11
#define PHOTO_UNKNOWNS 6

/* Add sign * sum over k of a[i][k] b[j][k] for the unknowns of two runs, with vectors of `width` for each unknown. */
static inline __attribute__((always_inline)) void add_products(
    const Reduced *m, int64_t first_i, int64_t count_i, const double *a, int64_t first_j, int64_t count_j,
    const double *b, int width, double sign)
{
    if (first_i < first_j) {
        const int64_t first = first_i, count = count_i;
        const double *vectors = a;
        first_i = first_j, count_i = count_j, a = b;
        first_j = first, count_j = count, b = vectors;
    }
    if (!count_i || !count_j)
        return;
    if (first_i >= m->banded) {
        for (int64_t i = 0; i < count_i; i++) {
            double *row = m->border + (first_i + i - m->banded) * m->size + first_j;
            for (int64_t j = 0; j < (first_i == first_j ? i + 1 : count_j); j++) {
                double sum = 0.0;
                for (int k = 0; k < width; k++)
                    sum += a[width * i + k] * b[width * j + k];
                row[j] += sign * sum;
            }
        }
        return;
    }
    /* component by component, so that elements that stand beside each other are added at once */
    double components[3][MOST_IN_RUN];
    for (int64_t i = 0; i < count_i; i++)
        for (int k = 0; k < width; k++)
            components[k][i] = sign * a[width * i + k];
    for (int64_t j = 0; j < count_j; j++) {
        double *column = m->band + (first_j + j) * m->stride + first_i;
        if (first_i != first_j && count_i == PHOTO_UNKNOWNS)
            for (int64_t i = 0; i < PHOTO_UNKNOWNS; i++) {
                double sum = components[0][i] * b[width * j];
                for (int k = 1; k < width; k++)
                    sum += components[k][i] * b[width * j + k];
                column[i] += sum;
            }
        else
            for (int64_t i = first_i == first_j ? j : 0; i < count_i; i++) {
                double sum = components[0][i] * b[width * j];
                for (int k = 1; k < width; k++)
                    sum += components[k][i] * b[width * j + k];
                column[i] += sum;
            }
    }
}

/* Factor a symmetric 3 x 3 block; see orip/adjustment/elimination.py. half: H with H^T H = inverse of the block. */
static inline __attribute__((always_inline)) void factorise_block(
    const double *block, const uint8_t *fixed, double max_lost_digits, double *half, double *lost, uint8_t *removed)
{
    double scale[3], rest[3][3], accumulated[3][3];
    int open[3];
    for (int i = 0; i < 3; i++) {
        const double diagonal = block[4 * i];
        const int empty = !fixed[i] && diagonal <= 0.0;
        lost[i] = empty ? LOST_ALL : 0.0;
        removed[i] = (uint8_t)empty;
        open[i] = !fixed[i] && !empty;
        scale[i] = open[i] ? 1.0 / sqrt(diagonal) : 0.0;
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            rest[i][j] = block[3 * i + j] * scale[i] * scale[j];
            accumulated[i][j] = i == j;
            half[3 * i + j] = 0.0;
        }
    for (int step = 0; step < 3; step++) {
        int place = -1;
        for (int i = 0; i < 3; i++)
            if (open[i] && (place < 0 || rest[i][i] > rest[place][place]))
                place = i;
        if (place < 0)
            break;
        /* of pivots that are as large but for rounding the first is taken */
        const double as_large = rest[place][place] - AS_LARGE * fabs(rest[place][place]);
        for (int i = 2; i >= 0; i--)
            if (open[i] && rest[i][i] >= as_large)
                place = i;
        const double pivot = rest[place][place];
        lost[place] = pivot > 0.0 ? -log10(pivot) : LOST_ALL;
        open[place] = 0;
        if (!(lost[place] <= max_lost_digits)) {
            removed[place] = 1;
            continue;
        }
        const double root = sqrt(pivot);
        double row[3], own[3];
        for (int j = 0; j < 3; j++) {
            row[j] = rest[place][j];
            own[j] = accumulated[place][j];
            half[3 * step + j] = own[j] / root * scale[j];
        }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const double multiplier = row[i] / pivot;
                rest[i][j] -= multiplier * row[j];
                accumulated[i][j] -= multiplier * own[j];
            }
    }
}

static inline __attribute__((always_inline)) void multiply(const double *matrix, const double *vector, double *result)
{
    for (int i = 0; i < 3; i++)
        result[i] = matrix[3 * i] * vector[0] + matrix[3 * i + 1] * vector[1] + matrix[3 * i + 2] * vector[2];
}

#endif
