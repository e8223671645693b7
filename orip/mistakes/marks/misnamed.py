"""Fiducial and tick marks with exchanged names, and single ones that are measured or given wrong."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.geometry.plane import MARKS_NEEDED, PARAMETERS, fit_plane_transformation
from orip.mistakes.control.slips_of_pen import slip_of_pen
from orip.mistakes.mistake import BENT_PICTURES, declare
from orip.records.interior import MarkAdjustment
from orip.structs import replace
from orip.wording import counted_names, joined

# Marks named by their position in the scan fit nearly as well as under their own names, because the four corners of a
# frame are nearly symmetrical. But no camera and no template is perfectly symmetrical: the given coordinates fit best
# under the right names. So the marks are named in every order that a rotation or a reflection of the film would give,
# and the residuals are compared with those of the other films.

MISNAMED_MARKS = declare("misnamed-marks", "", BENT_PICTURES, explains_misfit=True)
MISREAD_MARK = declare("misread-mark", "", BENT_PICTURES, explains_misfit=True)

_UNLIKELY = 1e-6
"""Probability of such large residuals by chance below which names are doubted; there is one test for each film."""

_LIKELY = 1e-3
"""Probability of the residuals above which marks fit under these names."""

_STRETCHED = 1.2
"""Ratio of the scales in x and y that no film or enlargement reaches: an upright frame was stretched into a landscape
one."""

_MOST_EXCHANGED = 16
"""Marks of a film, those with the largest residuals, of which any two may be exchanged."""

_LISTED = 4
"""Most marks that a message lists."""

_FAR_BETTER = 0.01
"""Part of a square sum that is left under other names, if these are the right ones."""

_MEDIAN_EFFICIENCY = 2.0 / np.pi
"""Part of the redundancy that a median makes use of."""

_UNEXPLAINED = 3.0
"""Ratio to the residuals of other films from which a film has a wrong mark though none is found: films differ."""


class _Order(Struct, frozen=True):
    """Which mark each one would be, and whether the film would have to be turned over."""

    marks: IntArray
    turned_over: bool


class _Film(Struct, frozen=True):
    """Square sums (mm²) of the residuals under the names given, and under those that fit best.

    And with two marks exchanged, and without one mark, each by their places among the used marks. `noise` is the
    variance (mm²) with which the marks of the other films fit (its own where there is no other), `freedom` its
    degrees of freedom.
    """

    adjustment: MarkAdjustment
    given: float
    best: float
    order: _Order
    exchanged: dict[tuple[int, int], float]
    without: dict[int, float]
    noise: float = 0.0
    freedom: float = 0.0

    @property
    def redundancy(self) -> int:
        return self.adjustment.summary.redundancy

    @property
    def variance(self) -> float:
        """Return that with which the marks fit (mm²): as given, unless they fit far better otherwise.

        The least of many is too small. What a residual loses of a square sum without its mark is a part with a beta
        distribution.
        """
        renamed = min(self.best, *self.exchanged.values())
        fitted = renamed if renamed < _FAR_BETTER * self.given else self.given
        least, freedom = min(self.without.values(), default=np.inf), self.redundancy - 2
        if freedom > 0 and least < fitted and len(self.without) * (least / fitted) ** (0.5 * freedom) < _LIKELY:
            return least / _median_of_chi_square(freedom)
        return fitted / _median_of_chi_square(self.redundancy)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the used marks."""
        marks = self.adjustment.marks
        return tuple(name for name, left_out in zip(marks.names, marks.disregarded, strict=True) if not left_out)

    def is_likely(self, square_sum: float, redundancy: int, limit: float) -> bool:
        """Tell whether residuals are as large as those of the other films by chance, with a probability."""
        from scipy.special import fdtrc  # takes its time; most commands do without

        if self.noise <= 0.0 or not np.isfinite(square_sum):
            return self.noise <= 0.0
        return float(fdtrc(redundancy, self.freedom, square_sum / redundancy / self.noise)) > limit


