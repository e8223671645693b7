"""The first page: whose work it is, in which system and by which method, and the numbers that count."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.results.figures import figure
from orip.records.coded_names import coded
from orip.records.results.solution import Solution
from orip.records.results.stations import POSITION_KINDS
from orip.report.photos import rms_of_photos
from orip.report.report_input import ReportInput, photo_scale
from orip.report.table import counted, significant
from orip.units import METRES_PER_GROUND_UNIT


class Fact(NamedTuple):
    """A line of the first page: what it is about, and what is to be said."""

    label: str
    text: str


def order_facts(given: ReportInput) -> tuple[Fact, ...]:
    """Return what the user gave of the order, without what he left out."""
    details, solution = given.details, given.solution
    found = (
        ("Project", solution.project if details.title else ""),
        ("Client", details.client),
        ("Order", details.order),
        ("Location", details.location),
        ("Photos taken", details.flown),
        ("Equipment", details.equipment),
        ("Contractor", details.contractor),
        ("Author", details.author or solution.user),
        ("Date", details.date),
    )
    return tuple(Fact(label, text) for label, text in found if text)


def method_facts(given: ReportInput) -> tuple[Fact, ...]:
    """Return the reference system, the datum and the method."""
    bundle, solution = given.bundle, given.solution
    unit, precision = solution.ground_unit, bundle.measurement_precision
    system = f"{given.crs}, {unit}" if given.crs else f"local, right-handed, {unit}"
    facts = [
        Fact("Coordinate system", system),
        Fact("Datum", _datum(given)),
        Fact("Method", _method(given)),
        Fact("A-priori error", f"photo coordinates {precision.value:g} {precision.unit}"),
    ]
    adjusted = np.isfinite(solution.cameras.sd)
    calibrated = [name for name, own in zip(solution.cameras.names, adjusted, strict=True) if own.any()]
    cameras = ", ".join(
        f"{name} ({'calibrated here' if name in calibrated else 'held'})" for name in solution.cameras.names
    )
    return (*facts, Fact("Cameras", cameras)) if cameras else tuple(facts)


def key_numbers(given: ReportInput) -> tuple[Fact, ...]:
    """Return the numbers that count."""
    solution = given.solution
    unit, control = solution.ground_unit, _control_points(solution)
    is_position = coded(solution.residuals.kind).where(lambda kind: kind in POSITION_KINDS)
    stations = coded(solution.residuals.photo)[is_position].occurring()
    rays = solution.point_rays[solution.point_rays > 0]
    found = [
        Fact("Photos", str(len(solution.photos.names))),
        Fact("Points", f"{len(solution.points.names)}"),
        Fact("Rays a point, mean", significant(float(rays.mean()), 3) if rays.size else ""),
        Fact("Control points", str(control) if control else ""),
        Fact("Check points", str(len(solution.check_points)) if solution.check_points else ""),
        Fact("Exposure stations", str(len(stations)) if stations else ""),
        *_scale(given),
        Fact("Photo residuals of full weight, RMS", rms_of_photos(given)),
        Fact("Control, RMS in plan", _length(solution, "control.rms_xy", unit)),
        Fact("Control, RMS in height", _length(solution, "control.rms_z", unit)),
        Fact("Check, RMS in plan", _length(solution, "check_points.rms_xy", unit)),
        Fact("Check, RMS in height", _length(solution, "check_points.rms_z", unit)),
        Fact("Points, median sd in plan", _median(solution.points.sd[:, :2], unit)),
        Fact("Points, median sd in height", _median(solution.points.sd[:, 2], unit)),
    ]
    return tuple(fact for fact in found if fact.text)


def _control_points(solution: Solution) -> int:
    return int(np.count_nonzero(coded(solution.point_kinds).where("control".__eq__)))


def _datum(given: ReportInput) -> str:
    solution, datum_points = given.solution, given.bundle.datum_points
    if given.bundle.datum == "free":
        return f"free network, {counted(len(datum_points), 'datum point') if datum_points else 'on all points'}"
    fixed_by = [
        counted(count, noun)
        for count, noun in (
            (_control_points(solution), "control point"),
            (len(solution.exposures), "exposure station"),
        )
        if count
    ]
    return " and ".join(fixed_by) or "as given"


def _method(given: ReportInput) -> str:
    bundle, solution = given.bundle, given.solution
    how = "rigorous bundle adjustment by least squares"
    if solution.blunders:
        return f"{how}, with data snooping"
    if bundle.start_down_weight >= bundle.max_iterations:
        return f"{how}, no observation down-weighted"
    return f"{how}, Danish method above {bundle.max_standard_residual:g} standard errors"


def _scale(given: ReportInput) -> list[Fact]:
    """Return the scale of photos and the size of a pixel on the object, as medians."""
    scale = photo_scale(given)
    metres = METRES_PER_GROUND_UNIT.get(given.solution.ground_unit, np.nan)
    number, pixel = _middle(scale.scale_number * metres * 1000.0), _middle(scale.pixel_on_object)
    facts = []
    if np.isfinite(number):
        facts.append(Fact("Photo scale, median", f"1 : {significant(number, 3)}"))
    if np.isfinite(pixel):
        facts.append(Fact("Pixel on the object (GSD), median", f"{significant(pixel, 2)} {given.solution.ground_unit}"))
    return facts


def _length(solution: Solution, name: str, unit: str) -> str:
    value = figure(solution, name)
    return f"{significant(value)} {unit}" if np.isfinite(value) else ""


def _median(sd: FloatArray, unit: str) -> str:
    value = _middle(sd)
    return f"{significant(value)} {unit}" if np.isfinite(value) else ""


def _middle(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan
