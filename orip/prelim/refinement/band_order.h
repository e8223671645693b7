/* The order of photos that keeps the band of their normal equations narrow, as in band_order.py. */

#include "../compiled/linear.h"
#include <string.h>

typedef struct {
    const int64_t *photo, *start;
    const uint8_t *photo_free, *point_free;
    int64_t count, photos, points;
    /* points by photo, numbers of neighbours, of which photo each one was last found to be a neighbour, and a list */
    int64_t *first_of, *point_of, *degree, *found_by, *neighbours;
} PhotoGraph;

/* The numbers of int64 that the lists of a graph need. */
static int64_t photo_graph_space(int64_t count, int64_t photos) { return count + 5 * photos + 1; }

static void place_lists(PhotoGraph *g, int64_t *space)
{
    g->point_of = space, g->first_of = g->point_of + g->count, g->degree = g->first_of + g->photos + 1;
    g->found_by = g->degree + g->photos, g->neighbours = g->found_by + g->photos;
}

static void sort_by_photo(PhotoGraph *g)
{
    int64_t *next = g->degree;
    memset(g->first_of, 0, (size_t)(g->photos + 1) * sizeof(int64_t));
    for (int64_t row = 0; row < g->count; row++)
        g->first_of[g->photo[row] + 1]++;
    for (int64_t photo = 0; photo < g->photos; photo++)
        next[photo] = g->first_of[photo], g->first_of[photo + 1] += g->first_of[photo];
    for (int64_t point = 0; point < g->points; point++)
        for (int64_t row = g->start[point]; row < g->start[point + 1]; row++)
            g->point_of[next[g->photo[row]]++] = point;
}

/* List the free photos that share a free point with a free photo, and return how many they are. */
static int64_t list_neighbours(PhotoGraph *g, int64_t photo)
{
    int64_t number = 0;
    g->found_by[photo] = photo;
    for (int64_t k = g->first_of[photo]; k < g->first_of[photo + 1]; k++) {
        const int64_t point = g->point_of[k];
        for (int64_t row = g->start[point]; g->point_free[point] && row < g->start[point + 1]; row++) {
            const int64_t other = g->photo[row];
            if (g->photo_free[other] && g->found_by[other] != photo)
                g->found_by[other] = photo, g->neighbours[number++] = other;
        }
    }
    return number;
}

static int comes_first(const PhotoGraph *g, int64_t one, int64_t other)
{
    return g->degree[one] < g->degree[other] || (g->degree[one] == g->degree[other] && one < other);
}

/* Insert a photo into the ordered ones before `end`, of which those from `begin` on have been found together with it. */
static void insert_photo(const PhotoGraph *g, int64_t *order, int64_t begin, int64_t end, int64_t photo)
{
    for (; end > begin && comes_first(g, photo, order[end - 1]); end--)
        order[end] = order[end - 1];
    order[end] = photo;
}

static int64_t first_unplaced(const PhotoGraph *g, const int64_t *place)
{
    int64_t first = -1;
    for (int64_t photo = 0; photo < g->photos; photo++)
        if (g->photo_free[photo] && place[photo] < 0 && (first < 0 || comes_first(g, photo, first)))
            first = photo;
    return first;
}

/* Order the free photos; `order` has room for them. */
static void order_photos(PhotoGraph *g, int64_t *order, int64_t *place)
{
    int64_t number = 0;
    sort_by_photo(g);
    memset(g->found_by, -1, (size_t)g->photos * sizeof(int64_t));
    memset(place, -1, (size_t)g->photos * sizeof(int64_t));
    for (int64_t photo = 0; photo < g->photos; photo++)
        g->degree[photo] = g->photo_free[photo] ? list_neighbours(g, photo) : 0;
    memset(g->found_by, -1, (size_t)g->photos * sizeof(int64_t));
    for (int64_t at = 0;; at++) {
        if (at == number) {
            const int64_t first = first_unplaced(g, place);
            if (first < 0)
                break;
            order[number++] = first, place[first] = 0;
        }
        const int64_t begin = number, neighbours = list_neighbours(g, order[at]);
        for (int64_t k = 0; k < neighbours; k++)
            if (place[g->neighbours[k]] < 0) {
                place[g->neighbours[k]] = 0;
                insert_photo(g, order, begin, number++, g->neighbours[k]);
            }
    }
    for (int64_t low = 0, high = number - 1; low < high; low++, high--) {
        const int64_t kept = order[low];
        order[low] = order[high], order[high] = kept;
    }
    for (int64_t at = 0; at < number; at++)
        place[order[at]] = at;
}

/* The largest number of places, both counted, from the first to the last photo of a free point. */
static int64_t places_of_a_point(const PhotoGraph *g, const int64_t *place)
{
    int64_t most = 0;
    for (int64_t point = 0; point < g->points; point++) {
        int64_t low = INT64_MAX, high = -1;
        for (int64_t row = g->start[point]; g->point_free[point] && row < g->start[point + 1]; row++) {
            const int64_t at = place[g->photo[row]];
            low = at >= 0 && at < low ? at : low;
            high = at > high ? at : high;
        }
        if (high >= 0 && high - low + 1 > most)
            most = high - low + 1;
    }
    return most;
}
