/* What the refinement of a block takes and gives, and its loops, compiled for each kind of processor: see loops_plain.c,
 * loops_avx2.c.
 */

#ifndef ORIP_REFINEMENT_LOOPS_H
#define ORIP_REFINEMENT_LOOPS_H

#include "../../lanes.h"
#include <stdint.h>

enum { OF_CAMERA = 4 };

/* In place of a number of iterations: the user wants to end the program, or there is not enough memory. */
enum { REFINEMENT_INTERRUPTED = -1, REFINEMENT_WITHOUT_ROOM = -2 };

/* All rays of a block, in any order, and what is known of it. */
typedef struct {
    const int64_t *photo, *point, *camera_of_photo;
    const double *vectors, *error;
    const uint8_t *oriented, *held, *unknown;
    int64_t count, photos, points, cameras;
} BlockRays;

/* As `_rules` of refinement.py lists them. */
typedef struct {
    double median, limit, floor, largest_turn, uphill, uphill_steps, most_steps, first_damping, least_damping, gain,
        enough, expected[OF_CAMERA];
} RefinementRules;

/* Where the iterations stand: photos, points, corrections of the cameras, and what follows for the rays. */
typedef struct {
    double *rotations, *centres, *points, *corrections, *vectors, *squares, *lengths, *weights;
    double of_cameras, scale;
} BlockState;

/* What the program does for the loops; in some builds of SciPy the integers of LAPACK are long. */
typedef struct {
    void *dpbtrf;
    int has_long_integers;
    int (*is_interrupted)(void);
} RefinementSupport;

/* `refine` improves rotations, centres, points and corrections and returns the number of steps; `scale` is that of the
 * residuals, 0 without redundancy.
 */
typedef struct {
    int64_t (*refine)(const BlockRays *all, const RefinementRules *rules, const RefinementSupport *support, BlockState *to);
} RefinementLoops;

extern const RefinementLoops plain_refinement;
#ifdef HAS_AVX2_LOOPS
extern const RefinementLoops avx2_refinement;
#endif

#endif
