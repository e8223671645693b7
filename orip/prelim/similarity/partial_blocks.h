/* Partial blocks of one system assembled into one; prelim_references/similarity.py does the same and explains it.
 */

#include "../compiled/linear.h"
#include <string.h>

/* A deviation beside which the coordinates are exact, as a part of them, where none is given. */
#define TINY 1e-12

/* Median deviations of the axes, 0 where none is known. `space` has room for a number for each point. */
static void middle_deviations(const double *deviations, int64_t count, double *space, double middle[3])
{
    for (int i = 0; i < 3; i++) {
        int64_t known = 0;
        for (int64_t point = 0; point < count; point++)
            if (isfinite(deviations[3 * point + i]))
                space[known++] = deviations[3 * point + i];
        middle[i] = known ? median_of(space, known) : 0.0;
    }
}

/* A deviation as weights need it. */
static inline double steady_deviation(double deviation, double middle, double steady)
{
    return larger(isfinite(deviation) ? deviation : middle, steady * middle);
}

/* Where a run of ascending keys ends that begins at `start`. */
static int64_t end_of_run(const int64_t *keys, const int64_t *order, int64_t start, int64_t count)
{
    int64_t end = start + 1;
    while (end < count && keys[order[end - 1]] <= keys[order[end]])
        end++;
    return end;
}

/* The places of keys in ascending order, equal ones as they are: runs are merged by twos. Returns one of two arrays. */
static const int64_t *ascending(const int64_t *keys, int64_t count, int64_t *order, int64_t *other)
{
    for (int64_t k = 0; k < count; k++)
        order[k] = k;
    for (int64_t runs = 2; runs > 1;) {
        runs = 0;
        for (int64_t start = 0, end; start < count; start = end, runs++) {
            const int64_t middle = end_of_run(keys, order, start, count);
            end = middle < count ? end_of_run(keys, order, middle, count) : count;
            for (int64_t one = start, two = middle, to = start; to < end; to++)
                other[to] = two == end || (one < middle && keys[order[one]] <= keys[order[two]]) ? order[one++]
                                                                                                : order[two++];
        }
        int64_t *merged = other;
        other = order, order = merged;
    }
    return order;
}

/* What is given of several blocks, one after the other, and where each of them begins. */
typedef struct {
    const int64_t *points, *photos;
    const double *coordinates, *deviations, *rotations, *centres;
    const int64_t *starts;
    int64_t blocks, count, photo_count;
} BlocksOfOneSystem;

typedef struct {
    int64_t *points, *photos;
    double *coordinates, *deviations, *rotations, *centres;
} AssembledBlock;

/* Bytes that assembling needs. */
static size_t space_to_assemble(int64_t count, int64_t photo_count)
{
    return (size_t)(4 * count) * sizeof(double) + 2 * (size_t)(count + photo_count) * sizeof(int64_t);
}

/* Photos in ascending order, each as in the first block; returns how many there are. */
static int64_t assemble_photos(const BlocksOfOneSystem *b, int64_t *space, const AssembledBlock *whole)
{
    const int64_t *order = ascending(b->photos, b->photo_count, space, space + b->photo_count);
    int64_t found = 0;
    for (int64_t k = 0; k < b->photo_count; k++) {
        const int64_t photo = b->photos[order[k]];
        if (found && whole->photos[found - 1] == photo)
            continue;
        whole->photos[found] = photo;
        memcpy(whole->rotations + 9 * found, b->rotations + 9 * order[k], 9 * sizeof(double));
        memcpy(whole->centres + 3 * found, b->centres + 3 * order[k], 3 * sizeof(double));
        found++;
    }
    return found;
}

/* The weighted mean of several determinations of a coordinate, and their spread; `order` says where they are. */
static void mean_and_spread(const double *values, const double *weights, const int64_t *order, int64_t number, int axis,
                            double *mean, double *spread)
{
    double sum = 0.0, weight = 0.0, square = 0.0;
    /* the first one last, as NumPy adds */
    for (int64_t k = 1; k <= number; k++) {
        const int64_t at = 3 * order[k % number] + axis;
        sum += weights[at] * values[at], weight += weights[at];
    }
    *mean = sum / weight;
    for (int64_t k = 1; k <= number; k++) {
        const double off = values[3 * order[k % number] + axis] - *mean;
        square += off * off;
    }
    *spread = sqrt(square / (double)(number - 1));
}

/* Points in ascending order; returns how many there are. */
static int64_t assemble_points(const BlocksOfOneSystem *b, double steady, double *weights, int64_t *places,
                               const AssembledBlock *whole)
{
    double *space = weights + 3 * b->count, middle[3], most = 1e-300;
    for (int64_t k = 0; k < 3 * b->count; k++)
        most = larger(fabs(b->coordinates[k]), most);
    for (int64_t block = 0; block < b->blocks; block++) {
        const int64_t first = b->starts[block], count = b->starts[block + 1] - first;
        middle_deviations(b->deviations + 3 * first, count, space, middle);
        for (int64_t k = 3 * first; k < 3 * (first + count); k++) {
            const double deviation = larger(steady_deviation(b->deviations[k], middle[k % 3], steady), TINY * most);
            weights[k] = 1.0 / (deviation * deviation);
        }
    }
    const int64_t *order = ascending(b->points, b->count, places, places + b->count);
    int64_t found = 0;
    for (int64_t start = 0, end; start < b->count; start = end, found++) {
        const int64_t point = b->points[order[start]];
        for (end = start + 1; end < b->count && b->points[order[end]] == point;)
            end++;
        whole->points[found] = point;
        for (int i = 0; i < 3; i++) {
            double *coordinate = whole->coordinates + 3 * found + i, *deviation = whole->deviations + 3 * found + i;
            if (end == start + 1)
                *coordinate = b->coordinates[3 * order[start] + i], *deviation = b->deviations[3 * order[start] + i];
            else
                mean_and_spread(b->coordinates, weights, order + start, end - start, i, coordinate, deviation);
        }
    }
    return found;
}
