/* Normal equations: formed group by group, each point's three unknowns eliminated. */

#ifndef ORIP_NORMALS_H
#define ORIP_NORMALS_H

#include <math.h>
#include <string.h>

#include "columns.h"

#define AS_LARGE 1e-9
#define COLUMNS_AT_ONCE 4

/* Lower triangle of a symmetric matrix of `size` unknowns in the order of their places. Element (i, j) of the first
 * `banded` rows is band[j * stride + i]; a full matrix has stride = size. The rows after them are full, in `border`.
 */
typedef struct {
    double *band, *border;
    int64_t stride, banded, size;
} Reduced;

INLINE double *element_at(const Reduced *m, int64_t one, int64_t other)
{
    const int64_t i = one > other ? one : other, j = one > other ? other : one;
    return i < m->banded ? m->band + j * m->stride + i : m->border + (i - m->banded) * m->size + j;
}

/* Whether the matrix has an element. Points of a group are not all in all its photos: those may be too far apart. */
INLINE int is_stored(const Reduced *m, int64_t one, int64_t other)
{
    const int64_t i = one > other ? one : other, j = one > other ? other : one;
    return i >= m->banded || i - j <= m->stride;
}

/* Whether both triangles of a full matrix are there, so that its rows are its columns. */
INLINE int has_both_triangles(const Reduced *m)
{
    return m->stride == m->size && m->banded == m->size;
}

typedef struct {
    /* of each row; factor: root of the weight over the error, for the loops that come after */
    const double *weight, *residual;
    double *factor;
    const uint8_t *fixed;
    /* on_diagonal: the diagonals of the blocks are multiplied by it */
    double least_pivot, on_diagonal;
    const double *blocks;
    double *block_right, *diagonal, *right;
    double *half, *pivots;
    uint8_t *removed;
    Reduced reduced;
} Normals;

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

/* Normal equations of a group. matrix: column j from its element j, or from the first row that is not of the common columns
 * of cameras, every column `of_rows` long; cameras: the triangle of these; coupling: the three rows that couple a point with
 * the group's columns, each `stride` long. */
typedef struct {
    int64_t stride, of_rows, common;
    double *matrix, *cameras, *right, *diagonal, *coupling;
} Sums;

/* Length of a column of the sums of a group; it is padded, as additions are by whole lanes. */
static int64_t stride_of(int64_t size)
{
    return PADDED(size) + 2 * LANES;
}

static int64_t numbers_of_sums(int64_t size, int64_t common)
{
    return 5 * stride_of(size) + (size + COLUMNS_AT_ONCE) * stride_of(size - common);
}

static int64_t numbers_of_cameras(int64_t common)
{
    return common ? (common + COLUMNS_AT_ONCE) * stride_of(common) : 0;
}

/* Place the sums of a group in the room, after those of its cameras, which it may share with the groups before it; return
 * where the room goes on. */
INLINE double *place_sums(const Block *b, const Pattern *p, Share share, int64_t group, const Local *local, double *room,
                          Sums *sums)
{
    const int64_t size = local->size, common = local->common;
    if (group == share.first || !has_same_cameras(b, p, group)) {
        sums->cameras = room;
        room += numbers_of_cameras(common);
    }
    sums->common = common;
    sums->stride = stride_of(size);
    sums->of_rows = stride_of(size - common);
    sums->right = room;
    sums->diagonal = room + sums->stride;
    sums->coupling = room + 2 * sums->stride;
    sums->matrix = room + 5 * sums->stride;
    return room + numbers_of_sums(size, common);
}

/* Whether no group after this one adds to the sums of its cameras. */
INLINE int ends_cameras(const Block *b, const Pattern *p, Share share, int64_t group)
{
    return group + 1 == share.end || !has_same_cameras(b, p, group + 1);
}

/* The element of a row and a column of a group's sums, and how far columns are apart there. */
INLINE double *at_row(const Sums *s, int64_t column, int64_t row)
{
    return row < s->common ? s->cameras + column * stride_of(s->common) + row
                           : s->matrix + column * s->of_rows + row - s->common;
}

