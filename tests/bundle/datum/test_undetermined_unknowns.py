"""Blocks with unknowns that nothing determines: how many are removed, and what the others are then."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import noisy, solution, started_off, with_photo_points

import orip
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import solve_block
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace

BLOCKS = Path(__file__).parents[1] / "undetermined_blocks"


@pytest.fixture(autouse=True)
def adjusted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Adjust from the given values alone: other starts and what was probably mistaken are not what is tested."""
    monkeypatch.setattr("orip.solving.solve.doubt_about_given", lambda _: "")
    monkeypatch.setattr("orip.solving.solve.explain_misfit", lambda *_: [])


def solved(folder: Path, name: str) -> orip.Solution:
    shutil.copytree(BLOCKS / name, folder / name)
    return orip.open_project(folder / name).solve()


def started_with(folder: Path) -> dict[tuple[str, str], float]:
    """Return the values of orip.toml by photo and element."""
    blocks = (folder / "orip.toml").read_text().split("[[photo]]")[1:]
    return {
        (re.search(r'name = "(\w+)"', block)[1], element): float(re.search(rf"^{element} = (\S+)", block, re.M)[1])
        for block in blocks
        for element in PHOTO_PARAMETERS
    }


def test_no_determined_unknown_is_removed_beside_weakly_determined_ones(tmp_path):
    found = solved(tmp_path, "lost_digits_sound_removed")
    # the singular values of its design matrix have a gap from 6e-16 to 8e-4, and eleven are below it
    assert len(found.singular) == 11
    assert found.redundancy == 27
    assert found.status == "converged"


def test_a_removed_angle_keeps_its_value(tmp_path):
    found = solved(tmp_path, "removed_angle_moves")
    given = started_with(tmp_path / "removed_angle_moves")
    photos = found.photos
    assert any(unknown.kind == "PHI" for unknown in found.singular)
    for unknown in found.singular:
        value = photos.orientations[photos.names.index(unknown.name)][PHOTO_PARAMETERS.index(unknown.kind)]
        assert value == pytest.approx(given[unknown.name, unknown.kind], abs=1e-9)


def test_others_are_as_precise_as_if_the_removed_ones_were_constant(tmp_path):
    found = solved(tmp_path, "removed_angle_moves")
    block = found._solved.block
    held = {}
    for unknown in found.singular:
        held.setdefault(unknown.name, set()).add(unknown.kind)
    photos = tuple(
        replace(photo, constant=tuple(kind for kind in PHOTO_PARAMETERS if kind in held.get(photo.name, ())))
        for photo in block.photos
    )
    constant = solution_of(solve_block(replace(block, photos=photos), lambda _: None, lambda: False))
    record = found._record
    others, points = np.isfinite(record.photos.sd), np.isfinite(record.points.sd)
    # angles of photos without removed ones are unknowns about the axes there: the iterations end a little differently
    assert np.allclose(record.photos.sd[others], constant.photos.sd[others], rtol=1e-4)
    assert np.allclose(record.points.sd[points], constant.points.sd[points], rtol=1e-4)
    assert np.allclose(record.points.values, constant.points.values, atol=1e-3 * record.points.sd.min())


def test_a_part_whose_scale_nothing_determines_has_no_standard_deviations():
    # the first photo sees what the second sees, no other photo, and no control
    made = aerial_block("a part without a scale", 7)
    points = made.block.photo_points
    place = made.block.point_index()
    known = [place[point.name] for point in made.block.control_points]
    seen = points.point[(points.photo == 0) & ~np.isin(points.point, known)]
    common = np.intersect1d(seen, points.point[points.photo == 1])
    kept = np.where(np.isin(points.point, common), points.photo < 2, points.photo > 0)
    block = started_off(made, noisy(made, 1), 2)
    found = solution(with_photo_points(block, kept))
    assert [unknown.name for unknown in found.singular] == [block.photos[0].name]
    names = {block.point_names[point] for point in common}
    free = np.array([name in names for name in found.points.names])
    assert np.isinf(found.points.sd[free]).all()
    assert np.isfinite(found.points.sd[~free]).all()
    assert np.isinf(found.photos.sd[0]).any()
    assert np.isfinite(found.photos.sd[1:]).all()
