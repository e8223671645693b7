"""The interior orientation of a template or photo as adjusted, and photo observations as an operator sees them."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from orip.arrays import FloatArray
from orip.records.measurement import MeasuredMarks, TransformationKind
from orip.records.photo import Stage
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


Pair = tuple[float, float]
"""x and y; NaN where there is no value."""

PartnerPlace = Literal["measured", "predicted", "not known"]
"""Where a partner's coordinates come from: its own measurement, the last adjustment, nowhere."""

WhyAgain = Literal["down-weighted", "disregarded", "killed", "single ray"]


class ListedObservation(Struct, frozen=True):
    """One measured photo point with what the last adjustment says of it.

    Parameters
    ----------
    measured : pair
        Template coordinates (plate off a template), mm; pixels of a digital frame.
    error, residual, sd, weight_factor : pairs
        Along the photo axes, mm: a-priori error, adjusted minus observed, standard deviation of the adjusted
        observation; the weight factor is 1 or less. NaN where the point was not adjusted or is disregarded.
    rays : int
        Photos in which the point is measured and not disregarded.
    before : int
        How often the point was measured in this photo before, where every measurement is an observation.
    """

    photo: str
    point: str
    measured: Pair
    error: Pair
    residual: Pair
    sd: Pair
    weight_factor: Pair
    disregarded: bool
    rays: int
    before: int = 0

    @property
    def is_down_weighted(self) -> bool:
        """Tell whether a component had its weight reduced."""
        return any(factor < 1.0 for factor in self.weight_factor)


class StereoPartner(Struct, frozen=True):
    """A photo that shows a point of another photo, measured there or not.

    Parameters
    ----------
    model : str or None
        The model that photo and partner make, if it is defined.
    place : {"measured", "predicted", "not known"}
    photo_xy, log_xy : pairs
        Photo mm, and where to drive to: plate mm of the mounting in force, pixels of a scan or digital frame.
    """

    photo: str
    point: str
    partner: str
    model: str | None
    place: PartnerPlace
    photo_xy: Pair
    log_xy: Pair


class PointToMeasure(Struct, frozen=True):
    """A point to measure (again) in a photo.

    Parameters
    ----------
    why : {"down-weighted", "disregarded", "killed", "single ray"}
    before, predicted : pairs
        Coordinates as in a log: as measured before, and by the last adjustment.
    """

    photo: str
    point: str
    why: WhyAgain
    before: Pair
    predicted: Pair
    residual: Pair
    weight_factor: Pair
