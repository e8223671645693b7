"""What a search found, in the user's names: blunders with their sizes, and what to do about each."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.adjustment.outlier_tests import LEAST_SIGMA0
from orip.adjustment.residual_sums import joint_effects
from orip.arrays import FloatArray
from orip.bundle.kinds.photo_point import names_of_photo_points
from orip.bundle.kinds.station_difference import disregarded_difference
from orip.bundle.snooping.hypotheses import correlated_groups, size_of_errors
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.control import (
    ControlDirection,
    ControlDistance,
    ControlElement,
    ControlPoint,
    FigurePoint,
    GivenDirection,
    Station,
)
from orip.records.names import record_key
from orip.records.observation_kinds import (
    ATTITUDE,
    CONTROL_POINT,
    DIFFERENCE,
    DIRECTION,
    DISTANCE,
    ELEMENT,
    GIVEN_DIRECTION,
    OBSERVATION_KINDS,
    PHOTO_POINT,
    STATION,
    TERRAIN,
    unit_of_observation,
)
from orip.records.results.solution import Blunder, Diagnosis
from orip.records.results.tests import FIGURE_GROUPS
from orip.structs import replace
from orip.wording import first_names

_NAMED = 6
"""Most alternatives, or unknowns, that a sentence names."""

_SIZES = 6
"""Most sizes of errors in a sentence: of a theodolite set the largest ones."""


_FIGURE = {"line": "line", "plane": "plane", "cylinder": "cylinder", "height": "equal heights"}


class Finding(Struct, frozen=True):
    """Observations that failed their test together.

    Parameters
    ----------
    rows : tuple of int
        Among all observations.
    statistic, limit : float
        Of the test they failed; NaN where the Danish method found them.
    alternatives : tuple of tuples of int
        Rows of other hypotheses that explain the same misfit nearly as well.
    undetermined : tuple of str
        Names of what nothing determines without them.
    kept : bool
        They were not left out, since more than their own points would be undetermined.
    """

    rows: tuple[int, ...]
    statistic: float
    limit: float
    alternatives: tuple[tuple[int, ...], ...] = ()
    undetermined: tuple[str, ...] = ()
    kept: bool = False


class _Listed(Struct, frozen=True):
    """All observations of a block, by their rows: what the user calls them, and their a-priori errors."""

    kind: tuple[str, ...]
    photo: tuple[str, ...]
    point: tuple[str, ...]
    component: tuple[str, ...]
    error: FloatArray

    def names(self, rows: Sequence[int]) -> str:
        """Return what observations that belong together are called."""
        first = rows[0]
        kind, photo, point = self.kind[first], self.photo[first], self.point[first]
        components = ", ".join(dict.fromkeys(self.component[row] for row in rows))
        if kind == PHOTO_POINT.name:
            return f"photo {photo} point {point}"
        if kind == CONTROL_POINT.name:
            return f"control point {point}"
        if kind == DIRECTION.name:
            sights = dict.fromkeys(self.point[row] for row in rows)
            return f"theodolite set {photo}" if len(sights) > 1 else f"{components} {point} of set {photo}"
        if kind == ELEMENT.name:
            return f"{components} of photo {photo}" if photo else f"{components} of {point}"
        if kind in (STATION.name, ATTITUDE.name):
            return f"{OBSERVATION_KINDS[kind].label} of photo {photo}"
        if kind == TERRAIN.name:
            return f"height of point {point} on terrain {photo}"
        if kind == GIVEN_DIRECTION.name:
            return f"given direction {photo}"
        if kind in FIGURE_GROUPS:
            return f"point {point} of {_FIGURE[kind]} {photo}"
        return f"{OBSERVATION_KINDS[kind].label} {point}"


def _listed(solved: SolvedBlock) -> _Listed:
    parts = [kind.rows for kind in solved.problem.observations]
    return _Listed(
        tuple(part.kind.name for part in parts for _ in part.photo),
        tuple(name for part in parts for name in part.photo),
        tuple(name for part in parts for name in part.point),
        tuple(name for part in parts for name in part.component),
        np.concatenate([part.error for part in parts]),
    )


def blunders_of(solved: SolvedBlock, findings: Sequence[Finding]) -> tuple[Blunder, ...]:
    """Return the observations left out, with the size of each error and its standard deviation.

    Of a photo point it is the worse component. Where the adjustment without them does not determine what they measure,
    size and standard deviation are NaN.
    """
    listed = _listed(solved)
    return tuple(
        blunder
        for order, finding in enumerate(_left_out(findings), start=1)
        for blunder in _blunders(solved, listed, finding, order)
    )


def snooping_diagnosis(solved: SolvedBlock, findings: Sequence[Finding]) -> Iterator[Diagnosis]:
    """Return a diagnosis for each finding, in the order they were found."""
    listed = _listed(solved)
    for finding in findings:
        name, kind = listed.names(finding.rows), listed.kind[finding.rows[0]]
        text = f"{name} {_WRONG[kind]}"
        if finding.kept:
            text += f" (test {finding.statistic:.1f}, limit {finding.limit:.1f})"
        else:
            text += f"; it is off by {_sizes(_blunders(solved, listed, finding, 0), solved.block.ground_unit)}"
        if finding.alternatives:
            others = first_names([listed.names(rows) for rows in finding.alternatives], _NAMED)
            text += f"; it cannot be told apart from {others}: one of them is wrong"
        if finding.undetermined:
            unknowns = first_names(finding.undetermined, _NAMED)
            text += f"; nothing else determines {unknowns}" + (", so it was not left out" if finding.kept else "")
        yield Diagnosis("blunder-kept" if finding.kept else "blunder", name, text, _REMEDY[kind])


def without_blunders(block: Block, blunders: Sequence[Blunder]) -> Block:
    """Return the block in which the blunders are disregarded: their residuals are listed, without influence."""
    wrong = {(blunder.kind, blunder.photo, blunder.point, blunder.component) for blunder in blunders}
    differing = {blunder.point for blunder in blunders if blunder.kind == DIFFERENCE.name}
    contradicting = {blunder.point for blunder in blunders if blunder.kind == CONTROL_POINT.name}
    return replace(
        block,
        photo_points=_without_photo_points(block, blunders),
        control_points=tuple(
            _disregarded_point(point) if point.name in contradicting else point for point in block.control_points
        ),
        elements=tuple(
            replace(element, error=-abs(element.error)) if _is_element(element, wrong) else element
            for element in block.elements
        ),
        distances=tuple(
            replace(distance, error=-abs(distance.error)) if _is_distance(distance, wrong) else distance
            for distance in block.distances
        ),
        given_directions=tuple(
            replace(line, error=-abs(line.error)) if _is_given_direction(line, wrong) else line
            for line in block.given_directions
        ),
        figure_points=tuple(
            replace(point, error=-abs(point.error)) if _is_of_figure(point, wrong) else point
            for point in block.figure_points
        ),
        terrain_heights=tuple(
            replace(one, error=-abs(one.error)) if (TERRAIN.name, one.terrain, one.point, "Z") in wrong else one
            for one in block.terrain_heights
        ),
        stations=tuple(_disregarded_station(station, wrong) for station in block.stations),
        directions=tuple(_disregarded_direction(direction, wrong) for direction in block.directions),
        differences=tuple(
            disregarded_difference(line) if line.name in differing else line for line in block.differences
        ),
    )


_WRONG = {
    PHOTO_POINT.name: "is measured wrongly",
    CONTROL_POINT.name: "contradicts the other observations",
    ELEMENT.name: "contradicts the other observations",
    DISTANCE.name: "contradicts the other observations",
    DIRECTION.name: "contradicts the other observations",
    **dict.fromkeys(FIGURE_GROUPS, "does not lie on it"),
    GIVEN_DIRECTION.name: "contradicts the other observations",
    TERRAIN.name: "contradicts the other observations",
    STATION.name: "contradicts the other observations",
    ATTITUDE.name: "contradicts the other observations",
    DIFFERENCE.name: "contradicts the other observations",
}
_REMEDY = {
    PHOTO_POINT.name: "measure it again, or disregard it; check its name",
    CONTROL_POINT.name: "check the coordinates, and whether the feature measured in the photos is the one surveyed",
    ELEMENT.name: "check its value, its a-priori error and the name it is given under, or disregard it",
    DISTANCE.name: "check its value and the names of its two points; measure it again, or disregard it",
    **dict.fromkeys(
        FIGURE_GROUPS, "check its name and whether it belongs to the figure; measure it again, or disregard it"
    ),
    GIVEN_DIRECTION.name: "check its direction and the names of its two points, or disregard it",
    TERRAIN.name: "check whether the point lies on the ground; name it under disregard in [[terrain]] if it does not",
    STATION.name: "check its coordinates, its time and whether its ambiguities were fixed; or disregard it",
    ATTITUDE.name: "check its angles, their a-priori errors and the photo they are given for, or disregard it",
    DIFFERENCE.name: "check the inertial data between its two exposures, and their names; or disregard it",
    DIRECTION.name: "check the reading and the names of station and target; measure it again, or disregard it",
}


def _left_out(findings: Sequence[Finding]) -> list[Finding]:
    return [finding for finding in findings if not finding.kept]


def _blunders(solved: SolvedBlock, listed: _Listed, finding: Finding, order: int) -> list[Blunder]:
    residual, leverage = solved.equations.residual, solved.cofactors.leverage
    observed = solved.problem.as_observed(residual * listed.error)
    sigma0 = max(solved.deviation_scale, LEAST_SIGMA0)
    rows = finding.rows
    known = not solved.normals.removed[solved.equations.design[list(rows)].indices].any()
    if listed.kind[rows[0]] == PHOTO_POINT.name:
        rows = (max(rows, key=lambda row: abs(residual[row])),)
    # the residual of an unused observation has its own error and that of its prediction
    size, sd = -observed[list(rows)], sigma0 * listed.error[list(rows)] * np.sqrt(1.0 + leverage[list(rows)])
    if (correlated := _correlated_sizes(solved, finding.rows)) is not None:
        size, sd = (listed.error[list(rows)] * part for part in correlated)
        sd = sigma0 * sd
    return [
        Blunder(
            order, listed.kind[row], listed.photo[row], listed.point[row], listed.component[row],
            size=float(size[place]) if known else float("nan"),
            sd=float(sd[place]) if known else float("nan"),
            statistic=finding.statistic,
            limit=finding.limit,
            alternatives="; ".join(listed.names(other) for other in finding.alternatives),
        )
        for place, row in enumerate(rows)
    ]  # fmt: skip


def _correlated_sizes(solved: SolvedBlock, rows: Sequence[int]) -> tuple[FloatArray, FloatArray] | None:
    """Return sizes and deviations (k,) over a-priori errors of observations left out; None: they are independent."""
    own, active = np.array(rows), solved.equations.active
    for group in correlated_groups(solved.problem.observations):
        out = group.rows[~active[group.rows]]
        if np.isin(own, out).all():
            effects = joint_effects(solved.equations, solved.normals, solved.problem.layout, out)
            size, deviation = size_of_errors(group, out, effects.residual, effects.cofactor)
            at = np.searchsorted(out, own)
            return size[at], deviation[at]
    return None


def _sizes(blunders: Sequence[Blunder], ground_unit: str) -> str:
    if not np.isfinite([blunder.sd for blunder in blunders]).all():
        return "an amount that nothing determines"
    largest = sorted(blunders, key=lambda blunder: -abs(blunder.size) / blunder.sd)[:_SIZES]
    by_unit: dict[str, list[str]] = {}
    for blunder in (blunder for blunder in blunders if blunder in largest):
        unit = unit_of_observation(blunder.kind, blunder.component, ground_unit)
        by_unit.setdefault(unit, []).append(f"{blunder.component} {blunder.size:+.4g} ± {blunder.sd:.2g}")
    return ", ".join(f"{', '.join(sizes)} {unit}".rstrip() for unit, sizes in by_unit.items())


def _without_photo_points(block: Block, blunders: Sequence[Blunder]) -> IndexedPhotoPoints:
    wrong = {(blunder.photo, blunder.point) for blunder in blunders if blunder.kind == PHOTO_POINT.name}
    points = block.photo_points
    photos = [block.photos[photo].name for photo in points.photo.tolist()]
    keep = [named not in wrong for named in zip(photos, names_of_photo_points(block), strict=True)]
    return replace(points, used=points.used & np.array(keep, dtype=bool)[:, None])


def _disregarded_point(point: ControlPoint) -> ControlPoint:
    x, y, z = (None if error is None else -abs(error) for error in point.errors)
    return replace(point, errors=(x, y, z))


def _is_element(element: ControlElement, wrong: Collection[tuple[str, str, str, str]]) -> bool:
    of_photo = element.group == "PHOTO"
    names = (element.name, "") if of_photo else ("", element.name)
    return (ELEMENT.name, *names, element.kind) in wrong


def _is_distance(distance: ControlDistance, wrong: Collection[tuple[str, str, str, str]]) -> bool:
    return (DISTANCE.name, "", distance.name, distance.code) in wrong


def _is_given_direction(line: GivenDirection, wrong: Collection[tuple[str, str, str, str]]) -> bool:
    return any(one[:3] == (GIVEN_DIRECTION.name, line.name, f"{line.start}-{line.end}") for one in wrong)


def _is_of_figure(point: FigurePoint, wrong: Collection[tuple[str, str, str, str]]) -> bool:
    return any(one[:3] == (point.kind.lower(), point.figure, point.point) for one in wrong)


def _disregarded_station(station: Station, wrong: Collection[tuple[str, str, str, str]]) -> Station:
    key = record_key(station.photo)
    kinds = {kind for kind, photo, *_ in wrong if record_key(photo) == key}
    if STATION.name in kinds:
        x, y, z = (-abs(error) for error in station.position_error)
        station = replace(station, position_error=(x, y, z))
    if ATTITUDE.name in kinds:
        omega, phi, kappa = (-abs(error) for error in station.angle_error)
        station = replace(station, angle_error=(omega, phi, kappa))
    return station


def _disregarded_direction(
    direction: ControlDirection, wrong: Collection[tuple[str, str, str, str]]
) -> ControlDirection:
    name = (DIRECTION.name, direction.set, f"{direction.station}-{direction.target}")
    if (*name, "direction") in wrong:
        direction = replace(direction, direction_error=-abs(direction.direction_error))
    if (*name, "zenith") in wrong and direction.zenith_error is not None:
        direction = replace(direction, zenith_error=-abs(direction.zenith_error))
    return direction
