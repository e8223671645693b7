/* Photo points of some points, whose products by the columns of cameras are formed together.
 *
 * A row a of partials has a - t^T E left when its ground point has been eliminated, with the coupling E of the point and
 * t = H times the partials by it: products of rows with what is left of them are the normal equations without the points,
 * A^T (A - T E) = A^T A - E^T E. Rows have few of the columns of the cameras, and one photo. What is left of them by the
 * columns of the cameras is multiplied here; by those of photos, of which a point has few, E^T E is less.
 */

#include "point_blocks.h"
#include "sums.h"

/* A photo point: its rows of partials, those by the ground point, times H in the end, misclosures, the photo among the
 * runs of the group, and the one before it in that photo, or -1. */
typedef struct {
    double row[2][ROW], of_point[2][3], misclosure[2];
    Places at;
    int32_t photo, before;
} IN_LINES PanelRay;

/* rest: what is left of both rows of each photo point by the columns of cameras, `length` long; latest: the last photo point
 * of each photo of the group, or -1; by_photos: products of the columns of photos with those of cameras, `length` long. */
typedef struct {
    PanelRay *rays;
    double *rest, *by_photos;
    int32_t *latest;
    int64_t count, length;
} RayPanel;

/* Photo points with which the panel is full, at the end of a point. */
#define RAYS_OF_PANEL 48

static int64_t numbers_of_ray_panel(const Pattern *p)
{
    const int64_t length = stride_of(p->most_camera_columns), rays = RAYS_OF_PANEL + p->most_rays;
    return rays * ((int64_t)(sizeof(PanelRay) / sizeof(double)) + 2 * length) + p->longest * length;
}

INLINE RayPanel ray_panel_in(const Pattern *p, double *room, int32_t *numbers)
{
    const int64_t rays = RAYS_OF_PANEL + p->most_rays;
    RayPanel panel = {.rays = (PanelRay *)room, .latest = numbers};
    panel.rest = (double *)(panel.rays + rays);
    panel.by_photos = panel.rest + 2 * rays * stride_of(p->most_camera_columns);
    return panel;
}

/* Begin a group: nothing is summed up, and no photo has a photo point. */
INLINE void begin_group(const Local *local, RayPanel *panel)
{
    panel->count = 0;
    panel->length = local->cameras;
    memset(panel->by_photos, 0, sizeof(double) * (size_t)(panel->length * (local->size - local->cameras)));
    for (int32_t photo = 0; photo < local->photo_runs; photo++)
        panel->latest[photo] = -1;
}

/* Take a photo point into the panel. */
INLINE void take_ray(RayPanel *panel, const Places *at, int32_t photo, const double (*row)[ROW], const double *px,
                     const double *py, const double *misclosure)
{
    PanelRay *ray = panel->rays + panel->count;
    const int64_t width = PHOTO_ROW + PADDED(at->camera_columns);
    ray->at = *at;
    ray->photo = photo;
    ray->before = panel->latest[photo];
    panel->latest[photo] = (int32_t)panel->count++;
    for (int c = 0; c < 2; c++) {
        for (int64_t k = 0; k < width; k += LANES)
            AT(ray->row[c] + k) = AT(row[c] + k);
        memcpy(ray->of_point[c], c ? py : px, sizeof ray->of_point[c]);
        ray->misclosure[c] = misclosure[c];
    }
}

/* Find what is left of the rows of the photo points from the first one on, which are all those of a point, when it is
 * eliminated; H and E of the point. */
INLINE void eliminate_from_rays(RayPanel *panel, int64_t first, const double *H, const double *const *E)
{
    for (int64_t r = first; r < panel->count; r++) {
        const PanelRay *ray = panel->rays + r;
        double *x = panel->rest + 2 * r * panel->length, *y = x + panel->length, of_x[3], of_y[3];
        multiply(H, ray->of_point[0], of_x);
        multiply(H, ray->of_point[1], of_y);
        for (int64_t i = 0; i < panel->length; i += LANES) {
            const Lanes a = AT(E[0] + i), b = AT(E[1] + i), c = AT(E[2] + i);
            AT(x + i) = -(of_x[0] * a + of_x[1] * b + of_x[2] * c);
            AT(y + i) = -(of_y[0] * a + of_y[1] * b + of_y[2] * c);
        }
        add_multiple(x + ray->at.camera[0], 1.0, ray->row[0] + PHOTO_ROW, ray->at.camera_columns);
        add_multiple(y + ray->at.camera[1], 1.0, ray->row[1] + PHOTO_ROW, ray->at.camera_columns);
    }
}

/* Rows that are multiplied: numbers of each that belong to some columns of the sums, and a vector of each. */
#define MOST_ROWS 64
typedef struct {
    const double *numbers[MOST_ROWS], *vector[MOST_ROWS];
    double misclosure[MOST_ROWS];
    int count;
} Rows;

INLINE void add_row(Rows *rows, const double *numbers, const double *vector, double misclosure)
{
    rows->numbers[rows->count] = numbers, rows->vector[rows->count] = vector;
    rows->misclosure[rows->count++] = misclosure;
}

/* Add the products of rows to some columns of the sums, `stride` apart and of so many rows, the first of which is element
 * `first` of them; is_lower: only from the diagonal on, and what is in the same strip; at_once: columns at a time. */
