"""The chain on blocks whose truth is known: scenes of all kinds, a block in a crs, blocks that lack something."""

from __future__ import annotations

import numpy as np
import pytest
from monte_carlo.preliminary_records import gathered
from monte_carlo.weakly_joined_blocks import weakly_joined_records
from scipy.spatial.transform import Rotation
from support.aerial_block_in_crs import AerialBlock, aerial_block
from support.synthetic_block import Scene, SyntheticBlock, synthetic_block

from orip.bundle.antennas import without_photos
from orip.bundle.solve import SolvedBlock, solve_block
from orip.prelim import chain
from orip.prelim.block_grower import BlockGrower
from orip.prelim.chain import preliminary_values
from orip.prelim.ground import orientations_in_project, points_in_project
from orip.prelim.routes import Route
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.control import Control
from orip.records.definition import StereoModel
from orip.records.preliminary import PreliminaryValues
from orip.solving.starting_values import started_block
from orip.structs import replace

SCENES: tuple[Scene, ...] = ("strip", "convergent", "terrestrial")


def from_nothing(block: Block) -> Block:
    """Return a block as gathered: nothing starts anywhere."""
    return replace(
        block,
        photo_orientation=np.full_like(block.photo_orientation, np.nan),
        point_start=np.full_like(block.point_start, np.nan),
    )


def solved(block: Block) -> SolvedBlock:
    return solve_block(block, lambda _: None, lambda: False)


def seen_twice(block: Block) -> np.ndarray:
    """Return which points are determined by their rays."""
    return np.asarray(np.bincount(block.photo_points.point, minlength=len(block.point_names)) > 1)


def oriented(values: PreliminaryValues) -> list[str]:
    return [photo.name for photo in values.photos if photo.rotation is not None]


def worst(values: PreliminaryValues, made: SyntheticBlock) -> tuple[float, float]:
    """Return the largest error of a centre, as part of the distance to the points, and of a rotation, radians."""
    distance = np.median(np.linalg.norm(made.points.mean(axis=0) - made.orientations[:, :3], axis=1))
    centres = np.array([photo.centre for photo in values.photos])
    turned = Rotation.from_matrix(np.array([photo.rotation for photo in values.photos]))
    true = Rotation.from_euler("XYZ", made.orientations[:, 3:])
    return (
        float(np.linalg.norm(centres - made.orientations[:, :3], axis=1).max() / distance),
        float((turned * true.inv()).magnitude().max()),
    )


@pytest.mark.parametrize("scene", SCENES)
def test_without_noise_the_truth_is_found(scene: Scene) -> None:
    made = synthetic_block(scene, "chain without noise", control="constant")
    values = preliminary_values(from_nothing(made.block))
    assert len(oriented(values)) == len(made.block.photos)
    assert values.findings == ()
    centre, turn = worst(values, made)
    # adjusted until corrections are a millionth
    assert centre < 1e-6
    assert turn < 1e-6
    found = dict(zip(values.points.names, values.points.coordinates, strict=True))
    distance = np.linalg.norm(np.ptp(made.points, axis=0))
    determined = seen_twice(made.block) | made.block.constant_points.all(axis=1)
    for name, true, known in zip(made.block.point_names, made.points, determined, strict=True):
        assert (name in found) == known
        assert not known or found[name] == pytest.approx(true, abs=1e-6 * distance)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("distortion", [False, True])
def test_with_noise_the_adjustment_ends_where_it_ends_from_the_truth(scene: Scene, distortion: bool) -> None:
    settings = {"distortion": (2e-4, -3e-3, 2e-3, -1e-3, 0.0, 2e-4, -3e-4, 1e-4, -2e-4)} if distortion else {}
    made = synthetic_block(scene, "chain with noise", noise_mm=0.005, enp_stop=6.0, **settings)
    found = from_values(from_nothing(made.block))
    true = solved(made.block)
    # sums of squares from two iterations to 1e-6 standard deviations
    assert sigma0(found) == pytest.approx(sigma0(true), rel=1e-9)


def from_values(block: Block) -> SolvedBlock:
    """Return the adjustment from what the chain finds."""
    return solved(started_block(block, preliminary_values).block)


@pytest.mark.parametrize("off", [0.97, 1.05])
def test_an_unknown_camera_begins_where_the_block_has_it(off: float) -> None:
    settings = {"unknown": ("C", "DX", "DY", "A3"), "noise_mm": 0.005, "enp_stop": 6.0}
    made = synthetic_block("convergent", "unknown camera", **settings)
    camera = made.block.cameras[0]
    given = replace(camera, parameters=(off * camera.parameters[0], *camera.parameters[1:]))
    block = replace(made.block, cameras=(given, *made.block.cameras[1:]))
    started = started_block(from_nothing(block), preliminary_values).block
    assert started.cameras[0].parameters[0] == pytest.approx(camera.parameters[0], rel=5e-3)
    assert sigma0(solved(started)) == pytest.approx(sigma0(solved(made.block)), rel=1e-9)


