"""The solution in the user's names and units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import get_args

import numpy as np

from orip.adjustment.convergence import TerminationReason
from orip.adjustment.iteration_state import IterationRecord
from orip.adjustment.precision import residual_cofactor
from orip.arrays import BoolArray, IntArray, parts
from orip.bundle.antennas import station_places
from orip.bundle.results.further_records import (
    exposure_estimates,
    figure_estimates,
    mounting_estimates,
    photo_motions,
    rig_estimates,
)
from orip.bundle.results.ground import (
    adjusted_photos,
    adjusted_points,
    deviations,
    photo_correlations,
)
from orip.bundle.results.reliability import CorrelatedFigures, correlated_figures, lost_control, lost_photos
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT, set_names
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.coded_names import CodedNames, joined, repeated
from orip.records.control import PointKind
from orip.records.definition import ANTENNA_PARAMETERS, BORESIGHT, DRIFT, SHIFT
from orip.records.names import places_of_names, record_key
from orip.records.observation_kinds import photos_per_point
from orip.records.results.solution import (
    AdditionalEstimate,
    AntennaEstimate,
    CheckPoint,
    Correlation,
    Estimates,
    Exposure,
    IterationPass,
    Remark,
    Residuals,
    SingularUnknown,
    Solution,
    ZeroDirection,
)
from orip.records.results.tests import Status
from orip.set_aside import set_aside
from orip.threads import by_threads
from orip.units import DEGREES_PER_RADIAN

_DOUBTFUL_SHARE = 0.05
_DOUBTFUL_RATIO = 2.0
_SHOWN_CORRELATION = 0.5
"""Correlation of an antenna's unknown with one of a camera from which it is listed."""

_TESTABLE = 1e-6
"""Redundancy number below which a residual does not show the error of its observation."""


def solution_of(solved: SolvedBlock) -> Solution:
    """Return the solution in the user's names, without what belongs to the project it is of."""
    block, state = solved.block, solved.state
    variance = solved.variance
    equations = solved.equations
    adjusted = adjusted_points(solved)
    points = Estimates(block.point_names, adjusted.values, adjusted.sd)
    photos, correlated = adjusted_photos(solved), list(correlated_figures(solved))
    return Solution(
        project="",
        user="",
        bundle=block.definition.name,
        ground_unit=block.ground_unit,
        run="",
        status=_status(solved),
        sigma0=variance.sigma0,
        sigma0_all=variance.sigma0_all,
        redundancy=variance.redundancy,
        redundancy_used=variance.redundancy_used,
        observations=int(np.count_nonzero(equations.active)),
        unknowns=solved.problem.layout.unknowns + solved.problem.defect,
        enp=solved.iterations[-1].enp,
        iterations=tuple(iteration_pass(record) for record in solved.iterations),
        cameras=Estimates(
            tuple(camera.name for camera in block.cameras),
            state.cameras,
            deviations(solved, solved.problem.unknowns.cameras),
        ),
        projections=tuple(camera.projection for camera in block.cameras),
        photos=Estimates(tuple(photo.name for photo in block.photos), photos.values, photos.sd),
        points=points,
        point_rays=_rays_per_point(solved),
        point_kinds=_point_kinds(block),
        residuals=_residuals(solved, correlated),
        photo_rotation_sd_about_axes=tuple(bool(shown) for shown in photos.about_axes),
        additional=_additional(solved),
        zero_directions=_zero_directions(solved),
        figures=figure_estimates(solved),
        antennas=_antennas(solved),
        rigs=rig_estimates(solved),
        mountings=mounting_estimates(solved),
        rig_exposures=exposure_estimates(solved),
        exposures=_exposures(block),
        motions=photo_motions(solved),
        singular=_singular(solved),
        correlations=(*_camera_correlations(solved), *_antenna_correlations(solved)),
        check_points=_check_points(block, points),
        remarks=tuple(Remark(line) for line in block.ground.description()),
        photo_correlations=photo_correlations(solved),
        point_correlations=adjusted.correlations,
        correlated=tuple(one for figures in correlated for one in figures.reliability),
    )


def iteration_pass(record: IterationRecord) -> IterationPass:
    """Return an iteration as it is printed and stored."""
    return IterationPass(
        record.iteration, record.enp, record.sigma0, record.down_weighted, record.singular, record.step_limited
    )


