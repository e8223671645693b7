"""The way of a block to the ground."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

from orip.geometry.similarity import Similarity
from orip.prelim import to_ground
from orip.prelim.growing_block import GrowingBlock
from orip.prelim.measured_block import MeasuredBlock, measured_block
from orip.prelim.routes import Route, by_pairs
from orip.prelim.to_ground import Outcome, outcome_of
from orip.structs import replace


def test_control_of_all_photos_corrects_an_orientation_by_few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    made = synthetic_block("convergent", "to ground", noise_mm=0.005)
    measured = measured_block(made.block)
    absolute, found = to_ground._absolute, list[Outcome]()

    def first_by_three_points_elsewhere(measured: MeasuredBlock, route: Route, grown: GrowingBlock) -> Outcome:
        found.append(absolute(measured, route, grown))
        step = found[-1].absolute
        if len(found) > 1 or step is None:
            return found[-1]
        # as if the rays of these points had been those of photos in the wrong place
        few = replace(step, points=step.points[:3], weight_factor=step.weight_factor[:3])
        turned = Similarity(1.1, Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix(), np.array([0.2, 0.1, 0.0]))
        return replace(found[-1], grown=found[-1].grown.transformed(turned), absolute=few)

    monkeypatch.setattr(to_ground, "_absolute", first_by_three_points_elsewhere)
    outcome = outcome_of(measured, by_pairs(measured.grower(), 0))
    assert outcome is not None
    assert outcome.absolute is not None
    assert len(outcome.absolute.points) == len(measured.control.names)
    # control is good to 0.9 mm on an object of 1.2 m, 4.7 m away: some mm; the wrong similarity is off by decimetres
    assert np.allclose(outcome.grown.centres, made.orientations[:, :3], rtol=0.0, atol=0.03)


def test_a_single_photo_that_is_left_has_no_base_and_no_datum(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = measured_block(synthetic_block("convergent", "one left", control="none", datum="free").block)

    def in_no_system(measured: MeasuredBlock, route: Route, grown: GrowingBlock) -> Outcome:
        return Outcome(route, grown, False, None, "nothing is known")

    def with_one_photo(measured: MeasuredBlock, route: Route, grown: GrowingBlock) -> Outcome:
        centres = grown.centres.copy()
        centres[np.flatnonzero(grown.oriented)[1:]] = np.nan
        return in_no_system(measured, route, replace(grown, centres=centres))

    route = by_pairs(measured.grower(), 0)
    monkeypatch.setattr(to_ground, "_absolute", in_no_system)
    whole = outcome_of(measured, route)
    assert whole is not None
    assert whole.has_arbitrary_datum
    monkeypatch.setattr(to_ground, "_absolute", with_one_photo)
    left = outcome_of(measured, route)
    assert left is not None
    assert not left.on_ground
