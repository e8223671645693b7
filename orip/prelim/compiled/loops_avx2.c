/* Relative orientation and resection for processors with AVX2; module.c tests for it. */

#include "../../lanes.h"

#ifdef HAS_AVX2_LOOPS
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif

#include "../relative/given_scale.h"
#include "../resection/fitting_points.h"

const PairLoops avx2_pairs = {relative_space, orient_relatively, orient_at_scale, adjust_at_scale};
const ResectionLoops avx2_resections = {resection_space,     fitting_space, rank_triples,
                                           choose_orientations, resect_photo,  mark_fitting};

#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
