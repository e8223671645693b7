/* Reduced normal equations of a block's photos and points, and where a step leads. */

#include "../compiled/linear.h"
#include "band_solution.h"
#include <string.h>

/* Where the iterations stand: photos, points, corrections of the cameras, and what follows for the rays. */
typedef struct {
    double *rotations, *centres, *points, *corrections, *vectors, *squares, *lengths, *weights;
    double of_cameras, scale;
} BlockState;

typedef struct {
    const int64_t *photo, *start, *place;
    const double *error;
    const BlockState *at;
    const uint8_t *is_free;
    int64_t count, point_count, size, width;
    double damping;
    double *photo_normals, *coupling, *inverse, *point_right, *band, *right;
    /* corrections of `cameras` cameras: rows of the photos' equations, of the points', and the cameras' own */
    const int64_t *camera;
    const double *by_camera;
    int64_t cameras;
    double *border, *point_border, *camera_normals, *camera_right;
    const double *expected;
    /* the cameras of a point, one at a time */
    int64_t *seen, seen_count;
} RefinementProblem;

enum { OF_CAMERA = 4 };

/* As in problem.py: what the square of a ray counts whose point lies behind the photo. */
#define SQUARE_BEHIND 1e6

/* Squares and lengths of the residuals of a state over their a-priori errors; infinite lengths behind the photo. */
static void block_residuals(const RefinementProblem *n, BlockState *at)
{
    for (int64_t point = 0; point < n->point_count; point++)
        for (int64_t row = n->start[point]; row < n->start[point + 1]; row++) {
            const int64_t photo = n->photo[row];
            double residual[2];
            const int in_front = project(at->rotations + 9 * photo, at->centres + 3 * photo, at->points + 3 * point,
                                         at->vectors + 3 * row, residual, NULL);
            const double x = residual[0] / n->error[row], y = residual[1] / n->error[row];
            at->squares[row] = in_front ? x * x + y * y : SQUARE_BEHIND;
            at->lengths[row] = in_front ? sqrt(at->squares[row]) : INFINITY;
        }
}

/* Enlarge the diagonal, so that even unknowns without any equation are regular. */
static void damp(double *normals, int size, double damping)
{
    double largest = 0.0;
    for (int i = 0; i < size; i++)
        largest = fmax(largest, normals[i * (size + 1)]);
    const double floor = largest > 0.0 ? 1e-12 * largest : 1.0;
    for (int i = 0; i < size; i++)
        normals[i * (size + 1)] += damping * normals[i * (size + 1)] + floor;
}

/* Subtract W V^-1 W^T of two rays of a point from the band; its rows are the columns of the lower half, from the
 * diagonal on. */
static void subtract(RefinementProblem *n, int64_t high, int64_t low, const double *product, const double *coupling)
{
    if (high == low) {
        for (int j = 0; j < 6; j++)
            for (int i = j; i < 6; i++)
                n->band[(6 * low + j) * n->width + i - j] -= dot3(product + 3 * i, coupling + 3 * j);
        return;
    }
    for (int j = 0; j < 6; j++) {
        double *column = n->band + (6 * low + j) * n->width + 6 * (high - low) - j;
        const double w[3] = {coupling[3 * j], coupling[3 * j + 1], coupling[3 * j + 2]};
        for (int i = 0; i < 6; i++)
            column[i] -= product[3 * i] * w[0] + product[3 * i + 1] * w[1] + product[3 * i + 2] * w[2];
    }
}

