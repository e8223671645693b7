/* What two partial blocks have in common, the start that their common photos give, and where it leads;
 * orip/prelim/similarity/partial_blocks.py and joining.py do the same and explain it.
 */

#include "partial_blocks.h"
#include "start.h"

/* Lengths below this part of the longest one say nothing of a scale. */
#define NO_LENGTH 1e-9

/* Places that determine a rotation better than a common photo does. */
#define WITH_ROTATION 4

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
    middle_deviations(p->deviations, p->count, space, middle);
    for (int64_t k = 0; k < points; k++)
        for (int i = 0; i < 3; i++) {
            coordinates[3 * k + i] = p->coordinates[3 * p->points[k] + i];
            deviations[3 * k + i] = steady_deviation(p->deviations[3 * p->points[k] + i], middle[i], steady);
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

/* The similarity from several common photos, or from one. `space` has room for 5 + `photos` numbers for each place, and
 * below them for all starts.
 */
static void start_from_photos(const PartOfTwo *source, const PartOfTwo *target, int64_t photos, const Judges *judges,
                              const double *source_deviations, const double *target_deviations,
                              const Judgement *judgement, double *space, At *start)
{
    const int64_t count = judges->count;
    At *starts = (At *)(space + (5 + photos) * count);
    for (int64_t photo = 0; photo < photos; photo++)
        start_from_photo(source, target, photo, judges->source, judges->target, count, space, starts + photo);
    if (photos == 1)
        *start = *starts;
    if (photos < 2)
        return;
    prepare_judges(judges, source_deviations, target_deviations);
    best_of_starts(judges, judgement, starts, photos, space + 3 * count, start);
}

/* Where in two ascending lists the numbers are that occur in both; returns how many. */
static int64_t in_both(const int64_t *one, int64_t count, const int64_t *other, int64_t other_count, int64_t *of_one,
                       int64_t *of_other)
{
    int64_t found = 0;
    for (int64_t k = 0, l = 0; k < count && l < other_count;)
        if (one[k] < other[l])
            k++;
        else if (one[k] > other[l])
            l++;
        else
            of_one[found] = k++, of_other[found++] = l++;
    return found;
}

/* Where the photos are that occur in both of two lists in any order, none twice in a list; returns how many. */
static int64_t photos_in_both(const int64_t *one, int64_t count, const int64_t *other, int64_t other_count,
                              int64_t *of_one, int64_t *of_other)
{
    int64_t found = 0;
    for (int64_t k = 0; k < count; k++)
        for (int64_t l = 0; l < other_count; l++)
            if (one[k] == other[l]) {
                of_one[found] = k, of_other[found++] = l;
                break;
            }
    return found;
}

/* A partial block: names as numbers, and what belongs to them. */
typedef struct {
    const int64_t *points, *photos;
    const double *coordinates, *deviations, *rotations, *centres;
    int64_t count, photo_count;
} PartialBlock;

/* _RULES_OF_JOINING in orip/prelim/similarity/joining.py */
typedef struct {
    double steady, median_of_chi2, fitting, agreement, large;
} JoiningRules;

/* What is found of a joint: the rows of the source that are common points, their coordinates in the target and with those
 * of the projection centres their residuals and weight factors; and the source in the target system.
 */
typedef struct {
    int64_t *at_source;
    double *targets, *residuals, *factors, *coordinates, *deviations, *rotations, *centres;
    int64_t points, photos, first_photo, unfit;
    SimilarityFound *found;
} JoinedBlock;

/* Move a block to the target system; deviations are propagated from axis to axis. */
static void transform_block(const PartialBlock *source, const At *at, const JoinedBlock *j)
{
    const double *R = at->rotation;
    for (int64_t k = 0; k < source->count; k++)
        for (int i = 0; i < 3; i++) {
            const double *x = source->coordinates + 3 * k, *deviation = source->deviations + 3 * k;
            double variance = 0.0;
            for (int m = 0; m < 3; m++)
                variance += deviation[m] * deviation[m] * (R[3 * i + m] * R[3 * i + m]);
            j->coordinates[3 * k + i] = at->scale * dot3(R + 3 * i, x) + at->shift[i];
            j->deviations[3 * k + i] = sqrt(at->scale * at->scale * variance);
        }
    for (int64_t k = 0; k < source->photo_count; k++)
        for (int i = 0; i < 3; i++) {
            j->centres[3 * k + i] = at->scale * dot3(R + 3 * i, source->centres + 3 * k) + at->shift[i];
            for (int m = 0; m < 3; m++) {
                const double *turned = source->rotations + 9 * k + m;
                j->rotations[9 * k + 3 * i + m] =
                    R[3 * i] * turned[0] + R[3 * i + 1] * turned[3] + R[3 * i + 2] * turned[6];
            }
        }
}

static inline int fits_fully(const double *factors)
{
    return factors[0] == 1.0 && factors[1] == 1.0 && factors[2] == 1.0;
}

/* Points that do not fit have their residuals as deviations; returns how many they are. */
static int64_t loosen_unfit(const JoinedBlock *j)
{
    int64_t unfit = 0;
    for (int64_t k = 0; k < j->points; k++) {
        double *deviations = j->deviations + 3 * j->at_source[k];
        if (fits_fully(j->factors + 3 * k))
            continue;
        for (int i = 0; i < 3; i++) {
            const double off = fabs(j->residuals[3 * k + i]);
            deviations[i] = deviations[i] < off ? off : deviations[i];
        }
        unfit++;
    }
    return unfit;
}

/* The median length of the residuals of the common points. `space` has room for one number for each. */
static double typical_residual(const JoinedBlock *j, double *space)
{
    for (int64_t k = 0; k < j->points; k++)
        space[k] = sqrt(dot3(j->residuals + 3 * k, j->residuals + 3 * k));
    return j->points ? median_of(space, j->points) : 0.0;
}

/* Bytes that joining needs. */
static size_t space_to_join(const PartialBlock *source, const PartialBlock *target)
{
    const int64_t room = source->count + source->photo_count, most = room > target->count ? room : target->count;
    return (size_t)(most + (27 + source->photo_count) * room) * sizeof(double)
        + (size_t)source->photo_count * sizeof(At);
}

/* Whether the common points cannot be those of the same object. */
static int disagree(const JoinedBlock *j, const JoiningRules *joining, double extent, double *space)
{
    const double typical = typical_residual(j, space);
    int64_t fits = 0;
    for (int64_t k = 0; k < j->points; k++)
        fits += fits_fully(j->factors + 3 * k);
    return typical > joining->agreement * extent || (typical > joining->large * extent && 2 * fits < j->points);
}

enum { NOT_DETERMINED, JOINED, DISAGREEING };

/* Join a block to another one from their common photos; not determined where none is common, or where the equations may
 * not be regular.
 */
static int join_by_photos(const PartialBlock *source, const PartialBlock *target, const SimilarityRules *rules,
                          const JoiningRules *joining, double *space, JoinedBlock *j)
{
    const int64_t room = source->count + source->photo_count;
    int64_t *at_target = (int64_t *)space, *of_source = at_target + source->count;
    int64_t *of_target = of_source + source->photo_count;
    uint8_t *trusted = (uint8_t *)(space + 2 * room);
    double *from = space + 3 * room, *to = from + 3 * room, *rest = from + 12 * room;
    double *source_deviations = from + 6 * room, *target_deviations = from + 9 * room;
    j->points = in_both(source->points, source->count, target->points, target->count, j->at_source, at_target);
    j->photos = photos_in_both(source->photos, source->photo_count, target->photos, target->photo_count, of_source,
                               of_target);
    const int64_t count = j->points + j->photos;
    if (j->photos == 0 || count < 2 || (count < WITH_ROTATION && j->photos > 1))
        return NOT_DETERMINED;
    j->first_photo = of_source[0];
    const PartOfTwo one = {source->coordinates, source->deviations, source->rotations, source->centres, j->at_source,
                           of_source, source->count};
    const PartOfTwo other = {target->coordinates, target->deviations, target->rotations, target->centres, at_target,
                             of_target, target->count};
    common_places(&one, j->points, j->photos, joining->steady, from, source_deviations, rest);
    common_places(&other, j->points, j->photos, joining->steady, to, target_deviations, rest);
    const Judges judges = {from, to, rest, rest + count, rest + 2 * count, count};
    const Judgement judgement = {most_points(count), rules->least_error, joining->median_of_chi2, joining->fitting};
    start_from_photos(&one, &other, j->photos, &judges, source_deviations, target_deviations, &judgement, rest,
                      &j->found->at);
    for (int64_t k = 0; k < count; k++)
        trusted[k] = k >= j->points;
    Common common = {NULL, to, NULL, trusted, count, count < WITH_ROTATION ? 4 : MOST_UNKNOWNS};
    if (!adjust_similarity(&common, from, source_deviations, target_deviations, rules, j->factors, j->residuals, rest,
                           j->found))
        return NOT_DETERMINED;
    if (disagree(j, joining, extent_of(to, count), rest))
        return DISAGREEING;
    memcpy(j->targets, to, (size_t)(3 * j->points) * sizeof(double));
    transform_block(source, &j->found->at, j);
    j->unfit = loosen_unfit(j);
    return JOINED;
}
