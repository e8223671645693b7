"""The compiled loops of preliminary values against numpy: two ways to the same figures.

Both add the same terms in another order. Where iterations end early they end alike only to what the last one changes,
which the tolerances allow for.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.model.preliminary import ImageRays
from orip.prelim import compiled, intersection, refinement, resection_adjustment, resection_start
from orip.prelim.image_rays import image_rays
from orip.prelim.intersection import intersect
from orip.prelim.refinement import refine
from orip.prelim.resection import Resected, resect

pytestmark = pytest.mark.skipif(not compiled.is_compiled(), reason="the extension was not built: no compiler here")

BLUNDERS = 12


@pytest.fixture
def without_loops(monkeypatch: pytest.MonkeyPatch):
    """Return what does something once with the loops and once without."""

    def both(do):
        with_loops = do()
        for module in (intersection, refinement, resection_adjustment, resection_start):
            monkeypatch.setattr(module, "is_compiled", lambda: False)
        return with_loops, do()

    return both


def scene() -> tuple[ImageRays, np.ndarray, np.ndarray, np.ndarray]:
    """Return rays of which some are wrong, and rotations, centres and points that are nearly true."""
    made = synthetic_block("convergent", "compiled loops", noise_mm=0.005)
    rays = image_rays(made.block)
    random = np.random.default_rng(7)
    wrong = random.choice(len(rays.photo), BLUNDERS, replace=False)
    rays.vectors[wrong, :2] += random.normal(0.0, 0.5, (BLUNDERS, 2))
    from scipy.spatial.transform import Rotation

    rotations = Rotation.from_euler("XYZ", made.orientations[:, 3:]).as_matrix()
    return rays, rotations, made.orientations[:, :3].copy(), made.points


def test_intersection(without_loops) -> None:
    rays, rotations, centres, _ = scene()
    oriented = np.ones(len(centres), dtype=bool)
    mine, theirs = without_loops(lambda: intersect(rotations, centres, oriented, rays))
    assert np.abs(mine.coordinates - theirs.coordinates).max() < 1e-9 * np.abs(theirs.coordinates).max()
    assert mine.deviations == pytest.approx(theirs.deviations, rel=1e-9)
    assert mine.weight_factors == pytest.approx(theirs.weight_factors, abs=1e-9)
    assert np.count_nonzero(theirs.weight_factors < 0.5) >= BLUNDERS // 2
    assert mine.angles == pytest.approx(theirs.angles, abs=1e-12)
    assert mine.s0 == pytest.approx(theirs.s0, rel=1e-12)


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


@pytest.mark.parametrize("held", [False, True])
def test_refinement(without_loops, held: bool) -> None:
    rays, rotations, centres, points = scene()
    random = np.random.default_rng(3)
    start = points + 0.001 * random.normal(size=points.shape)
    oriented = np.ones(len(centres), dtype=bool)
    held_points = np.arange(len(points)) < (5 if held else 0)
    mine, theirs = without_loops(
        lambda: refine(rays, rotations, centres, oriented, start, held_points=held_points, sweeps=4)
    )
    assert mine.iterations == theirs.iterations
    assert np.abs(mine.rotations - theirs.rotations).max() < 1e-8
    assert np.abs(mine.centres - theirs.centres).max() < 1e-8 * np.abs(centres).max()
    assert mine.weight_factors == pytest.approx(theirs.weight_factors, abs=1e-6)
    assert mine.s0 == pytest.approx(theirs.s0, rel=1e-8)
