"""What a report is made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from orip.records.project.camera import Camera
from orip.records.project.definition import BundleDefinition
from orip.records.project.photo import Photo, Template
from orip.records.project.report_details import ReportDetails
from orip.records.results.gate import GateResult
from orip.records.results.solution import Solution


@dataclass(frozen=True, slots=True)
class ReportInput:
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
