/* What the resection of photos takes and gives, and its loops, compiled for each kind of processor: see loops_plain.c,
 * loops_avx2.c.
 */

#ifndef ORIP_RESECTION_LOOPS_H
#define ORIP_RESECTION_LOOPS_H

#include "../../lanes.h"
#include <stdint.h>

#define NUMBERS_OF_A_POINT (2 + 12 + 4)

#define MOST_ORIENTATIONS 16

/* Numbers that ranking orientations of triples needs room for, for each point. */
#define SPACE_TO_RANK (LANES + 1)

typedef struct {
    const double *vectors, *coordinates, *deviations;
    double error;
    int64_t count, least;
} Known;

typedef struct {
    double limit, floor, steady, same_scale, largest_turn;
    int64_t iterations;
} Danish;

typedef struct {
    double limit, excess, same, per_sum, largest_turn;
    int64_t steps;
    Danish danish;
} OrientationChoice;

/* _RULES in orip/prelim/resection/resection.py */
typedef struct {
    double one_line, fits, plane, limit, alike, same, improvements, floor, steady, same_scale, iterations, largest_turn,
        regular;
} ResectionRules;

/* Of the best orientation; deviations of its rotation about the ground axes, and of its centre. */
typedef struct {
    double s0, redundancy, misfit, radius, distance, deviation[6];
} ResectionFound;

/* Orientations that are kept of those of triples: CANDIDATES in orip/prelim/resection/start.py. */
#define MOST_CANDIDATES MOST_ORIENTATIONS

/* _JUDGEMENT in orip/prelim/resection/resection.py */
typedef struct {
    double misfit, angle, shift, sure;
} PhotoJudgement;

/* n points of one photo, and the triples that its orientation starts from. */
typedef struct {
    Known known;
    const double *points, *deviations;
    const int64_t *triples;
    int64_t number;
    double extent;
} PhotoToFit;

/* Spaces are numbers that the others need room for. */
typedef struct {
    int64_t (*space)(int64_t count, int64_t candidates);
    int64_t (*fitting_space)(int64_t count, int64_t candidates);
    void (*rank_triples)(const Known *k, const int64_t *triples, int64_t number, double fits, int64_t kept,
                         double *rotations, double *centres, double *quantiles, double *space);
    int64_t (*choose_orientations)(const Known *k, const OrientationChoice *s, int64_t number, double *rotations,
                                   double *centres, double *squares, double *factors, double *residual,
                                   double *normals, double *space);
    int64_t (*resect_photo)(const double *points, const double *deviations, Known k, const ResectionRules *rules,
                            const int64_t *triples, int64_t number, int64_t candidates, double *rotations,
                            double *centres, double *factors, double *residual, double *space, ResectionFound *f);
    int (*mark_fitting)(const PhotoToFit *photo, const ResectionRules *rules, const PhotoJudgement *judgement,
                        int64_t candidates, double *space, double *rotation, double *centre, uint8_t *fits);
} ResectionLoops;

extern const ResectionLoops plain_resections;
#ifdef HAS_AVX2_LOOPS
extern const ResectionLoops avx2_resections;
#endif

#endif