INLINE int64_t stride_at(const Sums *s, int64_t row)
{
    return row < s->common ? stride_of(s->common) : s->of_rows;
}

INLINE void add_to(double *sums, double x, const double *of_x, double y, const double *of_y, int64_t count)
{
    for (int64_t k = 0; k < count; k += LANES)
        AT(sums + k) += x * AT(of_x + k) + y * AT(of_y + k);
}

INLINE void add_multiple(double *sums, double x, const double *of_x, int64_t count)
{
    for (int64_t k = 0; k < count; k += LANES)
        AT(sums + k) += x * AT(of_x + k);
}

/* Add a photo point's rows by the columns of its camera, times x and y; common: whether both have the same columns. */
INLINE void add_to_camera(double *sums, const Places *at, int common, double x, double y, const double (*row)[ROW])
{
    const double *of_x = row[0] + PHOTO_ROW, *of_y = row[1] + PHOTO_ROW;
    if (common)
        add_to(sums + at->camera[0], x, of_x, y, of_y, at->camera_columns);
    else {
        add_multiple(sums + at->camera[0], x, of_x, at->camera_columns);
        add_multiple(sums + at->camera[1], y, of_y, at->camera_columns);
    }
}

/* Add the coupling of a photo point with its ground point, of partials px, py. */
INLINE void add_coupling(double *coupling, int64_t stride, const Places *at, int common, const double (*row)[ROW],
                         const double *px, const double *py)
{
    for (int i = 0; i < 3; i++) {
        double *w = coupling + i * stride;
        add_to_camera(w, at, common, px[i], py[i], row);
        add_to(w + at->photo, px[i], row[0], py[i], row[1], PHOTO_UNKNOWNS);
    }
}

#define KEPT_RAYS 8
#define KEPT_PHOTOS 8

/* Rows of some photo points of a photo, those of x and of y in turn. Points that follow each other are in the same photos:
 * the products of several rows are summed in registers. */
typedef struct {
    double row[KEPT_RAYS][2][ROW], misclosure[KEPT_RAYS][2];
    Places at;
    int32_t rays;
} IN_LINES PhotoRows;

/* Add products of numbers of some rows, `length` apart, to columns of a matrix; is_lower: of its lower triangle. Columns and
 * width are padded: the numbers of the padding are zeros, which add nothing to the columns that follow. */
INLINE void add_products(double *matrix, int64_t stride, const double *of_column, int64_t columns, const double *of_row,
                         int64_t width, int64_t rows, int64_t length, int is_lower)
{
    for (int64_t u = 0; u < columns; u += COLUMNS_AT_ONCE) {
        double *column[COLUMNS_AT_ONCE];
        for (int c = 0; c < COLUMNS_AT_ONCE; c++)
            column[c] = matrix + (u + c) * stride;
        for (int64_t k = is_lower ? u / (2 * LANES) * (2 * LANES) : 0; k < width; k += 2 * LANES) {
            Lanes sums[COLUMNS_AT_ONCE][2];
            for (int c = 0; c < COLUMNS_AT_ONCE; c++)
                sums[c][0] = AT(column[c] + k), sums[c][1] = AT(column[c] + k + LANES);
            for (int64_t r = 0; r < rows; r++) {
                const double *own = of_column + r * length + u;
                const Lanes one = AT(of_row + r * length + k), other = AT(of_row + r * length + k + LANES);
                for (int c = 0; c < COLUMNS_AT_ONCE; c++) {
                    sums[c][0] += own[c] * one;
                    sums[c][1] += own[c] * other;
                }
            }
            for (int c = 0; c < COLUMNS_AT_ONCE; c++)
                AT(column[c] + k) = sums[c][0], AT(column[c] + k + LANES) = sums[c][1];
        }
    }
}

/* Add products of numbers of some rows with misclosures, and their squares. */
INLINE void add_right(const Sums *s, int64_t first, const double *of_row, const double *misclosure, int64_t width,
                      int64_t rows, int64_t step)
{
    for (int64_t k = 0; k < width; k += LANES) {
        Lanes right = AT(s->right + first + k), squares = AT(s->diagonal + first + k);
        for (int64_t r = 0; r < rows; r++) {
            const Lanes x = AT(of_row + r * step * ROW + k);
            right += misclosure[r * step] * x;
            squares += x * x;
        }
        AT(s->right + first + k) = right, AT(s->diagonal + first + k) = squares;
    }
}