def _status(solved: SolvedBlock) -> Status:
    termination = solved.reason
    if termination is TerminationReason.STOPPED:
        return "stopped"
    if termination is not TerminationReason.CONVERGED:
        return "not_converged"
    if lost_control(solved) or lost_photos(solved):
        return "not_converged"
    active = solved.equations.active
    share = float(np.mean(solved.weight_factors[active] < 1.0))
    variance = solved.variance
    if share > _DOUBTFUL_SHARE or variance.sigma0_all > _DOUBTFUL_RATIO * variance.sigma0:
        return "doubtful"
    return "converged"


def _rays_per_point(solved: SolvedBlock) -> IntArray:
    points = solved.block.photo_points
    used: BoolArray = points.in_use
    return photos_per_point(points.photo, points.point, used, len(solved.block.point_names))


def _point_kinds(block: Block) -> CodedNames:
    kinds: tuple[PointKind, ...] = get_args(PointKind)
    number, place = np.full(len(block.point_names), kinds.index("tie")), block.point_index()
    for point in block.control_points:
        number[place[point.name]] = kinds.index(point.kind)
    found = CodedNames(kinds, number)
    occurring = found.occurring()
    return CodedNames(occurring, found.places({kind: place for place, kind in enumerate(occurring)}))


def _residuals(solved: SolvedBlock, correlated: Sequence[CorrelatedFigures]) -> Residuals:
    rows = [observations.rows for observations in solved.problem.observations]
    state, equations = solved.state, solved.equations
    error = set_aside(np.concatenate([part.error for part in rows]))
    of_equations = equations.residual * error
    first = 0
    for kind in rows:
        # what a kind adds to its equations (a constant distance, to be met exactly) is not part of the residual
        of_equations[first : first + len(kind.photo)] -= state.memory.get(kind.kind.name, 0.0)
        first += len(kind.photo)
    residual = set_aside(solved.problem.as_observed(of_equations))
    numbers = solved.variance.redundancy_numbers
    active, weight_factors = equations.active, solved.weight_factors
    weight_factors = weight_factors if active.all() else set_aside(np.where(active, weight_factors, np.nan))
    # a block has millions of observations: as few arrays as there have to be
    standard = np.abs(of_equations, out=of_equations)
    standard /= error
    standard = set_aside(standard)
    del of_equations
    w = np.empty_like(standard)

    def put_w(part: slice) -> None:
        shown = np.where(numbers[part] > _TESTABLE, numbers[part], np.nan)
        deviation = np.sqrt(residual_cofactor(shown, weight_factors[part])) * solved.deviation_scale
        np.divide(standard[part], deviation, out=w[part])

    by_threads(put_w, parts(len(w)))
    if correlated:
        numbers = np.array(numbers)
    for figures in correlated:
        numbers[figures.rows], w[figures.rows] = figures.redundancy_number, figures.w
    return Residuals(
        kind=_joined(repeated(part.kind.name, len(part.photo)) for part in rows),
        photo=_joined(part.photo for part in rows),
        point=_joined(part.point for part in rows),
        component=_joined(part.component for part in rows),
        observed=set_aside(np.concatenate([part.observed for part in rows])),
        residual=residual,
        a_priori=error,
        standard_residual=standard,
        weight_factor=weight_factors,
        redundancy_number=numbers,
        w=set_aside(w),
    )


def _joined(columns: Iterable[Sequence[str]]) -> CodedNames:
    names = joined(columns)
    return CodedNames(names.distinct, set_aside(names.codes))


def _additional(solved: SolvedBlock) -> tuple[AdditionalEstimate, ...]:
    sd = deviations(solved, solved.problem.unknowns.additional)
    values = solved.state.additional
    return tuple(
        AdditionalEstimate(camera.name, name, float(values[row, place]), float(sd[row, place]))
        for row, camera in enumerate(solved.block.cameras)
        for place, name in enumerate(set_names(camera))
    )


