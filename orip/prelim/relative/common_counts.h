/* How many points each two photos share, as in pair_selection.py. */

#include <stdint.h>
#include <string.h>

static void count_common(const int64_t *photo, const int64_t *start, int64_t points, int64_t photos, int64_t *counts)
{
    memset(counts, 0, (size_t)(photos * photos) * sizeof(int64_t));
    for (int64_t point = 0; point < points; point++)
        for (int64_t row = start[point]; row < start[point + 1]; row++)
            for (int64_t other = start[point]; other < start[point + 1]; other++)
                counts[photos * photo[row] + photo[other]]++;
}
