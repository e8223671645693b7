"""Points of one photo that are shifted against its fiducial marks."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.mistakes.marks.shifted_points import SHIFTED_POINTS, shift_tests
from orip.records.block import Block
from orip.records.camera import Mark
from orip.solving.solve import solve
from orip.structs import replace

NOISE_MM = 0.001
"""Relief of a twentieth of the height shows little of a shift: with 5 µm one of half a millimetre is not found."""
MARKS = tuple(
    Mark(name, x, y) for name, x, y in (("1", -85.0, -85.0), ("2", 85.0, -85.0), ("3", 85.0, 85.0), ("4", -85.0, 85.0))
)


def film(seed: int, photo: int, shift: tuple[float, float], *, marks: bool = True) -> Block:
    """Return a strip on film, all points of one photo of which are shifted, mm."""
    made = synthetic_block("strip", f"film {seed}", noise_mm=NOISE_MM, precision_mm=NOISE_MM, control_error=NOISE_MM)
    points = made.block.photo_points
    xy = points.xy + np.where((points.photo == photo)[:, None], shift, 0.0)
    cameras = tuple(replace(camera, fiducials=MARKS if marks else ()) for camera in made.block.cameras)
    return replace(
        made.block, cameras=cameras, photo_points=replace(points, xy=xy), photo_orientation=made.orientations,
        point_start=made.points,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_a_shifted_photo_is_named(seed: int) -> None:
    solution, _ = solve(film(seed, 2, (0.8, -0.6)))
    found = [(where, text) for code, where, text in solution.warnings if code == SHIFTED_POINTS]
    assert [where for where, _ in found] == ["photo P3"]
    assert solution.status == "doubtful"
    assert "all points of a photo are shifted against its fiducial marks" in solution.verdict


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_said_of_films_that_are_right(seed: int) -> None:
    solution, _ = solve(film(seed, 2, (0.0, 0.0)))
    assert SHIFTED_POINTS not in [code for code, _, _ in solution.warnings]


def test_digital_photos_have_no_marks_to_be_shifted_against() -> None:
    solution, _ = solve(film(0, 2, (0.8, -0.6), marks=False))
    assert SHIFTED_POINTS not in [code for code, _, _ in solution.warnings]


def test_shifts_have_the_standard_deviations_that_are_said() -> None:
    """Of right films: the mean of the chi-square statistics is 2, and estimates are off by their deviations."""
    statistics, standard = [], []
    for seed in range(10, 22):
        _, solved = solve(film(seed, 0, (0.0, 0.0)))
        tests = shift_tests(solved)
        assert tests is not None
        statistics.append(tests.statistic)
        standard.append(tests.shift / tests.sd)
    # 72 of them: correlated within a block, so that the mean of 2 varies by less than 0.6
    assert np.mean(statistics) == pytest.approx(2.0, abs=1.0)
    assert np.sqrt(np.mean(np.square(standard))) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("photo", [0, 3])
def test_the_shift_is_found_within_its_standard_deviation(photo: int) -> None:
    _, solved = solve(film(5, photo, (0.8, 0.4)))
    tests = shift_tests(solved)
    assert tests is not None
    assert int(np.argmax(tests.statistic)) == photo
    assert (np.abs(tests.shift[photo] - [0.8, 0.4]) < 4.0 * tests.sd[photo]).all()
