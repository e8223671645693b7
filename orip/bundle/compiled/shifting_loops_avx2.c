/* The loops for processors with AVX2, with the velocities of photos. */

#define MOTION_UNKNOWNS 3
#define avx2_loops shifting_avx2_loops
#include "loops_avx2.c"
