/* The three unknowns of a point: their block of the normal equations factored. */

#include <math.h>
#include <stdint.h>

#include "../../lanes.h"

#define AS_LARGE 1e-9
#define WELL_DETERMINED 1e-3
#define WELL_SEEN 1e-4

/* Factor a symmetric 3 x 3 block in the order of its coordinates; return whether no other order would be better.
 * half: H with H^T H = inverse of the block. */
INLINE int factorise_in_order(
    const double *block, const double *full, const uint8_t *fixed, double least_pivot, double *half, double *pivots)
{
    if (fixed[0] || fixed[1] || fixed[2])
        return 0;
    if (!(block[0] > WELL_SEEN * full[0] && block[4] > WELL_SEEN * full[1] && block[8] > WELL_SEEN * full[2]))
        return 0;
    const double a = 1.0 / block[0], l10 = block[3] * a, l20 = block[6] * a;
    const double d1 = block[4] - l10 * block[3], b = 1.0 / d1, e = block[7] - l20 * block[3], l21 = e * b;
    const double d2 = block[8] - l20 * block[6] - l21 * e;
    pivots[0] = block[0] / full[0];
    pivots[1] = d1 / full[1];
    pivots[2] = d2 / full[2];
    if (!(d1 > WELL_DETERMINED * block[4] && d2 > WELL_DETERMINED * block[8]))
        return 0;
    if (!(pivots[0] >= least_pivot && pivots[1] >= least_pivot && pivots[2] >= least_pivot))
        return 0;
    const double roots[3] = {sqrt(a), sqrt(b), sqrt(1.0 / d2)};
    half[0] = roots[0], half[1] = half[2] = half[5] = 0.0;
    half[3] = -l10 * roots[1], half[4] = roots[1];
    half[6] = (l21 * l10 - l20) * roots[2], half[7] = -l21 * roots[2], half[8] = roots[2];
    return 1;
}

/* Factor a symmetric 3 x 3 block by largest pivots; see orip/adjustment/factorisation/elimination.py. */
static void factorise_by_size(
    const double *block, const double *full, const uint8_t *fixed, double least_pivot, double *half, double *pivots,
    uint8_t *removed)
{
    double scale[3], rest[3][3], accumulated[3][3];
    int open[3];
    for (int i = 0; i < 3; i++) {
        const double diagonal = block[4 * i];
        const int empty = !fixed[i] && !(diagonal > 0.0);
        pivots[i] = empty ? 0.0 : 1.0;
        removed[i] = (uint8_t)empty;
        open[i] = !fixed[i] && !empty;
        scale[i] = open[i] ? 1.0 / sqrt(full[i]) : 0.0;
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            rest[i][j] = block[3 * i + j] * scale[i] * scale[j];
            accumulated[i][j] = i == j;
            half[3 * i + j] = 0.0;
        }
    for (int step = 0; step < 3; step++) {
        int place = -1;
        double largest = 0.0;
        for (int i = 0; i < 3; i++)
            if (open[i] && (place < 0 || rest[i][i] > largest))
                place = i, largest = rest[i][i];
        if (place < 0)
            break;
        /* of pivots that are equal within rounding the first is taken */
        const double as_large = largest - AS_LARGE * fabs(largest);
        for (int i = 2; i >= 0; i--)
            if (open[i] && rest[i][i] >= as_large)
                place = i;
        const double pivot = rest[place][place];
        pivots[place] = pivot;
        open[place] = 0;
        if (!(pivot >= least_pivot)) {
            removed[place] = 1;
            continue;
        }
        const double root = 1.0 / sqrt(pivot);
        double row[3], own[3];
        for (int j = 0; j < 3; j++) {
            row[j] = rest[place][j] * root;
            own[j] = accumulated[place][j] * root;
            half[3 * step + j] = own[j] * scale[j];
        }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                rest[i][j] -= row[i] * row[j];
                accumulated[i][j] -= row[i] * own[j];
            }
    }
}

INLINE void multiply(const double *matrix, const double *vector, double *result)
{
    for (int i = 0; i < 3; i++)
        result[i] = matrix[3 * i] * vector[0] + matrix[3 * i + 1] * vector[1] + matrix[3 * i + 2] * vector[2];
}
