"""Absolute orientation: control in full and in part, blunders and too little of it."""

from __future__ import annotations

import numpy as np
import pytest
from partial_block_samples import SampleNames, ground_sample
from scipy.spatial.transform import Rotation

from orip.prelim.similarity.absolute_orientation import KnownPositions, absolute_orientation
from orip.prelim.similarity.joining import Joined
from orip.records.preliminary import NotOriented, PartialBlock
from orip.structs import replace


def oriented(sample, control=None, centres=None) -> Joined:
    found = absolute_orientation(sample.block, sample.names, control or sample.control, centres)
    assert isinstance(found, Joined), found
    return found


def refused(sample, control=None, centres=None) -> str:
    found = absolute_orientation(sample.block, sample.names, control or sample.control, centres)
    assert isinstance(found, NotOriented), found
    assert (found.name, found.other) == ("AB", "")
    return found.reason


def some(control: KnownPositions, rows) -> KnownPositions:
    names = tuple(np.array(control.names)[rows])
    return KnownPositions(names, control.coordinates[rows], control.errors[rows])


@pytest.mark.parametrize("count", [3, 4, 12])
def test_full_control(count):
    for seed in range(10):
        sample = ground_sample(seed, full=count)
        found = oriented(sample)
        assert sample.turned_by(found.similarity) < (0.05 if count > 3 else 0.5)
        assert found.similarity.scale == pytest.approx(sample.truth.scale, rel=1e-3)
        assert np.allclose(found.block.coordinates - sample.control.coordinates, found.step.residuals, atol=1e-6)
        assert (found.step.step, found.step.source, found.step.target) == ("absolute", "AB", "")
        assert found.step.remarks == ()


def test_exact_control_gives_exact_places():
    sample = ground_sample(1, full=4, noise=0.0)
    found = oriented(sample, replace(sample.control, errors=np.full((4, 3), 0.02)))
    # coordinates of millions are rounded to 1e-9
    assert np.allclose(found.block.coordinates, sample.control.coordinates, atol=1e-7)
    assert np.allclose(found.similarity.rotation, sample.truth.rotation, atol=1e-10)


@pytest.mark.parametrize(("full", "plan", "height"), [(0, 3, 4), (2, 2, 2), (1, 3, 3), (0, 6, 6), (2, 0, 3)])
def test_control_in_part(full, plan, height):
    for seed in range(8):
        sample = ground_sample(seed, full, plan, height)
        found = oriented(sample)
        assert sample.turned_by(found.similarity) < 1.0, seed
        assert np.array_equal(np.isnan(found.step.residuals), np.isnan(sample.control.coordinates))


def test_flat_ground_known_in_part():
    for seed in range(8):
        sample = ground_sample(seed, 0, 3, 3, relief=2.0)
        assert sample.turned_by(oriented(sample).similarity) < 1.0, seed


def test_seven_coordinates_may_fit_in_more_than_one_position():
    told = right = 0
    for seed in range(20):
        sample = ground_sample(seed, 2, 0, 1)
        found = oriented(sample)
        told += any("more than one position" in remark for remark in found.step.remarks)
        right += sample.turned_by(found.similarity) < 1.0
    # the third point may lie on either side of the line through the first two: the photos that look down decide
    assert told >= 18
    assert right >= 19


@pytest.mark.parametrize(
    ("kind", "wrong"), [((5, 0, 0), 1), ((12, 0, 0), 3), ((4, 0, 0), 1), ((0, 6, 6), 1), ((2, 6, 6), 2)]
)
def test_blunders_are_named(kind, wrong):
    for seed in range(5):
        sample = ground_sample(seed, *kind, wrong=wrong)
        found = oriented(sample)
        assert sample.turned_by(found.similarity) < 1.0, seed
        for row in sample.wrong:
            sentences = [text for text in found.step.remarks if f"control point {sample.names.points[row]} " in text]
            assert len(sentences) == 1
        assert len(found.step.remarks) == wrong


def test_one_wrong_coordinate_leaves_the_others_of_its_point():
    sample = ground_sample(3, full=8)
    coordinates = sample.control.coordinates.copy()
    coordinates[2, 2] += 50.0
    found = oriented(sample, replace(sample.control, coordinates=coordinates))
    assert np.array_equal(np.argwhere(found.step.weight_factor < 1.0), [[2, 2]])
    (remark,) = found.step.remarks
    assert remark.startswith("Z of control point C2 does not fit: the block is off by -50")


