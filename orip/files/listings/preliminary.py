"""PRELIM_RESULT.OUT: how preliminary values were found, step by step, and the values themselves."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from orip.files.listings.title import title_block
from orip.files.text.table import INDENT, PAGE_WIDTH, Column, one_line, paragraph, section, table_lines
from orip.number_text import decimals_for, fixed, one_fixed
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import PreliminaryPoint
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.preliminary import (
    CameraStart,
    ModelCoordinates,
    NotOriented,
    PartialBlock,
    PreliminaryValues,
    RelativeOrientation,
    SimilarityStep,
)

# The columns and their headings are those that operators know: npts, its, seuw, mres; py and spy; by, bz, om, phi, kp.
# Model coordinates are printed in millimetres at photo scale, those on the ground in ground units. The scale of the
# absolute orientation is in ground units per metre at photo scale.


_ANGLES = ("om", "phi", "kp")
_DOWN = "down-weighted"

_MM = 1000.0
"""Model coordinates are metres at photo scale."""

_SYSTEMS = {
    "bridge": ("Model {}", "model {}"),
    "connect": ("Strip of model {}", "strip of model {}"),
    "absolute": ("Block of model {}", "the ground"),
}
"""What a similarity moves, and to what."""


def relative_overview(models: Sequence[RelativeOrientation]) -> list[str]:
    """Return one line a model."""
    return table_lines(
        [
            Column("Model", [model.model for model in models], align="left"),
            Column("Left", [model.left for model in models], align="left"),
            Column("Right", [model.right for model in models], align="left"),
            Column("npts", [str(len(model.points)) for model in models]),
            Column("its", [str(model.iterations) for model in models]),
            Column("seuw", fixed([model.seuw for model in models], 3)),
            Column("mres", fixed([model.max_residual for model in models], 4), "mm"),
            Column("", [_down_weighted(model) for model in models], align="left"),
        ]
    )


def relative_remarks(models: Sequence[RelativeOrientation]) -> list[str]:
    """Return what there is to say of some models, a paragraph each."""
    return _remarks([f"model {model.model}: {remark}" for model in models for remark in model.remarks], INDENT)


def relative_orientation_lines(model: RelativeOrientation) -> list[str]:
    """Return the points and the orientation parameters of one model."""
    place = "" if model.row is None else f", row {model.row}, column {model.column}"
    return [
        "",
        f"{' ' * INDENT}Model {model.model}:  photo {model.left} (left) and photo {model.right} (right){place}",
        "",
        *_parallaxes(model),
        "",
        *_relative_parameters(model),
        *_remarks(model.remarks, 2 * INDENT),
    ]


def _parallaxes(model: RelativeOrientation) -> list[str]:
    verdicts = [
        _DOWN if weight < 1.0 else "" if front else "behind a photo: not in the model"
        for weight, front in zip(model.weight_factor.tolist(), model.in_front.tolist(), strict=True)
    ]
    return table_lines(
        [
            Column("Point", model.points, align="left"),
            Column("left X", fixed(model.left_xy[:, 0], 4), "mm"),
            Column("left Y", fixed(model.left_xy[:, 1], 4), "mm"),
            Column("right X", fixed(model.right_xy[:, 0], 4), "mm"),
            Column("right Y", fixed(model.right_xy[:, 1], 4), "mm"),
            Column("py", fixed(model.parallax, 5), "mm"),
            Column("spy", fixed(model.parallax_deviation, 5), "mm"),
            Column("", verdicts, align="left"),
        ],
        indent=2 * INDENT,
    )


def _relative_parameters(model: RelativeOrientation) -> list[str]:
    base = zip("xyz", model.base * _MM, model.base_deviation * _MM, strict=True)
    angles = zip(_ANGLES, np.degrees(model.angles), np.degrees(model.angle_deviation), strict=True)
    return table_lines(
        [
            Column("", ["value", "sd"], align="left"),
            *(Column(f"b{axis}", [one_fixed(value, 4), _deviation(sd, 4)], "mm") for axis, value, sd in base),
            *(Column(name, [one_fixed(value, 5), _deviation(sd, 5)], "degrees") for name, value, sd in angles),
        ],
        indent=2 * INDENT,
    )


def similarity_overview(steps: Sequence[SimilarityStep]) -> list[str]:
    """Return one line a bridging or connection."""
    largest = [step.max_residual * _MM for step in steps]
    return table_lines(
        [
            Column("From", [step.source for step in steps], align="left"),
            Column("To", [step.target for step in steps], align="left"),
            Column("Photo in both", [step.common_photo or "-" for step in steps], align="left"),
            Column("npts", [str(len(step.points)) for step in steps]),
            Column("its", [str(step.iterations) for step in steps]),
            Column("seuw", fixed([step.s0 for step in steps], 3)),
            Column("mres", fixed(largest, decimals_for(np.array(largest) / 10.0, at_least=4)), "mm"),
            Column("", [_down_weighted(step) for step in steps], align="left"),
        ]
    )


def similarity_remarks(steps: Sequence[SimilarityStep]) -> list[str]:
    """Return what there is to say of some bridgings or connections, a paragraph each."""
    return _remarks([f"{step.source} to {step.target}: {text}" for step in steps for text in step.remarks], INDENT)


def similarity_lines(step: SimilarityStep, ground_unit: str) -> list[str]:
    """Return the points and the transformation parameters of one similarity."""
    photo = f", photo {step.common_photo} in both" if step.common_photo else ""
    figures = f"pnt {len(step.points)}  its {step.iterations}  s0 {one_fixed(step.s0, 3)}"
    source, target = (
        text.format(name) for text, name in zip(_SYSTEMS[step.step], (step.source, step.target), strict=True)
    )
    factor, unit = (1.0, ground_unit) if step.step == "absolute" else (_MM, "mm")
    return [
        "",
        f"{' ' * INDENT}{source} to {target}{photo}:  {figures}",
        "",
        *_residuals(step, factor, unit),
        "",
        *_similarity_parameters(step, factor, unit, f"{ground_unit}/m" if step.step == "absolute" else ""),
        *_remarks(step.remarks, 2 * INDENT),
    ]


def _residuals(step: SimilarityStep, factor: float, unit: str) -> list[str]:
    residuals = factor * step.residuals
    decimals = decimals_for(np.abs(residuals).max(initial=0.0, where=np.isfinite(residuals)) / 10.0)
    down = np.any(step.weight_factor < 1.0, axis=1).tolist()
    return table_lines(
        [
            Column("Point", step.points, align="left"),
            *(Column(axis, fixed(factor * step.coordinates[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
            *(Column(f"s{axis}", fixed(residuals[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
            Column("", [_DOWN if flag else "" for flag in down], align="left"),
        ],
        indent=2 * INDENT,
    )


def _similarity_parameters(step: SimilarityStep, factor: float, unit: str, scale_unit: str) -> list[str]:
    scale = decimals_for(step.scale_deviation)
    deviations = factor * step.shift_deviation
    shift = decimals_for(deviations)
    shifts = zip("XYZ", factor * step.shift, deviations, strict=True)
    angles = zip(_ANGLES, np.degrees(step.angles), np.degrees(step.angle_deviation), strict=True)
    return table_lines(
        [
            Column("", ["value", "sd"], align="left"),
            Column("scale", [one_fixed(step.scale, scale), _deviation(step.scale_deviation, scale)], scale_unit),
            *(
                Column(f"shift {axis}", [one_fixed(value, shift), _deviation(sd, shift)], unit)
                for axis, value, sd in shifts
            ),
            *(Column(name, [one_fixed(value, 5), _deviation(sd, 5)], "degrees") for name, value, sd in angles),
        ],
        indent=2 * INDENT,
    )


def model_coordinate_lines(found: ModelCoordinates, ground_unit: str) -> list[str]:
    """Return the model coordinate list: centres and points of every system."""
    return [line for system in found.systems for line in _system_lines(system, found, ground_unit)]


def _system_lines(system: PartialBlock, found: ModelCoordinates, ground_unit: str) -> list[str]:
    on_ground = found.stage == "absolute"
    factor, unit = (1.0, ground_unit) if on_ground else (_MM, "mm")
    kinds = ["photo"] * len(system.photos) + ["point"] * len(system.points)
    names = [found.photos[row] for row in system.photos] + [found.points[row] for row in system.points]
    xyz = factor * np.vstack([system.centres, system.coordinates])
    sd = factor * np.vstack([np.full((len(system.photos), 3), np.nan), system.deviations])
    decimals = decimals_for(np.nanmedian(sd) if np.isfinite(sd).any() else [])
    return [
        "",
        f"{' ' * INDENT}{'Ground' if on_ground else f'System of model {system.name}'}:",
        "",
        *table_lines(
            [
                Column("", kinds, align="left"),
                Column("Name", names, align="left"),
                *(Column(axis, fixed(xyz[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
                *(Column(f"s{axis}", fixed(sd[:, k], decimals), unit) for k, axis in enumerate("XYZ")),
            ],
            indent=2 * INDENT,
        ),
    ]


def failure_lines(failures: Sequence[NotOriented]) -> list[str]:
    """Return one paragraph for each model or joint that failed."""
    return [
        line
        for failure in failures
        for line in paragraph(
            f"{failure.name}{f' and {failure.other}' if failure.other else ''}: {failure.reason}", hanging=INDENT
        )
    ]


def _remarks(remarks: Sequence[str], indent: int) -> list[str]:
    lines = [line for remark in remarks for line in paragraph(remark, indent=indent, hanging=INDENT)]
    return ["", *lines] if lines else []


def _deviation(value: float, decimals: int) -> str:
    return "-" if not value > 0.0 else f"({one_fixed(value, decimals)})"


def _down_weighted(step: RelativeOrientation | SimilarityStep) -> str:
    coordinates = tuple(range(1, step.weight_factor.ndim))
    count = np.count_nonzero(np.any(step.weight_factor < 1.0, axis=coordinates))
    return f"{count} {_DOWN}" if count else ""


TITLE = "PRELIMINARY VALUES"


def preliminary_listing(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    points: Sequence[PreliminaryPoint],
    ground_unit: str,
    facts: Sequence[tuple[str, str]],
    run: str,
) -> str:
    """Return PRELIM_RESULT.OUT as one text with a newline at its end.

    Parameters
    ----------
    orientations : sequence of 6 floats a photo
        Elements of `values.photos` as in the files: ground unit and degrees; NaN where there are none.
    points : sequence of PreliminaryPoint
        Those of `values` in the project's coordinates.
    facts : sequence of (label, text)
        Project, user and bundle for the title.
    run : str
        Run id.
    """
    lines = chain(title_block(TITLE, run, facts), _sections(values, orientations, points, ground_unit))
    return "".join(f"{line}\n" for line in lines)


def _sections(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    points: Sequence[PreliminaryPoint],
    ground_unit: str,
) -> Iterator[str]:
    if values.findings:
        yield from section("FINDINGS", [line for finding in values.findings for line in paragraph(finding, hanging=2)])
    yield from section("HOW EACH PHOTO WAS ORIENTED", _how(values))
    if values.failures:
        yield from section("WHAT COULD NOT BE ORIENTED", failure_lines(values.failures))
    if values.relative:
        said = relative_remarks(values.relative)
        yield from section("RELATIVE ORIENTATION", [*relative_overview(values.relative), *said])
    yield from _similarities("MODEL BRIDGING", values.bridges)
    yield from _similarities("CONNECTION", values.connections)
    if values.absolute is not None:
        yield from section("ABSOLUTE ORIENTATION", similarity_lines(values.absolute, ground_unit))
    if values.cameras:
        yield from section("CAMERAS", _cameras(values.cameras))
    yield from section("PHOTOS", _photos(values, orientations, points, ground_unit))
    yield from section("POINTS", _points(points, ground_unit))
    if values.relative:
        details = [line for model in values.relative for line in relative_orientation_lines(model)]
        yield from section("RELATIVE ORIENTATION: POINTS AND PARAMETERS", details)
    for title, steps in (("MODEL BRIDGING", values.bridges), ("CONNECTION", values.connections)):
        if steps:
            details = [line for step in steps for line in similarity_lines(step, ground_unit)]
            yield from section(f"{title}: POINTS AND PARAMETERS", details)


def _similarities(title: str, steps: Sequence[SimilarityStep]) -> Iterator[str]:
    if steps:
        yield from section(title, [*similarity_overview(steps), *similarity_remarks(steps)])


def _how(values: PreliminaryValues) -> list[str]:
    width = PAGE_WIDTH - 2 * INDENT - max(len("Photo"), *(len(photo.name) for photo in values.photos))
    wrapped = [textwrap.wrap(one_line(photo.how), width) or [""] for photo in values.photos]
    names = [
        name
        for photo, lines in zip(values.photos, wrapped, strict=True)
        for name in (photo.name, *[""] * (len(lines) - 1))
    ]
    return table_lines(
        [
            Column("Photo", names, align="left"),
            Column("How", [line for lines in wrapped for line in lines], align="left"),
        ]
    )


def _cameras(cameras: Sequence[CameraStart]) -> list[str]:
    """Return what preliminary values contain of unknown cameras."""
    parameters = np.array([camera.parameters for camera in cameras])
    return table_lines(
        [
            Column("Camera", [camera.name for camera in cameras], align="left"),
            *(Column(kind, fixed(parameters[:, CAMERA_PARAMETERS.index(kind)], 3), "mm") for kind in ("C", "DX", "DY")),
            Column("A3", [f"{value:.3e}" for value in parameters[:, CAMERA_PARAMETERS.index("A3")]], "1/mm²"),
        ]
    )


def _photos(
    values: PreliminaryValues,
    orientations: Sequence[Sequence[float]],
    points: Sequence[PreliminaryPoint],
    ground_unit: str,
) -> list[str]:
    table = np.array(orientations, dtype=np.float64).reshape(-1, 6)
    units = [ground_unit] * 3 + ["degrees"] * 3
    decimals = [_decimals(points)] * 3 + [4] * 3
    return table_lines(
        [
            Column("Photo", [photo.name for photo in values.photos], align="left"),
            *(Column(kind, fixed(table[:, k], decimals[k]), units[k]) for k, kind in enumerate(PHOTO_PARAMETERS)),
        ]
    )


def _points(points: Sequence[PreliminaryPoint], ground_unit: str) -> list[str]:
    xyz = np.array([point.coordinates for point in points], dtype=np.float64).reshape(-1, 3)
    sd = _deviations(points)
    decimals = _decimals(points)
    return table_lines(
        [
            Column("Point", [point.name for point in points], align="left"),
            *(Column(axis, fixed(xyz[:, k], decimals), ground_unit) for k, axis in enumerate("XYZ")),
            *(Column(f"s{axis}", fixed(sd[:, k], decimals), ground_unit) for k, axis in enumerate("XYZ")),
        ]
    )


def _deviations(points: Sequence[PreliminaryPoint]) -> NDArray[np.float64]:
    unknown = (np.nan,) * 3
    return np.array([point.deviations or unknown for point in points], dtype=np.float64).reshape(-1, 3)


def _decimals(points: Sequence[PreliminaryPoint]) -> int:
    """Return the decimals with which a typical standard deviation has two significant digits."""
    sd = _deviations(points)
    return decimals_for(np.nanmedian(sd) if np.isfinite(sd).any() else [])
