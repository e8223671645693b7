/* Normal equations of each point by itself, with cameras and photos held. */

#include "block.h"

typedef struct {
    const double *factor, *misclosure;
    /* 9, 3 and 1 numbers for each block; the sums are added to what the arrays contain */
    double *blocks, *right, *squares;
} PointNormals;

static void points_loop(const Block *b, const Pattern *p, Share share, const PointNormals *n)
{
    const int64_t end = p->start[p->group_start[share.end]];
    Ray ray;
    Linearised found;
    int32_t cameras[LANES], rows[LANES];
    int64_t place = p->group_start[share.first];
    memset(&ray, 0, sizeof ray);
    for (int lane = 0; lane < LANES; lane++)
        cameras[lane] = -1;
    for (int64_t k = p->start[place]; k < end; k += LANES) {
        const int64_t rest = end - k;
        const int count = rest < LANES ? (int)rest : LANES;
        for (int lane = 0; lane < LANES; lane++)
            rows[lane] = p->order[k + (lane < count ? lane : 0)];
        linearise(b, rows, 1, &ray, cameras, &found);
        for (int lane = 0; lane < count; lane++) {
            while (p->start[place + 1] <= k + lane)
                place++;
            const double *f = n->factor + 2 * (int64_t)rows[lane], *y = n->misclosure + 2 * (int64_t)rows[lane];
            double *V = n->blocks + 9 * (int64_t)p->block[place], *g = n->right + 3 * (int64_t)p->block[place];
            n->squares[p->block[place]] += y[0] * y[0] + y[1] * y[1];
            for (int c = 0; c < 2 && found.in_front[lane]; c++) {
                const Lanes *partials = found.partials[c] + POINT;
                const double a[3] = {f[c] * LANE(partials[0], lane), f[c] * LANE(partials[1], lane), f[c] * LANE(partials[2], lane)};
                for (int i = 0; i < 3 && f[c] != 0.0; i++) {
                    g[i] += a[i] * y[c];
                    for (int j = 0; j < 3; j++)
                        V[3 * i + j] += a[i] * a[j];
                }
            }
        }
    }
}
