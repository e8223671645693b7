/* Points that are eliminated from the columns of their photos together. */

#include "sums.h"

/* Points that are eliminated together, for each a bit, and the products that they make in an element of the sums. */
#define PANEL_POINTS 30
#define PANEL_PRODUCTS (3 * PANEL_POINTS)

/* E, which is H times the coupling, of some points with the unknowns of the photos of their group: strip after strip, in
 * each the three rows of one point after the other. seen: points that each photo of the group is coupled with, a bit each;
 * of_strip: those that are coupled with a photo in each strip. */
typedef struct {
    double *rows;
    int32_t *seen, *of_strip;
    int points;
} PointPanel;

static int64_t numbers_of_point_panel(int64_t size)
{
    return PANEL_PRODUCTS * PADDED(size);
}

/* Multiply the coupling of a point by H, and subtract what the point explains of the right-hand side. */
INLINE void find_elimination(const Sums *s, int64_t size, const double *H, const double *g, double *const *w)
{
    for (int64_t i = 0; i < size; i += LANES) {
        const Lanes a = AT(w[0] + i), b = AT(w[1] + i), c = AT(w[2] + i);
        const Lanes x = H[0] * a + H[1] * b + H[2] * c, y = H[3] * a + H[4] * b + H[5] * c;
        const Lanes z = H[6] * a + H[7] * b + H[8] * c;
        AT(w[0] + i) = x, AT(w[1] + i) = y, AT(w[2] + i) = z;
        AT(s->right + i) -= g[0] * x + g[1] * y + g[2] * z;
    }
}

/* Take the rows of a point by so many columns of photos into the panel. */
INLINE void take_point(PointPanel *panel, int64_t photos, const double *const *rows)
{
    double *to = panel->rows + 3 * STRIP * panel->points++;
    for (int64_t first = 0; first < photos; first += STRIP, to += PANEL_PRODUCTS * STRIP)
        for (int row = 0; row < 3; row++)
            for (int64_t k = 0; k < STRIP; k += LANES)
                AT(to + row * STRIP + k) = AT(rows[row] + first + k);
}

/* Find which points are coupled with the columns of each strip: most photos of a large group do not show most of them. */
INLINE void find_points_of_strips(const Local *local, int64_t photos, const PointPanel *panel)
{
    memset(panel->of_strip, 0, sizeof(int32_t) * (size_t)((photos + STRIP - 1) / STRIP));
    for (int32_t photo = 0; photo < local->photo_runs; photo++) {
        const int64_t first = local->first[local->camera_runs + photo] - local->cameras;
        for (int64_t strip = first / STRIP; strip <= (first + PHOTO_UNKNOWNS - 1) / STRIP; strip++)
            panel->of_strip[strip] |= panel->seen[photo];
    }
}

/* Subtract the products of some points of a panel, a bit each, from a strip of some columns, from its i-th row on; of each
 * column the panel has the strip that it lies in from its own place on. */
INLINE void subtract_products(const double *strip, const double *const *of_column, int32_t points, double *const *columns,
                              int64_t i)
{
    Lanes sums[PHOTO_COLUMNS][STRIP / LANES];
    for (int c = 0; c < PHOTO_COLUMNS; c++)
        for (int k = 0; k < STRIP / LANES; k++)
            sums[c][k] = ALL(0.0);
    for (; points; points &= points - 1) {
        const int64_t from = 3 * STRIP * first_of(points);
        for (int64_t at = from; at < from + 3 * STRIP; at += STRIP)
            for (int c = 0; c < PHOTO_COLUMNS; c++) {
                const Lanes of_own = ALL(of_column[c][at]);
                for (int k = 0; k < STRIP / LANES; k++)
                    sums[c][k] += of_own * AT(strip + at + k * LANES);
            }
    }
    for (int c = 0; c < PHOTO_COLUMNS; c++)
        for (int k = 0; k < STRIP / LANES; k++)
            AT(columns[c] + i + k * LANES) -= sums[c][k];
}

/* Eliminate the points of a panel from some columns of a photo, the first of so many columns of photos. */
INLINE void eliminate_from_photo(const Sums *s, int64_t cameras, int64_t photos, int64_t first, const PointPanel *panel,
                                 int32_t seen)
{
    if (!seen)
        return;
    const double *of_column[PHOTO_COLUMNS];
    double *columns[PHOTO_COLUMNS];
    for (int64_t c = 0; c < PHOTO_COLUMNS; c++) {
        const int64_t j = first + c;
        of_column[c] = panel->rows + j / STRIP * (PANEL_PRODUCTS * STRIP) + j % STRIP;
        columns[c] = photos_of(s, cameras + j);
    }
    for (int64_t i = first / STRIP * STRIP; i < photos; i += STRIP) {
        const int32_t both = seen & panel->of_strip[i / STRIP];
        if (both)
            subtract_products(panel->rows + i * PANEL_PRODUCTS, of_column, both, columns, i);
    }
}

/* Eliminate the points of a panel, which is empty then. */
static void eliminate_points(const Local *local, const Sums *s, PointPanel *panel)
{
    const int64_t cameras = local->cameras;
    if (panel->points)
        find_points_of_strips(local, local->size - cameras, panel);
    for (int32_t photo = 0; panel->points && photo < local->photo_runs; photo++) {
        const int64_t first = local->first[local->camera_runs + photo] - cameras;
        for (int64_t of_photo = 0; of_photo < PHOTO_UNKNOWNS; of_photo += PHOTO_COLUMNS)
            eliminate_from_photo(s, cameras, local->size - cameras, first + of_photo, panel, panel->seen[photo]);
        panel->seen[photo] = 0;
    }
    panel->points = 0;
}
