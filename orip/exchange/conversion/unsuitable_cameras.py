"""Cameras of other programs that orip cannot hold, whatever their values are fitted by."""

from __future__ import annotations

import numpy as np

from orip.errors import OripError
from orip.exchange.conversion.lenses.table import focal_lengths, lens_parameters
from orip.records.exchanged import ExchangedCamera

_FOCAL_LENGTHS = (1e-3, 1e9)  # pixels or mm; beyond, powers of the focal length are no numbers any more


class UnsuitableCameraError(OripError):
    """Orip has no camera that comes near enough."""

    exit_code = 3


def named(source: ExchangedCamera) -> str:
    """Return how a camera is called in messages: as its file has it."""
    return f"camera '{source.name}' ({source.model})" if source.model else f"camera '{source.name}'"


def require_possible(source: ExchangedCamera) -> None:
    """Refuse a camera whose lens, frame or values cannot be those of a camera of orip.

    Raises
    ------
    UnsuitableCameraError
    """
    what = named(source)
    if source.lens == "unsupported":
        message = (
            f"{what}: orip has perspective and fisheye lenses with polynomial distortion, and this is neither; "
            "calibrate the camera as one of these in the other program"
        )
        raise UnsuitableCameraError(message)
    if source.columns <= 0 or source.rows <= 0:
        message = f"{what}: the number of its columns and rows is not known; give it with --frame COLUMNSxROWS"
        raise UnsuitableCameraError(message)
    focal, shortest, longest = focal_lengths(source), *_FOCAL_LENGTHS
    if (
        not all(np.isfinite(list(lens_parameters(source).values())))
        or not shortest <= min(focal) <= max(focal) <= longest
    ):
        message = (
            f"{what}: its focal length is not between {shortest:g} and {longest:g} {source.lens_axes.unit}, or a "
            "parameter is not finite"
        )
        raise UnsuitableCameraError(message)
