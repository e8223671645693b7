/* The loops for every processor, with the motions of photos. */

#define MOTION_UNKNOWNS 6
#define plain_loops moving_plain_loops
#include "loops_plain.c"
