"""Marks with exchanged names: film that lay rotated or upside down, with its marks named by their places.

Marks named by their position in the scan fit nearly as well as under their own names, because the four corners of a
frame are nearly symmetrical. But no camera and no template is perfectly symmetrical: the given coordinates fit best
under the right names. So the marks are named in every order that a rotation or a reflection of the film would give, and
the residuals are compared with those of the other films.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.geometry.plane import MARKS_NEEDED, PARAMETERS
from orip.records.results.interior import MarkAdjustment
from orip.wording import counted_names

_UNLIKELY = 1e-6
"""Probability of such large residuals by chance below which names are doubted; there is one test for each film."""

_LIKELY = 1e-3
"""Probability of the residuals above which marks fit under these names."""

_STRETCHED = 1.2
"""Ratio of the scales in x and y that no film or enlargement reaches: an upright frame was stretched into a landscape
one."""

_LISTED = 4
"""Most marks that a message lists."""


class _Order(Struct, frozen=True):
    """Which mark each one would be, and whether the film would have to be turned over."""

    marks: IntArray
    turned_over: bool


class _Film(Struct, frozen=True):
    """Square sums (mm²) of the residuals under the names given, and under those that fit best."""

    adjustment: MarkAdjustment
    given: float
    best: float
    order: _Order

    @property
    def redundancy(self) -> int:
        return self.adjustment.summary.redundancy


def misnamed_marks(adjustments: Sequence[MarkAdjustment]) -> list[ProjectWarning]:
    """Return warnings for templates and photos whose marks fit with exchanged names, and not with their own.

    Parameters
    ----------
    adjustments : sequence of MarkAdjustment
        Of all templates and photos: together they tell how well marks fit.
    """
    films = [film for adjustment in adjustments if (film := _film(adjustment)) is not None]
    found: dict[tuple[str, str], list[_Film]] = {}
    for film in films:
        if _is_misnamed(film, films):
            found.setdefault((film.adjustment.summary.group, _finding(film)), []).append(film)
    most_first = sorted(found.items(), key=lambda item: -len(item[1]))
    return [_warning(group, finding, alike) for (group, finding), alike in most_first]


def _film(adjustment: MarkAdjustment) -> _Film | None:
    used = ~adjustment.marks.disregarded
    measured, given = adjustment.marks.measured[used], adjustment.given[used]
    if len(measured) <= MARKS_NEEDED[adjustment.kind]:
        return None
    sums = [
        (_square_sum(adjustment.kind, measured, given[order.marks], order.turned_over), order)
        for order in _orders(given)
    ]
    (as_given, _), *_ = sums
    best, order = min(sums, key=lambda pair: pair[0])
    return _Film(adjustment, as_given, best, order)


def _orders(given: FloatArray) -> Iterator[_Order]:
    """Yield the orders in which the marks around a film may be named; the one as given first."""
    centred = given - given.mean(axis=0)
    around = np.argsort(np.arctan2(centred[:, 1], centred[:, 0]))
    count = len(given)
    for turned_over in (False, True):
        for shift in range(count):
            marks = np.empty(count, dtype=np.int64)
            marks[around] = around[(shift + (-1 if turned_over else 1) * np.arange(count)) % count]
            yield _Order(marks, turned_over)


def _square_sum(kind: str, measured: FloatArray, given: FloatArray, turned_over: bool) -> float:
    """Return the square sum of residuals of a transformation; infinite where it would have to stretch the film."""
    centred, target = measured - measured.mean(axis=0), given - given.mean(axis=0)
    if kind == "A":
        matrix, *_ = np.linalg.lstsq(centred, target, rcond=None)
        scales = np.hypot(*matrix)
        if not 1.0 / _STRETCHED < scales[0] / scales[1] < _STRETCHED:
            return np.inf
        return float(np.sum((centred @ matrix - target) ** 2))
    if turned_over:
        centred = centred * [-1.0, 1.0]
    a, b = centred @ [1.0, 1j], target @ [1.0, 1j]
    factor = np.vdot(a, b) / np.vdot(a, a)
    if kind == "W":
        factor /= abs(factor)
    return float(np.sum(np.abs(factor * a - b) ** 2))


def _is_misnamed(film: _Film, films: Sequence[_Film]) -> bool:
    from scipy.special import fdtrc  # takes its time; most commands do without

    if film.best >= film.given:
        return False
    if not np.isfinite(film.given):
        return True
    others = [other for other in films if other is not film]
    noise = float(np.median([other.best / other.redundancy for other in others])) if others else 0.0
    if noise <= 0.0:
        return False
    freedom = sum(other.redundancy for other in others)
    as_given, best = (
        float(fdtrc(film.redundancy, freedom, square_sum / film.redundancy / noise))
        for square_sum in (film.given, film.best)
    )
    return as_given < _UNLIKELY and best > _LIKELY


def _finding(film: _Film) -> str:
    """Return how the film probably lay, and which marks are meant."""
    used = np.flatnonzero(~film.adjustment.marks.disregarded)
    names = [film.adjustment.marks.names[row] for row in used]
    pairs = [f"{name} is {names[row]}" for name, row in zip(names, film.order.marks, strict=True) if names[row] != name]
    listed = ", ".join(pairs[:_LISTED]) + (", …" if len(pairs) > _LISTED else "")
    return f"lay {_how(film, used)} and its marks were named by where they lay: {listed}"


def _warning(group: str, finding: str, films: Sequence[_Film]) -> ProjectWarning:
    owner, what, marks = ("template", "template", "tick") if group == "templates" else ("photo", "film", "fiducial")
    names = [film.adjustment.summary.name for film in films]
    first = films[0]
    text = (
        f"the {marks} marks do not fit as they are named ({_rms(first.given, first)} mm), but they would "
        f"({_rms(first.best, first)} mm) if the {what} {finding}; give marks the names that they have on the {what}"
    )
    return ProjectWarning("misnamed-marks", counted_names(owner, names), text)


def _how(film: _Film, used: IntArray) -> str:
    """Return how the film probably lay."""
    given = film.adjustment.given[used]
    if film.order.turned_over:
        return "upside down (a mirror image, as of a scan with the emulsion up)"
    a, b = (given - given.mean(axis=0)) @ [1.0, 1j], (given[film.order.marks] - given.mean(axis=0)) @ [1.0, 1j]
    turn = round(float(np.degrees(np.angle(np.vdot(b, a)))) / 90.0) * 90 % 360
    return f"turned by {turn}°" if turn else "turned"


def _rms(square_sum: float, film: _Film) -> str:
    if not np.isfinite(square_sum):
        square_sum = float(np.sum(film.adjustment.residuals[~film.adjustment.marks.disregarded] ** 2))
    freedom = 2 * int(np.count_nonzero(~film.adjustment.marks.disregarded)) - PARAMETERS[film.adjustment.kind]
    return f"{np.sqrt(square_sum / freedom):.3g}"