INLINE void add_products(const Rows *rows, double *matrix, int64_t stride, int64_t columns, int64_t first, int64_t width,
                         int is_lower, int at_once)
{
    for (int64_t u = 0; u < columns; u += at_once) {
        double *column[COLUMNS_OF_PANEL], nowhere[STRIP] = {0.0};
        for (int64_t i = is_lower ? (first + u) / STRIP * STRIP : 0; i < width; i += STRIP) {
            Lanes sums[COLUMNS_OF_PANEL][STRIP / LANES];
            for (int c = 0; c < at_once; c++) {
                column[c] = u + c < columns ? matrix + (u + c) * stride + i : nowhere;
                for (int k = 0; k < STRIP / LANES; k++)
                    sums[c][k] = ALL(0.0);
            }
            for (int r = 0; r < rows->count; r++) {
                const double *numbers = rows->numbers[r] + u, *vector = rows->vector[r] + i;
                for (int c = 0; c < at_once; c++)
                    for (int k = 0; k < STRIP / LANES; k++)
                        sums[c][k] += numbers[c] * AT(vector + k * LANES);
            }
            for (int c = 0; c < at_once; c++)
                for (int k = 0; k < STRIP / LANES; k++)
                    AT(column[c] + k * LANES) += sums[c][k];
        }
    }
}

/* Add products of the numbers of rows with misclosures, and their squares. */
INLINE void add_right(const Rows *rows, const Sums *s, int64_t first, int64_t width)
{
    for (int64_t k = 0; k < width; k += LANES) {
        Lanes right = AT(s->right + first + k), squares = AT(s->diagonal + first + k);
        for (int r = 0; r < rows->count; r++) {
            const Lanes x = AT(rows->numbers[r] + k);
            right += rows->misclosure[r] * x;
            squares += x * x;
        }
        AT(s->right + first + k) = right, AT(s->diagonal + first + k) = squares;
    }
}

/* Add rows by the columns of their camera, from the first one on; none is left then. */
INLINE void add_camera_rows(const RayPanel *panel, const Sums *s, int64_t first, int64_t columns, Rows *rows)
{
    add_products(rows, s->by_cameras + first * s->of_cameras, s->of_cameras, columns, first, panel->length, 1,
                 COLUMNS_OF_PANEL);
    add_right(rows, s, first, PADDED(columns));
    rows->count = 0;
}

INLINE int have_same_camera(const PanelRay *one, const PanelRay *other)
{
    return one->at.camera[0] == other->at.camera[0] && one->at.camera_columns == other->at.camera_columns;
}

/* Add the products by the columns of cameras of the rows of x (c = 0) or y, or of both. */
INLINE void add_by_cameras(const RayPanel *panel, const Sums *s, int c, int both)
{
    Rows rows;
    rows.count = 0;
    for (int64_t r = 0; r < panel->count; r++) {
        const PanelRay *ray = panel->rays + r;
        const Places *at = &ray->at;
        if (has_common_columns(at) != both)
            continue;
        for (int i = c; i < (both ? 2 : c + 1); i++)
            add_row(&rows, ray->row[i] + PHOTO_ROW, panel->rest + (2 * r + i) * panel->length, ray->misclosure[i]);
        if (r + 1 == panel->count || rows.count + 2 > MOST_ROWS || !have_same_camera(ray, ray + 1))
            add_camera_rows(panel, s, at->camera[c], at->camera_columns, &rows);
    }
}

/* Add the products by the columns of the photo that a photo point was the last one of. */
INLINE void add_by_photo(const RayPanel *panel, const Local *local, const Sums *s, int32_t latest)
{
    Rows of_cameras, of_photo;
    of_cameras.count = of_photo.count = 0;
    const int64_t photo = panel->rays[latest].at.photo, own = photo - local->cameras;
    for (int32_t r = latest; r >= 0; r = panel->rays[r].before) {
        const PanelRay *ray = panel->rays + r;
        for (int c = 0; c < 2; c++) {
            add_row(&of_cameras, ray->row[c], panel->rest + (2 * (int64_t)r + c) * panel->length, 0.0);
            add_row(&of_photo, ray->row[c], ray->row[c], ray->misclosure[c]);
        }
        if (of_photo.count + 2 > MOST_ROWS || ray->before < 0) {
            add_products(&of_cameras, panel->by_photos + own * panel->length, panel->length, PHOTO_UNKNOWNS, 0,
                         panel->length, 0, PHOTO_COLUMNS);
            add_products(&of_photo, photos_of(s, photo) + own, s->of_photos, PHOTO_UNKNOWNS, 0, PHOTO_ROW, 1, PHOTO_COLUMNS);
            add_right(&of_photo, s, photo, PHOTO_ROW);
            of_cameras.count = of_photo.count = 0;
        }
    }
}

/* Add what the photo points of a panel contribute, which is empty then. */
static void add_rays(const Local *local, const Sums *s, RayPanel *panel)
{
    add_by_cameras(panel, s, 0, 1);
    add_by_cameras(panel, s, 0, 0);
    add_by_cameras(panel, s, 1, 0);
    for (int64_t r = 0; r < panel->count; r++) {
        int32_t *latest = panel->latest + panel->rays[r].photo;
        if (*latest >= 0)
            add_by_photo(panel, local, s, *latest);
        *latest = -1;
    }
    panel->count = 0;
}

/* Add the products by columns of photos and of cameras to the columns of the cameras; with them the sums are complete. */
INLINE void end_group(const RayPanel *panel, const Local *local, const Sums *s)
{
    for (int64_t j = 0; j < local->cameras; j++)
        for (int64_t i = 0; i < local->size - local->cameras; i++)
            photos_of(s, j)[i] = panel->by_photos[i * panel->length + j];
}
