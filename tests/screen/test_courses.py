"""Profiles, grids and contours of the rendered hill: the mark set by matching, what fails set by hand, snapping."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("PIL")
pytest.importorskip("cv2")

from cli.command_line import orip  # after what it needs
from screen.stereo_project import stereo_of
from workflow.small_projects import REPOSITORY

from orip.errors import OripError
from orip.screen.courses import grid, profile
from orip.screen.stereo_screen import STEREO_FILE, StereoScreen

CONTOUR = 13.0
_REFUSED = ((grid, (4, 4), 5.0), (grid, (1e6, 1e6), 1.0), (profile, (1, 1), 1.0), (profile, (1e9, 0), 1.0))
WITH = {"code": "C", "name": "1"}


class Hill(NamedTuple):
    """The adjusted project, and the script with the truth."""

    folder: Path
    truth: ModuleType


@pytest.fixture(scope="module")
def adjusted_hill(tmp_path_factory: pytest.TempPathFactory) -> Hill:
    folder = tmp_path_factory.mktemp("hill") / "project"
    shutil.copytree(REPOSITORY / "sample_projects" / "rendered_hill", folder, ignore=shutil.ignore_patterns("*.png"))
    spec = importlib.util.spec_from_file_location("rendered_hill", folder / "simulate.py")
    assert spec is not None
    assert spec.loader is not None
    truth = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(truth)
    truth.render()
    assert orip(folder, "run", "--no-report").code == 0
    return Hill(folder, truth)


@pytest.fixture
def hill(adjusted_hill: Hill) -> Hill:
    for name in (STEREO_FILE, "HILL.GEO"):
        (adjusted_hill.folder / name).unlink(missing_ok=True)
    return adjusted_hill


def run_through(screen: StereoScreen) -> str:
    """Run until all is done; return what was said last."""
    while "all is done" not in (said := screen.commands["run"]({})["said"]):
        assert said.startswith("recorded")
    return said


def restituted(folder: Path) -> Mapping[str, np.ndarray]:
    """Return by kind, code and name of a feature its vertices: X Y Z, their standard deviations, and y-parallaxes."""
    assert orip(folder, "restitute", "compute", STEREO_FILE).code == 0
    found: dict[str, list[list[float]]] = {}
    name = ""
    for line in (folder / "HILL.GEO").read_text().splitlines():
        if line.startswith("  "):
            words = line.split()
            found[name].append([float(word) for word in (*words[:6], words[8])])
        elif line[:1].isalpha():
            name = line.strip()
            found[name] = []
    return {name: np.array(rows) for name, rows in found.items()}


def test_places_of_profiles_and_grids() -> None:
    assert profile("P", "1", ((0, 0), (6, 8)), 4.0).places.tolist() == [[0, 0], [2.4, 3.2], [4.8, 6.4], [6, 8]]
    assert profile("P", "1", ((0, 0), (0, 8)), 4.0).places.tolist() == [[0, 0], [0, 4], [0, 8]]
    assert profile("P", "1", ((0, 0), (0, 3)), 4.0).places.tolist() == [[0, 0], [0, 3]]
    made = grid("G", "A", ((11.0, 3.0), (4.9, 9.9)), 5.0)
    assert made.places.tolist() == [[5, 5], [10, 5]]
    assert grid("G", "A", ((0, 0), (5, 5)), 5.0).places.tolist() == [[0, 0], [5, 0], [5, 5], [0, 5]]
    assert grid("G", "A", ((-5, 0), (0, 5)), 5.0).names == ("A-0-0", "A-1-0", "A-1-1", "A-0-1")
    for make, end, spacing in _REFUSED:
        with pytest.raises(OripError):
            make("G", "A", ((1, 1), end), spacing)


def test_a_contour_is_closed_over_three_models_without_a_step(hill: Hill) -> None:
    """Off the surface by the standard deviations; where the model changes both models see it at the same height."""
    processor, screen = stereo_of(hill.folder)
    screen.commands["drive"]({"object": [45.0, -13.0, CONTOUR]})
    said = screen.commands["course"]({"kind": "CONTOUR", **WITH, "z": CONTOUR, "spacing": 5.0})["said"]
    assert said == "contour C 1"
    assert run_through(screen).startswith("recorded LINE C 1, vertex")
    assert "closed" in screen.commands["close"]({})["said"]
    (feature,) = screen._file.features
    assert feature.vertices[0] == feature.vertices[-1]
    assert len({(one.left, one.right) for one in feature.vertices}) == 3
    rows = restituted(hill.folder)["LINE C 1"]
    assert rows[:, 2] == pytest.approx(CONTOUR, abs=0.01)
    true = hill.truth.height(*rows[:, :2].T)
    assert np.sqrt(np.mean(np.square((true - CONTOUR) / rows[:, 5]))) < 1.2
    # an image in a photo of 0.2 pixel is a third of a metre of height: matching is better than that
    assert np.abs(true - CONTOUR).max() < 0.35
    length = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    assert length[:-1].max() < 6.4
    assert 140.0 < length.sum() < 190.0
    steps = []
    for (one, other), sd in zip(zip(feature.vertices, feature.vertices[1:], strict=False), rows[:, 5], strict=False):
        if (one.left, one.right) == (other.left, other.right):
            continue
        heights = []
        for vertex in (one, other):  # the place of the one, in both models
            x, y, _ = processor.project_place_of(one)
            processor.go_to_vertex(vertex)
            processor.drive((x, y, CONTOUR))
            pair = (vertex.left, vertex.right)
            processor.change_model(next(one["name"] for one in screen.scene["models"] if one["photos"] == pair))
            screen.commands["match"]({})
            heights.append(processor.read().xyz[2])
        steps.append((heights[1] - heights[0]) / sd)
    assert len(steps) >= 3
    assert np.abs(steps).max() < 2.0


def test_a_profile_goes_on_where_it_was_and_follows_the_surface(hill: Hill) -> None:
    _, screen = stereo_of(hill.folder)
    screen.commands["drive"]({"object": [20.0, -15.0, 12.0]})
    asked = {"kind": "PROFILE", "code": "P", "name": "1", "from": [20.0, -15.0], "to": [70.0, 15.0], "spacing": 4.0}
    assert screen.commands["course"](asked)["said"] == "profile P 1: 16 places ahead"
    assert screen.commands["step"]({})["said"] == "at 1: look, correct, record"
    screen.commands["record"]({"kind": "LINE", "code": "P", "name": "1"})
    screen.commands["run"]({})
    screen.commands["undo"]({})
    _, screen = stereo_of(hill.folder)  # ended meanwhile
    count = len(screen._file.features[0].vertices)
    assert screen.commands["course"](asked)["said"] == f"profile P 1: {16 - count} places ahead"
    run_through(screen)
    screen.commands["close"]({})
    rows = restituted(hill.folder)["LINE P 1"]
    assert len(rows) == 16
    assert rows[0, :2] == pytest.approx([20.0, -15.0], abs=0.02)
    assert rows[-1, :2] == pytest.approx([70.0, 15.0], abs=0.02)
    off = rows[:, 2] - hill.truth.height(*rows[:, :2].T)
    assert np.sqrt(np.mean(np.square(off / rows[:, 5]))) < 1.2


def test_a_grid_leaves_what_does_not_match_to_the_operator(hill: Hill) -> None:
    """Part of a picture is blank: its places are left, and set by hand; what is outside of all models, too."""
    from PIL import Image

    before = (hill.folder / "P2.png").read_bytes()
    blank = np.array(Image.open(hill.folder / "P2.png"))
    truth = hill.truth.height
    x, y = hill.truth.pixels("P2", np.array([[10.0, 5.0, float(truth(10.0, 5.0))]]))[0]
    blank[int(y) - 24 : int(y) + 24, int(x) - 24 : int(x) + 24] = 128
    Image.fromarray(blank).save(hill.folder / "P2.png")
    try:
        _, screen = stereo_of(hill.folder)
        screen.commands["drive"]({"object": [20.0, 0.0, 16.0]})
        asked = {"kind": "GRID", "code": "D", "name": "A", "from": [0.0, 0.0], "to": [20.0, 10.0], "spacing": 5.0}
        assert screen.commands["course"](asked)["said"] == "grid D A: 15 places ahead"
        with pytest.raises(OripError, match="places are left to be set by hand: matching"):
            run_through(screen)
        there = {one.name for one in screen._file.features}
        assert "A-2-1" not in there
        assert 8 <= len(there) < 15
        with pytest.raises(OripError, match="matching"):
            screen.commands["step"]({})
        screen.commands["drive"]({"object": [10.0, 5.0, float(truth(10.0, 5.0))]})
        screen.commands["record"]({"kind": "POINT", "code": "D", "name": "A-2-1"})
        rows = restituted(hill.folder)
        assert all(len(one) == 1 for one in rows.values())
        found = np.vstack(list(rows.values()))
        assert np.abs(found[:, :2] / 5.0 - np.rint(found[:, :2] / 5.0)).max() < 0.01
        off = found[:, 2] - truth(*found[:, :2].T)
        assert np.sqrt(np.mean(np.square(off / found[:, 5]))) < 1.2
    finally:
        (hill.folder / "P2.png").write_bytes(before)


def test_a_vertex_snaps_to_one_that_is_near_in_both_photos(hill: Hill) -> None:
    _, screen = stereo_of(hill.folder)
    do, line = screen.commands, {"kind": "LINE", **WITH}
    for x, y in ((30.0, 0.0), (34.0, 0.0), (34.0, 4.0)):
        do["drive"]({"object": [x, y, 18.0]})
        do["record"](line)
    do["drive"]({"object": [30.3, 0.2, 18.0]})
    assert "snapped" not in do["record"]({**line, "snap": 2.0})["said"]
    do["undo"]({})
    do["drive"]({"object": [30.3, 0.2, 18.0]})
    assert do["record"]({**line, "snap": 5.0})["said"].endswith("vertex 4, snapped to LINE C 1, vertex 1")
    vertices = screen._file.features[0].vertices
    assert vertices[3] == vertices[0]
    do["close"]({})
    do["model"]({"name": "2-3"})
    do["drive"]({"object": [33.9, 3.9, 18.0]})
    said = do["record"]({"kind": "LINE", "code": "C", "name": "2", "snap": 6.0})["said"]
    assert "snapped to LINE C 1, vertex 3" in said
    place = screen._processor.project_place_of(screen._file.features[-1].vertices[0])
    assert place == pytest.approx([34.0, 4.0, 18.0], abs=1e-3)
    do["undo"]({})
    point = screen.scene["points"][0]
    do["drive"]({"point": point})
    do["move"]({"right": 2.0, "up": 1.0})
    said = do["record"]({"kind": "POINT", "code": "T", "name": "1", "snap": 4.0})["said"]
    assert said.endswith(f"snapped to {point}")
    for wrong in ({"snap": "1"}, {"snap": -1e9}, {"snap": None}):
        with pytest.raises(OripError):
            do["record"]({"kind": "POINT", "code": "T", "name": "2", **wrong})


def test_what_cannot_be_is_refused(hill: Hill) -> None:
    _, screen = stereo_of(hill.folder)
    do = screen.commands
    for command in ("step", "run"):
        with pytest.raises(OripError, match="begin a profile, a grid or a contour first"):
            do[command]({})
    good = {"kind": "PROFILE", **WITH, "from": [0, 0], "to": [10, 0], "spacing": 2.0}
    for wrong in (
        {"kind": "SPIRAL"}, {"from": [0]}, {"to": "x"}, {"spacing": 0}, {"spacing": -1}, {"spacing": 1e-3},
        {"spacing": True}, {"code": ""}, {"to": [1e300, 0]}, {"kind": "CONTOUR"}, {"from": [0, None]},
    ):  # fmt: skip
        with pytest.raises(OripError):
            do["course"]({**good, **wrong})
    do["course"]({**good, "from": [500.0, 0.0], "to": [600.0, 0.0]})
    with pytest.raises(OripError, match="outside"):
        do["run"]({})
    assert not (hill.folder / STEREO_FILE).exists()
