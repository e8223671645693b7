"""Limits of a-priori errors: beyond them weights would differ by more digits than the normal equations have."""

from __future__ import annotations

from msgspec import Struct


class ErrorLimits(Struct, frozen=True):
    """The least and the largest size of an a-priori error, in a unit.

    An error of 0 (constant, where that is possible) and the sign (negative: disregarded) are not judged.
    """

    least: float
    largest: float
    unit: str

    def fault(self, error: float) -> str | None:
        """Return what is wrong with an a-priori error; None for one that is possible, or no number."""
        size = abs(error)
        if 0.0 < size < self.least:
            return (
                f"an a-priori error of {error:g} is smaller than any that makes sense; "
                f"write one from {self.least:g} to {self.largest:g} {self.unit}, or 0 for what is exactly known"
            )
        if size > self.largest:
            return (
                f"an a-priori error of {error:g} is larger than any that makes sense; "
                f"write one from {self.least:g} to {self.largest:g} {self.unit}, or a negative one to disregard"
            )
        return None


GROUND_ERRORS = ErrorLimits(1e-7, 1e6, "ground units")
ANGLE_ERRORS = ErrorLimits(1e-8, 360.0, "degrees")
PHOTO_ERRORS = ErrorLimits(1e-6, 1e3, "mm")
PIXEL_ERRORS = ErrorLimits(1e-4, 1e5, "px")
COEFFICIENT_ERRORS = ErrorLimits(1e-30, 1e3, "of the coefficient's unit")