def _antennas(solved: SolvedBlock) -> tuple[AntennaEstimate, ...]:
    """Return the parameters of the antennas that stations of the block have, then their shifts and drifts."""
    block, state, unknowns = solved.block, solved.state, solved.problem.unknowns
    places = station_places(block)
    unit = np.where(np.isin(np.array(ANTENNA_PARAMETERS), BORESIGHT), DEGREES_PER_RADIAN, 1.0)
    values, sd = state.antennas * unit, deviations(solved, unknowns.antennas) * unit
    found = [
        AntennaEstimate(antenna.name, "", name, float(values[row, column]), float(sd[row, column]))
        for row, antenna in enumerate(block.antennas)
        if row in places.antenna
        for column, name in enumerate(ANTENNA_PARAMETERS)
    ]
    for stretches, names, table, columns in (
        (places.shifts, SHIFT, state.shifts, unknowns.shifts),
        (places.drifts, DRIFT, state.drifts, unknowns.drifts),
    ):
        sd = deviations(solved, columns)
        found += [
            AntennaEstimate(
                block.antennas[stretch.antenna].name, stretch.strip or "", name, float(value), float(deviation)
            )
            for stretch, *row in zip(stretches, table, sd, strict=True)
            for name, value, deviation in zip(names, *row, strict=True)
        ]
    return tuple(found)


def _exposures(block: Block) -> tuple[Exposure, ...]:
    """Return strips and times of the stations, photos as the block has their names."""
    names = {record_key(photo.name): photo.name for photo in block.photos}
    return tuple(Exposure(names[record_key(station.photo)], station.strip, station.time) for station in block.stations)


def _zero_directions(solved: SolvedBlock) -> tuple[ZeroDirection, ...]:
    sd = deviations(solved, solved.problem.unknowns.theodolites) * DEGREES_PER_RADIAN
    values = np.mod(solved.state.theodolites * DEGREES_PER_RADIAN, 360.0)
    return tuple(
        ZeroDirection(theodolite.name, float(value), float(deviation))
        for theodolite, value, deviation in zip(solved.block.theodolites, values, sd, strict=True)
    )


def _singular(solved: SolvedBlock) -> tuple[SingularUnknown, ...]:
    normals = solved.normals
    names = solved.problem.unknowns.names
    if not normals.removed.any():
        return ()
    found, lost_digits = [], normals.lost_digits
    for column in np.flatnonzero(normals.removed):
        name = names[column]
        if name is not None:
            found.append(SingularUnknown(name.group, name.name, name.kind, float(lost_digits[column])))
    return tuple(found)


def _camera_correlations(solved: SolvedBlock) -> tuple[Correlation, ...]:
    """Return the correlations of the unknowns of each camera."""
    found = []
    removed = solved.normals.removed
    for camera, columns in zip(solved.block.cameras, solved.problem.unknowns.cameras, strict=True):
        kinds = [
            (kind, column) for kind, column in zip(CAMERA_PARAMETERS, columns, strict=True)
            if column != CONSTANT and not removed[column]
        ]  # fmt: skip
        for place, (b, column_b) in enumerate(kinds):
            for a, column_a in kinds[:place]:
                cofactor = solved.cofactors.reduced
                r = cofactor[column_a, column_b] / np.sqrt(cofactor[column_a, column_a] * cofactor[column_b, column_b])
                found.append(Correlation(f"{camera.name}.{a}", f"{camera.name}.{b}", float(r)))
    return tuple(found)


def _antenna_correlations(solved: SolvedBlock) -> tuple[Correlation, ...]:
    """Return the correlations of the unknowns of antennas, with each other and with those of the cameras."""
    names, removed, cofactor = solved.problem.unknowns.names, solved.normals.removed, solved.cofactors.reduced
    of_group: dict[str, list[int]] = {"ANTENNA": [], "CAMERA": []}
    for column, name in enumerate(names.reduced):
        if name.group in of_group and not removed[column] and not solved.problem.layout.fixed[column]:
            of_group[name.group].append(column)
    found = []
    for place, b in enumerate(of_group["ANTENNA"]):
        for a in (*of_group["CAMERA"], *of_group["ANTENNA"][:place]):
            r = cofactor[a, b] / np.sqrt(cofactor[a, a] * cofactor[b, b])
            one, other = names.reduced[a], names.reduced[b]
            if one.group == "ANTENNA" or abs(r) > _SHOWN_CORRELATION:
                group = f"{one.group.lower()} {one.name}"
                found.append(Correlation(f"antenna {other.name}.{other.kind}", f"{group}.{one.kind}", float(r)))
    return tuple(found)


def _check_points(block: Block, points: Estimates) -> tuple[CheckPoint, ...]:
    place = places_of_names(points.names)
    found = []
    for point in block.control_points:
        if point.kind == "check" and np.isfinite(points.sd[place[point.name]]).all():
            given = np.array([np.nan if value is None else value for value in point.coordinates])
            difference = points.values[place[point.name]] - given
            found.append(CheckPoint(point.name, *(float(value) for value in difference)))
    return tuple(found)