/* Add what a ray contributes to its camera; `p` and `q` are the partials of its coordinates by the photo. */
static void add_camera(RefinementProblem *n, int64_t point, int64_t row, double weight, const double residual[2],
                       const double *p, const double *q)
{
    const int64_t camera = n->camera[row], place = n->place[n->photo[row]], width = OF_CAMERA * n->cameras;
    if (camera < 0)
        return;
    double by_x[OF_CAMERA], by_y[OF_CAMERA], x[OF_CAMERA], y[OF_CAMERA];
    memcpy(by_x, n->by_camera + 2 * OF_CAMERA * row, sizeof(by_x));
    memcpy(by_y, n->by_camera + 2 * OF_CAMERA * row + OF_CAMERA, sizeof(by_y));
    /* the partials by the first correction are the computed coordinates */
    by_x[0] *= residual[0] + n->at->vectors[3 * row], by_y[0] *= residual[1] + n->at->vectors[3 * row + 1];
    for (int k = 0; k < OF_CAMERA; k++) {
        x[k] = weight * by_x[k], y[k] = weight * by_y[k];
        n->camera_right[OF_CAMERA * camera + k] += x[k] * residual[0] + y[k] * residual[1];
    }
    for (int k = 0; k < OF_CAMERA; k++)
        for (int l = 0; l < OF_CAMERA; l++)
            n->camera_normals[width * (OF_CAMERA * camera + k) + OF_CAMERA * camera + l] +=
                x[k] * by_x[l] + y[k] * by_y[l];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < OF_CAMERA; k++)
            n->point_border[width * (3 * point + i) + OF_CAMERA * camera + k] -= p[3 + i] * x[k] + q[3 + i] * y[k];
    for (int i = 0; i < 6 && place >= 0; i++)
        for (int k = 0; k < OF_CAMERA; k++)
            n->border[width * (6 * place + i) + OF_CAMERA * camera + k] += p[i] * x[k] + q[i] * y[k];
}

static void add_ray(RefinementProblem *n, int64_t point, int64_t row, double V[9], double g[3])
{
    const BlockState *at = n->at;
    const int64_t photo = n->photo[row], place = n->place[photo];
    double residual[2], partials[2][6], *W = n->coupling + 18 * row;
    memset(W, 0, 18 * sizeof(double));
    const int in_front = project(at->rotations + 9 * photo, at->centres + 3 * photo, at->points + 3 * point,
                                 at->vectors + 3 * row, residual, partials);
    const double weight = in_front ? at->weights[row] / (n->error[row] * n->error[row]) : 0.0;
    if (weight == 0.0)
        return;
    /* the partials by the point are those by the projection centre with the other sign */
    const double *p = partials[0], *q = partials[1];
    double wp[6], wq[6];
    for (int i = 0; i < 6; i++)
        wp[i] = weight * p[i], wq[i] = weight * q[i];
    for (int i = 0; i < 3; i++) {
        g[i] -= wp[3 + i] * residual[0] + wq[3 + i] * residual[1];
        for (int j = 0; j < 3; j++)
            V[3 * i + j] += wp[3 + i] * p[3 + j] + wq[3 + i] * q[3 + j];
    }
    if (n->cameras > 0)
        add_camera(n, point, row, weight, residual, p, q);
    if (place < 0)
        return;
    double *normals = n->photo_normals + 36 * place, *right = n->right + 6 * place;
    for (int i = 0; i < 6; i++) {
        right[i] += wp[i] * residual[0] + wq[i] * residual[1];
        for (int j = 0; j < 6; j++)
            normals[6 * i + j] += wp[i] * p[j] + wq[i] * q[j];
        for (int j = 0; j < 3; j++)
            W[3 * i + j] = -(wp[i] * p[3 + j] + wq[i] * q[3 + j]);
    }
}

/* Note the unknown cameras whose photos show a point. */
static void see_cameras(RefinementProblem *n, int64_t point)
{
    n->seen_count = 0;
    for (int64_t row = n->start[point]; row < n->start[point + 1] && n->cameras > 0; row++) {
        const int64_t camera = n->camera[row];
        int64_t k = 0;
        while (k < n->seen_count && n->seen[k] != camera)
            k++;
        if (camera >= 0 && k == n->seen_count)
            n->seen[n->seen_count++] = camera;
    }
}

