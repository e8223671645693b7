"""BINGO and PAT-B, whose rotations the measurements decide."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import block
from exchange.imported import Read, read_well, reprojected, written
from exchange.test_metric import PIXEL_MM, numbers, rows_of

from orip.exchange.bingo import READING, is_bingo, read_bingo
from orip.exchange.patb import READINGS, is_patb, read_patb
from orip.records.exchanged import ExchangedProject, PoseReading
from orip.structs import replace

DEGREES = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree", "centre")


def millimetres(x: float, y: float) -> tuple[float, float]:
    return (x - 2010.0) * PIXEL_MM, (1490.0 - y) * PIXEL_MM


def lists(project: ExchangedProject, head: str, unit: float = 1.0) -> str:
    """Return the measurements of each photo after its head, ended by -99."""
    lines = []
    for photo in project.photos:
        lines.append(f"{photo.name} {head}")
        lines += [
            f"{point} {numbers(*(unit * value for value in millimetres(x, y)))}"
            for name, point, x, y in rows_of(project)
            if name == photo.name
        ]
        lines.append("-99")
    return "\n".join(lines) + "\n"


def bingo_files(folder: Path, project: ExchangedProject) -> Path:
    """Write the files; angles are those of the project, written as phi, omega, kappa."""
    written(folder / "image.dat", "* measurements\n" + lists(project, "CAM").replace("\n59 ", "\n-59 "))
    written(
        folder / "geoin.dat",
        "C a comment\nCAPA CAM x 18.0 0.0 0.0\nCONT 1 1 2 3\nCONT 2 1 2 3 0.1 0.2 0.3\nCHCK 3 1 2 3\nSDEV 1\nSDEV 2\n",
    )
    rows = []
    for photo in project.photos:
        omega, phi, kappa = photo.rotation
        rows.append(f"ORIA {photo.name} {numbers(*photo.position, phi, omega, kappa)}")
    for name, xyz in zip(project.points.names, project.points.coordinates.tolist(), strict=True):
        rows.append(f"CORD {name} {numbers(*xyz)}")
    written(folder / "itera.dat", "\n".join(rows) + "\n")
    return folder


@pytest.mark.parametrize(("reading", "is_as_said"), [(READING, True), (DEGREES, False)])
def test_bingo_is_read_whatever_its_angles_are(tmp_path: Path, reading: PoseReading, is_as_said: bool) -> None:
    folder = bingo_files(tmp_path, block(reading))
    assert is_bingo(folder)
    project = read_well(read_bingo, folder)
    found, is_declared = reprojected(project)
    assert (found.reading, is_declared) == (reading, is_as_said)
    assert found.rms < 1e-6
    assert [point.errors for point in project.control] == [(None, None, None), (0.1, 0.2, 0.3), (-0.01, -0.01, -0.01)]
    assert project.notes[0] == "Keywords of geoin.dat that are not read: SDEV (2 lines)."
    assert (~project.rays.is_active).sum() == len(project.photos)


def patb_files(folder: Path, project: ExchangedProject, unit: float = 1000.0) -> Path:
    rows = []
    for photo in project.photos:
        matrix = np.array(photo.rotation)
        # Fortran's fixed columns: negative numbers touch those before them
        rows.append(f"{photo.name:>16}{'':16}" + "".join(f"{value:16.9f}" for value in photo.position))
        rows += ["".join(f"{value:16.12f}" for value in part) for part in (matrix[:5], matrix[5:])]
    written(folder / "block.ori", "\n".join(rows) + "\n")
    written(folder / "block.im", lists(project, "", unit))
    written(folder / "block.con", "1 10.5 20.5\n2 11 21 5\n-99\n1 30.5\n3 31 5\n-99\n")
    written(folder / "camera.txt", "c = 18.0\n")
    return folder


@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize("reading", READINGS)
def test_patb_is_read_whatever_its_matrix_is(tmp_path: Path, reading: PoseReading, unit: float) -> None:
    folder = patb_files(tmp_path, block(reading), unit)
    assert is_patb(folder)
    project = read_well(read_patb, folder)
    found, is_declared = reprojected(project)
    assert (found.reading, is_declared) == (reading, True)
    # printed with 12 and 9 decimals, and points intersected
    assert found.rms < 1e-5
    assert [point.coordinates for point in project.control] == [
        (10.5, 20.5, 30.5),
        (11.0, 21.0, None),
        (None, None, 31.0),
    ]


def test_numbers_that_touch_are_in_fixed_columns(tmp_path: Path) -> None:
    folder = patb_files(tmp_path, block(READINGS[0]))
    path = folder / "block.ori"
    lines = path.read_text().splitlines()
    lines[1] = "  1.000000000000-10.000000000000-10.000000000000  1.000000000000  1.000000000000"
    written(path, "\n".join(lines))
    project = read_well(read_patb, folder)
    assert project.photos[0].rotation[:5] == (1.0, -10.0, -10.0, 1.0, 1.0)


def test_what_is_wrong_is_told_with_its_line(tmp_path: Path) -> None:
    folder = patb_files(tmp_path, block(READINGS[0]))
    written(folder / "camera.txt", "c = -1\n")
    written(folder / "block.con", "1 10.5\n-99\n1 x\n")
    parsed = read_patb(folder, "P")
    assert [(one.path, one.line) for one in parsed.complaints] == [
        ("P/camera.txt", 1),
        ("P/block.con", 1),
        ("P/block.con", 3),
        ("P/block.con", 4),
    ]
    folder = bingo_files(tmp_path / "b", replace(block(READING)))
    written(folder / "image.dat", "0.jpg CAM\n1 2\n1 x 2\n")
    parsed = read_bingo(folder, "B")
    assert [one.line for one in parsed.complaints] == [2, 3, 3]


def test_orientations_are_found_in_other_upper_and_lower_case(tmp_path: Path) -> None:
    folder = bingo_files(tmp_path, block(READING))
    path = folder / "itera.dat"
    text = path.read_text(encoding="utf-8")
    written(path, text.replace("ORIA 1.jpg", "ORIA 1.JPG").replace("ORIA 2.jpg", "ORIA gone.jpg"))
    project = read_well(read_bingo, folder)
    assert [bool(photo.rotation) for photo in project.photos] == [True, True, False, True, True, True]
    assert "1 photo of image.dat without orientation, as no oriented photo has the names there: 2.jpg." in project.notes


@pytest.mark.parametrize(
    ("read", "files", "name", "last"),
    [
        (read_bingo, bingo_files, "image.dat", "-99\n"),
        (read_patb, patb_files, "block.im", "-99\n"),
        (read_patb, patb_files, "block.con", "1 30.5\n3 31 5\n-99\n"),
        (read_patb, patb_files, "block.con", "-99\n1 30.5\n3 31 5\n-99\n"),
    ],
)
def test_a_file_that_is_cut_off_is_refused(
    tmp_path: Path, read: Read, files: Callable[[Path, ExchangedProject], Path], name: str, last: str
) -> None:
    folder = files(tmp_path, block(READING if read is read_bingo else READINGS[0]))
    path = folder / name
    written(path, path.read_text(encoding="utf-8").removesuffix(last))
    assert [one.path for one in read(folder, "P").complaints if "the file is cut off" in one.message] == [f"P/{name}"]


@pytest.mark.parametrize(
    ("read", "files", "name"),
    [
        (read_bingo, bingo_files, "image.dat"),
        (read_bingo, bingo_files, "geoin.dat"),
        (read_patb, patb_files, "block.im"),
        (read_patb, patb_files, "block.ori"),
        (read_patb, patb_files, "block.con"),
    ],
)
def test_what_is_there_twice_is_refused(
    tmp_path: Path, read: Read, files: Callable[[Path, ExchangedProject], Path], name: str
) -> None:
    folder = files(tmp_path, block(READING if read is read_bingo else READINGS[0]))
    path = folder / name
    written(path, 2 * path.read_text(encoding="utf-8"))
    found = read(folder, "P").complaints
    assert found
    assert all(one.path == f"P/{name}" and ("again" in one.message or "here is more" in one.message) for one in found)
