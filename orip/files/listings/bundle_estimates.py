"""The adjusted values in a bundle listing: cameras, photos, points, check points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.files.text.table import Column, FixedCells, deviation_cells, each_table_line, paragraph, table_lines
from orip.number_text import decimals_for, decimals_of, deviations, fixed, root_mean_square, scientific
from orip.records.camera import CAMERA_PARAMETERS, CAMERA_UNITS, READOUT
from orip.records.definition import MOTION_PARAMETERS
from orip.records.observation_kinds import unit_of_unknown
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import (
    AdditionalEstimate,
    AntennaEstimate,
    ExposureEstimate,
    MountingEstimate,
    Solution,
)

AXES_MARK = "*"

ANGLE_DECIMALS = (4, 7)


def camera_lines(solution: Solution) -> list[str]:
    """Return a table for each camera: parameter, value, standard deviation, unit; then its additional parameters.

    The projection is named where it is not the perspective.
    """
    cameras, lines = solution.cameras, []
    for name, values, sd, projection in zip(
        cameras.names, cameras.values, cameras.sd, solution.projections, strict=True
    ):
        kind = "" if projection == "perspective" else f", {projection} projection"
        lines += ["", f"  Camera {name}{kind}", ""]
        lines += _one_camera(values, sd)
        lines += _additional([parameter for parameter in solution.additional if parameter.camera == name])
    return lines or ["  none"]


def _additional(parameters: Sequence[AdditionalEstimate]) -> list[str]:
    if not parameters:
        return []
    table = table_lines(
        [
            Column("Additional parameter", [parameter.name for parameter in parameters], align="left"),
            Column("Value", scientific([parameter.value for parameter in parameters]), align="point"),
            Column("Standard deviation", deviations([parameter.sd for parameter in parameters], None), align="point"),
        ],
        indent=4,
    )
    return ["", *table]


def _one_camera(values: FloatArray, sd: FloatArray) -> list[str]:
    # most cameras have no readout
    parameters = CAMERA_PARAMETERS if values[READOUT] or not np.isnan(sd[READOUT]) else CAMERA_PARAMETERS[:READOUT]
    units = [CAMERA_UNITS[parameter] for parameter in parameters]
    values, sd = values[: len(parameters)], sd[: len(parameters)]
    lengths = [unit == "mm" for unit in units]
    decimals = _decimals(values[lengths], sd[lengths])
    value_cells = [
        *fixed(values[lengths], decimals),
        *scientific(values[np.logical_not(lengths)]),
    ]
    sd_cells = [
        *deviations(sd[lengths], decimals),
        *deviations(sd[np.logical_not(lengths)], None),
    ]
    return table_lines(
        [
            Column("Parameter", parameters, align="left"),
            Column("Value", value_cells, align="point"),
            Column("Standard deviation", sd_cells, align="point"),
            Column("Unit", units, align="left"),
        ],
        indent=4,
    )


def photo_lines(
    solution: Solution, names: Sequence[str] = PHOTO_PARAMETERS, unit: str = "degrees", finer: int = 0
) -> list[str]:
    """Return the table of photo orientations, standard deviations beneath the values.

    `names` are those of the elements, `unit` that of the angles, which have `finer` decimals more than degrees have.
    """
    photos = solution.photos
    about_axes = solution.photo_rotation_sd_about_axes
    marks = [AXES_MARK if marked else "" for marked in about_axes]
    columns = [
        Column("Photo", _two_lines(photos.names, [""] * len(photos.names)), align="left"),
        Column("", _two_lines([""] * len(marks), [f"sd{mark}" for mark in marks]), align="left"),
    ]
    for k, parameter in enumerate(names):
        group = slice(0, 3) if k < 3 else slice(3, 6)
        limits = (3, 6) if k < 3 else (ANGLE_DECIMALS[0] + finer, ANGLE_DECIMALS[1] + finer)
        decimals = _decimals(photos.values[:, group], photos.sd[:, group], *limits)
        cells = _two_lines(fixed(photos.values[:, k], decimals), deviations(photos.sd[:, k], decimals))
        columns.append(Column(parameter, cells, solution.ground_unit if k < 3 else unit))
    lines = table_lines(columns)
    if any(about_axes):
        footnote = (
            f"{AXES_MARK} PHI is so near to 90 or -90 degrees that OMEGA and KAPPA are not separable: the columns "
            "OMEGA, PHI, KAPPA give standard deviations of rotations about X, Y, Z"
        )
        lines += ["", *paragraph(footnote, hanging=2)]
    return lines


def _two_lines(upper: Sequence[str], lower: Sequence[str]) -> list[str]:
    return [cell for pair in zip(upper, lower, strict=True) for cell in pair]


def point_lines(solution: Solution) -> Iterator[str]:
    """Yield the table of points: kind, rays, coordinates, standard deviations, and the mean precision."""
    points, unit = solution.points, solution.ground_unit
    decimals = _decimals(points.values, points.sd)
    yield from each_table_line(
        [
            Column("Point", points.names, align="left"),
            Column("Kind", solution.point_kinds, align="left"),
            Column("Rays", list(map(str, solution.point_rays.tolist()))),
            *(Column(axis, FixedCells(points.values[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
            *(Column(f"s{axis}", deviation_cells(points.sd[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
        ]
    )
    yield from _mean_precision(points.sd, decimals, unit)


def zero_direction_lines(solution: Solution) -> list[str]:
    """Return the table of the zero directions of theodolite sets."""
    rows = solution.zero_directions
    sd = np.array([row.sd for row in rows], dtype=np.float64)
    values = np.array([row.value for row in rows], dtype=np.float64)
    decimals = _decimals(values, sd, *ANGLE_DECIMALS)
    return table_lines(
        [
            Column("Set", [row.set for row in rows], align="left"),
            Column("R", fixed(values, decimals), "degrees"),
            Column("sR", deviations(sd, decimals), "degrees"),
        ]
    )


def motion_lines(solution: Solution) -> list[str]:
    """Return the table of the motions of photos of rolling shutters, standard deviations of unknown ones beneath."""
    motions = solution.motions
    with_sd = any(not np.isnan(row.VX_sd) or not np.isnan(row.WX_sd) for row in motions)
    nothing = [""] * len(motions)

    def cells(first: list[str], second: list[str]) -> list[str]:
        return _two_lines(first, second) if with_sd else first

    columns = [Column("Photo", cells([row.photo for row in motions], nothing), align="left")]
    for kind in MOTION_PARAMETERS:
        values = np.array([getattr(row, kind) for row in motions])
        sd = deviations(np.array([getattr(row, f"{kind}_sd") for row in motions]), 3)
        columns.append(Column(kind, cells(fixed(values, 3), sd), unit_of_unknown(kind, solution.ground_unit)))
    columns.append(Column("Motion", cells(fixed([row.pixels for row in motions], 1), nothing), "pixels"))
    return table_lines(columns)


def figure_lines(solution: Solution) -> list[str]:
    """Return the table of the figures that points lie on: a place, direction and radius, with standard deviations."""
    rows, unit = solution.figures, solution.ground_unit
    places = np.array([(row.X, row.Y, row.Z, row.radius) for row in rows], dtype=np.float64)
    sd = np.array([(row.sd_place, row.sd_direction, row.sd_radius) for row in rows], dtype=np.float64)
    directions = np.array([(row.dX, row.dY, row.dZ) for row in rows], dtype=np.float64)
    decimals, of_angles = _decimals(places, sd[:, ::2]), _decimals(np.zeros(1), sd[:, 1], *ANGLE_DECIMALS)
    return table_lines(
        [
            Column("Figure", [row.name for row in rows], align="left"),
            Column("Kind", [row.kind for row in rows], align="left"),
            Column("Points", [str(row.points) for row in rows]),
            *(Column(axis, fixed(places[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
            Column("Radius", fixed(places[:, 3], decimals), unit),
            *(Column(f"d{axis}", fixed(directions[:, k], 6)) for k, axis in enumerate("XYZ")),
            Column("s place", deviations(sd[:, 0], decimals), unit),
            Column("s direction", deviations(sd[:, 1], of_angles), "degrees"),
            Column("s radius", deviations(sd[:, 2], decimals), unit),
            Column("RMS v", fixed(np.array([row.rms for row in rows]), decimals), unit),
        ]
    )


def antenna_lines(solution: Solution) -> list[str]:
    """Return the table of the parameters of antennas, and of the shifts and drifts of their strips."""
    rows = solution.antennas
    names = {"Antenna": [row.antenna for row in rows], "Strip": [row.strip for row in rows]}
    return _parameter_lines(rows, names, solution.ground_unit)


def mounting_lines(solution: Solution) -> list[str]:
    """Return the table of the parameters of mountings."""
    rows = solution.mountings
    names = {"Rig": [row.rig for row in rows], "Camera": [row.camera for row in rows]}
    return _parameter_lines(rows, names, solution.ground_unit)


def exposure_lines(solution: Solution) -> list[str]:
    """Return the table of the elements of exposures."""
    rows = solution.rig_exposures
    names = {"Exposure": [row.exposure for row in rows], "Rig": [row.rig for row in rows]}
    return _parameter_lines(rows, names, solution.ground_unit)


def _parameter_lines(
    rows: Sequence[AntennaEstimate | MountingEstimate | ExposureEstimate],
    names: Mapping[str, Sequence[str]],
    ground_unit: str,
) -> list[str]:
    decimals = [_decimals(np.array([row.value]), np.array([row.sd]), 3, 8) for row in rows]
    values = [fixed([row.value], own)[0] for row, own in zip(rows, decimals, strict=True)]
    sd = [deviations(np.array([row.sd]), own)[0] for row, own in zip(rows, decimals, strict=True)]
    return table_lines(
        [
            *(Column(heading, of_rows, align="left") for heading, of_rows in names.items()),
            Column("Parameter", [row.name for row in rows], align="left"),
            Column("Value", values, align="point"),
            Column("Standard deviation", sd, align="point"),
            Column("Unit", [unit_of_unknown(row.name, ground_unit) for row in rows], align="left"),
        ]
    )


def variance_component_lines(solution: Solution) -> list[str]:
    """Return the table of estimated a-priori errors, as factors of the given ones."""
    rows = solution.variance_components
    table = table_lines(
        [
            Column("Observations", [row.name for row in rows], align="left"),
            Column("Number", [str(row.number) for row in rows]),
            Column("Redundancy", fixed([row.redundancy for row in rows], 2)),
            Column("Factor", fixed([row.factor for row in rows], 3)),
            Column("sd", fixed([row.sd for row in rows], 3)),
            Column("p", fixed([row.p for row in rows], 4)),
        ]
    )
    note = (
        "Factor: estimated over given a-priori error; the adjustment uses the estimated errors. p: probability of a "
        "factor as far from 1 by chance if the given errors are right. Groups without a factor keep the given errors."
    )
    return [*table, "", *paragraph(note)]


def _mean_precision(sd: FloatArray, decimals: int, unit: str) -> list[str]:
    known = np.isfinite(sd)
    if not known.any():
        return []
    means = [root_mean_square(sd[:, k]) for k in range(3)]
    columns = [
        Column("", list("XYZ"), align="left"),
        Column("RMS", fixed(means, decimals), unit),
        Column("Coordinates", [str(count) for count in known.sum(axis=0).tolist()]),
    ]
    return ["", "  Root mean square of the standard deviations of the points", "", *table_lines(columns, indent=4)]


def check_point_lines(solution: Solution) -> list[str]:
    """Return the differences at check points, and their root mean squares.

    The root mean square of XY is that of one coordinate: sqrt(sum(dX² + dY²) / 2n).
    """
    points, unit = solution.check_points, solution.ground_unit
    differences = np.array([(point.dX, point.dY, point.dZ) for point in points], dtype=np.float64).reshape(-1, 3)
    decimals = max(_decimals(solution.points.values, solution.points.sd), 4)
    lines = table_lines(
        [
            Column("Point", [point.name for point in points], align="left"),
            *(Column(f"d{axis}", fixed(differences[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
        ]
    )
    return lines + _check_figures(differences, decimals, unit)


def _check_figures(differences: FloatArray, decimals: int, unit: str) -> list[str]:
    parts = {"XY": differences[:, :2], "Z": differences[:, 2:]}
    known = {label: part[np.isfinite(part)] for label, part in parts.items() if np.isfinite(part).any()}
    if not known:
        return []
    columns = [
        Column("", list(known), align="left"),
        Column("RMS", fixed([root_mean_square(part) for part in known.values()], decimals), unit),
        Column("Largest", fixed([float(np.abs(part).max()) for part in known.values()], decimals), unit),
        Column("Differences", [str(part.size) for part in known.values()]),
    ]
    return ["", "  Root mean squares; XY: of one coordinate", "", *table_lines(columns, indent=4)]


def _decimals(values: FloatArray, sd: FloatArray, at_least: int = 3, at_most: int = 6) -> int:
    # where nothing was estimated, the given values are printed as they were given
    if np.any(np.isfinite(sd) & (sd > 0.0)):
        return decimals_for(sd, at_least, at_most)
    return decimals_of(values, at_least, at_most)
