"""The relative orientation of cameras that move together, from the photos that they took at the same instant."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.report.numbers import decimals_for, fixed
from orip.report.photo_scale import camera_of_photo
from orip.report.report_input import ReportInput
from orip.report.table import PageColumn, PageTable
from orip.units import DEGREES_PER_RADIAN

FEWEST_INSTANTS = 3
_LARGEST_SCATTER = 0.1
"""Of the base of a rig, as a part of how far the first camera moves from one instant to the next."""
_LARGEST_ANGLE = np.radians(5.0)
_NUMBER = re.compile(r"(\d+)(?:\.\w+)?$")
_NOTE = (
    "Cameras whose photos of the same instant (time of the station, else number at the end of the name) are always in "
    "the same relative position. Base: projection centre of the second camera in the system of the first; angles: "
    "rotation of the second camera against the first. ±: standard deviation of the mean, from the scatter between the "
    "instants; scatter: that of one instant, mean of the three axes. The adjustment orients all photos on their own."
)


class Rig(NamedTuple):
    """Two cameras at n instants.

    Parameters
    ----------
    first, second : str
    base : array (n, 3)
        Projection centre of the second camera in the system of the first, ground units.
    rotation : array (n, 3, 3)
        From the second camera to the first.
    """

    first: str
    second: str
    base: FloatArray
    rotation: FloatArray

    @property
    def mean_rotation(self) -> FloatArray:
        """Return the rotation nearest to the mean matrix."""
        u, _, vt = np.linalg.svd(self.rotation.mean(axis=0))
        return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)

    @property
    def turns(self) -> FloatArray:
        """Return the small rotations (n, 3) of the instants against the mean, radians about the first camera's axes."""
        found = self.rotation @ self.mean_rotation.T
        skew = (found - np.swapaxes(found, 1, 2)) / 2.0
        return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


def rig_table(given: ReportInput) -> PageTable | None:
    """Return base and rotation of each two cameras that move together; None where there are none."""
    found = list(rigs(given))
    if not found:
        return None
    unit = given.solution.ground_unit
    base_sd = np.array([_scatter(rig.base) for rig in found])
    angle_sd = np.array([_scatter(rig.turns) for rig in found]) * DEGREES_PER_RADIAN
    count = np.array([len(rig.base) for rig in found])
    base = np.array([rig.base.mean(axis=0) for rig in found])
    angles = np.array([angles_from_rotation(rig.mean_rotation) for rig in found]) * DEGREES_PER_RADIAN
    columns = (
        PageColumn("Cameras", [f"{rig.first}, {rig.second}" for rig in found], words=True),
        PageColumn("Instants", [str(number) for number in count]),
        *_columns(("BX", "BY", "BZ"), base, base_sd, count, unit),
        PageColumn("Scatter", [_sd(row) for row in base_sd], unit),
        *_columns(("OMEGA", "PHI", "KAPPA"), angles, angle_sd, count, "°"),
        PageColumn("Scatter", [_sd(row) for row in angle_sd], "°"),
    )
    return PageTable("", "Relative orientation of cameras that move together", columns, _NOTE)


def rigs(given: ReportInput) -> Iterator[Rig]:
    """Yield each two cameras whose photos of the same instant are always in the same relative position."""
    solution = given.solution
    rotation = rotation_from_angles(solution.photos.values[:, 3:] / DEGREES_PER_RADIAN)
    centre = solution.photos.values[:, :3]
    by_camera = _rows_by_camera(given)
    for first, second in combinations(by_camera, 2):
        common = [instant for instant in by_camera[first] if instant in by_camera[second]]
        if len(common) < FEWEST_INSTANTS:
            continue
        one, other = ([by_camera[name][instant] for instant in common] for name in (first, second))
        back = np.swapaxes(rotation[one], 1, 2)
        rig = Rig(first, second, (back @ (centre[other] - centre[one])[:, :, None])[:, :, 0], back @ rotation[other])
        moved = float(np.median(np.linalg.norm(np.diff(centre[one], axis=0), axis=1)))
        is_fixed = np.linalg.norm(_scatter(rig.base)) <= _LARGEST_SCATTER * moved
        if is_fixed and np.linalg.norm(_scatter(rig.turns)) <= _LARGEST_ANGLE:
            yield rig


def _rows_by_camera(given: ReportInput) -> Mapping[str, Mapping[object, int]]:
    """Return the row of each photo by camera and instant, without instants of which a camera has several photos."""
    solution = given.solution
    instants = _instants(solution)
    found: dict[str, dict[object, int]] = {}
    several: set[tuple[str, object]] = set()
    for row, name in enumerate(solution.photos.names):
        camera, instant = camera_of_photo(given, name), instants.get(name)
        if camera is None or instant is None or not np.isfinite(solution.photos.values[row]).all():
            continue
        if instant in found.setdefault(camera.name, {}):
            several.add((camera.name, instant))
        found[camera.name][instant] = row
    return {
        camera: {instant: row for instant, row in rows.items() if (camera, instant) not in several}
        for camera, rows in sorted(found.items(), key=lambda item: record_key(item[0]))
    }


def _instants(solution: Solution) -> dict[str, object]:
    """Return when each photo was taken: the time of its station in milliseconds, else the number in its name."""
    times = {exposure.photo: exposure.time for exposure in solution.exposures if np.isfinite(exposure.time)}
    found: dict[str, object] = {}
    for name in solution.photos.names:
        number = _NUMBER.search(name)
        if name in times:
            found[name] = ("time", round(1e3 * times[name]))
        elif number is not None:
            found[name] = ("number", int(number[1]))
    return found


def _scatter(values: FloatArray) -> FloatArray:
    return np.asarray(np.std(values, axis=0, ddof=1))


def _sd(row: FloatArray) -> str:
    size = float(np.sqrt(np.mean(row**2)))
    return fixed(size, decimals_for([size]))


def _columns(
    names: tuple[str, ...], values: FloatArray, scatter: FloatArray, count: FloatArray, unit: str
) -> Iterator[PageColumn]:
    for place, name in enumerate(names):
        sd = scatter[:, place] / np.sqrt(count)
        decimals = decimals_for(sd.tolist())
        cells = [f"{fixed(v, decimals)} ± {fixed(s, decimals)}" for v, s in zip(values[:, place], sd, strict=True)]
        yield PageColumn(name, cells, unit)
