"""Two results compared figure by figure."""

from __future__ import annotations

import math
from collections.abc import Iterator

from msgspec import Struct

from orip.records.results.tests import Figure, FigureGroup, ResultFigures
from orip.units import DEGREES_PER_RADIAN

_FULL_CIRCLE = 360.0


class Tolerance(Struct, frozen=True):
    """How far two figures may be apart and still be equal.

    Parameters
    ----------
    absolute : float
        In each figure's own unit; of a distortion coefficient, mm of distortion 10 mm from the principal point.
    relative : float
        Of a ground coordinate it is a share of the extent of the block, of an angle one of a radian, of C, DX and DY
        one of C, of any other figure one of its value, or its standard deviation if that is larger: none depends on
        where the origin of a system lies.
    sigma : float or None
        If given, adjusted values may differ by so many standard deviations (of both, combined) instead, and figures of
        precision and reliability are not compared.
    """

    absolute: float = 1e-9
    relative: float = 1e-6
    sigma: float | None = None


class Difference(Struct, frozen=True):
    """Two figures that are not equal.

    Parameters
    ----------
    a, b : float, str or None
        Their values in the two results.
    size : float
        The difference without sign; infinite where one of them is not a number.
    """

    name: str
    a: float | str | None
    b: float | str | None
    size: float
    allowed: float

    @property
    def excess(self) -> float:
        """Return how many times the allowed difference it is."""
        return self.size / self.allowed if self.allowed > 0.0 else math.inf


class Comparison(Struct, frozen=True):
    """What two results have in common and what not.

    Parameters
    ----------
    compared : int
        Figures that both have.
    differences : tuple of Difference
        Largest first, measured by what is allowed.
    only_a, only_b : tuple of str
        Names of figures, or of records with figures, that are in one result only.
    """

    compared: int
    differences: tuple[Difference, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """Tell whether there is no difference."""
        return not (self.differences or self.only_a or self.only_b)


class _Scales(Struct, frozen=True):
    """Lengths that relative tolerances are shares of."""

    extent: float
    principal_distance: float


def compare_figures(a: ResultFigures, b: ResultFigures, tolerance: Tolerance) -> Comparison:
    """Compare two results; angles are compared on the circle."""
    extent = max(_extent(a), _extent(b))
    compared, differences = 0, []
    only_a = [group.name for key, group in a.items() if key not in b and _counts(group, tolerance)]
    only_b = [group.name for key, group in b.items() if key not in a and _counts(group, tolerance)]
    for key in a.keys() & b.keys():
        one, other = a[key], b[key]
        only_a += _missing(one, other)
        only_b += _missing(other, one)
        scales = _Scales(extent, max(_principal_distance(one), _principal_distance(other)))
        for name in one.figures.keys() & other.figures.keys():
            pair = one.figures[name], other.figures[name]
            if tolerance.sigma is not None and not all(figure.adjusted for figure in pair):
                continue
            compared += 1
            found = _difference(f"{one.name} {name}".strip(), *pair, tolerance, scales)
            if found is not None:
                differences.append(found)
    differences.sort(key=lambda difference: (-difference.excess, difference.name))
    return Comparison(compared, tuple(differences), tuple(sorted(only_a)), tuple(sorted(only_b)))


def _counts(group: FigureGroup, tolerance: Tolerance) -> bool:
    return tolerance.sigma is None or any(figure.adjusted for figure in group.figures.values())


def _missing(one: FigureGroup, other: FigureGroup) -> Iterator[str]:
    return (f"{one.name} {name}".strip() for name in one.figures if name not in other.figures and not _is_sd(name))


def _is_sd(name: str) -> bool:
    """Tell whether a figure is the standard deviation of another one that is already missing."""
    return name.endswith(" sd")


def _difference(name: str, a: Figure, b: Figure, tolerance: Tolerance, scales: _Scales) -> Difference | None:
    allowed = _allowed(a, b, tolerance, scales)
    if isinstance(a.value, float) and isinstance(b.value, float):
        size = abs(a.value - b.value)
        if a.quantity == "angle":
            size = abs(math.remainder(a.value - b.value, _FULL_CIRCLE))
        return Difference(name, a.value, b.value, size, allowed) if size > allowed else None
    return None if a.value == b.value else Difference(name, a.value, b.value, math.inf, allowed)


def _allowed(a: Figure, b: Figure, tolerance: Tolerance, scales: _Scales) -> float:
    if tolerance.sigma is not None and (a.sd is not None or b.sd is not None):
        return tolerance.sigma * math.hypot(a.sd or 0.0, b.sd or 0.0)
    if a.quantity == "ground":
        scale = scales.extent
    elif a.quantity == "angle":
        scale = DEGREES_PER_RADIAN
    elif a.quantity == "photo":
        scale = scales.principal_distance
    else:
        scale = max(
            abs(number) for figure in (a, b) for number in (figure.value, figure.sd, 0.0) if isinstance(number, float)
        )
    return tolerance.absolute / a.effect + tolerance.relative * scale


def _principal_distance(group: FigureGroup) -> float:
    value = group.figures["C"].value if "C" in group.figures else None
    return abs(value) if isinstance(value, float) else 0.0


def _extent(figures: ResultFigures) -> float:
    """Return the largest range of a ground coordinate, over points and projection centres."""
    by_axis: dict[str, list[float]] = {}
    for (kind, _name), group in figures.items():
        if kind in {"photo", "point"}:
            for name, figure in group.figures.items():
                if figure.quantity == "ground" and isinstance(figure.value, float):
                    by_axis.setdefault(name[0], []).append(figure.value)
    return max((max(values) - min(values) for values in by_axis.values()), default=0.0)
