"""No compiled function of preliminary values without a comparison with NumPy.

Each function of the extension has a case here, which has to call it and to give the same figures without it. More cases
of each are in `test_compiled`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled_cases import common_pairs, common_points, scene
from msgspec import Struct
from msgspec.structs import astuple
from partial_block_samples import pair
from scipy.spatial.transform import Rotation

from orip.geometry.similarity import Similarity
from orip.geometry.stereo import TwoPhotos
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.growing_block import GrowingBlock, residual_lengths
from orip.prelim.rays import intersect, with_consensus
from orip.prelim.refinement import no_corrections, refine
from orip.prelim.relative.given_scale import adjusted_at_scale, at_scale
from orip.prelim.relative.solution import solve
from orip.prelim.resection.known_points import KnownPoints
from orip.prelim.resection.resection import Resected, SeenPoints, fitting_points, resect
from orip.prelim.resection.start import best_orientations, starting_orientations
from orip.prelim.similarity.adjustment import adjust_similarity
from orip.prelim.similarity.joining import Joined, join
from orip.prelim.similarity.partial_blocks import assembled, common_places, in_common, transformed
from orip.prelim.similarity.start import start_from_triples
from orip.structs import replace

pytestmark = pytest.mark.skipif(not is_compiled(), reason="the extension was not built: no compiler here")


def known_points() -> KnownPoints:
    rays, _, _, points = scene()
    rows = np.flatnonzero(rays.photo == 1)[:30]
    coordinates = points[rays.point[rows]] - points[rays.point[rows]].mean(axis=0)
    spread = np.sqrt((coordinates**2).sum(axis=1).mean())
    return KnownPoints(rays.vectors[rows], coordinates / spread, np.full(len(rows), 1e-4), 0.005)


def refined() -> object:
    rays, rotations, centres, points = scene()
    start = points + 0.001 * np.random.default_rng(3).normal(size=points.shape)
    return refine(
        rays, rotations, centres, np.ones(len(centres), dtype=bool), start, held_points=np.arange(len(points)) < 5
    )


def intersected() -> object:
    rays, rotations, centres, _ = scene()
    return intersect(rotations, centres, np.ones(len(centres), dtype=bool), rays)


def lengths_of_residuals() -> object:
    """Residuals of a block with a photo that is not oriented, points that are not known and one behind a photo."""
    rays, rotations, centres, points = scene()
    coordinates = points.copy()
    coordinates[3:9], coordinates[12] = np.nan, centres[1] + 2.0 * (centres[1] - points[12])
    centres[0] = np.nan
    corrections = no_corrections(rays)
    return residual_lengths(
        rays, GrowingBlock("", rotations, centres, coordinates, coordinates, corrections, ("",) * len(centres))
    )


def placed_by_consensus() -> object:
    rays, rotations, centres, points = scene()
    random = np.random.default_rng(5)
    start = points + np.where(random.random((len(points), 1)) < 0.3, 0.5, 0.0)
    start[3] = np.nan
    some = rays.of(np.sort(random.choice(len(rays.photo), 3 * len(points), replace=False)))
    return with_consensus(rotations, centres, some, random.random(len(points)) < 0.8, start, 1.2)


def ranked_triples() -> object:
    return starting_orientations(known_points())


def resected() -> object:
    rays, _, _, points = scene()
    rows = np.flatnonzero(rays.photo == 1)[:30]
    found = resect(rays.vectors[rows], points[rays.point[rows]], np.full(len(rows), 1e-3), error_mm=0.005)
    assert isinstance(found, Resected)
    deviations = found.rotation_deviation, found.centre_deviation
    return found.rotation, found.centre, *deviations, found.residuals, found.weight_factor, found.s0, found.redundancy


def fitted_photos() -> object:
    """Return four photos, the last of which sees other points than those that it is given."""
    rays, _, _, points = scene()
    of_photos = [np.flatnonzero(rays.photo == photo)[: 12 + 5 * photo] for photo in range(4)]
    starts, rows = np.cumsum([0, *map(len, of_photos)]), np.concatenate(of_photos)
    known = points[rays.point[rows]]
    known[starts[3] :] = known[starts[3] :][::-1]
    seen = SeenPoints(
        starts, rays.xy[rows], rays.vectors[rows], np.full(len(rows), 0.005), known, np.full(len(rows), 1e-3)
    )
    found = fitting_points(seen)
    assert [np.count_nonzero(found.fits[starts[k] : starts[k + 1]]) > 10 for k in range(4)] == [True, True, True, False]
    # what another start leads to where nothing fits is of no consequence
    return found.rotations[:3], found.centres[:3], found.fits


def chosen_orientations() -> object:
    known = known_points()
    return best_orientations(known, starting_orientations(known))


def oriented_pair() -> object:
    return solve(common_pairs(scene()[0], 1))


def oriented_at_scale() -> object:
    pairs = common_pairs(scene()[0], 1)
    solution = solve(pairs)
    assert solution is not None
    return at_scale(solution, pairs, 1.0)


def adjusted_pair() -> object:
    pairs = common_pairs(scene()[0], 1)
    solution = solve(pairs)
    assert solution is not None
    found = adjusted_at_scale(turned_by_a_tenth_of_a_degree(solution.photos), pairs, 1.2)
    assert found is not None
    return found


def turned_by_a_tenth_of_a_degree(photos: TwoPhotos) -> TwoPhotos:
    return TwoPhotos(photos.base, photos.rotation @ Rotation.from_rotvec([0.001, -0.001, 0.001]).as_matrix())


def adjusted_similarity() -> object:
    common, rotation = common_points(25)
    return adjust_similarity(common, Similarity(2.01, rotation, np.full(3, 3.01)))


def joined_blocks() -> object:
    """Two common photos, and of one point no deviation."""
    made = pair(3)
    made.source.deviations[2, 1] = np.nan
    target = transformed(pair(3, noise=1e-3).source, made.truth)
    return common_places(made.source, target, in_common(made.source, target))


def joined_by_photos() -> object:
    """Two models of which two points are wrong, and two with two common points."""
    made, few = pair(3, wrong=2), pair(5, count=2)
    made.source.deviations[2, 1] = np.nan
    found = [join(sample.source, sample.target, sample.names, "bridge") for sample in (made, few)]
    assert all(isinstance(joint, Joined) for joint in found)
    return tuple((*astuple(joint.similarity), *astuple(joint.block)[1:], *astuple(joint.step)[5:-1]) for joint in found)


def assembled_blocks() -> object:
    """Three blocks with common photos and points; one has points in another order, and of one no deviation is known."""
    first, second = pair(3), pair(3, noise=1e-3)
    first.source.deviations[2, 1] = np.nan
    third = replace(second.source, points=second.source.points[::-1].copy(), photos=second.source.photos + 1)
    return astuple(assembled([first.source, transformed(second.target, second.truth), third]))[1:]


CASES: dict[str, Callable[[], object]] = {
    "adjust_at_scale": adjusted_pair,
    "adjust_similarity": adjusted_similarity,
    "assemble": assembled_blocks,
    "best_orientations": chosen_orientations,
    "best_triple": lambda: start_from_triples(common_points(25)[0]),
    "common_places": joined_blocks,
    "consensus": placed_by_consensus,
    "fitting_points": fitted_photos,
    "intersect": intersected,
    "join_by_photos": joined_by_photos,
    "orient_at_scale": oriented_at_scale,
    "orient_pair": oriented_pair,
    "rank_triples": ranked_triples,
    "residual_lengths": lengths_of_residuals,
    "resect": resected,
    "refine": refined,
}


CONDITIONS = {"refine"}
"""Whose results are known by conditions that they fulfil (`test_refined_blocks`)."""


def figures(found: object) -> list[np.ndarray]:
    """Return all numbers of a result."""
    if isinstance(found, Struct):
        return [array for part in astuple(found) for array in figures(part)]
    if isinstance(found, tuple):
        return [array for part in found for array in figures(part)]
    return [np.asarray(found, dtype=np.float64)]


def test_every_function_has_a_case() -> None:
    functions = {name for name in dir(kernels) if not name.startswith("_")}
    assert functions == set(CASES)


@pytest.mark.parametrize("name", sorted(CASES.keys() - CONDITIONS))
def test_function_gives_the_figures_of_numpy(name: str, without_loops, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    function = getattr(kernels, name)
    monkeypatch.setattr(kernels, name, lambda *arguments: calls.append(name) or function(*arguments))
    numbers: list[int] = []

    def case() -> object:
        found = CASES[name]()
        numbers.append(len(calls))
        return found

    compiled, with_numpy = without_loops(case)
    assert numbers[0] > 0, "the case does not call the function"
    assert numbers[1] == numbers[0], "the function was called where NumPy should have done the work"
    one, other = figures(compiled), figures(with_numpy)
    assert len(one) == len(other)
    for mine, theirs in zip(one, other, strict=True):
        # iterations end where a correction is some 1e-6 at most: what they leave is of the order of its square, but
        # shows to the first order in weights, residuals and redundancy numbers
        size = float(np.max(np.abs(theirs), initial=0.0, where=np.isfinite(theirs)))
        np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-6 * size + 1e-12)
