"""Tables of the steps to preliminary values: relative orientations, similarities, the model coordinate list.

The columns and their headings are those that operators know: npts, its, seuw, mres; py and spy; by, bz, om, phi, kp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.files.number_text import decimals_for, fixed, one_fixed
from orip.files.text_table import INDENT, Column, paragraph, table_lines
from orip.model.preliminary import (
    ModelCoordinates,
    NotOriented,
    RelativeOrientation,
    SimilarityStep,
    SubBlock,
)

_ANGLES = ("om", "phi", "kp")
_DOWN = "down-weighted"


def relative_overview(models: Sequence[RelativeOrientation]) -> list[str]:
    """Return one line a model."""
    return table_lines(
        [
            Column("Model", [each.model for each in models], align="left"),
            Column("Left", [each.left for each in models], align="left"),
            Column("Right", [each.right for each in models], align="left"),
            Column("npts", [str(len(each.points)) for each in models]),
            Column("its", [str(each.iterations) for each in models]),
            Column("seuw", fixed([each.seuw for each in models], 3)),
            Column("mres", fixed([each.max_residual for each in models], 4), "mm"),
            Column("", [_count(int(np.sum(each.weight_factor < 1.0)), _DOWN) for each in models], align="left"),
        ]
    )


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
        *_remarks(model.remarks),
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
    base = zip("xyz", model.base * 1000.0, model.base_deviation * 1000.0, strict=True)
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
    """Return one line a similarity."""
    decimals = decimals_for([each.max_residual / 10.0 for each in steps if each.max_residual > 0.0])
    return table_lines(
        [
            Column("From", [each.source for each in steps], align="left"),
            Column("To", [each.target or "ground" for each in steps], align="left"),
            Column("Photo in both", [each.common_photo or "-" for each in steps], align="left"),
            Column("npts", [str(len(each.points)) for each in steps]),
            Column("its", [str(each.iterations) for each in steps]),
            Column("seuw", fixed([each.s0 for each in steps], 3)),
            Column("mres", fixed([each.max_residual for each in steps], decimals)),
            Column("", [_count(_down_weighted(each), _DOWN) for each in steps], align="left"),
        ]
    )


def similarity_lines(step: SimilarityStep) -> list[str]:
    """Return the points and the transformation parameters of one similarity."""
    photo = f", photo {step.common_photo} in both" if step.common_photo else ""
    figures = f"pnt {len(step.points)}  its {step.iterations}  s0 {one_fixed(step.s0, 3)}"
    title = f"{step.source} to {step.target or 'the ground'}{photo}:  {figures}"
    return [
        "",
        " " * INDENT + title,
        "",
        *_residuals(step),
        "",
        *_similarity_parameters(step),
        *_remarks(step.remarks),
    ]


def _residuals(step: SimilarityStep) -> list[str]:
    finite = np.abs(step.residuals[np.isfinite(step.residuals)])
    decimals = decimals_for([finite.max() / 1000.0] if finite.size else [])
    down = np.any(step.weight_factor < 1.0, axis=1).tolist()
    return table_lines(
        [
            Column("Point", step.points, align="left"),
            *(Column(axis, fixed(step.coordinates[:, k], decimals)) for k, axis in enumerate("XYZ")),
            *(Column(f"s{axis}", fixed(step.residuals[:, k], decimals)) for k, axis in enumerate("XYZ")),
            Column("", [_DOWN if flag else "" for flag in down], align="left"),
        ],
        indent=2 * INDENT,
    )


def _similarity_parameters(step: SimilarityStep) -> list[str]:
    scale = decimals_for([step.scale_deviation])
    shift = decimals_for(step.shift_deviation)
    shifts = zip("XYZ", step.shift, step.shift_deviation, strict=True)
    angles = zip(_ANGLES, np.degrees(step.angles), np.degrees(step.angle_deviation), strict=True)
    return table_lines(
        [
            Column("scale", [one_fixed(step.scale, scale), _deviation(step.scale_deviation, scale)]),
            *(Column(f"shift {axis}", [one_fixed(value, shift), _deviation(sd, shift)]) for axis, value, sd in shifts),
            *(Column(name, [one_fixed(value, 5), _deviation(sd, 5)], "degrees") for name, value, sd in angles),
        ],
        indent=2 * INDENT,
    )


def model_coordinate_lines(found: ModelCoordinates) -> list[str]:
    """Return the model coordinate list: centres and points of every system."""
    return [line for system in found.systems for line in _system_lines(system, found)]


def _system_lines(system: SubBlock, found: ModelCoordinates) -> list[str]:
    kinds = ["photo"] * len(system.photos) + ["point"] * len(system.points)
    names = [found.photos[row] for row in system.photos] + [found.points[row] for row in system.points]
    xyz = np.vstack([system.centres, system.coordinates])
    sd = np.vstack([np.full((len(system.photos), 3), np.nan), system.deviations])
    decimals = 3 if found.stage == "absolute" else 6
    return [
        "",
        f"{' ' * INDENT}{'Ground' if found.stage == 'absolute' else f'System of model {system.name}'}:",
        "",
        *table_lines(
            [
                Column("", kinds, align="left"),
                Column("Name", names, align="left"),
                *(Column(axis, fixed(xyz[:, k], decimals)) for k, axis in enumerate("XYZ")),
                *(Column(f"s{axis}", fixed(sd[:, k], decimals)) for k, axis in enumerate("XYZ")),
            ],
            indent=2 * INDENT,
        ),
    ]


def failure_lines(failures: Sequence[NotOriented]) -> list[str]:
    """Return one paragraph for each model or joint that failed."""
    return [
        line
        for each in failures
        for line in paragraph(f"{each.name}{f' and {each.other}' if each.other else ''}: {each.reason}", hanging=INDENT)
    ]


def _remarks(remarks: Sequence[str]) -> list[str]:
    lines = [line for remark in remarks for line in paragraph(remark, indent=2 * INDENT, hanging=INDENT)]
    return ["", *lines] if lines else []


def _deviation(value: float, decimals: int) -> str:
    return "-" if not value > 0.0 else f"({one_fixed(value, decimals)})"


def _down_weighted(step: SimilarityStep) -> int:
    return int(np.sum(np.any(step.weight_factor < 1.0, axis=1)))


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number else ""
