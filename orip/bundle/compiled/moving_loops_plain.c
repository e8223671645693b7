/* The loops for every processor, with the motions of photos. */

#define HAS_MOTIONS
#define plain_loops moving_plain_loops
#include "loops_plain.c"
