/* Relative orientation for every processor. */

#include "../relative/given_scale.h"

const PairLoops plain_pairs = {relative_space, orient_relatively, orient_at_scale, adjust_at_scale};