def misnamed_marks(adjustments: Sequence[MarkAdjustment]) -> list[ProjectWarning]:
    """Return warnings for templates and photos whose marks do not fit as they are named, measured and given.

    Parameters
    ----------
    adjustments : sequence of MarkAdjustment
        Of all templates and photos: together they tell how well marks fit.
    """
    films = _compared([film for adjustment in adjustments if (film := _film(adjustment)) is not None])
    if 2 * sum(film.adjustment.mirrored for film in films) > len(films):
        # that is said of them already; three marks turned over are also two that are exchanged
        films = [film for film in films if not film.adjustment.mirrored]
    found: dict[tuple[str, str], list[_Film]] = {}
    wrong: dict[tuple[str, str], list[_Film]] = {}
    for film in films:
        if _is_misnamed(film):
            found.setdefault((film.adjustment.summary.group, _finding(film)), []).append(film)
        elif not film.is_likely(film.given, film.redundancy, _UNLIKELY):
            mark = _wrong_mark(film)
            if mark or film.given > _UNEXPLAINED**2 * film.redundancy * film.noise:
                wrong.setdefault((film.adjustment.summary.group, mark), []).append(film)
    most_first = sorted(found.items(), key=lambda item: -len(item[1]))
    misnamed = [_warning(group, finding, alike) for (group, finding), alike in most_first]
    return misnamed + [_of_wrong_mark(mark, alike, films) for (_, mark), alike in wrong.items()]


def _film(adjustment: MarkAdjustment) -> _Film | None:
    used, kind = ~adjustment.marks.disregarded, adjustment.kind
    measured, given = adjustment.marks.measured[used], adjustment.given[used]
    count = len(measured)
    if count <= MARKS_NEEDED[kind]:
        return None
    around = _orders(given)
    turned = measured if kind == "A" else measured * [-1.0, 1.0]
    sums = np.append(*(_square_sums(kind, lying, given[around[over]]) for over, lying in enumerate((measured, turned))))
    best = int(np.argmin(sums))
    order = _Order(around.reshape(-1, count)[best], best >= count)
    # two that are exchanged have the largest residuals
    largest = np.argsort(-np.sum(adjustment.residuals[used] ** 2, axis=1), kind="stable")[:_MOST_EXCHANGED]
    pairs = list(combinations(sorted(largest.tolist()), 2))
    exchanged = np.tile(np.arange(count), (len(pairs), 1))
    np.put_along_axis(exchanged, np.array(pairs), np.array(pairs)[:, ::-1], axis=1)
    rest = np.array([np.delete(np.arange(count), row) for row in range(count)])
    without = _square_sums(kind, measured[rest], given[rest]) if count - 1 > MARKS_NEEDED[kind] else np.empty(0)
    return _Film(
        adjustment, float(sums[0]), float(sums[best]), order,
        dict(zip(pairs, _square_sums(kind, measured, given[exchanged]).tolist(), strict=True)),
        dict(enumerate(without.tolist())),
    )  # fmt: skip


def _compared(films: Sequence[_Film]) -> list[_Film]:
    """Return films with the variance that the others of them have."""
    variances, redundancies = np.array([film.variance for film in films]), [film.redundancy for film in films]
    if len(films) < 2:
        return [replace(film, noise=film.variance, freedom=film.redundancy) for film in films]
    return [
        replace(
            film,
            noise=float(np.median(np.delete(variances, place))),
            freedom=_MEDIAN_EFFICIENCY * (sum(redundancies) - film.redundancy),
        )
        for place, film in enumerate(films)
    ]


def _median_of_chi_square(freedom: int) -> float:
    """Return the median of the square sum of standard residuals (Wilson and Hilferty 1931)."""
    return float(freedom * (1.0 - 2.0 / (9.0 * freedom)) ** 3)


def _orders(given: FloatArray) -> IntArray:
    """Return the orders (2, n, n) in which n marks around a film may be named, first by a turn, then turned over.

    The very first is the one as given.
    """
    centred = given - given.mean(axis=0)
    around = np.argsort(np.arctan2(centred[:, 1], centred[:, 0]))
    place, shift = np.arange(len(given)), np.arange(len(given))[:, np.newaxis]
    marks = np.empty((2, len(given), len(given)), dtype=np.int64)
    marks[0][:, around] = around[(shift + place) % len(given)]
    marks[1][:, around] = around[(shift - place) % len(given)]
    return marks


def _square_sums(kind: str, measured: FloatArray, given: FloatArray) -> FloatArray:
    """Return the square sums (m,) of residuals of m transformations; infinite where one would have to stretch the film.

    Parameters
    ----------
    kind : {"A", "C", "W"}
    measured : array (n, 2) or (m, n, 2)
    given : array (m, n, 2)
    """
    centred, target = measured - measured.mean(axis=-2, keepdims=True), given - given.mean(axis=-2, keepdims=True)
    if kind == "A":
        matrices = np.linalg.pinv(centred) @ target
        scales = np.linalg.norm(matrices, axis=-2)
        sums = np.sum((centred @ matrices - target) ** 2, axis=(-2, -1))
        # zero where marks of a square are exchanged
        return np.where(scales.max(axis=-1) < _STRETCHED * scales.min(axis=-1), sums, np.inf)
    a, b = centred @ [1.0, 1j], target @ [1.0, 1j]
    factors = np.sum(a.conj() * b, axis=-1, keepdims=True)
    factors /= (
        np.maximum(np.abs(factors), np.finfo(float).tiny)
        if kind == "W"
        else np.sum(np.abs(a) ** 2, axis=-1, keepdims=True)
    )
    return np.asarray(np.sum(np.abs(factors * a - b) ** 2, axis=-1))


