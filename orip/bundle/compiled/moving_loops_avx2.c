/* The loops for processors with AVX2, with the motions of photos. */

#define MOTION_UNKNOWNS 6
#define avx2_loops moving_avx2_loops
#include "loops_avx2.c"
