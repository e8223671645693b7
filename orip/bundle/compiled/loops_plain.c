/* The loops for every processor. */

#include "loops.h"
#include "residuals.h"

const Loops plain_loops = {residual_loop, points_loop, normals_loop, add_normals, precision_loop, movements_loop,
                           add_movements, forward_loop, add_forward, backward_loop, right_loop};
