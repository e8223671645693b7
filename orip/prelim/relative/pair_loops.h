/* What the relative orientation of two photos takes and gives, and its loops, compiled for each kind of processor: see
 * loops_plain.c, loops_avx2.c.
 */

#ifndef ORIP_PAIR_LOOPS_H
#define ORIP_PAIR_LOOPS_H

#include "../../lanes.h"
#include <stdint.h>

typedef struct {
    const double *left, *right, *error;
    int64_t count;
} Pairs;

/* SAMPLING in orip/prelim/relative/solution.py */
typedef struct {
    double at_once, missed, ordinary_scale, samples_of_large_scale, no_better, limit, alike, kept, starts;
} Sampling;

/* DANISH in orip/prelim/relative/solution.py */
typedef struct {
    double limit, floor, converged, longest, regular, held;
} RelativeDanish;

/* CHOICE in orip/prelim/relative/solution.py */
typedef struct {
    double to_compare, most, equally_good, same, sure, plain_base, rotation_steps;
} Choice;

typedef struct {
    Sampling sampling;
    RelativeDanish danish;
    Choice choice;
} RelativeRules;

/* Deviations are those of the a-priori errors, those of the base in units of its length. */
typedef struct {
    double base[3], rotation[9], angles[3], base_deviation[3], angle_deviation[3];
    double scale, by_chance, ambiguous, iterations, seuw, length, left_by_rotation;
} RelativeFound;

/* Of each point; coordinates and deviations in units of the base. */
typedef struct {
    double *parallax, *weights, *redundancy, *coordinates, *deviations;
    uint8_t *in_front, *usable;
} RelativePoints;

/* `space` returns how many numbers the others need room for. */
typedef struct {
    int64_t (*space)(const RelativeRules *rules, int64_t count);
    int (*orient)(const Pairs *p, const RelativeRules *rules, const int64_t *samples, int64_t number,
                  const double *log_of_sets, double *space, const RelativePoints *points, RelativeFound *found);
    int (*orient_at_scale)(const Pairs *p, const RelativeRules *rules, const int64_t *samples, int64_t number,
                           const double *log_of_sets, double scale, double *space, const RelativePoints *points,
                           RelativeFound *found);
    int (*adjust_at_scale)(const Pairs *p, const RelativeRules *rules, const double *log_of_sets, double scale,
                           double *space, const RelativePoints *points, RelativeFound *found);
} PairLoops;

extern const PairLoops plain_pairs;
#ifdef HAS_AVX2_LOOPS
extern const PairLoops avx2_pairs;
#endif

#endif
