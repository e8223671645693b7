/* Relative orientation for processors with AVX2; module.c tests for it. */

#include "../../lanes.h"

#ifdef HAS_AVX2_LOOPS
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif

#include "../relative/given_scale.h"

const PairLoops avx2_pairs = {relative_space, orient_relatively, orient_at_scale, adjust_at_scale};

#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
