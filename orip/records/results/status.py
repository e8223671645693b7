"""How an adjustment ended."""

from __future__ import annotations

from typing import Literal

Status = Literal["converged", "doubtful", "not_converged", "stopped"]
"""Doubtful: converged, but something contradicts it."""
