"""MicMac: tie points in binary files and in files of several photos."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from exchange.imported import read_well, reprojected, written
from exchange.test_micmac import project_folder

from orip.exchange.micmac.source import read_micmac
from orip.records.exchanged import ExchangedProject

HEAD = "BeginHeader-MicMacTiePointFormat\n   Version=0.0.0\nEndHeader\n"


def pairs_of(path: Path) -> list[list[float]]:
    return [[float(word) for word in line.split()] for line in path.read_text().splitlines()]


def binary(pairs: list[list[float]]) -> bytes:
    """Return pairs as MicMac's own writer does: cPackNupletsHom::write, a head and then 2, weight, two places."""
    return struct.pack("<ii", 2, len(pairs)) + b"".join(struct.pack("<id4d", 2, 1.0, *pair) for pair in pairs)


def with_binary_pairs(folder: Path) -> Path:
    for path in (project_folder(folder) / "Homol").glob("*/*.txt"):
        path.with_suffix(".dat").write_bytes(binary(pairs_of(path)))
        path.unlink()
    return folder


def with_multiple_ties(folder: Path, *, is_text: bool) -> Path:
    """Put all tie points into one file: each is in all photos."""
    homol = project_folder(folder) / "Homol"
    files = sorted(homol.glob("*/*.txt"))
    chain = [pairs_of(path) for path in files]
    places = [[row[:2] for row in chain[0]], *([row[2:] for row in rows] for rows in chain)]
    for path in files:
        path.unlink()
    count, photos = len(places[0]), len(places)
    names = [f"{n}.jpg={n}" for n in range(photos)]
    rows = [[value for place in places for value in place[n]] for n in range(count)]
    if is_text:
        text = [f"{HEAD}#=*=*=\n1 #Number of attribute / points", f"{photos} #Nb Images", *names, "#=*=", "1 #Nb", ""]
        text += [f"{count} {photos} ", " ".join(map(str, range(photos)))]
        text += [" ".join(map(repr, [*row, 3.0])) for row in rows]
        written(homol / "PMulAll.txt", "\n".join([*text, "#====", ""]))
        return folder
    data = HEAD.encode() + struct.pack("<II", 1, photos) + "".join(f"{name}\n" for name in names).encode()
    data += struct.pack("<III", 1, count, photos) + struct.pack(f"<{photos}I", *range(photos))
    data += b"".join(struct.pack(f"<{2 * photos + 1}d", *row, 3.0) for row in rows)
    (homol / "PMulAll.dat").write_bytes(data)
    return folder


def of_tracks(project: ExchangedProject) -> np.ndarray:
    rays = project.rays
    kept = project.points.is_track[rays.point]
    rows = np.column_stack([rays.photo[kept], rays.image[kept]])
    return rows[np.lexsort(rows.T)]


@pytest.mark.parametrize("form", ["pairs", "multiple", "multiple text"])
def test_tie_points_are_those_of_texts(tmp_path: Path, form: str) -> None:
    expected = of_tracks(read_well(read_micmac, project_folder(tmp_path / "text")))
    folder = tmp_path / "other"
    if form == "pairs":
        with_binary_pairs(folder)
    else:
        with_multiple_ties(folder, is_text=form == "multiple text")
    project = read_well(read_micmac, folder)
    assert np.array_equal(of_tracks(project), expected)
    found, _ = reprojected(project)
    assert found.rms < 1e-6


def test_pairs_come_before_points_in_several_photos(tmp_path: Path) -> None:
    with_multiple_ties(tmp_path, is_text=False)
    project_folder(tmp_path)
    project = read_well(read_micmac, tmp_path)
    assert any("1 file PMul not read" in note for note in project.notes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data[:5], "ends before byte 8"),
        (lambda data: data[:-1], "announced"),
        (lambda data: b"\2\0\0\0\xff\xff\xff\x7f" + data[8:], "2147483647 points in 2 photos"),
        (lambda data: b"\3" + data[1:], "points in 3 photos"),
        (lambda data: data[:8] + b"\7" + data[9:], "byte 8: this is not a pair"),
        (lambda data: data[:20] + struct.pack("<d", np.nan) + data[28:], "byte 8: this is not a pair"),
    ],
)
def test_a_damaged_file_of_pairs(tmp_path: Path, change: object, said: str) -> None:
    path = with_binary_pairs(tmp_path) / "Homol" / "Pastis0.jpg" / "1.jpg.dat"
    path.write_bytes(change(path.read_bytes()))  # type: ignore[operator]
    parsed = read_micmac(tmp_path, "P")
    assert parsed.value is None
    assert said in parsed.complaints[0].message
    assert parsed.complaints[0].path == "P/Homol/Pastis0.jpg/1.jpg.dat"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"EndHeader", b"EndHead", "this is not a file of tie points"),
        (struct.pack("<II", 1, 6), struct.pack("<II", 1, 4000000000), "4000000000 is more than the file has room for"),
        (struct.pack("<II", 1, 6), struct.pack("<II", 1, 7), "is more than"),
        (b"5.jpg=5\n", b"5.jpg=5 ", "more than"),
    ],
)
def test_a_damaged_file_of_several_photos(tmp_path: Path, old: bytes, new: bytes, said: str) -> None:
    path = with_multiple_ties(tmp_path, is_text=False) / "Homol" / "PMulAll.dat"
    assert old in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    parsed = read_micmac(tmp_path, "P")
    assert parsed.value is None
    assert said in parsed.complaints[0].message


@pytest.mark.parametrize(
    ("old", "new"), [("60 6 ", "61 6 "), ("60 6 ", "60 7 "), ("1 #Nb", "x #Nb"), (" 3.0\n", " a\n")]
)
def test_a_damaged_text_of_several_photos(tmp_path: Path, old: str, new: str) -> None:
    path = with_multiple_ties(tmp_path, is_text=True) / "Homol" / "PMulAll.txt"
    assert old in path.read_text()
    written(path, path.read_text().replace(old, new, 1))
    parsed = read_micmac(tmp_path, "P")
    assert parsed.value is None
    assert "line " in parsed.complaints[0].message