/* Add what rows contribute by the columns of their camera, from the first one on: all rows, or each second one. */
INLINE void add_camera_rows(const Sums *s, const PhotoRows *kept, int64_t first, int64_t columns, int c, int64_t rows,
                            int64_t step)
{
    const double *photo = kept->row[0][c], *camera = photo + PHOTO_ROW;
    const int64_t row = kept->at.photo;
    add_products(at_row(s, first, first), stride_at(s, first), camera, columns, camera, PADDED(columns), rows, step * ROW, 1);
    add_products(at_row(s, first, row), stride_at(s, row), camera, columns, photo, PHOTO_ROW, rows, step * ROW, 0);
    add_right(s, first, camera, kept->misclosure[0] + c, PADDED(columns), rows, step);
}

/* Add what the rows that are kept of a photo contribute; none is kept then. */
static void add_photo_rows(const Sums *s, PhotoRows *kept)
{
    const Places *at = &kept->at;
    const double *photo = kept->row[0][0];
    const int64_t rays = kept->rays;
    kept->rays = 0;
    if (!rays)
        return;
    if (has_common_columns(at))
        add_camera_rows(s, kept, at->camera[0], at->camera_columns, 0, 2 * rays, 1);
    else
        for (int c = 0; c < 2; c++)
            add_camera_rows(s, kept, at->camera[c], at->camera_columns, c, rays, 2);
    add_products(at_row(s, at->photo, at->photo), stride_at(s, at->photo), photo, PHOTO_UNKNOWNS, photo, PHOTO_ROW,
                 2 * rays, ROW, 1);
    add_right(s, at->photo, photo, kept->misclosure[0], PHOTO_ROW, 2 * rays, 1);
}

/* Keep the rows of a photo point among those of its photo, after adding those that have no room beside them. */
INLINE void keep_rows(const Sums *s, const Places *at, const double (*row)[ROW], const double *y, PhotoRows *kept)
{
    if (kept->rays == KEPT_RAYS || (kept->rays && at->photo != kept->at.photo))
        add_photo_rows(s, kept);
    kept->at = *at;
    const int64_t width = PHOTO_ROW + PADDED(at->camera_columns);
    for (int c = 0; c < 2; c++) {
        double *to = kept->row[kept->rays][c];
        for (int64_t k = 0; k < width; k += LANES)
            AT(to + k) = AT(row[c] + k);
        kept->misclosure[kept->rays][c] = y[c];
    }
    kept->rays++;
}

/* Points that are eliminated together, and the products that they make in an element of the sums. */
#define PANEL_POINTS 16
#define PANEL_PRODUCTS (3 * PANEL_POINTS)
/* Unknowns of a strip of the panel, and columns of the sums that are in registers at the same time. */
#define STRIP 8
#define COLUMNS_OF_PANEL 6

/* H times the coupling of some points with the unknowns of their group: strip after strip, in each the three rows of one
 * point after the other. seen: points that each run of the group is coupled with, a bit each. */
typedef struct {
    double *rows;
    int32_t *seen;
    int points;
} Panel;

static int64_t numbers_of_panel(int64_t size)
{
    return PANEL_PRODUCTS * PADDED(size);
}

/* Take a point into the panel, and subtract what it explains of the right-hand side. */
INLINE void take_into_panel(const Sums *s, int64_t size, const double *H, const double *g, Panel *panel)
{
    const double *w0 = s->coupling, *w1 = w0 + s->stride, *w2 = w1 + s->stride;
    double *rows = panel->rows + 3 * STRIP * panel->points++;
    for (int64_t first = 0; first < size; first += STRIP, rows += PANEL_PRODUCTS * STRIP)
        for (int64_t k = 0; k < STRIP; k += LANES) {
            const Lanes a = AT(w0 + first + k), b = AT(w1 + first + k), c = AT(w2 + first + k);
            const Lanes x = H[0] * a + H[1] * b + H[2] * c, y = H[3] * a + H[4] * b + H[5] * c;
            const Lanes z = H[6] * a + H[7] * b + H[8] * c;
            AT(rows + k) = x, AT(rows + STRIP + k) = y, AT(rows + 2 * STRIP + k) = z;
            AT(s->right + first + k) -= g[0] * x + g[1] * y + g[2] * z;
        }
}

