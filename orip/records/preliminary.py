"""Preliminary values: what each step of their computation found, as listings and the terminal show it.

Indices of photos and points are those of one `orip.prelim.rays.ImageRays`. Everything is radians;
coordinates are those of the system that a class names. A model's own system is that of its left photo: origin in the
left projection centre, axes of the left photo, unit the metre at photo scale (millimetres of the photo / 1000).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray

NO_CONTROL = "no control point is in the block, 3 are needed"
"""Why a block, or a photo, is not oriented."""


class PartialBlock(Struct, frozen=True):
    """Photos and points in one system: a model, a strip of bridged models, or the block.

    Parameters
    ----------
    name : str
        Of the model, or of the first model.
    photos : array (p,) of int
    rotations : array (p, 3, 3)
        Photo to system.
    centres : array (p, 3)
    points : array (q,) of int
        Ascending.
    coordinates : array (q, 3)
    deviations : array (q, 3)
        Standard deviations of the coordinates: of the intersection in a model, of what bridging and connection found.
    """

    name: str
    photos: IntArray
    rotations: FloatArray
    centres: FloatArray
    points: IntArray
    coordinates: FloatArray
    deviations: FloatArray


class RelativeOrientation(Struct, frozen=True):
    """The relative orientation of one model (dependent pair: the right photo to the left one).

    Parameters
    ----------
    row, column : int or None
        Place of the model; None for a pair of photos that the chain chose itself.
    points : tuple of str
        n common points.
    left_xy, right_xy : arrays (n, 2)
        Measured photo coordinates, mm.
    parallax : array (n,)
        Residual parallax py, mm.
    parallax_deviation : array (n,)
        Standard deviation spy of the residual parallax, mm.
    weight_factor : array (n,)
        Of the Danish method; below 1: down-weighted.
    in_front : array (n,) of bool
        The point lies in front of both photos.
    base : array (3,)
        Right projection centre in the model's system, metres at photo scale.
    base_deviation : array (3,)
        0 for the component that fixes the scale.
    angles, angle_deviation : arrays (3,)
        omega, phi, kappa of the right photo in the model's system.
    seuw : float
        Standard error of unit weight; 0 with no redundancy.
    max_residual : float
        Largest residual parallax of a point with full weight, mm.
    block : PartialBlock
        Both photos and the points in front of both of them, in the model's system.
    remarks : tuple of str
        Remarks for the user, in sentences.
    """

    model: str
    left: str
    right: str
    row: int | None
    column: int | None
    points: tuple[str, ...]
    left_xy: FloatArray
    right_xy: FloatArray
    parallax: FloatArray
    parallax_deviation: FloatArray
    weight_factor: FloatArray
    in_front: BoolArray
    base: FloatArray
    base_deviation: FloatArray
    angles: FloatArray
    angle_deviation: FloatArray
    iterations: int
    seuw: float
    max_residual: float
    block: PartialBlock
    remarks: tuple[str, ...] = ()


class NotOriented(Struct, frozen=True):
    """A model, a joint or a photo that could not be oriented: its names, and why, as a sentence."""

    name: str
    other: str
    reason: str


class SimilarityStep(Struct, frozen=True):
    """A spatial similarity X = T + m R x that took one system to another: bridging, connection, absolute orientation.

    Parameters
    ----------
    step : {"bridge", "connect", "absolute"}
    source, target : str
        First model of the system that was moved and of the one that stays; target "" is the ground.
    common_photo : str
        Photo that appears in both; "" if none.
    points : tuple of str
        n common points (control points, and "photo NAME" for centres that serve as control); the centre of the common
        photo is not among them.
    coordinates : array (n, 3)
        In the target system; NaN where not known.
    residuals : array (n, 3)
        Transformed minus target; NaN where not known.
    weight_factor : array (n, 3)
    shift, shift_deviation : arrays (3,)
    angles, angle_deviation : arrays (3,)
        omega, phi, kappa of R.
    s0 : float
        Standard error of unit weight; 0 with no redundancy.
    max_residual : float
        Largest residual of full weight, units of the target system.
    """

    step: Literal["bridge", "connect", "absolute"]
    source: str
    target: str
    common_photo: str
    points: tuple[str, ...]
    coordinates: FloatArray
    residuals: FloatArray
    weight_factor: FloatArray
    scale: float
    scale_deviation: float
    shift: FloatArray
    shift_deviation: FloatArray
    angles: FloatArray
    angle_deviation: FloatArray
    iterations: int
    s0: float
    max_residual: float
    remarks: tuple[str, ...] = ()


Stage = Literal["relative", "bridged", "connected", "absolute"]


class ModelCoordinates(Struct, frozen=True):
    """The model coordinate list after a step for all: every system that there is at that stage.

    Parameters
    ----------
    stage : {"relative", "bridged", "connected", "absolute"}
    photos, points : tuples of str
        Names that the indices of the partial blocks count in.
    systems : tuple of PartialBlock
        One a model, one a strip, or one for the block (several where they could not be joined).
    """

    stage: Stage
    photos: tuple[str, ...]
    points: tuple[str, ...]
    systems: tuple[PartialBlock, ...]


class PhotoStart(Struct, frozen=True):
    """Preliminary orientation of one photo, and how it was found.

    Parameters
    ----------
    rotation : array (3, 3) or None
        Photo to ground; None: could not be oriented.
    centre : array (3,) or None
        Ground units.
    how : str
        A sentence: what was done, or why it could not be oriented.
    """

    name: str
    rotation: FloatArray | None
    centre: FloatArray | None
    how: str


class PointStarts(Struct, frozen=True):
    """Preliminary coordinates of q points.

    Parameters
    ----------
    coordinates : array (q, 3)
        Ground units.
    deviations : array (q, 3)
        sX sY sZ; NaN where they are not known.
    """

    names: tuple[str, ...]
    coordinates: FloatArray
    deviations: FloatArray

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.names)


NO_POINTS = PointStarts((), np.empty((0, 3)), np.empty((0, 3)))


class CameraStart(Struct, frozen=True):
    """Preliminary values of an unknown camera.

    Parameters
    ----------
    parameters : tuple of 12 floats
        In the order of `CAMERA_PARAMETERS`; those that are not unknown as given.
    """

    name: str
    parameters: tuple[float, ...]


class ControlReading(Struct, frozen=True):
    """A reading of the control in which it fits a block far better than as given, or equally well.

    Parameters
    ----------
    reading : str
        "longitude, latitude": X and Y are these, in degrees; "latitude, longitude": Y and X are; "mirror image": block
        and control are mirror images of each other; "unit of Z": Z is in another unit than X and Y; "from below": the
        control fits a mirror image equally well, and as given the cameras are below it.
    points : int
        Control points that were compared.
    misfit, misfit_as_given : float
        Typical residuals in this reading and as given, ground units.
    z_factor : float
        What Z has to be multiplied by.
    changes : tuple of str
        Of a mirror image: the changes that bring the projection centres to their known positions; "exchanged": X and Y
        exchanged; "X", "Y", "Z": the opposite sign; "photos": the photos are mirrored, not the control.
    side : float
        Of a mirror image: 1 where the photos look down or stand upright, -1 where they look up or stand on their head,
        0 where neither can be said.
    """

    reading: Literal["longitude, latitude", "latitude, longitude", "mirror image", "unit of Z", "from below"]
    points: int
    misfit: float
    misfit_as_given: float
    z_factor: float = 1.0
    changes: tuple[str, ...] = ()
    side: float = 0.0


class PreliminaryValues(Struct, frozen=True):
    """What the chain found for a block, step by step.

    Parameters
    ----------
    failures : tuple of NotOriented
        Models and joints that failed.
    findings : tuple of str
        What the user should know of the block as a whole, in sentences.
    cameras : tuple of CameraStart
        Unknown cameras, as the orientations of the photos ask for.
    reading : ControlReading or None
        The reading of the control that the block would fit; it has not been taken to the ground then.
    has_arbitrary_datum : bool
        The block is a free network in a system of its own: no coordinates that are given go with it.
    """

    relative: Sequence[RelativeOrientation]
    bridges: tuple[SimilarityStep, ...]
    connections: tuple[SimilarityStep, ...]
    absolute: SimilarityStep | None
    failures: tuple[NotOriented, ...]
    photos: tuple[PhotoStart, ...]
    points: PointStarts
    findings: tuple[str, ...]
    cameras: tuple[CameraStart, ...] = ()
    reading: ControlReading | None = None
    has_arbitrary_datum: bool = False