/* Eliminate a point from the equations of the cameras. */
static void eliminate_from_cameras(RefinementProblem *n, int64_t point, const double *inverse, const double g[3])
{
    const int64_t width = OF_CAMERA * n->cameras;
    const double *Q = n->point_border + 3 * width * point;
    for (int64_t one = 0; one < OF_CAMERA * n->seen_count; one++) {
        const int64_t k = OF_CAMERA * n->seen[one / OF_CAMERA] + one % OF_CAMERA;
        const double column[3] = {Q[k], Q[width + k], Q[2 * width + k]};
        double solved[3];
        times3(inverse, column, solved);
        n->camera_right[k] -= dot3(solved, g);
        for (int64_t other = 0; other < n->seen_count; other++) {
            double *normals = n->camera_normals + width * k + OF_CAMERA * n->seen[other];
            const double *q = Q + OF_CAMERA * n->seen[other];
            for (int l = 0; l < OF_CAMERA; l++)
                normals[l] -= solved[0] * q[l] + solved[1] * q[width + l] + solved[2] * q[2 * width + l];
        }
    }
}

/* Eliminate a point from the border of a photo's equations; the product is W V^-1. */
static void eliminate_from_border(RefinementProblem *n, int64_t point, int64_t place, const double *product)
{
    const int64_t width = OF_CAMERA * n->cameras;
    for (int64_t one = 0; one < n->seen_count; one++) {
        const double *q = n->point_border + 3 * width * point + OF_CAMERA * n->seen[one];
        for (int i = 0; i < 6; i++) {
            const double *row = product + 3 * i;
            double *border = n->border + width * (6 * place + i) + OF_CAMERA * n->seen[one];
            for (int k = 0; k < OF_CAMERA; k++)
                border[k] -= row[0] * q[k] + row[1] * q[width + k] + row[2] * q[2 * width + k];
        }
    }
}

static void eliminate_point(RefinementProblem *n, int64_t point)
{
    double V[9] = {0.0}, g[3] = {0.0};
    const int64_t first = n->start[point], end = n->start[point + 1];
    see_cameras(n, point);
    for (int64_t row = first; row < end; row++)
        add_ray(n, point, row, V, g);
    double *inverse = n->inverse + 9 * point;
    memset(inverse, 0, 9 * sizeof(double));
    memcpy(n->point_right + 3 * point, g, sizeof(g));
    if (!n->is_free[point])
        return;
    damp(V, 3, n->damping);
    double minors[9];
    const double determinant = minors3(V, minors);
    for (int k = 0; k < 9; k++)
        inverse[k] = minors[k] / determinant;
    eliminate_from_cameras(n, point, inverse, g);
    for (int64_t row = first; row < end; row++) {
        const int64_t place = n->place[n->photo[row]];
        if (place < 0)
            continue;
        const double *W = n->coupling + 18 * row;
        double product[18];
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < 3; j++)
                product[3 * i + j] = dot3(W + 3 * i, inverse + 3 * j);
        for (int i = 0; i < 6; i++)
            n->right[6 * place + i] -= dot3(product + 3 * i, g);
        eliminate_from_border(n, point, place, product);
        for (int64_t other = first; other < end; other++) {
            const int64_t low = n->place[n->photo[other]];
            if (low >= 0 && low <= place)
                subtract(n, place, low, product, n->coupling + 18 * other);
        }
    }
}

static void clear(double *numbers, int64_t count) { memset(numbers, 0, (size_t)count * sizeof(double)); }

static void block_normals(RefinementProblem *n)
{
    const int64_t width = OF_CAMERA * n->cameras;
    clear(n->photo_normals, 6 * n->size), clear(n->band, n->size * n->width), clear(n->right, n->size);
    clear(n->border, width * n->size), clear(n->point_border, 3 * width * n->point_count);
    clear(n->camera_normals, width * width), clear(n->camera_right, width);
    for (int64_t point = 0; point < n->point_count; point++)
        eliminate_point(n, point);
    for (int64_t place = 0; place < n->size / 6; place++) {
        double *normals = n->photo_normals + 36 * place;
        damp(normals, 6, n->damping);
        for (int j = 0; j < 6; j++)
            for (int i = j; i < 6; i++)
                n->band[(6 * place + j) * n->width + i - j] += normals[6 * i + j];
    }
}

/* Solve the normal equations: `right` becomes the solution for the photos, `camera_right` that for the cameras, whose
 * corrections so far are observed to be 0 with weights. 0 where the equations are not positive definite.
 */
