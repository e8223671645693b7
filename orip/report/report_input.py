"""What a report is made from."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray, IntArray
from orip.geometry.rotation import rotation_from_angles
from orip.records.coded_names import coded
from orip.records.observations.observation_kinds import PHOTO_POINT
from orip.records.project.camera import Camera
from orip.records.project.definition import BundleDefinition
from orip.records.project.photo import Photo, Template
from orip.records.project.report_details import ReportDetails
from orip.records.results.gate import GateResult
from orip.records.results.solution import Solution
from orip.report.photo_vectors import PhotoVectors, photo_vectors
from orip.units import DEGREES_PER_RADIAN


class ReportInput(Struct, frozen=True, dict=True):
    """A solution with the definitions that it is based on.

    Parameters
    ----------
    solution : Solution
    gates : tuple of GateResult
    bundle : BundleDefinition
    cameras : mapping of record_key to Camera
        Their parameters as they were before the adjustment.
    photos : mapping of record_key to Photo
    templates : mapping of record_key to Template
    details : ReportDetails
    crs : str or None
        Of the project.
    replayed : tuple of (str, str)
        Names and digests of the measurement files as they were replayed last.
    test_level : float or None
        Error probability of the test of one observation; None: that of all tests of the block together is stated.
    """

    solution: Solution
    gates: tuple[GateResult, ...]
    bundle: BundleDefinition
    cameras: Mapping[str, Camera]
    photos: Mapping[str, Photo]
    templates: Mapping[str, Template] = field(default_factory=dict)
    details: ReportDetails = field(default_factory=ReportDetails)
    crs: str | None = None
    replayed: tuple[tuple[str, str], ...] = ()
    test_level: float | None = None

    @cached_property
    def photo_vectors(self) -> Mapping[str, PhotoVectors]:
        """Return the residual vectors of each photo that has photo points."""
        return photo_vectors(self.solution.residuals)

    @cached_property
    def axes(self) -> FloatArray:
        """Return the directions (photos, 3) in which the photos look, ground coordinates."""
        return -rotation_from_angles(self.solution.photos.values[:, 3:] / DEGREES_PER_RADIAN)[:, :, 2]

    @cached_property
    def depths(self) -> FloatArray:
        """Return the median distance (photos,) of each photo's points along its axis, ground unit; NaN if not known."""
        points, values = self.solution.points.values, self.solution.photos.values
        depth = np.full(len(values), np.nan)
        for row, seen in enumerate(self.seen_points):
            along = (points[seen] - values[row, :3]) @ self.axes[row]
            along = along[np.isfinite(along)]
            if along.size:
                depth[row] = _median(along)
        depth[~(depth > 0.0)] = np.nan
        return depth

    @cached_property
    def seen_points(self) -> tuple[IntArray, ...]:
        """Return the rows of the points that each photo of the solution has, in the order of the points."""
        residuals, photos, points = self.solution.residuals, self.solution.photos.names, self.solution.points.names
        photo_row = {name: row for row, name in enumerate(photos)}
        # x and y are in successive rows
        rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__))[::2]
        photo = coded(residuals.photo)[rows].places(photo_row)
        point = coded(residuals.point)[rows].places_among(points)
        is_known = (photo >= 0) & (point >= 0)
        # mostly measured in this order, in which a stable sort leaves what is there
        both = np.sort(photo[is_known] * len(points) + point[is_known], kind="stable")
        both = both[np.diff(both, prepend=-1) > 0]
        photo, point = np.divmod(both, max(len(points), 1))
        return tuple(np.split(point, np.searchsorted(photo, np.arange(1, len(photos))))) if photos else ()


def _median(values: FloatArray) -> float:
    """Return the median of finite numbers; for the few of a photo, `np.median` takes several times as long."""
    middle = len(values) // 2
    upper = np.partition(values, middle)
    below = upper[:middle].max() if len(values) % 2 == 0 else upper[middle]
    return float((below + upper[middle]) / 2.0)
