"""The interior orientation of one template or photo, as adjusted: marks, residuals, parameters."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from orip.arrays import FloatArray
from orip.records.observations.measurement import MeasuredMarks, TransformationKind
from orip.records.project.photo import Stage
from orip.records.results.solution import InteriorSummary


class MarkAdjustment(Struct, frozen=True):
    """A plane transformation found from marks.

    Parameters
    ----------
    summary : InteriorSummary
        Name, parameters, s0 and redundancy.
    kind : {"A", "C", "W"}
    system : {"plate", "template"}
        System of the measured coordinates; the given ones are template (ticks) or photo (fiducials) mm.
    stage : {"UPPER", "LOWER"} or None
    marks : MeasuredMarks
        Measured coordinates (mm) and the disregarded ones.
    given : array (n, 2)
        Given coordinates, mm.
    residuals : array (n, 2)
        VX, VY: transformed minus given, mm, disregarded marks included.
    mirrored : bool
        The affine determinant is negative: the film lies upside down.
    """

    summary: InteriorSummary
    kind: TransformationKind
    system: Literal["plate", "template"]
    stage: Stage | None
    marks: MeasuredMarks
    given: FloatArray
    residuals: FloatArray
    mirrored: bool