def sigma0(found: SolvedBlock) -> float:
    return found.variance.sigma0


def test_three_control_points_are_enough() -> None:
    made = synthetic_block("convergent", "three control points", noise_mm=0.005, enp_stop=6.0)
    place, twice = made.block.point_index(), seen_twice(made.block)
    control = [point for point in made.block.control_points if twice[place[point.name]]]
    block = replace(made.block, control_points=(control[0], control[1], control[-1]))
    assert sigma0(from_values(from_nothing(block))) == pytest.approx(sigma0(solved(block)), rel=1e-9)


def test_a_control_point_whose_two_rays_miss_each_other_serves_where_none_is_to_spare() -> None:
    made = synthetic_block("convergent", "three control points", noise_mm=0.005, enp_stop=6.0)
    place, twice, points = made.block.point_index(), seen_twice(made.block), made.block.photo_points
    control = [point for point in made.block.control_points if twice[place[point.name]]]
    last = np.flatnonzero(points.point == place[control[-1].name])
    kept = np.setdiff1d(np.arange(len(points.point)), last[2:])
    xy = points.xy.copy()
    # across and along, so that it cannot be taken for a change of depth alone
    xy[last[0]] += 0.06
    few = IndexedPhotoPoints(points.photo[kept], points.point[kept], xy[kept], points.error[kept], points.used[kept])
    block = replace(made.block, photo_points=few, control_points=(control[0], control[1], control[-1]))
    values = preliminary_values(from_nothing(block))
    assert len(oriented(values)) == len(block.photos)
    centre, _ = worst(values, made)
    # 12 times the noise at one of three points: some ten times what the others leave
    assert centre < 0.03


def test_with_models_each_step_is_told() -> None:
    models = tuple(StereoModel(f"M{k}", f"P{k}", f"P{k + 1}", 1, k) for k in range(1, 6))
    made = synthetic_block("strip", "models", noise_mm=0.005, models=models)
    values = preliminary_values(from_nothing(made.block))
    assert [model.model for model in values.relative] == [model.name for model in models]
    # neighbouring models of this thin strip have a few points in common, or none but the photo
    bridged = {bridge.source for bridge in values.bridges}
    assert bridged == {"M2", "M3", "M5"}
    assert {(failure.name, failure.other) for failure in values.failures} == {("M4", "M3"), ("M4", "M1")}
    for failure in values.failures:
        assert (
            failure.reason == "photo P4 is common, but no point is: the scale is not determined; measure common points"
        )
    for bridge in values.bridges:
        if len(bridge.points) < 3:
            assert any("the rotation is that of photo" in remark for remark in bridge.remarks)
    assert values.absolute is not None
    told = {photo.name: photo.how for photo in values.photos}
    assert told["P1"].startswith("relative orientation in model M1 from ")
    assert ", bridged to model M1 by " in told["P3"]
    # all the same every photo is oriented: by control, or by another way around
    assert len(oriented(values)) == 6
    assert worst(values, made)[0] < 0.01


def test_what_is_missing_is_said_for_each_photo() -> None:
    made = synthetic_block("strip", "a lonely photo", control="constant")
    points = made.block.photo_points
    shared = set(points.point[points.photo == 4]) & set(points.point[points.photo == 5])
    kept = sorted(shared - set(np.flatnonzero(made.block.constant_points.all(axis=1))))[:2]
    rows = (points.photo != 5) | np.isin(points.point, kept)
    fewer = replace(
        points,
        photo=points.photo[rows], point=points.point[rows], xy=points.xy[rows], error=points.error[rows],
        used=points.used[rows],
    )  # fmt: skip
    values = preliminary_values(replace(from_nothing(made.block), photo_points=fewer))
    assert oriented(values) == ["P1", "P2", "P3", "P4", "P5"]
    assert (
        "photo P6 shares 2 points with its neighbours, 5 are needed; of its points 0 are known, 3 are needed"
        in values.photos[5].how
    )


def test_without_any_control_nothing_is_on_the_ground() -> None:
    made = synthetic_block("convergent", "no control", control="none")
    values = preliminary_values(from_nothing(made.block))
    assert oriented(values) == []
    assert not len(values.points)
    for photo in values.photos:
        assert photo.how.endswith("no control point is in the block, 3 are needed")


