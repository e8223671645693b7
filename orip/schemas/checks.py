"""What checks, reports and comparisons of results print."""

from __future__ import annotations

from typing import Literal

from msgspec import UNSET, UnsetType, field

from orip.schemas.project import Part, Status, Warned


class Gate(Part, frozen=True):
    """A gate with the figure that it limits; the reason says why a value is null."""

    name: str
    operator: Literal["<", "<=", ">", ">=", "==", "!="]
    limit: float
    value: float | None
    passed: bool = field(name="pass")
    reason: str | None


class Check(Part, frozen=True):
    """Gates against the last adjustment."""

    command: Literal["check"]
    bundle: str
    run: str
    status: Status
    gates: list[Gate]
    passed: bool = field(name="pass")
    warnings: list[Warned]


class Report(Part, frozen=True):
    """Where the report was written."""

    command: Literal["report"]
    run: str
    bundle: str
    file: str
    pdf: str | UnsetType = UNSET


class Difference(Part, frozen=True):
    """A figure in which two results differ by more than is allowed."""

    name: str
    a: float | str | None
    b: float | str | None
    difference: float | None
    allowed: float


class Compare(Part, frozen=True):
    """Two results compared figure by figure."""

    command: Literal["compare"]
    a: str
    b: str
    tolerance: float
    relative: float
    sigma: float | None
    equal: bool
    compared: int
    differences: list[Difference]
    only_in_a: list[str]
    only_in_b: list[str]
