"""The compiled loops of preliminary values against numpy: two ways to the same figures.

Both add the same terms in another order. Where iterations end early they end alike only to what the last one changes,
which the tolerances allow for.
"""

from __future__ import annotations

import numpy as np
import pytest
from compiled_cases import BLUNDERS, common_pairs, common_points, scene, synthetic_rays

from orip.geometry.similarity import Similarity
from orip.prelim import compiled
from orip.prelim.rays import ImageRays, intersect
from orip.prelim.relative.orientation import orient_pair
from orip.prelim.relative.solution import Pairs, PairSolution, solve
from orip.prelim.resection.resection import Resected, resect
from orip.prelim.similarity.adjustment import ALL_UNKNOWNS, NO_ROTATION, CommonPoints, adjust_similarity
from orip.prelim.similarity.start import start_from_triples
from orip.records.preliminary import RelativeOrientation

pytestmark = pytest.mark.skipif(not compiled.is_compiled(), reason="the extension was not built: no compiler here")


def test_intersection(without_loops) -> None:
    rays, rotations, centres, _ = scene()
    oriented = np.ones(len(centres), dtype=bool)
    mine, theirs = without_loops(lambda: intersect(rotations, centres, oriented, rays))
    assert np.abs(mine.coordinates - theirs.coordinates).max() < 1e-9 * np.abs(theirs.coordinates).max()
    assert mine.deviations == pytest.approx(theirs.deviations, rel=1e-9)
    assert mine.weight_factors == pytest.approx(theirs.weight_factors, abs=1e-9)
    assert np.count_nonzero(theirs.weight_factors < 0.5) >= BLUNDERS // 2
    assert mine.angles == pytest.approx(theirs.angles, abs=1e-12)
    # no better than the weight factors that it is made with
    assert mine.s0 == pytest.approx(theirs.s0, rel=1e-9)


@pytest.mark.parametrize("count", [3, 4, 6, 40])
def test_resection(without_loops, count: int) -> None:
    rays, _, _, points = scene()
    rows = np.flatnonzero(rays.photo == 1)[:count]
    vectors, known = rays.vectors[rows], points[rays.point[rows]]
    mine, theirs = without_loops(lambda: resect(vectors, known, np.full(len(rows), 1e-4), error_mm=0.005))
    assert isinstance(mine, Resected)
    assert isinstance(theirs, Resected)
    # both end where a correction is below 1e-6, and its square is left
    assert np.abs(mine.rotation - theirs.rotation).max() < 1e-9
    assert mine.centre == pytest.approx(theirs.centre, rel=1e-8)
    assert mine.weight_factor == pytest.approx(theirs.weight_factor, abs=1e-6)
    assert mine.redundancy == theirs.redundancy
    assert len(mine.alternatives.centres) == len(theirs.alternatives.centres)


def same_solution(mine: PairSolution, theirs: PairSolution) -> None:
    """Assert that two solutions agree within what ends their iterations: corrections of 1e-9 deviations."""
    assert mine.photos.base == pytest.approx(theirs.photos.base, abs=1e-9)
    assert mine.photos.rotation == pytest.approx(theirs.photos.rotation, abs=1e-9)
    assert mine.angles == pytest.approx(theirs.angles, abs=1e-9)
    assert mine.weight_factor == pytest.approx(theirs.weight_factor, abs=1e-6)
    assert mine.parallax == pytest.approx(theirs.parallax, abs=1e-8)
    assert (mine.ambiguous, mine.by_chance) == (theirs.ambiguous, theirs.by_chance)
    assert mine.scale == pytest.approx(theirs.scale, rel=1e-6)
    assert mine.seuw == pytest.approx(theirs.seuw, rel=1e-6, abs=1e-6)
    # the least sum of distances is not iterated to its end
    assert mine.left_by_rotation == pytest.approx(theirs.left_by_rotation, rel=1e-8)
    assert np.array_equal(mine.in_front, theirs.in_front)
    assert np.array_equal(mine.usable, theirs.usable)
    assert mine.length == pytest.approx(theirs.length, rel=1e-6)
    assert mine.base_deviation == pytest.approx(theirs.base_deviation, rel=1e-6, abs=1e-12)
    assert mine.angle_deviation == pytest.approx(theirs.angle_deviation, rel=1e-6)
    assert mine.redundancy_number == pytest.approx(theirs.redundancy_number, rel=1e-5, abs=1e-9)
    assert mine.coordinates == pytest.approx(theirs.coordinates, rel=1e-6, abs=1e-9)
    assert mine.deviations == pytest.approx(theirs.deviations, rel=1e-6, nan_ok=True)


