"""A hand-held block of 42 photos of which two cannot be oriented: the others are adjusted, the two named first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from monte_carlo.weakly_joined_blocks import facades
from support.tie_points import measured_points

from orip.wording import counted

PHOTOS = 42
LACKING = {"P7": 1, "P30": 2}
"""Photos and the points that are left in them."""

NOISE_MM = 0.003


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a project of photos of a facade, nothing preliminary, six control points."""
    random = np.random.default_rng(42)
    scene = facades(random, PHOTOS)
    ties = measured_points(scene, random, 24, 0.95, von_gruber=False)
    xy = ties.xy + NOISE_MM * random.normal(size=ties.xy.shape)
    rays = np.bincount(ties.place)
    control = random.permutation(np.flatnonzero(rays >= 4))[:6].tolist()
    folder = tmp_path_factory.mktemp("facade")
    lines = []
    for photo in range(PHOTOS):
        name = f"P{photo + 1}"
        rows = np.flatnonzero((ties.photo == photo) & ~((name in LACKING) & np.isin(ties.place, control)))
        lines.append(f"POINTS MAIN {name}")
        lines += [f"{ties.place[row]} {xy[row, 0]:.5f} {xy[row, 1]:.5f}" for row in rows[: LACKING.get(name)]]
    (folder / "FACADE.MEA").write_text("\n".join(lines) + "\n", encoding="utf-8")
    points = [" ".join([str(place), *(f"{value:.4f}" for value in scene.surface[place]), "0 0 0"]) for place in control]
    (folder / "FACADE.PNT").write_text("\n".join(points) + "\n", encoding="utf-8")
    camera = f'[[camera]]\nname = "CAM"\nc = {scene.principal_distance}\nframe = {scene.frame.tolist()}'
    photos = [f'[[photo]]\nname = "P{number}"\ncamera = "CAM"' for number in range(1, PHOTOS + 1)]
    bundle = f'[[bundle]]\nname = "MAIN"\nmeasurement_precision = {NOISE_MM}'
    project = ['project = { name = "FACADE", ground_unit = "m" }', camera, *photos, bundle]
    (folder / "orip.toml").write_text("\n\n".join(project) + "\n", encoding="utf-8")
    return folder


def test_forty_photos_are_adjusted_and_the_two_others_named_first_with_what_they_lack(folder: Path) -> None:
    said = orip(folder, "run", "--all", "--json", "--no-report")
    # all photos are wanted
    assert said.code == 4
    assert len(said.document["photos"]) == PHOTOS - len(LACKING)
    assert said.document["status"] == "converged"
    # some thousand observations of errors as large as said
    assert said.document["sigma0"] == pytest.approx(1.0, abs=0.1)
    warnings = [line for line in said.err.splitlines() if line.startswith("warning: ")]
    for warning, (photo, points) in zip(warnings, LACKING.items(), strict=False):
        assert warning.startswith(f"warning: photo {photo} is left out, since it could not be oriented: ")
        assert f"shares {counted(points, 'point')} with its neighbours, 5 are needed" in warning
    # no good photo is blamed
    assert not [warning for warning in warnings if "wrong place" in warning]


def test_preliminary_values_name_the_two_before_anything_else(folder: Path) -> None:
    for command in ("init", "measure"):
        assert orip(folder, command).code == 0
    said = orip(folder, "prelim")
    assert said.code == 4
    error = said.err[said.err.index("error: ") :]
    assert error.startswith("error: 2 of 42 photos could not be oriented")
    first, second = error.splitlines()[1:3]
    assert first.startswith("photo P7 shares 1 point ")
    assert second.startswith("photo P30 shares 2 points")
