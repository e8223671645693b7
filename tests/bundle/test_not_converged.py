"""What is said of iterations that did not converge: which photo they would have moved farthest."""

from __future__ import annotations

import numpy as np
from bundle.solving import noisy, redefined, solved, started_off
from support.synthetic_block import synthetic_block

from orip.adjustment.convergence import TerminationReason
from orip.bundle.diagnosis import diagnose

MADE = synthetic_block("convergent", "not converged", noise_mm=0.0)


def test_the_photo_that_is_farthest_from_its_end_is_named():
    block = started_off(MADE, noisy(MADE, 3), 3, 0.05)
    end = solved(redefined(block, max_iterations=30, start_down_weight=30))
    broken_off = solved(redefined(block, max_iterations=2, start_down_weight=2))
    assert broken_off.reason is TerminationReason.MAX_ITERATIONS
    (told,) = [diagnosis for diagnosis in diagnose(broken_off) if diagnosis.code == "not-converged"]
    columns = end.problem.unknowns.photos[:, :3]
    deviations = end.deviation_scale * np.sqrt(np.diag(end.cofactors.reduced)[columns])
    here, there = broken_off.state.centres, end.state.centres
    off = np.abs((here - there) / deviations).max(axis=1)
    assert off.max() > 0.1
    # corrections tell where the end is to first order; the axes of rotations are not compared
    named = [photo.name for photo in end.block.photos].index(told.where.removeprefix("photo "))
    assert off[named] > 0.5 * off.max()
    assert all(diagnosis.code != "not-converged" for diagnosis in diagnose(end))


def test_photos_that_no_longer_move_are_not_blamed():
    block = started_off(MADE, noisy(MADE, 3), 3, 0.05)
    # ENP grows by some digits an iteration here: after eight of them corrections are far below a tenth of a deviation
    ended = solved(redefined(block, max_iterations=8, start_down_weight=8, enp_stop=15.0))
    assert ended.reason is TerminationReason.MAX_ITERATIONS
    columns = ended.problem.unknowns.photos
    deviations = ended.deviation_scale * np.sqrt(np.diag(ended.cofactors.reduced)[columns])
    assert np.abs(ended.normals.correction[columns] / deviations).max() < 0.1
    (told,) = [diagnosis for diagnosis in diagnose(ended) if diagnosis.code == "not-converged"]
    assert told.where == f"bundle {block.definition.name}"
    assert told.text.startswith("max_iterations = 8 was reached before ENP was 15")
