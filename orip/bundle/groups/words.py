"""The wording for groups of observations: their names, what contradicts the others, and what to do."""

from __future__ import annotations

from collections.abc import Sequence

from orip.number_text import decimals_of_two_digits
from orip.records.observations.observation_kinds import (
    ANGULAR_UNKNOWNS,
    ATTITUDE,
    CONTROL_POINT,
    DIRECTION,
    DISTANCE,
    ELEMENT,
    PHOTO_POINT,
    STATION,
    ObservationKind,
)
from orip.records.results.group_test import Contradiction, GroupTest
from orip.records.results.solution import Diagnosis
from orip.wording import joined

CODE = "group"
"""Of the diagnoses of contradicting groups; the gravest comes first."""

_KINDS: dict[str, ObservationKind] = {
    "photo": PHOTO_POINT,
    "control": CONTROL_POINT,
    "check": CONTROL_POINT,
    "element": ELEMENT,
    "distance": DISTANCE,
    "direction": DIRECTION,
    "station": STATION,
    "attitude": ATTITUDE,
}
_ELEMENTS = {"CAMERA": "cameras", "POINT": "observed points", "THEODOLITE": "theodolite sets"}
_LENGTH = "XYZ"

_COEFFICIENT, _MOST_DECIMALS = 1e-5, 6
"""Smaller standard deviations are printed with an exponent."""

_REMEDIES = {
    "photo": "check the calibration of the camera and the a-priori error of its photo points",
    "control": "check the coordinate and height system of the control points and their a-priori errors",
    "check": "check the coordinate and height system of the check points, and that their features were measured",
    "element": "check system, units and a-priori errors of the .ELE file; of stations also the offset of the antenna",
    "distance": "check the unit, the calibrated length and the a-priori error of the distances",
    "station": "check the system of the stations, their heights, times and a-priori errors, and the lever arm",
    "attitude": "check the system and the a-priori errors of the attitudes, and the boresight",
    "direction": "check the unit, the instrument's errors and the a-priori error of the directions",
}


def group_diagnosis(contradictions: Sequence[Contradiction], ground_unit: str) -> tuple[Diagnosis, ...]:
    """Return a diagnosis for each contradiction, in their order."""
    return tuple(Diagnosis(CODE, _where(found), _text(found, ground_unit), _remedy(found)) for found in contradictions)


def _where(found: Contradiction) -> str:
    if found.extent != "strip":
        return "exposure stations" if found.groups[0].kind == "station" else "attitudes"
    return joined([group_name(group) for group in found.groups])


def group_name(group: GroupTest) -> str:
    """Return what a group is called: ``Z0 of the exposure stations``, ``distances``."""
    match group.kind:
        case "photo":
            return f"{group.component} of the photo points of camera {group.of}"
        case "control":
            return f"{group.component} of the control points"
        case "check":
            return f"{group.component} of the check points"
        case "element" if group.of == "PHOTO":
            of = "photos" if group.component in ANGULAR_UNKNOWNS else "exposure stations"
            return f"{group.component} of the {of}"
        case "element":
            return f"{group.component} of the {_ELEMENTS[group.of]}"
        case "distance":
            return "distances" if group.component == _LENGTH else f"distances in {group.component}"
        case "station":
            return f"{group.component} of the {_stations(group)}"
        case "attitude":
            return f"{group.component} of the attitudes{_of_strip(group)}"
        case "direction":
            return "zenith angles" if group.component == "zenith" else "directions"


def unit_of_group(group: GroupTest, ground_unit: str) -> str:
    """Return the unit of a group's residuals; empty for pure numbers."""
    return _KINDS[group.kind].unit(group.component, ground_unit)


