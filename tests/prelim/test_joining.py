"""Joining models and strips: exact, noisy, with wrong points, with little in common."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from partial_block_samples import NOISE, SampleNames, pair, random_similarity
from scipy.stats import chi2
from support.prelim_references.similarity import student_limit

from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.geometry.similarity import Similarity
from orip.prelim.similarity.adjustment import CommonPoints, adjust_similarity, misfits, unbent
from orip.prelim.similarity.bridging import bridge, bridge_row, connect_strips
from orip.prelim.similarity.joining import Joined, join
from orip.prelim.similarity.partial_blocks import assembled, transformed
from orip.prelim.similarity.start import start_from_triples
from orip.records.preliminary import NotOriented, PartialBlock
from orip.structs import replace


def only(block: PartialBlock, rows) -> PartialBlock:
    return replace(
        block, points=block.points[rows], coordinates=block.coordinates[rows], deviations=block.deviations[rows]
    )


def joined(sample, step="bridge") -> Joined:
    found = join(sample.source, sample.target, sample.names, step)
    assert isinstance(found, Joined), found
    return found


@pytest.mark.parametrize("common_photo", [True, False])
@pytest.mark.parametrize("count", [3, 4, 20])
def test_exact_models_join_exactly(count, common_photo):
    sample = pair(1, count, noise=0.0, common_photo=common_photo)
    found = joined(sample)
    assert np.allclose(found.block.coordinates, sample.target.coordinates, atol=1e-10)
    assert found.similarity.scale == pytest.approx(sample.truth.scale, abs=1e-10)
    assert np.allclose(found.similarity.rotation, sample.truth.rotation, atol=1e-9)


def test_step_has_all_that_is_listed():
    sample = pair(2)
    found = joined(sample)
    step = found.step
    assert (step.step, step.source, step.target, step.common_photo) == ("bridge", "BC", "AB", "B")
    assert step.points == sample.names.points
    assert np.array_equal(step.coordinates, sample.target.coordinates)
    assert np.allclose(step.residuals, found.block.coordinates - sample.target.coordinates, atol=1e-15)
    assert np.allclose(step.angles, angles_from_rotation(found.similarity.rotation))
    assert step.scale == found.similarity.scale
    assert np.array_equal(step.shift, found.similarity.shift)
    assert step.max_residual == pytest.approx(np.abs(step.residuals[step.weight_factor == 1.0]).max())
    assert step.remarks == ()


def test_standard_deviations_are_those_of_many_repetitions():
    generator = np.random.default_rng(3)
    truth, exact = random_similarity(generator), generator.normal(0.0, 0.1, (12, 3))
    error = np.full((12, 3), NOISE)
    results, predicted, squares = [], [], 0.0
    for _ in range(400):
        noise = NOISE * generator.normal(size=(2, 12, 3))
        common = CommonPoints(exact + noise[0], truth.apply(exact) + noise[1], error, error, np.ones(12, dtype=bool))
        found = adjust_similarity(common, truth)
        similarity = found.similarity
        results.append([similarity.scale, *similarity.shift, *angles_from_rotation(similarity.rotation)])
        # what is predicted from the a-priori errors has no scatter
        deviations = np.array([found.scale_deviation, *found.shift_deviation, *found.angle_deviation])
        predicted.append(deviations / found.s0)
        squares += found.s0**2
    # 400 results give their standard deviation to 3.5 %, their mean square to 1.9 %; four times that is allowed
    assert np.allclose(np.std(np.array(results), axis=0), np.mean(predicted, axis=0), rtol=0.14)
    assert squares / 400 == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("seed", range(10))
def test_standard_deviations_with_equal_errors_are_exact(seed):
    # with equal errors on all axes the cofactors have a closed form: scale 1 / Σ|x|², and no correlation with rotation
    generator = np.random.default_rng(seed)
    truth, source = random_similarity(generator), generator.normal(size=(10, 3))
    target = truth.apply(source) + 1e-3 * generator.normal(size=(10, 3))
    common = CommonPoints(source, target, np.zeros((10, 3)), np.full((10, 3), 1e-3), np.ones(10, dtype=bool))
    found = adjust_similarity(common, start_from_triples(common))
    reduced = source - source.mean(axis=0)
    assert found.scale_deviation == pytest.approx(found.s0 * 1e-3 / np.sqrt((reduced**2).sum()), rel=1e-6)
    redundancy = 3 * 10 - 7
    assert found.s0 == pytest.approx(np.sqrt((found.residuals**2).sum() / 1e-6 / redundancy), rel=1e-9)
    assert chi2.ppf(1e-5, redundancy) < found.s0**2 * redundancy < chi2.ppf(1.0 - 1e-5, redundancy)


@pytest.mark.parametrize("common_photo", [True, False])
@pytest.mark.parametrize(("count", "wrong"), [(20, 6), (10, 3), (5, 1)])
def test_wrong_points_are_named_and_do_no_harm(count, wrong, common_photo):
    for seed in range(10):
        sample = pair(seed, count, wrong, common_photo=common_photo)
        found = joined(sample)
        # some five standard deviations of the least certain point
        assert sample.error(found.similarity) < (20.0 if count > 5 else 100.0)
        for row in sample.wrong:
            assert any(f"point {sample.names.points[row]} does not fit" in remark for remark in found.step.remarks)
        assert (found.step.weight_factor[sample.wrong] < 1.0).any(axis=1).all()


def test_points_twenty_times_worse_than_promised_are_not_called_wrong():
    down = 0
    for seed in range(20):
        sample = pair(seed, 20, 2, noise=20.0 * NOISE)
        found = joined(sample)
        assert 10.0 < found.step.s0 < 40.0
        assert sample.error(found.similarity) < 20.0 * 20.0
        down += int((found.step.weight_factor < 1.0).any(axis=1).sum())
    assert 40 <= down <= 44


def test_points_of_another_model_are_refused():
    sample = pair(4, 12, 12)
    found = join(sample.source, sample.target, sample.names, "bridge")
    assert isinstance(found, NotOriented)
    assert (found.name, found.other) == ("BC", "AB")
    assert "do not agree" in found.reason
    assert "12 points and photo B" in found.reason


def test_few_points_without_a_photo():
    sample = pair(5, 2, common_photo=False)
    found = join(sample.source, sample.target, sample.names, "connect")
    assert isinstance(found, NotOriented)
    assert "2 common points and no common photo, 3 points are needed" in found.reason


def joined_on_a_line(sample, line, step):
    source = replace(sample.source, coordinates=line)
    return join(source, replace(sample.target, coordinates=sample.truth.apply(line)), sample.names, step)


def test_points_on_a_line_without_a_photo():
    sample = pair(5, 6, common_photo=False)
    line = np.outer(np.linspace(0.0, 1.0, 6), [0.1, 0.05, 0.0])
    found = joined_on_a_line(sample, line, "connect")
    assert isinstance(found, NotOriented)
    assert "on one line" in found.reason


def test_points_on_a_line_do_with_the_projection_centre():
    sample = pair(6, 6, noise=0.0)
    line = np.column_stack([np.full(6, 0.01), np.linspace(-0.1, 0.1, 6), np.full(6, -0.15)])
    found = joined_on_a_line(sample, line, "bridge")
    assert isinstance(found, Joined)
    assert np.allclose(found.similarity.rotation, sample.truth.rotation, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2])
def test_with_fewer_than_three_points_the_photo_gives_the_rotation(count):
    sample = pair(7, count)
    found = joined(sample)
    rotation = sample.target.rotations[1] @ sample.source.rotations[0].T
    assert np.allclose(found.similarity.rotation, rotation, atol=1e-12)
    assert np.array_equal(found.step.angle_deviation, np.zeros(3))
    assert found.step.scale_deviation > 0.0
    assert any("the rotation is that of photo B" in remark for remark in found.step.remarks)
    # the rotation of the photo is off by some 5e-3, a third of it is in the scale at most
    assert found.similarity.scale == pytest.approx(sample.truth.scale, rel=5e-3)


def test_a_photo_without_a_point_gives_no_scale():
    sample = pair(8, 3)
    found = join(only(sample.source, [0]), only(sample.target, [1, 2]), sample.names, "bridge")
    assert isinstance(found, NotOriented)
    assert "photo B is common, but no point" in found.reason


def strip_of_models(seed: int, photos: int, noise: float = NOISE, y: float = 0.0, first_photo: int = 0, gap: int = -1):
    """Return models of a strip over one ground, each in its left photo's system, and the ground in the first's."""
    generator = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(-0.1, 0.1 * photos, 0.04), np.arange(-0.14, 0.15, 0.035)), axis=-1)
    ground = np.column_stack([grid.reshape(-1, 2), -0.15 + 0.01 * np.sin(40.0 * grid.reshape(-1, 2).sum(axis=1))])
    centres = np.column_stack([0.09 * np.arange(photos), np.full(photos, y), np.zeros(photos)])
    rotations = rotation_from_angles(0.03 * generator.normal(size=(photos, 3)))
    models = []
    for left in range(photos - 1):
        if left == gap:
            continue
        scale = 1.0 + 0.1 * left
        own = Similarity(scale, rotations[left].T, -scale * rotations[left].T @ centres[left])
        both = centres[left : left + 2]
        seen = np.flatnonzero((np.abs(ground[:, 0] - both[:, 0].mean()) < 0.07) & (np.abs(ground[:, 1] - y) < 0.1))
        sigma = np.broadcast_to(np.array([1.0, 1.0, 2.0]) * NOISE, (len(seen), 3))
        models.append(
            PartialBlock(
                f"{first_photo + left}/{first_photo + left + 1}", first_photo + np.array([left, left + 1]),
                own.rotation @ rotations[left : left + 2], own.apply(both), seen,
                own.apply(ground[seen]) + noise / NOISE * sigma * generator.normal(size=(len(seen), 3)), sigma,
            )
        )  # fmt: skip
    names = SampleNames(tuple(f"P{k}" for k in range(40)), tuple(str(k) for k in range(len(ground))))
    return models, names, ground, rotations[0], centres[0]


def test_models_of_a_row_become_a_strip_in_the_system_of_the_first():
    models, names, ground, rotation, centre = strip_of_models(1, 6, noise=0.0)
    found = bridge_row(models, names)
    assert len(found.systems) == 1
    assert found.failures == ()
    assert [(step.target, step.source, step.common_photo) for step in found.steps] == [
        ("0/1", "1/2", "P1"), ("1/2", "2/3", "P2"), ("2/3", "3/4", "P3"), ("3/4", "4/5", "P4"),
    ]  # fmt: skip
    strip = found.systems[0]
    assert strip.name == "0/1"
    assert np.array_equal(strip.photos, np.arange(6))
    # nothing but rounding, with the first model's system kept
    assert np.allclose(strip.coordinates, (ground[strip.points] - centre) @ rotation, atol=1e-10)


def test_precision_of_bridging_is_the_spread_of_several_determinations():
    models, names, *_ = strip_of_models(2, 4)
    strip = bridge_row(models, names).systems[0]
    often = np.isin(strip.points, np.intersect1d(models[0].points, models[1].points))
    # root mean square of many spreads of two is the noise of one, in X and Y some 1e-5, in Z twice that
    spread = np.sqrt((strip.deviations[often] ** 2).mean(axis=0))
    assert np.all((spread[:2] > 0.4 * NOISE) & (spread[:2] < 1.6 * NOISE))
    assert spread[2] > spread[:2].max()


def test_a_gap_begins_a_new_strip():
    models, names, *_ = strip_of_models(3, 8, gap=3)
    far = [model for model in models if model.photos[0] > 3]
    first = far[0]
    last_points = {
        "points": first.points[-3:],
        "coordinates": first.coordinates[-3:],
        "deviations": first.deviations[-3:],
    }
    moved = [replace(first, **last_points), *far[1:]]
    near = [model for model in models if model.photos[0] < 3]
    near[-1] = only(near[-1], slice(0, 3))
    found = bridge_row([*near, *moved], names)
    assert len(found.systems) == 2
    assert [(failure.name, failure.other) for failure in found.failures] == [("4/5", "2/3")]
    assert [system.name for system in found.systems] == ["0/1", "4/5"]


def test_strips_are_connected_in_the_system_of_the_first():
    first, names, ground, rotation, centre = strip_of_models(4, 5, noise=0.0)
    second, *_ = strip_of_models(5, 5, noise=0.0, y=0.09, first_photo=10)
    third, *_ = strip_of_models(6, 5, noise=0.0, y=-0.09, first_photo=20)
    strips = [bridge_row(row, names).systems[0] for row in (first, second, third)]
    found = connect_strips(strips, names)
    assert found.failures == ()
    (block,) = found.systems
    assert [(step.step, step.source, step.target) for step in found.steps] == [
        ("connect", "10/11", "0/1"), ("connect", "20/21", "0/1"),
    ]  # fmt: skip
    assert np.allclose(block.coordinates, (ground[block.points] - centre) @ rotation, atol=1e-9)
    assert len(block.photos) == 15


def test_a_strip_that_connects_only_by_another_one_is_tried_again():
    first, names, *_ = strip_of_models(4, 5, y=-0.09)
    third, *_ = strip_of_models(6, 5, y=0.12, first_photo=20)
    second, *_ = strip_of_models(5, 5, y=0.0, first_photo=10)
    strips = [bridge_row(row, names).systems[0] for row in (first, third, second)]
    found = connect_strips(strips, names)
    assert [step.source for step in found.steps] == ["10/11", "20/21"]
    assert len(found.systems) == 1
    alone = connect_strips(strips[:2], names)
    assert len(alone.systems) == 2
    assert "3 points are needed" in alone.failures[0].reason


def test_a_wrong_point_keeps_the_coordinates_of_the_first_and_shows_its_spread():
    sample = pair(9, 20, 2)
    found = joined(sample)
    block = assembled([sample.target, found.block])
    for row in sample.wrong:
        length = np.linalg.norm(found.step.residuals[row])
        assert np.linalg.norm(block.coordinates[row] - sample.target.coordinates[row]) < 0.01 * length
        assert np.linalg.norm(block.deviations[row]) > 0.5 * length


def test_assembling_takes_weighted_means():
    one = PartialBlock("A", np.array([0]), np.eye(3)[None], np.zeros((1, 3)), np.array([4, 2]),
                   np.array([[1.0, 1.0, 1.0], [5.0, 5.0, 5.0]]), np.full((2, 3), 0.1))  # fmt: skip
    two = replace(one, photos=np.array([1]), points=np.array([4]), coordinates=np.array([[2.0, 2.0, 2.0]]),
                  deviations=np.full((1, 3), 0.2))  # fmt: skip
    both = assembled([one, two])
    assert np.array_equal(both.points, [2, 4])
    # weights 100 and 25: (100 · 1 + 25 · 2) / 125; spread of 1 and 2 about it
    assert np.allclose(both.coordinates, [[5.0] * 3, [1.2] * 3])
    assert np.allclose(both.deviations, [[0.1] * 3, [np.sqrt(0.2**2 + 0.8**2)] * 3])


def test_transformed_deviations_turn_with_the_axes():
    block = replace(pair(1, 1).source, deviations=np.array([[1.0, 2.0, 3.0]]))
    quarter = Similarity(2.0, rotation_from_angles(np.array([np.pi / 2.0, 0.0, 0.0])), np.zeros(3))
    assert np.allclose(transformed(block, quarter).deviations, [[2.0, 6.0, 4.0]])


def test_several_common_photos():
    models, names, *_ = strip_of_models(7, 4)
    left = bridge_row(models[:2], names).systems[0]
    right = bridge_row(models[1:], names).systems[0]
    found = bridge(right, left, names)
    assert isinstance(found, Joined)
    assert found.step.common_photo == "P1"
    # nothing is moved by more than some standard deviations of a point
    whole = bridge_row(models, names).systems[0]
    last = found.block.coordinates[-1] - whole.coordinates[np.flatnonzero(whole.points == found.block.points[-1])[0]]
    assert np.abs(last).max() < 20.0 * NOISE


def test_limit_grows_when_there_is_little_redundancy():
    # quantiles of Student's distribution at 0.99865: 3.96 for 10, 3.42 for 20 redundancies
    assert student_limit(10) == pytest.approx(3.96, abs=0.05)
    assert student_limit(20) == pytest.approx(3.42, abs=0.01)
    assert student_limit(1e9) == pytest.approx(3.0)


@pytest.mark.long
@pytest.mark.parametrize("common_photo", [True, False])
def test_a_fifth_of_wrong_points_never_spoils_a_joint(common_photo):
    for seed in range(1000):
        sample = pair(seed, 20, 4, common_photo=common_photo)
        found = joined(sample)
        assert sample.error(found.similarity) < 25.0
        assert (found.step.weight_factor[sample.wrong] < 1.0).any(axis=1).all()


def bent_strip(wrong: float) -> tuple[list[str], np.ndarray, SimpleNamespace]:
    """Return names and coordinates of points, and the residuals of bent strips (m), the last one off by `wrong` too."""
    generator = np.random.default_rng(11)
    x, y = generator.uniform(-0.04, 0.04, 30), generator.uniform(-0.005, 0.005, 30)
    coordinates = np.column_stack([x, y, 0.001 * generator.normal(size=30)])
    bend = np.column_stack([0.1 * x * y, 0.25 * x**2 - 1e-4, 0.05 * x**2])
    residuals = bend + 1e-5 * generator.normal(size=(30, 3))
    residuals[-1, 1] += wrong
    factor = np.where(np.abs(residuals) > 1e-4, 0.1, 1.0)
    lengths_of = SimpleNamespace(
        residuals=residuals, fits=(factor >= 1.0).all(axis=1), lengths=np.linalg.norm(residuals, axis=1)
    )
    return [str(101 + row) for row in range(30)], coordinates, lengths_of


@pytest.mark.parametrize(("wrong", "named"), [(0.0, []), (3e-4, ["130"]), (-3e-3, ["130"])])
def test_of_bent_strips_only_what_differs_from_its_neighbours_is_called_wrong(wrong: float, named: list[str]) -> None:
    points, coordinates, found = bent_strip(wrong)
    # of a calibrated camera all of them are wrong
    calibrated = misfits(points, coordinates, found, room=0.0)
    assert len([one for one in calibrated if "does not fit" in one]) > 3
    said = misfits(points, coordinates, found, room=2e-5)
    assert [one.split()[1] for one in said if "does not fit" in one] == named
    assert any("the camera is not calibrated" in one for one in said)


def test_bending_is_taken_away_to_the_noise() -> None:
    _, coordinates, found = bent_strip(0.0)
    left = unbent(coordinates, found.residuals)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(1e-5, rel=0.25)
