"""Bundler, BAL and NVM."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, with_frame, written
from reference.published_data import data_set

from orip.exchange.conversion.cameras import convert_camera
from orip.exchange.conversion.lens_table import directions_of_image
from orip.exchange.conversion.poses import orip_poses
from orip.exchange.format import Read
from orip.exchange.vision.bundler import BAL, BUNDLER, is_bal, is_bundler, read_bal, read_bundler
from orip.exchange.vision.nvm import READING, is_nvm, read_nvm
from orip.records.exchanged import ExchangedProject

SIZE = (4000, 3000)


def text(*rows: object) -> str:
    return "\n".join(" ".join(map(str, row)) if isinstance(row, list | tuple) else str(row) for row in rows) + "\n"


def centred(project: ExchangedProject, y: float) -> np.ndarray:
    """Return measurements from the principal point of the block, which these formats have in the centre."""
    return (project.rays.image - np.array([2010.0, 1490.0])) * np.array([1.0, y])


def bal(project: ExchangedProject) -> str:
    image = centred(project, -1.0)
    rays = [
        (photo, point, *map(repr, xy))
        for photo, point, xy in zip(project.rays.photo, project.rays.point, image.tolist(), strict=True)
    ]
    cameras = [number for photo in project.photos for number in (*photo.rotation, *photo.position, 3000.0, 0, 0)]
    coordinates = project.points.coordinates.ravel().tolist()
    counts = (len(project.photos), len(project.points.names), len(rays))
    return text(counts, *rays, *cameras, *coordinates)


def rays_of_point(project: ExchangedProject, point: int, image: np.ndarray) -> list[object]:
    rows = np.flatnonzero(project.rays.point == point)
    return [len(rows), *(item for n in rows for item in (project.rays.photo[n], n, *map(repr, image[n].tolist())))]


def bundler(project: ExchangedProject) -> str:
    """Return a bundle.out; a camera that was not oriented stands before all others."""
    rows: list[object] = ["# Bundle file v0.3", (len(project.photos) + 1, len(project.points.names)), *["0 0 0"] * 5]
    for photo in project.photos:
        r = photo.rotation
        rows += [(3000.0, 0, 0), r[:3], r[3:6], r[6:9], photo.position]
    image = centred(project, -1.0)
    for point, xyz in enumerate(project.points.coordinates.tolist()):
        words = [str(word) for word in rays_of_point(project, point, image)]
        words[1::4] = [str(int(word) + 1) for word in words[1::4]]
        rows += [xyz, (255, 0, 0), words]
    return text(*rows)


def nvm(project: ExchangedProject) -> str:
    rows: list[object] = ["NVM_V3", "", len(project.photos)]
    rows += [(f'"a b/{photo.name}"', 3000.0, *photo.rotation, *photo.position, 0, 0) for photo in project.photos]
    rows += ["", len(project.points.names)]
    image = centred(project, 1.0)
    for point, xyz in enumerate(project.points.coordinates.tolist()):
        rows.append([*xyz, 1, 2, 3, *rays_of_point(project, point, image)])
    return text(*rows, "", 0)


CASES = [(read_bal, bal, BAL), (read_bundler, bundler, BUNDLER), (read_nvm, nvm, READING)]


@pytest.mark.parametrize(("read", "write", "reading"), CASES)
def test_a_block_is_read_as_it_was_written(
    tmp_path: Path, read: Read, write: Callable[[ExchangedProject], str], reading: object
) -> None:
    given = block(reading)  # type: ignore[arg-type]
    project = with_frame(read_well(read, written(tmp_path / "a", write(given))), *SIZE)
    assert (len(project.photos), len(project.rays.photo)) == (len(given.photos), len(given.rays.photo))
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6


@pytest.mark.parametrize(("read", "write", "reading"), CASES)
def test_a_file_that_is_not_whole_is_refused(
    tmp_path: Path, read: Read, write: Callable[[ExchangedProject], str], reading: object
) -> None:
    whole = write(block(reading))  # type: ignore[arg-type]
    parsed = read(written(tmp_path / "a", whole[: len(whole) // 2]), "a")
    assert parsed.value is None
    assert parsed.complaints


def test_a_corrupt_count_is_told_before_anything_is_read(tmp_path: Path) -> None:
    given = bal(block(BAL)).split("\n", 1)[1]
    parsed = read_bal(written(tmp_path / "a", f"6 60 9999999999999\n{given}"), "a")
    assert "the file is incomplete" in parsed.complaints[0].message
    parsed = read_nvm(written(tmp_path / "b", "NVM_V3\n\n99999999\n"), "b")
    assert "lines follow" in parsed.complaints[0].message


@pytest.mark.parametrize("focal", ["0", "-5", "1e-320", "0.5"])
def test_a_focal_length_that_cannot_be_is_refused(tmp_path: Path, focal: str) -> None:
    whole = nvm(block(READING)).replace(" 3000.0 ", f" {focal} ", 1)
    parsed = read_nvm(written(tmp_path / "a", whole), "a")
    assert "has to be 1 pixel or more" in parsed.complaints[0].message


def test_beginnings_tell_the_formats_apart(tmp_path: Path) -> None:
    texts = {is_bundler: bundler(block(BUNDLER)), is_bal: bal(block(BAL)), is_nvm: nvm(block(READING))}
    for recognises, content in texts.items():
        path = written(tmp_path / "a", content)
        assert [other(path) for other in texts] == [other is recognises for other in texts]
    assert not is_bal(written(tmp_path / "a", "1 2 3\n"))
    assert not is_bal(tmp_path)


def test_names_of_photos_are_those_of_the_list(tmp_path: Path) -> None:
    names = ["zero.jpg", "one.jpg 0 300.0", *(f"{n}.jpg" for n in range(2, 7))]
    written(tmp_path / "list.txt", "\n".join(names))
    source = written(tmp_path / "bundle.out", bundler(block(BUNDLER)))
    project = read_well(read_bundler, source)
    assert [photo.name for photo in project.photos[:2]] == ["one.jpg", "2.jpg"]
    assert project.notes == ("1 photo not oriented, left out.",)
    written(tmp_path / "list.txt", "\n".join(names[:-1]))
    (fault,) = read_bundler(source, "P/bundle.out").complaints
    assert (fault.path, fault.message[:39]) == ("P/list.txt", "6 photos, and bundle.out has 7 cameras:")


def ideal_residuals(project: ExchangedProject) -> np.ndarray:
    """Return the residuals where VisualSFM has them: measurements freed of distortion minus projected points."""
    rotations, centres = orip_poses(project.photos, project.readings[0])
    lengths = np.zeros(len(project.rays.photo))
    for n, photo in enumerate(project.photos):
        rows = np.flatnonzero(project.rays.photo == n)
        seen = (project.points.coordinates[project.rays.point[rows]] - centres[n]) @ rotations[n]
        projected = seen[:, :2] / -seen[:, 2:] * np.array([1.0, -1.0])
        camera = project.cameras[photo.camera]
        image = project.rays.image[rows] - np.array([camera.columns, camera.rows]) / 2.0
        measured = directions_of_image(camera, image)
        lengths[rows] = camera.parameters["f"] * np.hypot(*(measured - projected).T)
    return lengths


def test_the_published_problem_of_bal_is_read() -> None:
    path = data_set("bal") / "problem-49-7776-pre.txt"
    project = read_well(read_bal, path)
    assert (len(project.photos), len(project.points.names), len(project.rays.photo)) == (49, 7776, 31843)
    camera = convert_camera(with_frame(project, 1600, 1200).cameras[0], "C")
    assert camera.is_exact