def test_a_wrong_one_of_three_full_points_shows_by_those_known_in_part():
    right = 0
    for seed in range(10):
        sample = ground_sample(seed, 3, 4, 4)
        coordinates = sample.control.coordinates.copy()
        coordinates[1] += [80.0, -60.0, 40.0]
        found = absolute_orientation(sample.block, sample.names, replace(sample.control, coordinates=coordinates))
        right += isinstance(found, Joined) and sample.turned_by(found.similarity) < 1.0
    assert right >= 9


def test_check_points_are_not_used():
    sample = ground_sample(4, full=6)
    errors, coordinates = sample.control.errors.copy(), sample.control.coordinates.copy()
    errors[5], coordinates[5] = -0.02, coordinates[5] + 100.0
    found = oriented(sample, replace(sample.control, coordinates=coordinates, errors=errors))
    assert "C5" not in found.step.points
    assert found.step.remarks == ()


def test_constant_control_weighs_more_and_all_constant_control_is_legal():
    sample = ground_sample(5, full=5)
    errors = sample.control.errors.copy()
    errors[0] = 0.0
    block = replace(sample.block, deviations=np.zeros_like(sample.block.deviations))
    constant = absolute_orientation(block, sample.names, replace(sample.control, errors=errors))
    plain = absolute_orientation(block, sample.names, sample.control)
    assert isinstance(constant, Joined)
    assert isinstance(plain, Joined)
    assert np.linalg.norm(constant.step.residuals[0]) < 0.3 * np.linalg.norm(plain.step.residuals[0])
    found = absolute_orientation(block, sample.names, replace(sample.control, errors=np.zeros((5, 3))))
    assert isinstance(found, Joined)
    assert sample.turned_by(found.similarity) < 0.05


def test_too_little_control_says_what_is_there():
    sample = ground_sample(6, full=4)
    assert refused(sample, some(sample.control, [0, 1])) == "2 control points in the block, 3 are needed"
    none = KnownPositions((), np.empty((0, 3)), np.empty((0, 3)))
    assert refused(sample, none) == "no control point is in the block, 3 are needed"
    part = some(sample.control, [0, 1, 2])
    part.coordinates[1:, 2] = np.nan
    part.coordinates[2, :2] = np.nan
    part.coordinates[2, 2] = 300.0
    reason = refused(sample, part)
    assert "3 control points in the block with 6 known coordinates (X of 2, Y of 2, Z of 2): 3 points known" in reason


def test_control_on_a_line():
    sample = ground_sample(7, full=5)
    steps = np.linspace(0.0, 1.0, 5)[:, None]
    line = sample.control.coordinates[:1] + steps * [[1200.0, 300.0, 20.0]]
    block = replace(sample.block, coordinates=sample.truth.inverse().apply(line))
    reason = refused(replace(sample, block=block), replace(sample.control, coordinates=line))
    assert "the control points lie on one line" in reason


def test_control_at_one_place_is_said_to_be_there():
    sample = ground_sample(7, full=5)
    here = np.repeat(sample.control.coordinates[:1], 5, axis=0)
    reason = refused(sample, replace(sample.control, coordinates=here))
    assert "all 5 control points are at one place (distance 0), so they fix neither scale nor rotation" in reason


@pytest.mark.parametrize("spread", [0.0, 0.01])
def test_exposure_stations_at_one_place_are_named(spread: float):
    sample = ground_sample(7, full=1)
    none = KnownPositions((), np.empty((0, 3)), np.empty((0, 3)))
    random = np.random.default_rng(3)
    here = sample.centres.coordinates[:1] + spread * random.normal(size=sample.centres.coordinates.shape)
    centres = replace(sample.centres, coordinates=here, errors=np.full(here.shape, 3.0))
    reason = refused(sample, none, centres)
    assert f"all {len(here)} exposure stations are at one place (distance " in reason
    assert "so they fix neither scale nor rotation" in reason
    assert reason.endswith("no control point is in the block, 3 are needed")


