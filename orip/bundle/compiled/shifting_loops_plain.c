/* The loops for every processor, with the velocities of photos. */

#define MOTION_UNKNOWNS 3
#define plain_loops shifting_plain_loops
#include "loops_plain.c"
