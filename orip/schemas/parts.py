"""What several documents have in common."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct


class Part(Struct, frozen=True, forbid_unknown_fields=True):
    """An object of a document: it has the keys that are named, and no others."""


class Warned(Part, frozen=True):
    """A warning: its kind, what it is about, and its text."""

    code: str
    where: str
    text: str


class Estimate(Part, frozen=True):
    """A value with its standard deviation: null for a constant, "singular" for what nothing determines."""

    value: float | None
    sd: float | Literal["singular"] | None


class Named(Part, frozen=True):
    """A name with what it stands for."""

    name: str
    text: str


Status = Literal["converged", "doubtful", "not_converged", "stopped", "not_determined"]