/* Subtract the products of some points of a panel from a strip of some columns; of each column the panel has the strip
 * that it lies in from its own place on. */
INLINE void subtract_products(const double *strip, const double *const *of_column, const int32_t *points, int count,
                              double *const *columns)
{
    Lanes sums[COLUMNS_OF_PANEL][STRIP / LANES];
    for (int c = 0; c < COLUMNS_OF_PANEL; c++)
        for (int k = 0; k < STRIP / LANES; k++)
            sums[c][k] = ALL(0.0);
    for (int p = 0; p < count; p++)
        for (int64_t at = 3 * STRIP * points[p]; at < 3 * STRIP * (points[p] + 1); at += STRIP)
            for (int c = 0; c < COLUMNS_OF_PANEL; c++) {
                const Lanes of_own = ALL(of_column[c][at]);
                for (int k = 0; k < STRIP / LANES; k++)
                    sums[c][k] += of_own * AT(strip + at + k * LANES);
            }
    for (int c = 0; c < COLUMNS_OF_PANEL; c++)
        for (int k = 0; k < STRIP / LANES; k++)
            AT(columns[c] + k * LANES) -= sums[c][k];
}

/* Eliminate the points of a panel from the columns of one run. */
INLINE void eliminate_from_run(const Sums *s, int64_t size, int64_t first, int64_t columns_of_own, const Panel *panel, int32_t seen)
{
    int32_t points[PANEL_POINTS], count = 0;
    for (int32_t p = 0; p < panel->points; p++)
        if (seen >> p & 1)
            points[count++] = p;
    for (int64_t u = first; count && u < first + columns_of_own; u += COLUMNS_OF_PANEL) {
        const double *of_column[COLUMNS_OF_PANEL];
        double *cameras[COLUMNS_OF_PANEL], *columns[COLUMNS_OF_PANEL], nowhere[STRIP] = {0.0};
        const int64_t own = first + columns_of_own - u;
        for (int64_t c = 0; c < COLUMNS_OF_PANEL; c++) {
            const int64_t j = c < own ? u + c : u;
            of_column[c] = panel->rows + j / STRIP * (PANEL_PRODUCTS * STRIP) + j % STRIP;
            cameras[c] = at_row(s, j, 0), columns[c] = at_row(s, j, s->common) - s->common;
        }
        for (int64_t i = u / STRIP * STRIP; i < size; i += STRIP) {
            double *at[COLUMNS_OF_PANEL];
            for (int64_t c = 0; c < COLUMNS_OF_PANEL; c++)
                at[c] = c < own ? (i < s->common ? cameras[c] : columns[c]) + i : nowhere;
            subtract_products(panel->rows + i * PANEL_PRODUCTS, of_column, points, count, at);
        }
    }
}

/* Eliminate the points of a panel, which is empty then. */
static void eliminate_panel(const Block *b, const Pattern *p, const Local *local, const Sums *s, Panel *panel)
{
    for (int32_t at = 0; panel->points && at < local->camera_runs + local->photo_runs; at++) {
        const int32_t r = local->sorted[at];
        eliminate_from_run(s, local->size, local->first[r], columns_of_run(b, p, local->runs[r]), panel, panel->seen[r]);
        panel->seen[r] = 0;
    }
    panel->points = 0;
}

/* Find how many unknowns, from each local unknown on, have consecutive places. */
INLINE void find_stretches(const Local *local, int32_t *stretch)
{
    for (int64_t i = local->size - 1; i >= 0; i--) {
        const int goes_on = i + 1 < local->size && local->place[i] >= 0 && local->place[i + 1] == local->place[i] + 1;
        stretch[i] = goes_on ? stretch[i + 1] + 1 : 1;
    }
}

