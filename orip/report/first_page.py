"""The first page: whose work it is, its numbers, and whether the adjustment converged and can be trusted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.results.figures import figure
from orip.bundle.results.reliability import number_by_chance
from orip.bundle.verdict import GlobalTest, Level, Untested, headline, sigma0_finding
from orip.records.coded_names import coded
from orip.records.observation_kinds import CONSTANT_DISTANCE, CONSTANT_ELEMENT, DIFFERENCE, DISTANCE, ELEMENT
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.records.results.stations import ATTITUDE_KINDS, POSITION_KINDS
from orip.records.results.tests import GATE_FIGURES
from orip.report.photos import rms_of_photos
from orip.report.report_input import ReportInput, photo_scale
from orip.report.table import PageColumn, PageTable, counted, fixed, length_unit, significant
from orip.units import METRES_PER_GROUND_UNIT
from orip.wording import agreeing

_ELEMENTS = (ELEMENT.name, CONSTANT_ELEMENT.name)
_DISTANCES = (DISTANCE.name, CONSTANT_DISTANCE.name)


class Verdict(Struct, frozen=True):
    """What the page says first."""

    level: Level
    headline: str
    sentences: tuple[str, ...]


def verdict(given: ReportInput, test: GlobalTest | Untested) -> Verdict:
    """Return what to think of the adjustment, in a few sentences."""
    solution = given.solution
    failed = [result for result in given.gates if not result.passed]
    level, text = headline(solution, len(failed), test)
    sentences = [_about_status(solution), _about_sigma0(solution, test)]
    if solution.blunders:
        count = len({blunder.order for blunder in solution.blunders})
        were, blunders = agreeing(count, "was", "were"), agreeing(count, "a blunder", "blunders")
        sentences.append(f"{counted(count, 'observation')} {were} found to be {blunders} and left out.")
    if by_chance := number_by_chance(solution, given.test_level):
        names = agreeing(by_chance, "observation has", "observations have")
        sentences.append(f"{by_chance} {names} lost weight, no more than chance explains; BUNDLE_ERROR.OUT lists them.")
    if given.gates:
        passed = len(given.gates) - len(failed)
        names = f": {', '.join(str(result.gate) for result in failed)} not met" if failed else ""
        sentences.append(f"{passed} of {counted(len(given.gates), 'gate')} passed{names}.")
    if solution.check_points:
        sentences.append(f"{check_point_finding(solution)}.")
    return Verdict(level, text, tuple(sentences))


def gate_table(given: ReportInput) -> PageTable | None:
    """Return the gates with what they found."""
    gates = given.gates
    if not gates:
        return None
    columns = (
        PageColumn("Gate", [str(result.gate) for result in gates], words=True),
        PageColumn("Meaning", [GATE_FIGURES.get(result.gate.name, "") for result in gates], words=True),
        PageColumn("Found", [result.reason or significant(result.value, 5) for result in gates]),
        PageColumn("", ["passed" if result.passed else "FAILED" for result in gates], words=True),
    )
    failed = frozenset(row for row, result in enumerate(gates) if not result.passed)
    return PageTable("", "Gates", columns, emphasised=failed)


def _about_status(solution: Solution) -> str:
    size = (
        f"{counted(solution.observations, 'observation')} of {counted(len(solution.photos.names), 'photo')} and "
        f"{counted(len(solution.points.names), 'point')} determine {counted(solution.unknowns, 'unknown')}"
    )
    ended = {
        "converged": "The adjustment converged",
        "doubtful": "The adjustment converged",
        "not_determined": "The iterations ended without determining the block,",
        "not_converged": "The adjustment did not converge",
        "stopped": "The adjustment was stopped",
    }[solution.status]
    last = f"{ended} in {counted(len(solution.iterations), 'iteration')} (ENP {fixed(solution.enp, 1)}): {size}."
    if solution.status != "doubtful":
        return last
    share = np.count_nonzero(solution.residuals.weight_factor < 1.0)
    return (
        f"{last} It is doubtful: {counted(int(share), 'component')} had to be down-weighted, and over all "
        f"observations sigma0 would be {significant(solution.sigma0_all)}."
    )


def _about_sigma0(solution: Solution, test: GlobalTest | Untested) -> str:
    if test is Untested.ERRORS_ESTIMATED:
        return (
            f"sigma0 is {significant(solution.sigma0)}, which says nothing here: the a-priori errors of the groups "
            f"below are estimated from the same residuals."
        )
    if test is Untested.NO_FULL_WEIGHT:
        return "No observation with full weight is checked by another one: sigma0 cannot be estimated."
    if isinstance(test, Untested):
        return "Nothing is redundant: no observation checks another, and sigma0 cannot be estimated."
    found = f"sigma0 is {significant(solution.sigma0, 4)}, {sigma0_finding(solution.sigma0, test)}."
    if solution.sigma0 < test.lower:
        return f"{found} The standard deviations here take that into account."
    if solution.sigma0 > test.upper:
        return (
            f"{found} The standard deviations here are already multiplied with it, but the cause should be known: "
            f"a-priori errors too small, blunders, or a camera model that does not fit."
        )
    return found


def check_point_finding(solution: Solution) -> str:
    """Return how far check points are off."""
    plan, height = (figure(solution, f"check_points.rms_{part}") for part in ("xy", "z"))
    unit = length_unit([plan, height], solution.ground_unit)
    return (
        f"{counted(len(solution.check_points), 'check point')} with an RMS of {unit.of(plan)} in X and Y "
        f"and {unit.of(height)} in Z"
    )


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
        Fact("Control, RMS in plan", _length(figure(solution, "control.rms_xy"), unit)),
        Fact("Control, RMS in height", _length(figure(solution, "control.rms_z"), unit)),
        Fact("Check, RMS in plan", _length(figure(solution, "check_points.rms_xy"), unit)),
        Fact("Check, RMS in height", _length(figure(solution, "check_points.rms_z"), unit)),
        Fact("Points, median sd in plan", _length(_middle(solution.points.sd[:, :2]), unit)),
        Fact("Points, median sd in height", _length(_middle(solution.points.sd[:, 2]), unit)),
    ]
    return tuple(fact for fact in found if fact.text)


def _control_points(solution: Solution) -> int:
    return int(np.count_nonzero(coded(solution.point_kinds).where("control".__eq__)))


def _datum(given: ReportInput) -> str:
    solution, datum_points = given.solution, given.bundle.datum_points
    if given.bundle.datum == "free":
        return f"free network, {counted(len(datum_points), 'datum point') if datum_points else 'on all points'}"
    held = [counted(count, noun) for count, noun in _holding(solution) if count]
    return (f"{', '.join(held[:-1])} and {held[-1]}" if held[1:] else "".join(held)) or "as given"


def _holding(solution: Solution) -> Iterator[tuple[int, str]]:
    """Yield how many there are of everything given on the ground that takes part, and so holds the block."""
    residuals = solution.residuals
    kind, component = coded(residuals.kind), coded(residuals.component)
    taking_part = ~np.isnan(residuals.weight_factor)
    yield _control_points(solution), "control point"
    for kinds, components, noun in (
        (POSITION_KINDS, "", "exposure station"),
        (ATTITUDE_KINDS, "", "observed attitude"),
        (_ELEMENTS, PHOTO_PARAMETERS[:3], "observed projection centre"),
        (_ELEMENTS, PHOTO_PARAMETERS[3:], "observed rotation"),
    ):
        of_kind = kind.where(lambda own, kinds=kinds: own in kinds)  # type: ignore[misc]
        rows = taking_part & of_kind
        if components:
            rows &= component.where(lambda own, components=components: own in components)  # type: ignore[misc]
        yield len([name for name in coded(residuals.photo)[rows].occurring() if name]), noun
    yield int(np.count_nonzero(taking_part & kind.where(_DISTANCES.__contains__))), "distance"
    yield len(coded(residuals.point)[taking_part & kind.where(DIFFERENCE.name.__eq__)].occurring()), DIFFERENCE.label


def _method(given: ReportInput) -> str:
    bundle, solution = given.bundle, given.solution
    how = "rigorous bundle adjustment by least squares"
    if solution.blunders:
        return f"{how}, with data snooping"
    if not bundle.reduces_weights:
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
        unit = length_unit(pixel, given.solution.ground_unit)
        facts.append(Fact("Pixel on the object (GSD), median", f"{significant(pixel * unit.factor, 2)} {unit.name}"))
    return facts


def _length(value: float, ground_unit: str) -> str:
    return length_unit(value, ground_unit).of(value) if np.isfinite(value) else ""


def _middle(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan
