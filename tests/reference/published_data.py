"""Data sets with published answers: where they are, and how their text is read.

They are no part of the project, and lie in ``../shared/reference-data`` beside the repository. They are
projects and results of the Damped Bundle Adjustment Toolbox (Börlin and Grussenmeyer 2013), some in the export format
of PhotoModeler.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import pytest
from msgspec import Struct

REFERENCE_DATA = Path(__file__).parents[3] / "shared" / "reference-data"

ORIENTATION = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
_REPORTED = {"Xc": "X0", "Yc": "Y0", "Zc": "Z0", "Omega": "OMEGA", "Phi": "PHI", "Kappa": "KAPPA"}


def data_set(name: str) -> Path:
    """Return the folder of a data set; where it is absent, the test is skipped."""
    folder = REFERENCE_DATA / name
    if not folder.is_dir():
        pytest.skip(f"the published data set {name} is not in ../shared/reference-data beside the repository")
    return folder


class Published(Struct, frozen=True):
    """A number and, if there is one, its standard deviation, as printed."""

    value: float
    deviation: float = math.nan


def half_digit(number: float, digits: int) -> float:
    """Return half a unit of the last of so many significant digits.

    A twentieth of a unit more is for numbers at the edge of rounding: both programs have iterated to theirs.
    """
    return 0.55 * 10.0 ** (math.floor(math.log10(abs(number))) + 1 - digits)


def records(path: Path) -> Iterator[list[str]]:
    """Yield the fields of the lines of a text table, separated by commas or blanks; ``#`` starts a comment line."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            yield line.replace(",", " ").split()


class Report(Struct, frozen=True):
    """What a result report says of an adjustment.

    Parameters
    ----------
    sigma0, redundancy, unknowns, observations
    camera : mapping of Published
        By "C", "px", "py", "K1" ... "as"; only what was unknown has a deviation.
    correlations : mapping of two of K1, K2, K3 to a coefficient
        Those beyond 0.95, to three digits.
    photos : mapping of photo number to mapping of Published
        By the names of orip; ground unit and degrees.
    text : str
    """

    sigma0: float
    redundancy: int
    unknowns: int
    observations: int
    camera: Mapping[str, Published]
    correlations: Mapping[tuple[str, str], float]
    photos: Mapping[str, Mapping[str, Published]]
    text: str


def read_report(path: Path) -> Report:
    """Read a result report."""
    text = path.read_text(encoding="utf-8")
    camera, correlations = _camera(text.partition("Camera Constant:")[2].partition("Rated angle of view")[0])
    _, *photos = re.split(r"^ +Photo (\d+): .*$", text.partition("\n   Quality")[0], flags=re.MULTILINE)
    return Report(
        float(_figure(text, "Sigma0:")), int(_figure(text, "Redundancy")), int(_figure(text, "Number of params:")),
        int(_figure(text, "Number of observations:")), camera, correlations,
        {number: _orientation(part) for number, part in zip(photos[::2], photos[1::2], strict=True)}, text,
    )  # fmt: skip


def _figure(text: str, label: str) -> str:
    found = re.search(rf"^ +{re.escape(label)} +(\S+)", text, re.MULTILINE)
    assert found is not None, label
    return found[1]


def _estimates(text: str) -> Iterator[tuple[str, Published, str]]:
    """Yield the label, the value with its deviation, and the text of each entry."""
    for entry in re.split(r"^ +(?=\S[^\n]*:\n)", text, flags=re.MULTILINE):
        value, deviation = (re.search(rf"{label}: +(\S+)", entry) for label in ("Value", "Deviation"))
        if value is not None:
            sd = float(deviation[1]) if deviation is not None else math.nan
            yield entry.partition(":\n")[0], Published(float(value[1]), sd), entry


def _camera(text: str) -> tuple[dict[str, Published], dict[tuple[str, str], float]]:
    camera, correlations = {}, {}
    for label, published, entry in _estimates("Camera Constant:" + text):
        name = "C" if label == "Camera Constant" else label.partition(" ")[0]
        camera[name] = published
        for other, percent in re.findall(r"(K\d):(-?[\d.]+)%", entry):
            correlations[name, other] = float(percent) / 100.0
    return camera, correlations


def _orientation(text: str) -> dict[str, Published]:
    return {_REPORTED[label]: published for label, published, _ in _estimates(text)}


class Export(Struct, frozen=True):
    """A PhotoModeler export.

    Parameters
    ----------
    stations : mapping of photo number (from 1) to tuple of 6
        In the order of `ORIENTATION`, ground unit and degrees.
    points : mapping of point to X, Y, Z
    marks : tuple of (photo, point, column, row)
        Of the listed points alone.
    """

    stations: Mapping[str, tuple[float, ...]]
    points: Mapping[str, tuple[float, ...]]
    marks: tuple[tuple[str, str, str, str], ...]


def read_export(path: Path) -> Export:
    """Read a PhotoModeler export."""
    rows = list(records(path))
    # After each image's name come its station, the deviations and two long lines of camera data; then points and marks.
    last_camera = max(place for place, fields in enumerate(rows) if len(fields) in (10, 11))
    stations: dict[str, tuple[float, ...]] = {}
    for name, station in pairwise(rows[: last_camera + 1]):
        if name[-1].endswith(".JPG"):
            x, y, z, kappa, phi, omega = map(float, station[1:])
            stations[str(int(name[0]) + 1)] = (x, y, z, omega, phi, kappa)
    rest = rows[last_camera + 1 :]
    points = {fields[0]: tuple(map(float, fields[1:4])) for fields in rest if len(fields) == 7}
    marks = (fields for fields in rest if len(fields) == 6 and fields[1] in points)
    return Export(
        stations, points, tuple((str(int(photo) + 1), point, column, row) for photo, point, column, row, *_ in marks)
    )