@pytest.mark.parametrize("sample", range(40))
def test_five_points(without_loops, sample: int) -> None:
    """Of all solutions with the points in front that with the smallest rotation is taken: none may be missing."""
    rays, *_ = scene()
    pairs = common_pairs(rays, 1 + sample % 3)
    chosen = np.random.default_rng(sample).choice(len(pairs.error), 5, replace=False)
    mine, theirs = without_loops(lambda: solve(Pairs(*(pair[chosen] for pair in pairs))))
    assert mine is not None
    assert theirs is not None
    assert mine.photos.base == pytest.approx(theirs.photos.base, abs=1e-7)
    assert mine.photos.rotation == pytest.approx(theirs.photos.rotation, abs=1e-7)
    assert mine.ambiguous == theirs.ambiguous


@pytest.mark.parametrize("wrong", [0, 8])
@pytest.mark.parametrize("scale", [1.0, 30.0])
@pytest.mark.parametrize("right", [1, 2, 3])
def test_solution(without_loops, right: int, scale: float, wrong: int) -> None:
    """With large residuals and blunders there are several lots of samples, and points weighted down."""
    pairs = common_pairs(synthetic_rays(), right)
    random = np.random.default_rng(right)
    pairs.right[:, :2] += (scale - 1.0) * random.normal(0.0, 0.005, (len(pairs.error), 2))
    pairs.right[random.choice(len(pairs.error), wrong, replace=False), :2] += random.normal(0.0, 5.0, (wrong, 2))
    mine, theirs = without_loops(lambda: solve(pairs))
    assert np.count_nonzero(theirs.weight_factor < 1.0) >= wrong // 2
    assert theirs.scale > scale / 3.0
    same_solution(mine, theirs)


@pytest.mark.parametrize("right", [1, 2, 3])
@pytest.mark.parametrize("count", [5, 6, 9, None])
def test_relative_orientation(without_loops, right: int, count: int | None) -> None:
    rays, *_ = scene()
    common = np.intersect1d(rays.point[rays.photo == 0], rays.point[rays.photo == right])[:count]
    rows = np.isin(rays.point, common)
    few = ImageRays(
        rays.photos, rays.points, rays.photo[rows], rays.point[rows], rays.xy[rows], rays.vectors[rows],
        rays.error[rows],
    )  # fmt: skip
    mine, theirs = without_loops(lambda: orient_pair(few, 0, right, model="M", row=None, column=None))
    assert isinstance(mine, RelativeOrientation)
    assert isinstance(theirs, RelativeOrientation)
    assert mine.base == pytest.approx(theirs.base, abs=1e-9)
    assert mine.remarks == theirs.remarks
    assert mine.base_deviation == pytest.approx(theirs.base_deviation, rel=1e-6)
    assert mine.parallax_deviation == pytest.approx(theirs.parallax_deviation, rel=1e-5, abs=1e-9)
    assert mine.block.deviations == pytest.approx(theirs.block.deviations, rel=1e-6)


