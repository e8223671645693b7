"""How an adjustment ended."""

from __future__ import annotations

from typing import Literal

Status = Literal["converged", "doubtful", "not_converged", "stopped", "not_determined"]
"""Doubtful: converged, but something contradicts it. Not determined: converged, but the observations leave free where
the block lies or how photos are turned."""

NOT_DETERMINED = frozenset({"datum", "photo-rotations"})
"""Codes of the diagnoses with which a block is not determined."""
