/* Relative orientation and resection for every processor. */

#include "../relative/given_scale.h"
#include "../resection/fitting_points.h"

const PairLoops plain_pairs = {relative_space, orient_relatively, orient_at_scale, adjust_at_scale};
const ResectionLoops plain_resections = {resection_space,     fitting_space, rank_triples,
                                           choose_orientations, resect_photo,  mark_fitting};
