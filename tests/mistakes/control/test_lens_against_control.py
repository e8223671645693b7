"""What a wrong camera or photo pushes out of place is not accused: control points, and other photos."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bundle.solving import solution
from mistakes.small_folders import Folder, images, known
from mistakes.test_first_sentence import run, status, warnings
from scipy.spatial.transform import Rotation
from support.long_cases import every
from support.synthetic_block import synthetic_block

from orip.bundle.groups.words import CODE
from orip.errors import ProjectWarning
from orip.records.results.solution import Diagnosis
from orip.solving.consequences import judged
from orip.structs import replace

TRUE = 150.0


def strip_with_control_at_its_ends(seed: int, c: float) -> Folder:
    """Return ten photos of a strip, of a camera that has `c` in place of 150 mm."""
    random = np.random.default_rng(seed)
    photos = {f"L{n}": (900.0 * n, 0.0, 1600.0, *random.normal(0.0, 1.0, 3)) for n in range(10)}
    points = {
        str(n): np.array([random.uniform(-500.0, 8600.0), random.uniform(-1000.0, 1000.0), random.normal(100.0, 30.0)])
        for n in range(250)
    }
    along = sorted(points, key=lambda name: points[name][0])
    control = known(points, 0.05, along[3:7] + along[-7:-3])
    return Folder(points, images(photos, points, TRUE, 115.0, 0.005), control, c=c)


@pytest.mark.parametrize("seed", every(4, [2, 4, 5, 6]))
def test_another_lens_is_not_called_a_wrong_control_point(tmp_path: Path, seed: int) -> None:
    said = run(strip_with_control_at_its_ends(seed, 157.3).write(tmp_path / "folder"))
    named = "C of camera C is off by about +", "the principal distance of a camera does not fit its photos"
    assert any(words in status(said) for words in named), said.told
    assert "control point" not in status(said)
    (line,) = (line for line in warnings(said) if "photos L0" not in line)
    assert line.startswith("warning: camera C: C = 157.3 mm does not fit the photos, 1")
    assert float(line.split("photos, ")[1].split(" ±")[0]) == pytest.approx(TRUE, abs=1.5)  # five deviations


def looking(centre: np.ndarray, target: np.ndarray, roll: float) -> tuple[float, ...]:
    """Return centre and angles of a photo that looks at a target."""
    back = (centre - target) / np.linalg.norm(centre - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    matrix = np.column_stack([right, np.cross(back, right), back]) @ Rotation.from_euler("z", roll).as_matrix()
    return (*centre, *Rotation.from_matrix(matrix).as_euler("XYZ", degrees=True))


def oblique(given: float, count: int) -> tuple[Folder, tuple[str, ...]]:
    """Return photos by a vertical and by an oblique camera of 200 mm, which has `given`; and the photos of that."""
    random = np.random.default_rng(5)
    points = {str(n): random.uniform([-600.0, -600.0, 0.0], [1800.0, 1200.0, 150.0]) for n in range(count)}
    vertical, slanted = {}, {}
    for row in range(2):
        for column in range(3):
            centre = np.array([600.0 * column, 600.0 * row, 1000.0]) + random.normal(0.0, 10.0, 3)
            vertical[f"N{row}{column}"] = (*centre, *random.normal(0.0, 2.0, 3))
            for way, (x, y) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
                target = centre + np.array([x, y, -1.2])
                slanted[f"S{row}{column}{way}"] = looking(centre + random.normal(0.0, 2.0, 3), target, 0.0)
    measured = {
        **images(vertical, points, TRUE, 115.0, 0.005),
        **{name: seen for name, seen in images(slanted, points, 200.0, 115.0, 0.005).items() if len(seen) > 30},
    }
    control = known(points, 0.05, ["0", "1", "2", "3", "4"])
    return Folder(points, measured, control, c=TRUE), tuple(name for name in measured if name in slanted)


@pytest.mark.parametrize("points", every(2, [120, 400]))
def test_the_lens_of_one_of_two_cameras_is_named_where_nothing_fits(tmp_path: Path, points: int) -> None:
    made, slanted = oblique(206.0, points)
    folder = made.write(tmp_path / "folder")
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    for photo in slanted:
        text = text.replace(f'name = "{photo}"\ncamera = "C"', f'name = "{photo}"\ncamera = "O"')
    text = text.replace("[[photo]]", '[[camera]]\nname = "O"\nc = 206.0\nframe = [230.0, 230.0]\n[[photo]]', 1)
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    said = run(folder)
    assert any(line.startswith("warning: camera O: C = 206 mm does not fit the photos, 200") for line in warnings(said))


@pytest.mark.parametrize("code", ["mirrored", "other-camera", "shifted-numbers"])
def test_control_that_a_misread_photo_pushes_out_is_not_accused(code: str) -> None:
    found = replace(
        solution(synthetic_block("convergent", "misread photo").block),
        status="doubtful",
        diagnosis=(Diagnosis(CODE, "control point 77", "X of control point 77 is off by 0.083 m", "check it"),),
    )
    by_photo = judged(found, [ProjectWarning(code, "photo S8", "it does not fit as it was measured")], [], [])
    assert [sentence.text for sentence in by_photo.diagnosis] == ["see the warning about photo S8"]
    by_nothing = judged(found, [], [], [])
    assert by_nothing.diagnosis == found.diagnosis
