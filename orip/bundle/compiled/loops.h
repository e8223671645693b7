/* The loops over all photo points of a block, compiled for each kind of processor, without motions of photos as
 * unknowns, with velocities, and with angular rates too: see loops_plain.c and loops_avx2.c, and what includes them. */

#ifndef ORIP_LOOPS_H
#define ORIP_LOOPS_H

#include "points.h"
#include "substitution.h"

/* Each works on a share. What is added to sums of all is formed first, and added by a function of its own. */
typedef struct {
    void (*residuals)(const Block *b, Share share, double *residual, uint8_t *in_front);
    void (*points)(const Block *b, const Pattern *p, Share share, const PointNormals *n);
    void (*normals)(const Block *b, const Pattern *p, Share share, const Normals *n, int32_t *numbers, double *room,
                    double *of_panel);
    void (*add_normals)(const Block *b, const Pattern *p, Share share, const Normals *n, int32_t *numbers, double *room);
    void (*precision)(const Block *b, const Pattern *p, Share share, const Precision *c, int32_t *numbers, double *room);
    void (*movements)(const Block *b, const Pattern *p, Share share, const MovementSums *c, int32_t *numbers, double *room);
    void (*add_movements)(const Block *b, const Pattern *p, Share share, const MovementSums *c, int32_t *numbers,
                          const double *room);
    void (*forward)(const Block *b, const Pattern *p, Share share, const Coupling *c, int32_t *numbers, double *room);
    void (*add_forward)(const Block *b, const Pattern *p, Share share, const Coupling *c, int32_t *numbers, double *room);
    void (*backward)(const Block *b, const Pattern *p, Share share, const Coupling *c, int32_t *numbers, double *room);
    void (*right)(const Block *b, const Pattern *p, Share share, const RightSide *r, int32_t *numbers, double *room);
} Loops;

extern const Loops plain_loops, shifting_plain_loops, moving_plain_loops;
#ifdef HAS_AVX2_LOOPS
extern const Loops avx2_loops, shifting_avx2_loops, moving_avx2_loops;
#endif

#endif
