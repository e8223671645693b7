/* Residuals of photo points, and for each coordinate whether it can be computed. */

#include "block.h"

static void residual_loop(const Block *b, Share share, double *residual, uint8_t *in_front)
{
    Ray ray;
    Linearised found;
    int32_t cameras[LANES], rows[LANES];
    memset(&ray, 0, sizeof ray);
    for (int lane = 0; lane < LANES; lane++)
        cameras[lane] = -1;
    for (int64_t row = share.first; row < share.end; row += LANES) {
        const int count = share.end - row < LANES ? (int)(share.end - row) : LANES;
        for (int lane = 0; lane < LANES; lane++)
            rows[lane] = (int32_t)(row + (lane < count ? lane : 0));
        linearise(b, rows, 0, &ray, cameras, &found);
        for (int lane = 0; lane < count; lane++) {
            const int64_t at = 2 * (row + lane);
            for (int c = 0; c < 2; c++) {
                in_front[at + c] = (uint8_t)found.in_front[lane];
                residual[at + c] = found.in_front[lane] ? LANE(found.residual[c], lane) / b->error[at + c] : 0.0;
            }
        }
    }
}
