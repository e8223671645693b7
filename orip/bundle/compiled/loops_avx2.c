/* The loops for processors with AVX2 and FMA; orip/bundle/compiled/module.c tests for it. */

#include "../../lanes.h"

#ifdef HAS_AVX2_LOOPS
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#else
#pragma GCC target("avx2,fma")
#endif

#include "loops.h"
#include "residuals.h"

const Loops avx2_loops = {residual_loop, points_loop, normals_loop, add_normals, precision_loop, movements_loop,
                          add_movements, forward_loop, add_forward, backward_loop, right_loop};

#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