def test_photos_that_share_nothing_at_all() -> None:
    made = synthetic_block("convergent", "nothing shared", control="none")
    points = made.block.photo_points
    alone = replace(points, point=np.arange(len(points.point)))
    names = tuple(str(number) for number in range(len(points.point)))
    block = replace(
        from_nothing(made.block), photo_points=alone, point_names=names,
        point_start=np.full((len(names), 3), np.nan), constant_points=np.zeros((len(names), 3), dtype=bool),
    )  # fmt: skip
    values = preliminary_values(block)
    assert oriented(values) == []
    assert values.photos[0].how == "photo P1 shares 0 points with its neighbours, 5 are needed"


# a crs


@pytest.fixture(scope="module")
def in_crs() -> AerialBlock:
    return aerial_block()


def weighted_control(made: AerialBlock) -> Control:
    points = made.control(dict.fromkeys([*made.corners, made.middle, *made.middles_of_the_sides], (0.02, 0.02, 0.02)))
    return Control(points=tuple(points))


@pytest.mark.slow
def test_in_a_crs_the_adjustment_is_the_same_as_from_given_values(in_crs: AerialBlock) -> None:
    block = in_crs.assembled(weighted_control(in_crs), shift=10.0)
    found = from_values(from_nothing(block))
    given = solved(block)
    # free of noise, both end at residuals of nothing: a photo coordinate within 1e-6 of its a-priori error
    assert sigma0(found) < 1e-6
    assert sigma0(given) < 1e-6
    mine, theirs = found.state, given.state
    assert np.abs(mine.centres - theirs.centres).max() < 1e-4
    assert np.abs(mine.points - theirs.points).max() < 1e-4


@pytest.mark.slow
def test_in_a_crs_preliminary_values_are_those_of_the_project(in_crs: AerialBlock) -> None:
    block = from_nothing(in_crs.assembled(weighted_control(in_crs)))
    values = preliminary_values(block)
    orientations = orientations_in_project(values.photos, block.ground)
    # centimetres at a scale of 1 : 18 000, where a micrometre is 18 mm
    assert np.abs(orientations[:, :3] - in_crs.orientations[:, :3]).max() < 0.01
    assert np.abs(orientations[:, 3:] - in_crs.orientations[:, 3:]).max() < 1e-4
    places = {point.name: point.coordinates for point in points_in_project(values.points, block.ground)}
    for name, true in zip(in_crs.point_names, in_crs.points, strict=True):
        assert places[name] == pytest.approx(true, abs=0.01)


@pytest.mark.parametrize("off", [3.0, 8.0])
def test_a_single_photo_of_an_unknown_camera_is_oriented_by_control_in_space(off: float) -> None:
    made = synthetic_block("convergent", "single photo", unknown=("C", "DX", "DY"), noise_mm=0.005, control="constant")
    camera, points = made.block.cameras[0], made.block.photo_points
    given = replace(camera, parameters=(off * camera.parameters[0], *camera.parameters[1:]))
    block = without_photos(from_nothing(made.block), np.arange(len(made.block.photos)) > 0)
    values = preliminary_values(replace(block, cameras=(given,)))
    assert oriented(values) == ["P1"]
    assert len(points.photo) > len(block.photo_points.photo)
    # the adjustment expects corrections of a few per cent and pulls C by ten; without the transformation it is 135, 381
    assert values.cameras[0].parameters[0] == pytest.approx(camera.parameters[0], rel=0.15)


def test_nothing_grows_in_a_weakly_joined_block_whose_photos_look_down(monkeypatch: pytest.MonkeyPatch) -> None:
    block = gathered(weakly_joined_records(1, "small overlaps"))
    monkeypatch.setattr(BlockGrower, "grow", lambda *_: pytest.fail("grew"))
    values = preliminary_values(block)
    assert {photo.how for photo in values.photos} == {"placed on the ground together with all 6 photos of the block"}


def test_parts_of_a_block_that_falls_apart_are_placed_before_other_pairs_are_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # pairs of photos join three of the six, and two others; that the photos look down is not known
    block = gathered(weakly_joined_records(1, "small overlaps"))
    monkeypatch.setattr(chain, "by_level_photos", lambda *_: Route(()))
    choices: list[int] = []
    by_pairs = chain.by_pairs
    monkeypatch.setattr(chain, "by_pairs", lambda grower, choice: choices.append(choice) or by_pairs(grower, choice))
    values = preliminary_values(block)
    assert set(choices) == {0}
    assert {photo.how for photo in values.photos} == {"placed on the ground together with all 3 parts of the block"}