def test_no_base(without_loops) -> None:
    rays, *_ = scene()
    left = rays.vectors[rays.photo == 0]
    from scipy.spatial.transform import Rotation

    random = np.random.default_rng(2)
    turned = left @ Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    right = turned * (left[:, 2:] / turned[:, 2:])
    right[:, :2] += random.normal(0.0, 0.01, (len(left), 2))
    pairs = Pairs(left, right, np.full(len(left), 0.014))
    mine, theirs = without_loops(lambda: solve(pairs))
    # the least sum of distances is not iterated to its end
    assert mine.left_by_rotation == pytest.approx(theirs.left_by_rotation, rel=1e-9)
    assert theirs.left_by_rotation < 3.0


@pytest.mark.parametrize("unknowns", [ALL_UNKNOWNS, NO_ROTATION])
@pytest.mark.parametrize("count", [3, 4, 25])
def test_similarity(without_loops, unknowns: np.ndarray, count: int) -> None:
    common, rotation = common_points(count)
    start = Similarity(2.01, rotation, np.full(3, 3.01))
    mine, theirs = without_loops(lambda: adjust_similarity(common, start, unknowns))
    assert mine.iterations == theirs.iterations
    assert mine.similarity.scale == pytest.approx(theirs.similarity.scale, rel=1e-12)
    assert np.abs(mine.similarity.rotation - theirs.similarity.rotation).max() < 1e-12
    assert np.abs(mine.similarity.shift - theirs.similarity.shift).max() < 1e-12
    assert mine.weight_factor == pytest.approx(theirs.weight_factor, abs=1e-9)
    assert mine.s0 == pytest.approx(theirs.s0, rel=1e-9)
    assert mine.residuals == pytest.approx(theirs.residuals, abs=1e-12, nan_ok=True)
    assert mine.angles == pytest.approx(theirs.angles, abs=1e-12)
    assert mine.scale_deviation == pytest.approx(theirs.scale_deviation, rel=1e-9)
    assert mine.shift_deviation == pytest.approx(theirs.shift_deviation, rel=1e-9)
    assert mine.angle_deviation == pytest.approx(theirs.angle_deviation, rel=1e-9)


@pytest.mark.parametrize("count", [3, 4, 12, 40])
def test_similarity_of_triples(without_loops, count: int) -> None:
    """In closed form, by planes, against singular values; points wrong, known in part, on a line and nearly so."""
    from scipy.spatial.transform import Rotation

    random = np.random.default_rng(count)
    rotation = Rotation.random(random_state=count).as_matrix()
    source = random.normal(size=(count, 3))
    source[: min(count, 4)] = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])[:count]
    source[2] += [0.0, 1e-2, 0.0]
    target = 0.5 * source @ rotation.T + 3.0 + random.normal(0.0, 1e-6, (count, 3))
    target[4 : 4 + count // 4] += 0.1
    target[count - count // 4 :, 2] = np.nan
    errors = [np.abs(random.normal(1e-6, 2e-7, (count, 3))) for _ in range(2)]
    common = CommonPoints(source, target, *errors, np.zeros(count, dtype=bool))
    mine, theirs = without_loops(lambda: start_from_triples(common))
    # of a triangle that is nearly a line singular values of products lose the digits of its width twice
    assert mine.scale == pytest.approx(theirs.scale, rel=1e-11)
    assert np.abs(mine.rotation - theirs.rotation).max() < 1e-10
    assert np.abs(mine.shift - theirs.shift).max() < 1e-10


def test_similarity_of_triples_on_a_line(without_loops) -> None:
    source = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    error = np.full((4, 3), 1e-3)
    common = CommonPoints(source, source, error, error, np.zeros(4, dtype=bool))

    def message() -> str:
        with pytest.raises(ValueError, match="lie on one line") as raised:
            start_from_triples(common)
        return str(raised.value)

    assert len(set(without_loops(message))) == 1


def test_similarity_that_points_of_a_line_leave_open() -> None:
    source = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    error = np.full((4, 3), 1e-3)
    common = CommonPoints(source, source, error, error, np.zeros(4, dtype=bool))
    with pytest.raises(ValueError, match="do not determine"):
        adjust_similarity(common, Similarity(1.0, np.eye(3), np.zeros(3)))