/* Add a part of column j of a group's sums, from the i-th row on, to the reduced system, one stretch of consecutive places
 * after the other. Cameras with the same lens have common places: where two unknowns of the group are one, both triangles
 * of the sums go to the diagonal. */
INLINE void scatter_column(const double *column, int64_t j, int64_t i, int64_t end, const Local *local, const Reduced *m,
                           const int32_t *stretch)
{
    const int64_t own = local->place[j];
    for (int64_t length; i < end; i += length) {
        const int64_t place = local->place[i], room = own + m->stride + 1 - place;
        length = stretch[i] < end - i ? stretch[i] : end - i;
        if (place >= own && place + length <= m->banded) {
            double *banded = m->band + own * m->stride + place;
            for (int64_t k = 0; k < length && k < room; k++)
                banded[k] += column[i + k];
        } else if (own >= m->banded && place >= 0 && place + length <= own) {
            double *row = m->border + (own - m->banded) * m->size + place;
            for (int64_t k = 0; k < length; k++)
                row[k] += column[i + k];
        } else
            for (int64_t k = 0; place >= 0 && k < length; k++)
                if (is_stored(m, own, place + k))
                    *element_at(m, own, place + k) += column[i + k];
        if (i != j && place >= 0 && place <= own && own < place + length)
            *element_at(m, own, own) += column[i + own - place];
    }
}

/* Add a group's sums to the reduced system; with_cameras: those that it shares with other groups, too. */
INLINE void scatter(const Sums *s, const Local *local, const Normals *n, int32_t *stretch, int with_cameras)
{
    const Reduced *m = &n->reduced;
    find_stretches(local, stretch);
    for (int64_t j = 0; j < local->size; j++) {
        const int64_t own = local->place[j], from = j < s->common ? s->common : j;
        if (own < 0)
            continue;
        n->right[own] += s->right[j];
        n->diagonal[own] += s->diagonal[j];
        if (with_cameras && j < s->common)
            scatter_column(s->cameras + j * stride_of(s->common), j, j, s->common, local, m, stretch);
        scatter_column(s->matrix + j * s->of_rows - s->common, j, from, local->size, local, m, stretch);
    }
}

/* Copy the lower triangle of a full matrix to the upper one. */
INLINE void mirror(const Reduced *m)
{
    for (int64_t i = 0; i < m->size; i++)
        for (int64_t j = 0; j < i; j++)
            m->band[i * m->stride + j] = m->band[j * m->stride + i];
}

/* Weigh the photo points from the k-th of the pattern on that are linearised at once; fetch those that come later. */
INLINE void weigh(const Block *b, const Pattern *p, const Normals *n, int64_t k, double (*roots)[2])
{
    const int64_t rest = p->start[p->blocks] - k;
    for (int64_t lane = 0; lane < LANES && lane < rest; lane++) {
        const int64_t first = 2 * (int64_t)p->order[k + lane];
        for (int c = 0; c < 2; c++) {
            roots[lane][c] = sqrt(n->weight[first + c]);
            n->factor[first + c] = roots[lane][c] / b->error[first + c];
        }
        if (lane + FETCHED_BEFORE < rest) {
            const int64_t later = 2 * (int64_t)p->order[k + lane + FETCHED_BEFORE];
            FETCH(n->weight + later);
            FETCH(n->residual + later);
            FETCH(b->error + later);
        }
    }
}

