"""The wording for groups of observations: their names, what contradicts the others, and what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orip.number_text import decimals_of_two_digits
from orip.records.observation_kinds import (
    ANGULAR_UNKNOWNS,
    ATTITUDE,
    CONTROL_POINT,
    CYLINDER,
    DIFFERENCE,
    DIRECTION,
    DISTANCE,
    ELEMENT,
    GIVEN_DIRECTION,
    HEIGHT,
    LINE,
    PHOTO_POINT,
    PLANE,
    STATION,
    TERRAIN,
    ObservationKind,
)
from orip.records.results.solution import Diagnosis
from orip.records.results.tests import FIGURE_GROUPS, CommonCause, Contradiction, GroupTest
from orip.units import METRES_PER_GROUND_UNIT
from orip.wording import joined

CODE = "group"
"""Of the diagnoses of contradicting groups; the gravest comes first."""

EXPLAINED = "explained-group"
"""Of those whose cause a warning names: all else is looked at after that is corrected."""

_KINDS: dict[str, ObservationKind] = {
    "photo": PHOTO_POINT,
    "control": CONTROL_POINT,
    "check": CONTROL_POINT,
    "element": ELEMENT,
    "distance": DISTANCE,
    "direction": DIRECTION,
    "line": LINE,
    "plane": PLANE,
    "cylinder": CYLINDER,
    "height": HEIGHT,
    "given direction": GIVEN_DIRECTION,
    "terrain": TERRAIN,
    "station": STATION,
    "attitude": ATTITUDE,
    "difference": DIFFERENCE,
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
    "difference": "check the system and the a-priori errors of the .REL file, and the lever arm",
    "direction": "check the unit, the instrument's errors and the a-priori error of the directions",
    "terrain": "check height system and a-priori error of the terrain model, and that its points lie on the ground",
    "given direction": "check the given directions, their points and a-priori errors",
    **dict.fromkeys(FIGURE_GROUPS, "check whether the points are those of the figure, and their a-priori errors"),
}

_LONGEST_ARM, _LARGEST_SHIFT = 3.0, 20.0
"""Metres: from the antenna to a camera on board of an aircraft, and what single-point GNSS is off by."""

_LARGEST_BORESIGHT, _OF_LARGEST = 20.0, 0.1
"""Degrees that a camera is turned by in its mount, and part of the largest angle that hardly counts."""

_PLACES = ("X0", "Y0", "Z0")

_HELD_REMEDY = (
    "check the calibration of the camera; if it was made at another time, or in another state of the camera, set "
    'unknown = ["{component}"] in its [[camera]]'
)


def group_diagnosis(contradictions: Sequence[Contradiction], ground_unit: str) -> tuple[Diagnosis, ...]:
    """Return a diagnosis for each contradiction, in their order."""
    return tuple(
        Diagnosis(CODE, _where(found), _text(found, ground_unit), _remedy(found, ground_unit))
        for found in contradictions
    )


def _where(found: Contradiction) -> str:
    if found.extent in ("all", "lever arm"):
        return "exposure stations" if found.groups[0].kind == "station" else "attitudes"
    if found.extent == "one" and not found.alternatives:
        return f"{_KINDS[found.groups[0].kind].label} {found.groups[0].worst}"
    if found.extent == "held" and not found.alternatives:
        return f"camera {found.groups[0].worst}"
    return joined(list(dict.fromkeys([_named(found), *map(_named, found.alternatives)])))


def _named(found: Contradiction | CommonCause) -> str:
    """Return what has an error in common, without the component where there are several."""
    group = found.group if isinstance(found, CommonCause) else found.groups[0]
    if found.extent == "one":
        return _single(group)
    if found.extent in ("all", "whole", "lever arm"):
        return _stations_of(found).removeprefix("the ")
    return group_name(group)


def _single(group: GroupTest) -> str:
    """Return what a single observation is called: ``distance BAR1``, ``Z of control point 12``."""
    of = "" if group.component == _LENGTH else f"{group.component} of "
    return f"{of}{_KINDS[group.kind].label} {group.worst}"


def group_name(group: GroupTest) -> str:
    """Return what a group is called: ``Z0 of the exposure stations``, ``distances``."""
    match group.kind:
        case "photo":
            return f"{group.component} of the photo points of camera {group.of}"
        case "control":
            return f"{group.component} of the control points" if group.component else "control points"
        case "check":
            return f"{group.component} of the check points"
        case "element":
            return _name_of_elements(group)
        case "distance":
            return "distances" if group.component == _LENGTH else f"distances in {group.component}"
        case "station":
            return f"{group.component} of the {_stations(group)}"
        case "attitude":
            return f"{group.component} of the attitudes{_of_strip(group)}"
        case "difference":
            return f"{group.component} of the station differences"
        case "direction":
            return "zenith angles" if group.component == "zenith" else "directions"
        case _:
            return _name_of_figures(group)


def _name_of_figures(group: GroupTest) -> str:
    if group.kind == "terrain":
        return f"heights on terrain {group.of}"
    if group.kind == "given direction":
        return f"given directions, {group.component}"
    if group.kind == "line":
        return f"distances {'to the side' if group.component == 'side' else 'up'} of points on lines"
    return FIGURE_GROUPS[group.kind]


def _name_of_elements(group: GroupTest) -> str:
    if group.of == "PHOTO":
        of = "photos" if group.component in ANGULAR_UNKNOWNS else "exposure stations"
        return f"{group.component} of the {of}"
    if group.of == "CAMERA" and group.worst:
        return f"{group.component} of camera {group.worst}"
    return f"{group.component} of the {_ELEMENTS[group.of]}"


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
            text = f"the differences of the {name} are {group.sigma0:.1f} times what their standard deviations allow"
        case "scatter" if group.kind == "photo":
            text = (
                f"the residuals of camera {group.of}'s photo points are {group.sigma0:.1f} times their a-priori errors"
            )
        case "scatter":
            text = f"the residuals of the {name} are {group.sigma0:.1f} times their a-priori errors"
        case "down-weighted":
            text = f"{group.down_weighted} of {group.number} {name} do not fit and were down-weighted"
        case "shift":
            text = _shift(found, f" {unit}".rstrip())
    return f"{text} ({probability_in_words(found.p)})"


def _stations(group: GroupTest) -> str:
    return f"exposure stations{_of_strip(group)}"


def _of_strip(group: GroupTest) -> str:
    return f" of strip {group.of}" if group.of else ""


def _stations_of(found: Contradiction | CommonCause) -> str:
    """Return whose positions, attitudes or coordinates are off together."""
    group = found.group if isinstance(found, CommonCause) else found.groups[0]
    of = _of_strip(group) if found.extent == "strip" else ""
    if group.kind in ("station", "element"):
        return f"the exposure stations{of}"
    return f"the attitudes{of}" if group.kind == "attitude" else f"the {group.kind} points"


def _common(found: Contradiction, unit: str) -> str:
    """Return by what stations or control are off together."""
    if found.extent == "lever arm" and not _is_beyond_gnss(found, unit.strip()):
        sizes_of_arm = ", ".join(f"{error.component} {_with_sd(error.size, error.sd, '+')}" for error in found.common)
        return f"the exposure stations are all off by a lever arm of {sizes_of_arm}{unit}"
    if found.extent == "lever arm":
        length = sum(error.size**2 for error in found.common) ** 0.5
        return f"the exposure stations are off by about {length:.4g}{unit}, along the axes of the photos"
    sizes = {
        is_drift: ", ".join(
            f"{error.component} {_with_sd(error.size, error.sd, '+')}"
            for error in found.common
            if error.is_drift == is_drift
        )
        for is_drift in (False, True)
    }
    if found.extent == "one":
        group = found.groups[0]
        return f"{_KINDS[group.kind].label} {group.worst} is off by {sizes[False]}{unit}"
    drift = f", with a drift of {sizes[True]}{unit} a second" if sizes[True] else ""
    return f"{_stations_of(found)} are all off by {sizes[False]}{unit}{drift}"


def _alternatives(found: Contradiction) -> str:
    """Return what else explains the same misfit, to follow what explains it best."""
    if not found.alternatives:
        return ""
    strips = found.extent == "strip" and bool(found.common)
    if strips and all(other.extent == "strip" and other.group.of for other in found.alternatives):
        names = joined([f"those{_of_strip(other.group)}" for other in found.alternatives])
        return f"; it cannot be told whether {names} are"
    names = joined([_cause(other) for other in found.alternatives], "or")
    return f"; it cannot be told whether instead it is {names}"


def _cause(other: CommonCause) -> str:
    if other.extent in ("one", "held"):
        return _named(other)
    if other.group.kind in ("station", "attitude") or other.extent == "whole":
        components = joined(list(other.components))
        shifted = _stations_of(other) + _against(other)
        return f"a shift of {shifted}" + (f" in {components}" if other.extent != "lever arm" else "")
    shifted = f"a shift of all {group_name(other.group)}{_against(other)}"
    return shifted if other.group.kind != "distance" else "all distances"


def _against(other: CommonCause) -> str:
    """Return what the positions of all photos are shifted against, as that may be wrong in their place."""
    group = other.group
    of_all = group.kind == "station" and not group.of and other.extent != "lever arm"
    return " against the control" if of_all or (group.kind == "element" and group.component in _PLACES) else ""


def _are_plain(found: Contradiction) -> bool:
    """Tell whether the error is that of one group or another, and nothing else: they contradict each other."""
    return (
        bool(found.alternatives)
        and not found.common
        and found.extent == "strip"
        and all(
            other.extent == "strip" and other.group.kind not in ("station", "attitude") for other in found.alternatives
        )
    )


def _shift(found: Contradiction, unit: str) -> str:
    group = found.groups[0]
    if found.common:
        return _common(found, unit) + _alternatives(found)
    size, sd = (group.mean, group.mean_sd) if group.kind == "photo" else (found.shift, found.shift_sd)
    if _are_plain(found):
        names = joined([f"the {group_name(other)}" for other in found.groups])
        return f"{names} contradict each other by about {_with_sd(abs(size), sd)}{unit}"
    if not (math.isfinite(size) and math.isfinite(sd)):
        return f"{_named(found)} {'contradicts' if group.number <= 1 else 'contradict'} the other observations"
    about = f"about {_with_sd(size, sd, '+')}{unit}"
    if group.kind == "photo":
        return f"the residuals in {group_name(group)} have a mean of {about}"
    if found.extent == "held":
        return f"{group_name(group)} is off by {about}{_alternatives(found)}"
    if group.number == 1:
        return f"{_single(group)} is off by {about}{_alternatives(found)}"
    return f"all {group_name(group)} are off by {about}{_alternatives(found)}"


def _with_sd(value: float, sd: float, sign: str = "") -> str:
    if sd < _COEFFICIENT:
        return f"{value:{sign}.2e} ± {sd:.1e}"
    decimals = decimals_of_two_digits(sd, 0, _MOST_DECIMALS)
    return f"{value:{sign}.{decimals}f} ± {sd:.{decimals}f}"


def _remedy(found: Contradiction, ground_unit: str) -> str:
    group = found.groups[0]
    if group.kind == "station" and _is_beyond_gnss(found, ground_unit):
        what = "lever arm" if found.extent == "lever arm" else "shift"
        return f"no {what} is so large: {_REMEDIES[group.kind].removesuffix(', and the lever arm')}"
    if found.what == "scatter" and group.kind == "control":
        return f"{_REMEDIES['control']}: they may be less precise than is said, by a factor of {group.sigma0:.1g}"
    if found.extent == "held":
        return _HELD_REMEDY.format(component=group.component)
    if found.extent == "lever arm":
        arm = ", ".join(f"{error.size:.3f}" for error in found.common)
        return (
            f"set lever_arm = [{arm}] in [[antenna]] of orip.toml; or check the principal point of the camera, which "
            f"shifts photos alike; or {_REMEDIES[group.kind]}"
        )
    if found.what == "shift" and group.kind == "element" and group.of == "PHOTO":
        return f"take that off in the .ELE file, if the system or the antenna explains it; or {_REMEDIES[group.kind]}"
    if found.extent == "all" and group.kind == "station":
        return f'set shift = "session" in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}'
    if found.common and group.kind == "station":
        # stations without strips are one
        extent = "strip" if group.of else "session"
        kinds = [
            f'{key} = "{extent}"' for key in ("shift", "drift")[: 1 + any(error.is_drift for error in found.common)]
        ]
        kinds += [f'strips = ["{group.of}"]'] if group.of else []
        return f"set {joined(kinds)} in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}"
    if found.common and group.kind == "attitude":
        if (turn := _turn_of_azimuths(found)) is not None:
            return turn
        return f'set unknown = ["BX", "BY", "BZ"] in [[antenna]] of orip.toml; or {_REMEDIES[group.kind]}'
    return "; ".join(dict.fromkeys(_REMEDIES[group.kind] for group in found.groups))


def _turn_of_azimuths(found: Contradiction) -> str | None:
    """Return what to do where attitudes are turned about the vertical alone, or farther than a camera is mounted."""
    sizes = {error.component: abs(error.size) for error in found.common if not error.is_drift}
    largest = max(sizes.values(), default=0.0)
    if largest > _LARGEST_BORESIGHT:
        return (
            "no boresight is so large: angles are OMEGA, PHI and KAPPA in degrees, about grid axes; convert them, or "
            "write 'ANGLES ROLL PITCH HEADING' as a line before the first station"
        )
    if sizes.get("KAPPA", 0.0) == largest and all(
        size < _OF_LARGEST * largest for component, size in sizes.items() if component != "KAPPA"
    ):
        return (
            "check whether KAPPA counts from grid north, not from true or magnetic north (convergence, declination): "
            'correct it; or set unknown = ["BX", "BY", "BZ"] in [[antenna]] of orip.toml, if the camera is turned'
        )
    return None


def _is_beyond_gnss(found: Contradiction, ground_unit: str) -> bool:
    """Tell whether stations are off by more than an antenna from its camera, or GNSS from the truth."""
    if ground_unit not in METRES_PER_GROUND_UNIT:
        return False
    farthest = max((abs(error.size) for error in found.common if not error.is_drift), default=0.0)
    farthest *= METRES_PER_GROUND_UNIT[ground_unit]
    return farthest > (_LONGEST_ARM if found.extent == "lever arm" else _LARGEST_SHIFT)


def probability_in_words(p: float) -> str:
    """Return a probability as sentences have it: ``p = 0.031``, ``p < 0.0001``."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"