def _is_misnamed(film: _Film) -> bool:
    if film.best >= film.given:
        return False
    return not film.is_likely(film.given, film.redundancy, _UNLIKELY) and film.is_likely(
        film.best, film.redundancy, _LIKELY
    )


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
    return ProjectWarning(MISNAMED_MARKS, counted_names(owner, names), text)


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


# ------------------------------------------------------------------------------------------------------- single marks


def _wrong_mark(film: _Film) -> str:
    """Return the names of two marks that are exchanged, or of the one without which the others fit; "" for neither."""
    pair, square_sum = min(film.exchanged.items(), key=lambda item: item[1])
    if film.is_likely(square_sum, film.redundancy, _LIKELY):
        return " and ".join(sorted(film.names[row] for row in pair))
    if not film.without:
        return ""
    row, square_sum = min(film.without.items(), key=lambda item: item[1])
    return film.names[row] if film.is_likely(square_sum, film.redundancy - 2, _LIKELY) else ""


def _of_wrong_mark(mark: str, alike: Sequence[_Film], films: Sequence[_Film]) -> ProjectWarning:
    """Return a warning of films in which the same mark does not fit, or the same two are exchanged."""
    group = alike[0].adjustment.summary.group
    owner, record, kind = ("template", "temtick", "tick") if group == "templates" else ("photo", "camera", "fiducial")
    where = counted_names(owner, [film.adjustment.summary.name for film in alike])
    own = sum(film.adjustment.summary.group == group for film in films)
    in_all = len(alike) > 1 and len(alike) > _IN_ALL * own
    first = alike[0]
    as_given = f"the {kind} marks do not fit ({_rms(first.given, first)} mm)"
    if not mark:
        text = (
            f"{as_given}: one of them is measured or given wrong, and which one cannot be told; measure them again, "
            f"and compare their coordinates in the [[{record}]] of orip.toml"
        )
    elif " and " in mark:
        square_sum = min(first.exchanged.values())
        text = (
            f"{as_given}, but they would ({_rms(square_sum, first)} mm) if {mark} were exchanged: exchange their names "
            f"{f'in the [[{record}]] of orip.toml, or ' if in_all else ''}in the measurements"
        )
    else:
        text = _of_single(mark, alike, in_all, kind, record)
    return ProjectWarning(MISREAD_MARK, where, text)


_IN_ALL = 0.5
"""Part of all films from which a mark is given wrong, and not measured wrong."""


def _of_single(mark: str, alike: Sequence[_Film], in_all: bool, kind: str, record: str) -> str:
    off = np.mean([_off(film, film.names.index(mark)) for film in alike], axis=0)
    film = alike[0]
    rest = film.without[film.names.index(mark)]
    others = float(np.sqrt(rest / (film.redundancy - 2)))
    text = (
        f"{kind} mark {mark} does not fit: it is off by x {off[0]:+.3f}, y {off[1]:+.3f} mm, the others fit within "
        f"{others:.2g} mm"
    )
    if not in_all:
        return f"{text}; measure it again, or disregard it (- at the end of its line)"
    given = film.adjustment.given[list(film.adjustment.marks.names).index(mark)]
    slips = [
        f"{axis} = {value:.10g} {slip}"
        for axis, value, by in zip("xy", given.tolist(), off.tolist(), strict=True)
        if abs(by) > _LARGE * others and (slip := slip_of_pen(value, value + by, _LARGE * others)) is not None
    ]
    where = f"its coordinates in the [[{record}]] of orip.toml are wrong"
    return f"{text}; {where}: {joined(slips)}" if slips else f"{text}; {where}: correct them"


_LARGE = 5.0
"""Standard errors of the other marks that a coordinate is off by where it is wrong."""


def _off(film: _Film, row: int) -> FloatArray:
    """Return by what a mark is measured off from where it is given (2,), mm, with the transformation of the others."""
    used = ~film.adjustment.marks.disregarded
    measured, given = film.adjustment.marks.measured[used], film.adjustment.given[used]
    kept = np.delete(np.arange(len(given)), row)
    transformation = fit_plane_transformation(film.adjustment.kind, measured[kept], given[kept])
    return np.asarray(transformation.apply(measured[[row]])[0] - given[row])