/* Form the sums of each group of a share, one after the other in `room`. */
static void normals_loop(const Block *b, const Pattern *p, Share share, const Normals *n, int32_t *numbers, double *room,
                         double *of_panel)
{
    Ahead a;
    double roots[LANES][2];
    PhotoRows kept[KEPT_PHOTOS];
    Local local = local_in(p, numbers);
    Panel panel = {.rows = of_panel, .seen = numbers + ARRAYS_OF_LOCAL * p->longest};
    Sums s;
    begin_ahead(&a);
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        double *const next = place_sums(b, p, share, group, &local, room, &s);
        for (int photo = 0; photo < KEPT_PHOTOS; photo++)
            kept[photo].rays = 0;
        memset(panel.seen, 0, sizeof(int32_t) * (size_t)(local.camera_runs + local.photo_runs));
        memset(room, 0, sizeof(double) * (size_t)(next - room));
        for (int64_t place = p->group_start[group]; place < p->group_start[group + 1]; place++) {
            const int64_t block = p->block[place];
            double V[9] = {0.0}, full[3], *g = n->block_right + 3 * block, *H = n->half + 9 * block;
            const double *given_block = n->blocks + 9 * block;
            int32_t last[2] = {0, 0};
            memset(s.coupling, 0, sizeof(double) * 3 * (size_t)s.stride);
            for (int64_t k = p->start[place]; k < p->start[place + 1]; k++) {
                if (k >= a.end)
                    weigh(b, p, n, k, roots);
                const int lane = ahead(b, p, n->factor, k, &a);
                const int32_t row = p->order[k];
                const double *root = roots[lane], *residual = n->residual + 2 * (int64_t)row;
                const double y[2] = {-residual[0] * root[0], -residual[1] * root[1]};
                if (!a.found.in_front[lane] || (root[0] == 0.0 && root[1] == 0.0))
                    continue;
                const Places at = places_of(b, p, &local, row, a.cameras[lane], last);
                double px[3], py[3];
                for (int i = 0; i < 3; i++)
                    px[i] = LANE(a.of_point[0][i], lane), py[i] = LANE(a.of_point[1][i], lane);
                for (int i = 0; i < 3; i++) {
                    g[i] += px[i] * y[0] + py[i] * y[1];
                    for (int j = 0; j < 3; j++)
                        V[3 * i + j] += px[i] * px[j] + py[i] * py[j];
                }
                panel.seen[local.camera_runs + last[0]] |= 1 << panel.points;
                panel.seen[last[1]] |= 1 << panel.points;
                if (has_common_columns(&at))
                    add_coupling(s.coupling, s.stride, &at, 1, a.row[lane], px, py);
                else
                    add_coupling(s.coupling, s.stride, &at, 0, a.row[lane], px, py);
                keep_rows(&s, &at, a.row[lane], y, &kept[last[0] % KEPT_PHOTOS]);
            }
            /* every ray counts for all three coordinates, other observations for their own */
            const double of_rays = V[0] + V[4] + V[8];
            for (int i = 0; i < 9; i++)
                V[i] += given_block[i];
            for (int i = 0; i < 3; i++) {
                full[i] = of_rays + given_block[4 * i];
                V[4 * i] *= n->on_diagonal;
            }
            const uint8_t *fixed = n->fixed + 3 * block;
            double *pivots = n->pivots + 3 * block;
            memset(n->removed + 3 * block, 0, 3);
            if (!factorise_in_order(V, full, fixed, n->least_pivot, H, pivots))
                factorise_by_size(V, full, fixed, n->least_pivot, H, pivots, n->removed + 3 * block);
            const double given[3] = {g[0], g[1], g[2]};
            multiply(H, given, g);
            take_into_panel(&s, local.size, H, g, &panel);
            if (panel.points == PANEL_POINTS)
                eliminate_panel(b, p, &local, &s, &panel);
        }
        eliminate_panel(b, p, &local, &s, &panel);
        for (int photo = 0; photo < KEPT_PHOTOS; photo++)
            add_photo_rows(&s, &kept[photo]);
        if (ends_cameras(b, p, share, group))
            matrix_to_unknowns(p, &local, s.cameras, stride_of(s.common));
        rows_to_unknowns(p, &local, s.matrix, s.of_rows, s.right, s.diagonal);
        room = next;
    }
}

/* Add the sums of a share's groups to the reduced system; with the last ones it is complete. */
static void add_normals(const Block *b, const Pattern *p, Share share, const Normals *n, int32_t *numbers, double *room)
{
    Local local = local_in(p, numbers);
    Sums s;
    for (int64_t group = share.first; group < share.end; group++) {
        local_unknowns(b, p, group, &local);
        room = place_sums(b, p, share, group, &local, room, &s);
        scatter(&s, &local, n, numbers + ARRAYS_OF_LOCAL * p->longest, ends_cameras(b, p, share, group));
    }
    if (share.end == p->groups && has_both_triangles(&n->reduced))
        mirror(&n->reduced);
}

#endif
