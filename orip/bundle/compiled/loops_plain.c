/* The loops for every processor. */

#include "loops.h"
#include "residuals.h"

const Loops plain_loops = {residual_loop, points_loop, normals_loop, precision_loop, forward_loop, backward_loop};
