/* The loops for processors with AVX2 and FMA, with the motions of photos. */

#define HAS_MOTIONS
#define avx2_loops moving_avx2_loops
#include "loops_avx2.c"