static int solve_block(RefinementProblem *n, const double *corrections)
{
    const int64_t width = OF_CAMERA * n->cameras;
    if (!factorise_band(n->band, n->size, n->width))
        return 0;
    reduce_vector(n->band, n->size, n->width, n->right);
    reduce_rows(n->band, n->size, n->width, n->border, width);
    for (int64_t k = 0; k < width; k++) {
        const double weight = 1.0 / (n->expected[k % OF_CAMERA] * n->expected[k % OF_CAMERA]);
        n->camera_normals[width * k + k] += weight, n->camera_right[k] += weight * corrections[k];
    }
    for (int64_t row = 0; row < n->size; row++) {
        const double *border = n->border + width * row;
        for (int64_t k = 0; k < width; k++)
            subtract_column(n->camera_normals + width * k, border, border[k], width);
        subtract_column(n->camera_right, border, n->right[row], width);
    }
    /* as a band: columns of the lower half from the diagonal on, which are the rows of the upper half */
    for (int64_t k = 0; k < width; k++) {
        double *row = n->camera_normals + width * k;
        memmove(row, row + k, (size_t)(width - k) * sizeof(double));
        clear(row + width - k, k);
    }
    if (!factorise_band(n->camera_normals, width, width))
        return 0;
    reduce_vector(n->camera_normals, width, width, n->camera_right);
    substitute_by_band(n->camera_normals, width, width, n->camera_right);
    for (int64_t row = 0; row < n->size; row++)
        for (int64_t k = 0; k < width; k++)
            n->right[row] -= n->border[width * row + k] * n->camera_right[k];
    substitute_by_band(n->band, n->size, n->width, n->right);
    return 1;
}

/* Corrections of the points from those of photos and cameras; the solution has the sign of the right-hand side. */
static void point_corrections(const RefinementProblem *n, double *corrections)
{
    const double *solution = n->right, *of_cameras = n->camera_right;
    const int64_t width = OF_CAMERA * n->cameras;
    for (int64_t point = 0; point < n->point_count; point++) {
        double g[3];
        memcpy(g, n->point_right + 3 * point, sizeof(g));
        for (int64_t row = n->start[point]; row < n->start[point + 1]; row++) {
            const int64_t place = n->place[n->photo[row]];
            for (int i = 0; i < 6 && place >= 0; i++)
                for (int j = 0; j < 3; j++)
                    g[j] -= n->coupling[18 * row + 3 * i + j] * solution[6 * place + i];
        }
        for (int j = 0; j < 3; j++)
            for (int64_t k = 0; k < width; k++)
                g[j] -= n->point_border[width * (3 * point + j) + k] * of_cameras[k];
        for (int j = 0; j < 3; j++)
            corrections[3 * point + j] = -dot3(n->inverse + 9 * point + 3 * j, g);
    }
}

/* Photos, points and corrections of cameras after a step from `from`; no photo is turned by more than `largest_turn`, and
 * all corrections are shortened alike.
 */
static void move_block(const RefinementProblem *n, const BlockState *from, double largest_turn, int64_t photos,
                       BlockState *to)
{
    double largest = 0.0;
    for (int64_t k = 0; k < n->size; k += 6)
        largest = larger(largest, dot3(n->right + k, n->right + k));
    const double factor = smaller(1.0, largest_turn / larger(sqrt(largest), 1e-300));
    point_corrections(n, to->points);
    for (int64_t k = 0; k < 3 * n->point_count; k++)
        to->points[k] = from->points[k] + factor * to->points[k];
    for (int64_t photo = 0; photo < photos; photo++) {
        const int64_t place = n->place[photo];
        const double none[6] = {0.0}, *s = place < 0 ? none : n->right + 6 * place;
        const double turn[3] = {-factor * s[0], -factor * s[1], -factor * s[2]};
        if (place < 0)
            memcpy(to->rotations + 9 * photo, from->rotations + 9 * photo, 9 * sizeof(double));
        else
            turn3(turn, from->rotations + 9 * photo, to->rotations + 9 * photo);
        for (int i = 0; i < 3; i++)
            to->centres[3 * photo + i] = from->centres[3 * photo + i] - factor * s[3 + i];
    }
    for (int64_t k = 0; k < OF_CAMERA * n->cameras; k++)
        to->corrections[k] = from->corrections[k] - factor * n->camera_right[k];
}