def _text(found: Contradiction, ground_unit: str) -> str:
    group = found.groups[0]
    name, unit = group_name(group), unit_of_group(group, ground_unit)
    match found.what:
        case "point":
            size = f"{group.worst_size:+.4g} {unit}"
            text = f"check point {group.worst} differs by {size} in {group.component}, more than its standard deviation"
        case "scatter" if group.kind == "check":
            text = f"the {name} differ {group.sigma0:.1f} times more than their standard deviations"
        case "scatter" if group.kind == "photo":
            text = (
                f"the photo points of camera {group.of} fit {group.sigma0:.1f} times worse than their a-priori errors"
            )
        case "scatter":
            text = f"the {name} fit {group.sigma0:.1f} times worse than their a-priori errors"
        case "down-weighted":
            text = f"{group.down_weighted} of {group.number} {name} do not fit and were down-weighted"
        case "shift":
            text = _shift(found, f" {unit}".rstrip())
    return f"{text} ({probability_in_words(found.p)})"


def _stations(group: GroupTest) -> str:
    return f"exposure stations{_of_strip(group)}"


def _of_strip(group: GroupTest) -> str:
    return f" of strip {group.of}" if group.of else ""


def _common(found: Contradiction, unit: str) -> str:
    """Return by what the stations of a strip are off together."""
    group = found.groups[0]
    if found.extent == "lever arm":
        sizes_of_arm = ", ".join(f"{error.component} {_with_sd(error.size, error.sd, '+')}" for error in found.common)
        return f"the exposure stations are all off by a lever arm of {sizes_of_arm}{unit}"
    if found.extent == "all":
        names = "the exposure stations" if group.kind == "station" else "the attitudes"
    else:
        names = f"the {_stations(group)}" if group.kind == "station" else f"the attitudes{_of_strip(group)}"
    others = [f"those{_of_strip(other)}" for other in found.groups[1:]]
    sizes = {
        is_drift: ", ".join(
            f"{error.component} {_with_sd(error.size, error.sd, '+')}"
            for error in found.common
            if error.is_drift == is_drift
        )
        for is_drift in (False, True)
    }
    drift = f", with a drift of {sizes[True]}{unit} a second" if sizes[True] else ""
    contradict = f"; it cannot be told whether {joined(others)} are" if others else ""
    return f"{names} are all off by {sizes[False]}{unit}{drift}{contradict}"


def _shift(found: Contradiction, unit: str) -> str:
    group = found.groups[0]
    if found.common:
        return _common(found, unit)
    size, sd = (group.mean, group.mean_sd) if group.kind == "photo" else (found.shift, found.shift_sd)
    if len(found.groups) > 1:
        names = joined([f"the {group_name(other)}" for other in found.groups])
        return f"{names} contradict each other by about {_with_sd(abs(size), sd)}{unit}"
    about = f"about {_with_sd(size, sd, '+')}{unit}"
    if group.kind == "photo":
        return f"the residuals in {group_name(group)} have a mean of {about}"
    if group.number == 1:
        return f"{_KINDS[group.kind].label} {group.worst} is off by {about}"
    return f"all {group_name(group)} are off by {about}"


def _with_sd(value: float, sd: float, sign: str = "") -> str:
    if sd < _COEFFICIENT:
        return f"{value:{sign}.2e} ± {sd:.1e}"
    decimals = decimals_of_two_digits(sd, 0, _MOST_DECIMALS)
    return f"{value:{sign}.{decimals}f} ± {sd:.{decimals}f}"


def _remedy(found: Contradiction) -> str:
    group = found.groups[0]
    if found.extent == "lever arm":
        arm = ", ".join(f"{error.size:.3f}" for error in found.common)
        return f"set lever_arm = [{arm}] in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}"
    if found.extent == "all" and group.kind == "station":
        return f'set shift = "session" in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}'
    if found.common and group.kind == "station":
        kinds = ['shift = "strip"', *(['drift = "strip"'] if any(error.is_drift for error in found.common) else [])]
        kinds += [f'strips = ["{group.of}"]'] if group.of else []
        return f"set {joined(kinds)} in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}"
    if found.common:
        return f'set unknown = ["BX", "BY", "BZ"] in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}'
    return "; ".join(dict.fromkeys(_REMEDIES[group.kind] for group in found.groups))


def probability_in_words(p: float) -> str:
    """Return a probability as sentences have it: ``p = 0.031``, ``p < 0.0001``."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"
