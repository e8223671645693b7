/* What two partial blocks have in common, and the start that their common photos give; orip/prelim/similarity/in_common.py
 * does the same and explains it.
 */

#include "start.h"

/* Lengths below this part of the longest one say nothing of a scale. */
#define NO_LENGTH 1e-9

/* One of the two blocks, and where in it the common points and photos are. */
typedef struct {
    const double *coordinates, *deviations, *rotations, *centres;
    const int64_t *points, *photos;
    int64_t count;
} PartOfTwo;

/* Coordinates and steady deviations of the common points, and below them of the projection centres. `space` has room
 * for one number for each point of the block, and for three for each common one.
 */
static void common_places(const PartOfTwo *p, int64_t points, int64_t photos, double steady, double *coordinates,
                          double *deviations, double *space)
{
    double middle[3];
    for (int i = 0; i < 3; i++) {
        int64_t known = 0;
        for (int64_t point = 0; point < p->count; point++)
            if (isfinite(p->deviations[3 * point + i]))
                space[known++] = p->deviations[3 * point + i];
        middle[i] = known ? median_of(space, known) : 0.0;
    }
    for (int64_t k = 0; k < points; k++)
        for (int i = 0; i < 3; i++) {
            const double deviation = p->deviations[3 * p->points[k] + i];
            coordinates[3 * k + i] = p->coordinates[3 * p->points[k] + i];
            deviations[3 * k + i] = larger(isfinite(deviation) ? deviation : middle[i], steady * middle[i]);
        }
    memcpy(space, deviations, (size_t)(3 * points) * sizeof(double));
    const double of_centres = points ? median_of(space, 3 * points) : 0.0;
    for (int64_t k = 0; k < photos; k++)
        for (int i = 0; i < 3; i++) {
            coordinates[3 * (points + k) + i] = p->centres[3 * p->photos[k] + i];
            deviations[3 * (points + k) + i] = of_centres;
        }
}

/* The root mean square distance from the centroid. */
static double extent_of(const double *places, int64_t count)
{
    double centroid[3] = {0.0}, square = 0.0;
    for (int64_t k = 0; k < 3 * count; k++)
        centroid[k % 3] += places[k] / (double)count;
    for (int64_t k = 0; k < 3 * count; k++)
        square += (places[k] - centroid[k % 3]) * (places[k] - centroid[k % 3]);
    return sqrt(square / (double)count);
}

/* The median ratio of the distances from a projection centre. `space` has room for two numbers for each place. */
static double scale_about(const double *source, const double *target, int64_t count, const double *own,
                          const double *other, double *space)
{
    double *lengths = space + count, longest = 0.0;
    for (int64_t k = 0; k < count; k++) {
        double here[3], there[3];
        for (int i = 0; i < 3; i++)
            here[i] = source[3 * k + i] - own[i], there[i] = target[3 * k + i] - other[i];
        lengths[k] = sqrt(dot3(here, here)), space[k] = sqrt(dot3(there, there));
        longest = larger(longest, lengths[k]);
    }
    int64_t far = 0;
    for (int64_t k = 0; k < count; k++)
        if (lengths[k] > NO_LENGTH * longest)
            space[far++] = space[k] / lengths[k];
    return far ? median_of(space, far) : 1.0;
}

/* The similarity that one common photo gives: only its scale comes from the places. */
static void start_from_photo(const PartOfTwo *source, const PartOfTwo *target, int64_t photo, const double *from,
                             const double *to, int64_t count, double *space, At *start)
{
    const double *own = source->centres + 3 * source->photos[photo], *R = source->rotations + 9 * source->photos[photo];
    const double *other = target->centres + 3 * target->photos[photo];
    const double *turned = target->rotations + 9 * target->photos[photo];
    start->scale = scale_about(from, to, count, own, other, space);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            start->rotation[3 * i + j] = dot3(turned + 3 * i, R + 3 * j);
        start->shift[i] = other[i] - start->scale * dot3(start->rotation + 3 * i, own);
    }
}