def test_exposure_stations_on_one_line_are_named():
    sample = ground_sample(7, full=1)
    none = KnownPositions((), np.empty((0, 3)), np.empty((0, 3)))
    count = len(sample.centres.names)
    first = sample.centres.coordinates[:1]
    line = first + np.linspace(0.0, 1.0, count)[:, None] * [[900.0, 200.0, 0.0]]
    reason = refused(sample, none, replace(sample.centres, coordinates=line, errors=np.full(line.shape, 0.05)))
    assert "the exposure stations lie on one line" in reason
    assert "they do not fix the rotation about it; give a control point off the line" in reason


def test_heights_alone_do_not_suffice():
    sample = ground_sample(8, height=9)
    reason = refused(sample)
    assert "X of 0, Y of 0, Z of 9 points" in reason


def test_projection_centres_help_where_control_does_not_suffice():
    sample = ground_sample(9, full=2)
    assert "2 control points in the block, 3 are needed" in refused(sample)
    found = oriented(sample, centres=sample.centres)
    assert sample.turned_by(found.similarity) < 1.0
    assert found.step.points == ("C0", "C1", "photo A", "photo B", "photo C", "photo D")
    assert found.step.remarks[0].startswith("projection centres are used as control")
    unknown = replace(sample.centres, errors=np.full((4, 3), np.nan))
    assert sample.turned_by(oriented(sample, centres=unknown).similarity) < 1.0


@pytest.mark.parametrize("known", [[0, 1, 2], [2]], ids=["two points", "two heights"])
@pytest.mark.parametrize("stations", [8, 12, 30])
def test_control_beside_one_strip_turns_a_bent_block_about_it(known, stations):
    """Stations that are nearly on a line would turn a bent block anywhere, at the cost of the points beside it."""
    right = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        length = 24.0 * (stations - 1)
        along = np.r_[random.uniform(0.0, length, 2), np.linspace(0.0, length, stations)]
        across = np.r_[random.uniform(20.0, 100.0, 2) * random.choice([-1, 1], 2), 0.1 * random.normal(size=stations)]
        height = np.r_[3.0 * random.normal(size=2), 80.0 + 0.1 * random.normal(size=stations)]
        ground = np.column_stack([along, across, height])
        bent = ground + (2.0 * along / length - 1.0)[:, None] ** 2 * random.normal(0.0, 0.1, 3)
        truth = replace(ground_sample(seed).truth, shift=np.zeros(3))
        source = truth.inverse().apply(bent + random.normal(0.0, 0.005, bent.shape))
        given = ground + random.normal(0.0, 0.01, ground.shape)
        control = np.full((2, 3), np.nan)
        control[:, known] = given[:2][:, known]
        photos = tuple(f"P{k}" for k in range(stations))
        block = PartialBlock(
            "AB", np.arange(stations), np.repeat(truth.rotation.T[None], stations, axis=0), source[2:], np.arange(2),
            source[:2], np.full((2, 3), 0.004 / truth.scale),
        )  # fmt: skip
        found = absolute_orientation(
            block,
            SampleNames(photos, ("K1", "K2")),
            KnownPositions(("K1", "K2"), control, np.full((2, 3), 0.01)),
            KnownPositions(photos, given[2:], np.full((stations, 3), 0.01)),
        )
        assert isinstance(found, Joined)
        right += Rotation.from_matrix(found.similarity.rotation @ truth.rotation.T).magnitude() < np.radians(3.0)
    assert right >= 19


def test_control_of_something_else_is_refused():
    sample = ground_sample(10, full=8)
    other = replace(sample.control, coordinates=np.roll(sample.control.coordinates, 3, axis=0))
    assert "the control does not fit the block" in refused(sample, other)


def test_control_twenty_times_worse_than_promised_is_not_called_wrong():
    down = 0
    for seed in range(20):
        sample = ground_sample(seed, full=10, noise=0.4)
        found = oriented(sample, replace(sample.control, errors=np.full((10, 3), 0.02)))
        down += int((found.step.weight_factor < 1.0).sum())
    assert down <= 6


@pytest.mark.long
@pytest.mark.parametrize(("full", "plan", "height"), [(0, 3, 4), (2, 2, 2), (0, 6, 6)])
def test_control_in_part_never_fails(full, plan, height):
    right = sum(
        sample.turned_by(oriented(sample).similarity) < 2.0
        for sample in (ground_sample(seed, full, plan, height) for seed in range(1000))
    )
    assert right >= 998
