/* Starting values of a spatial similarity from triples of points, judged by all;
 * prelim_references/similarity.py does the same and names the sources.
 */

#include "adjustment.h"

/* Square of width over length below which triangles count as lines. */
#define ONE_LINE 1e-12

/* Deviations of points that are not known in full are those of their known coordinates. */
typedef struct {
    const double *source, *target;
    double *source_variance, *target_variance, *known;
    int64_t count;
} Judges;

/* A triangle: its vertices from their centroid, two axes of its plane, and the normal from which it runs anticlockwise;
 * returns the sum of squared distances, or 0 where it is a line.
 */
static double triangle_of(const double *points, const int64_t *rows, double centroid[3], double reduced[3][3],
                          double axes[3][3])
{
    double one[3], other[3], square = 0.0;
    for (int i = 0; i < 3; i++)
        centroid[i] = (points[3 * rows[0] + i] + points[3 * rows[1] + i] + points[3 * rows[2] + i]) / 3.0;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) {
            reduced[k][i] = points[3 * rows[k] + i] - centroid[i];
            square += reduced[k][i] * reduced[k][i];
        }
    for (int i = 0; i < 3; i++)
        one[i] = reduced[1][i] - reduced[0][i], other[i] = reduced[2][i] - reduced[0][i];
    cross3(one, other, axes[2]);
    const double length = sqrt(dot3(one, one)), normal = sqrt(dot3(axes[2], axes[2]));
    /* both singular values of the vertices: the sum of their squares is `square`, the product normal² / 3 */
    if (!(normal * normal > 3.0 * ONE_LINE * square * square))
        return 0.0;
    for (int i = 0; i < 3; i++)
        axes[0][i] = one[i] / length, axes[2][i] /= normal;
    cross3(axes[2], axes[0], axes[1]);
    return square;
}

/* The similarity that fits three points by least squares: it takes plane to plane, and the rotation in the plane follows
 * from the sums of products; 0 where three points lie on a line.
 */
static int fit_triangle(const double *source, const double *target, const int64_t *rows, At *s)
{
    double from[3], to[3], x[3][3], X[3][3], a[3][3], b[3][3], along = 0.0, across = 0.0;
    const double square = triangle_of(source, rows, from, x, a);
    if (square == 0.0 || triangle_of(target, rows, to, X, b) == 0.0)
        return 0;
    for (int k = 0; k < 3; k++) {
        const double u = dot3(a[0], x[k]), v = dot3(a[1], x[k]), U = dot3(b[0], X[k]), V = dot3(b[1], X[k]);
        along += U * u + V * v, across += V * u - U * v;
    }
    const double product = sqrt(along * along + across * across), cosine = along / product, sine = across / product;
    s->scale = product / square;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            s->rotation[3 * i + j] = cosine * (b[0][i] * a[0][j] + b[1][i] * a[1][j])
                + sine * (b[1][i] * a[0][j] - b[0][i] * a[1][j]) + b[2][i] * a[2][j];
    for (int i = 0; i < 3; i++)
        s->shift[i] = to[i] - s->scale * dot3(s->rotation + 3 * i, from);
    return 1;
}

static void prepare_judges(const Judges *j, const double *source_deviation, const double *target_deviation)
{
    for (int64_t point = 0; point < j->count; point++) {
        j->source_variance[point] = j->target_variance[point] = j->known[point] = 0.0;
        for (int i = 0; i < 3; i++) {
            const int64_t k = 3 * point + i;
            j->source_variance[point] += source_deviation[k] * source_deviation[k] / 3.0;
            if (isfinite(j->target[k])) {
                j->target_variance[point] += target_deviation[k] * target_deviation[k];
                j->known[point] += 1.0;
            }
        }
        j->target_variance[point] /= j->known[point];
    }
}

/* d²/s² of the points at a start, as of three coordinates. `space` has room for twice as many numbers. */
static void squares_of(const Judges *j, const At *s, double least, double *squares, double *space)
{
    double *variance = space, *sorted = space + j->count, least_variance = INFINITY, largest = 0.0, floor = 0.0;
    for (int64_t point = 0; point < j->count; point++) {
        variance[point] = j->target_variance[point] + s->scale * s->scale * j->source_variance[point];
        least_variance = smaller(least_variance, variance[point]), largest = larger(largest, variance[point]);
    }
    /* the floor is a part of the median: where no variance is as small a part of the largest, none is raised to it */
    if (!(least_variance > 0.0 && least_variance >= least * least * largest)) {
        memcpy(sorted, variance, (size_t)j->count * sizeof(double));
        const double middle = least * least * median_of(sorted, j->count);
        floor = middle > 0.0 ? middle : 1.0;
    }
    for (int64_t point = 0; point < j->count; point++) {
        const double *x = j->source + 3 * point, *X = j->target + 3 * point;
        double turned[3], square = 0.0;
        apply_similarity(s, x, turned);
        for (int i = 0; i < 3; i++) {
            const double difference = turned[i] + s->shift[i] - X[i];
            square += isfinite(X[i]) ? difference * difference : 0.0;
        }
        squares[point] = square / larger(variance[point], floor) * (3.0 / j->known[point]);
    }
}

/* How starts are judged: by the truncated sum of squares, in units in which `rank` points of the best start stay below
 * the median of chi square.
 */
typedef struct {
    int64_t rank;
    double least, median_of_chi2, limit;
} Judgement;

/* How many points make most of them. */
static inline int64_t most_points(int64_t count)
{
    const int64_t half = count / 2 + 2, others = count - 1;
    return count <= 3 ? count : half < others ? half : others;
}

/* Leave the best of several starts in `best`; returns the least d²/s² that `rank` points stay below at one of them,
 * negative where there is none. `space` has room for two numbers for each point, and for all squares.
 */
static double best_of_starts(const Judges *j, const Judgement *by, const At *starts, int64_t number, double *space,
                             At *best)
{
    double *scratch = space, *squares = space + 2 * j->count, most = INFINITY, cheapest = INFINITY;
    for (int64_t k = 0; k < number; k++) {
        squares_of(j, starts + k, by->least, squares + k * j->count, scratch);
        /* selected only where they are small enough to make `most` smaller */
        int64_t below = 0;
        for (int64_t point = 0; point < j->count; point++)
            below += squares[k * j->count + point] < most;
        if (below < by->rank)
            continue;
        memcpy(scratch, squares + k * j->count, (size_t)j->count * sizeof(double));
        most = select_smallest(scratch, j->count, by->rank - 1);
    }
    const double factor = larger(1.0, most / by->median_of_chi2);
    for (int64_t k = 0; k < number; k++) {
        double cost = 0.0;
        for (int64_t point = 0; point < j->count && cost < cheapest; point++)
            cost += smaller(squares[k * j->count + point] / factor, by->limit);
        if (cost < cheapest)
            cheapest = cost, *best = starts[k];
    }
    return number ? most : -1.0;
}

/* Fit triples and leave the best start in `best`, as above; `space` has room for all starts, too. */
static double best_triple(const Judges *j, const Judgement *by, const int64_t *triples, int64_t number, double *space,
                          At *best)
{
    At *starts = (At *)(space + (2 + number) * j->count);
    int64_t found = 0;
    for (int64_t k = 0; k < number; k++)
        found += fit_triangle(j->source, j->target, triples + 3 * k, starts + found);
    return best_of_starts(j, by, starts, found, space, best);
}
