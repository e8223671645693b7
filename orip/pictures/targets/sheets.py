"""Sheets of dots of which some have rings: which dot is which, and where the circles' centres are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import OripError
from orip.geometry.plane import homography
from orip.pictures.targets.dots import Dot, as_bytes, find_dots
from orip.pictures.targets.found_boards import (
    affinity,
    consistent,
    eccentricity,
    smallest_scale,
    spacing_in_plane,
    with_one,
)
from orip.pictures.targets.marks import FoundTargets, Mark, Rejected
from orip.pictures.targets.rings import PART_OF_RING, ring_codes

FEWEST_CODED = 2
"""Coded dots that must be seen: one says where the sheet is, the second how it is turned."""

_NEAR = 0.3
"""How far from its predicted place a dot may be, in distances of neighbouring dots."""

_NEIGHBOURS = 8
_LEAST_NAMED = 6


class Sheet(Struct, frozen=True):
    """A plane sheet of round dots.

    Parameters
    ----------
    names : tuple of str
    xy : array (n, 2)
        Places of the dots in the plane of the sheet, seen from the front, right-handed.
    codes : mapping of name to int
        How many parts the ring of a dot has; other dots have none.
    radius : float or None
        Of the dots, in units of xy; None: not known, and the eccentricity of the ellipses is not corrected.
    """

    names: tuple[str, ...]
    xy: FloatArray
    codes: Mapping[str, int]
    radius: float | None = None


def sheet_of(names: Sequence[str], xyz: FloatArray, codes: Mapping[str, int], radius: float | None = None) -> Sheet:
    """Return the sheet of named points in a plane.

    The front of a sheet is the side from which X, Y and the plane's normal are right-handed, the normal upwards; of a
    vertical one the side towards -Y, of one along Y the side towards +X.

    Parameters
    ----------
    xyz : array (n, 3)
    codes : mapping of name to int
    radius : float, optional

    Raises
    ------
    OripError
        If the points are not in one plane within 2 per cent of their extent.
    """
    centred = xyz - xyz.mean(axis=0)
    values, axes = np.linalg.svd(centred, full_matrices=False)[1:]
    if len(xyz) < _LEAST_NAMED or values[1] < 0.02 * values[0] or values[2] > 0.02 * values[0]:
        message = f"the {len(xyz)} points of the sheet are not spread over one plane: a sheet has at least 6 in a plane"
        raise OripError(message)
    normal = axes[2] * np.sign(next(part for part in axes[2][[2, 1, 0]] * (1, -1, 1) if abs(part) > 1e-3))
    along = axes[0]
    return Sheet(tuple(names), centred @ np.stack([along, np.cross(normal, along)], axis=1), codes, radius)


def find_sheet(grey: Any, sheet: Sheet) -> FoundTargets:
    """Find the dots of a sheet in a picture, and name them.

    Parameters
    ----------
    grey : array (rows, columns) of uint8 or uint16
        Of colour pictures best one band: lateral colour of the lens moves the edges of each band differently.

    Returns
    -------
    FoundTargets
        Without marks, and with the reason, where fewer than two coded dots agree with the sheet.

    Notes
    -----
    At a coded dot its four neighbours are those that are nearest in the affinity that makes the dot's ellipse a circle.
    Each of the four ways to name them is grown from neighbour to neighbour, every dot predicted by a local affinity,
    so that distortion adds up nowhere; the way that gives the other coded dots their rings is right. Whatever does not
    fit its neighbours then loses its name.
    """
    picture = as_bytes(grey)
    found = find_dots(picture)
    codes = ring_codes(picture, found.dots)
    dots = [dot for dot, code in zip(found.dots, codes, strict=True) if code != PART_OF_RING]
    coded = [code for code in codes if code != PART_OF_RING]
    named, fault = _named(dots, coded, sheet)
    if fault:
        return FoundTargets((), found.rejected, fault)
    named = _consistent(named, dots, sheet)
    missing = _missing(named, dots, found.rejected, sheet)
    return FoundTargets(tuple(_marks(named, dots, sheet)), missing, "")


class _Hypothesis(NamedTuple):
    named: dict[int, int]
    """Dots of the picture by those of the sheet."""

    agreeing: int
    """Coded dots whose rings are theirs; -1: some ring is another's."""


def _named(dots: Sequence[Dot], codes: Sequence[int], sheet: Sheet) -> tuple[dict[int, int], str]:
    wanted = _points_of_codes(sheet)
    seen = [place for place, code in enumerate(codes) if code in wanted]
    if len(seen) < FEWEST_CODED:
        what = "no coded dot" if not seen else "one coded dot"
        return {}, f"{what} of the sheet was found; at least {FEWEST_CODED} are needed"
    if len({codes[place] for place in seen}) < len(seen):
        return {}, "a code of the sheet was found twice: two sheets, or a ring of something else"
    begins = [(wanted[codes[place]], place) for place in seen]
    best = _best(dots, codes, sheet, begins, turn=1)
    if best.agreeing >= FEWEST_CODED:
        return best.named, ""
    if _best(dots, codes, sheet, begins, turn=-1).agreeing >= FEWEST_CODED:
        return {}, "the sheet is seen as its mirror image: the picture or the sheet's coordinates are mirrored"
    return {}, "the dots around the coded ones are not those of the sheet, or too few of them were found"


def _points_of_codes(sheet: Sheet) -> dict[int, int]:
    return {code: sheet.names.index(name) for name, code in sheet.codes.items()}


def _best(
    dots: Sequence[Dot], codes: Sequence[int], sheet: Sheet, begins: Sequence[tuple[int, int]], turn: int
) -> _Hypothesis:
    """Return the hypothesis that gives most coded dots their rings; the first one that gives all of them theirs."""
    best = _Hypothesis({}, -1)
    for begin in begins:
        for hypothesis in _hypotheses(dots, codes, sheet, begin, turn):
            best = max(best, hypothesis, key=lambda one: (one.agreeing, len(one.named)))
            if best.agreeing == len(begins):
                return best
    return best


def _hypotheses(
    dots: Sequence[Dot], codes: Sequence[int], sheet: Sheet, begin: tuple[int, int], turn: int
) -> Iterable[_Hypothesis]:
    """Yield the ways to name the neighbours of a coded dot, each grown as far as it goes."""
    wanted = _points_of_codes(sheet)
    point, place = begin
    dot = dots[place]
    around = _nearest(sheet.xy - sheet.xy[point], point)
    at = np.array([[other.column - dot.column, other.row - dot.row] for other in dots])
    in_picture = _nearest(at @ dot.shape.T, place)
    if len(around) < 4 or len(in_picture) < 4:
        return
    # rows go down in a picture: the other way about on the sheet
    around = _in_turn(around, sheet.xy - sheet.xy[point])[::-turn]
    in_picture = _in_turn(in_picture, at @ dot.shape.T)
    for shift in range(4):
        named = {point: place} | dict(zip(around, in_picture[shift:] + in_picture[:shift], strict=True))
        if _is_affine(named, dots, sheet):
            grown = _grown(named, dots, sheet)
            yield _Hypothesis(grown, _agreeing(grown, codes, wanted))


def _nearest(away: FloatArray, itself: int) -> list[int]:
    order = np.argsort(np.hypot(*away.T), kind="stable")
    return [int(place) for place in order if place != itself][:4]


def _in_turn(places: Sequence[int], away: FloatArray) -> list[int]:
    return sorted(places, key=lambda place: float(np.arctan2(away[place][1], away[place][0])))


def _agreeing(named: Mapping[int, int], codes: Sequence[int], wanted: Mapping[int, int]) -> int:
    """Return how many coded dots have their names; -1 where one has another's."""
    points = {place: point for point, place in named.items()}
    agreeing = 0
    for place, code in enumerate(codes):
        if place in points and (code in wanted or points[place] in wanted.values()):
            if code in wanted and wanted[code] != points[place]:
                return -1
            agreeing += code in wanted
    return agreeing


def _is_affine(named: Mapping[int, int], dots: Sequence[Dot], sheet: Sheet) -> bool:
    points = list(named)
    matrix, _ = affinity(sheet.xy[points], _places(dots, named.values()))
    off = _places(dots, named.values()) - with_one(sheet.xy[points]) @ matrix
    return bool(np.hypot(*off.T).max() < _NEAR * _spacing(matrix, sheet))


def _grown(named: Mapping[int, int], dots: Sequence[Dot], sheet: Sheet) -> dict[int, int]:
    """Name dot after dot, the one nearest to those that have names first."""
    grown = dict(named)
    at = _places(dots, range(len(dots)))
    taken = set(grown.values())
    left = set(range(len(sheet.names))) - set(grown)
    while left:
        order, predictions, spacings = _predictions(sorted(left), grown, dots, sheet)
        added = False
        for point, prediction, spacing in zip(order, predictions, spacings, strict=True):
            off = np.hypot(*(at - prediction).T)
            place = int(np.argmin(off))
            if off[place] < _NEAR * spacing and place not in taken:
                grown[point] = place
                taken.add(place)
                left.discard(point)
                added = True
        if not added:
            break
    return grown


def _predictions(
    points: Sequence[int], named: Mapping[int, int], dots: Sequence[Dot], sheet: Sheet
) -> tuple[list[int], list[FloatArray], list[float]]:
    """Return points that have neighbours with names, and where they should be in the picture."""
    known = list(named)
    spacing = spacing_in_plane(sheet.xy)
    at = _places(dots, named.values())
    order, predictions, spacings = [], [], []
    for point in points:
        away = np.hypot(*(sheet.xy[known] - sheet.xy[point]).T)
        near = np.argsort(away, kind="stable")[:_NEIGHBOURS]
        near = near[away[near] < 3.2 * spacing]
        if len(near) < 3 or away[near[0]] > 2.1 * spacing:
            continue
        matrix, rank = affinity(sheet.xy[[known[place] for place in near]], at[near], away[near])
        if rank == 3:
            order.append(point)
            predictions.append(with_one(sheet.xy[point][None])[0] @ matrix)
            spacings.append(_spacing(matrix, sheet))
    return order, predictions, spacings


def _spacing(matrix: FloatArray, sheet: Sheet) -> float:
    """Return the smallest distance of neighbours in the picture under an affinity."""
    return smallest_scale(matrix) * spacing_in_plane(sheet.xy)


def _places(dots: Sequence[Dot], which: Iterable[int]) -> FloatArray:
    return np.array([[dots[place].column, dots[place].row] for place in which]).reshape(-1, 2)


def _consistent(named: Mapping[int, int], dots: Sequence[Dot], sheet: Sheet) -> dict[int, int]:
    """Return what is named without dots that are not where all their neighbours predict them."""
    points = list(named)
    kept = consistent(sheet.xy[points], _places(dots, named.values()))
    return {points[place]: named[points[place]] for place in kept}


def _marks(named: Mapping[int, int], dots: Sequence[Dot], sheet: Sheet) -> Iterable[Mark]:
    points = sorted(named)
    places = _places(dots, (named[point] for point in points))
    if sheet.radius is not None:
        places = places - eccentricity(homography(sheet.xy[points], places), sheet.xy[points], sheet.radius)
    for point, place in zip(points, places, strict=True):
        yield Mark(sheet.names[point], float(place[0]), float(place[1]), dots[named[point]].deviation)


def _missing(
    named: Mapping[int, int], dots: Sequence[Dot], rejected: Sequence[Rejected], sheet: Sheet
) -> tuple[Rejected, ...]:
    """Return why the other dots of the sheet were not measured."""
    points = list(named)
    places = _places(dots, named.values())
    others = np.array([[item.column, item.row] for item in rejected]).reshape(-1, 2)
    missing = []
    for point in sorted(set(range(len(sheet.names))) - set(named)):
        near = np.argsort(np.hypot(*(sheet.xy[points] - sheet.xy[point]).T), kind="stable")[:_NEIGHBOURS]
        matrix, rank = affinity(sheet.xy[[points[other] for other in near]], places[near])
        place = with_one(sheet.xy[point][None])[0] @ matrix
        reason = "not found"
        if rank == 3 and len(others):
            off = np.hypot(*(others - place).T)
            if off.min() < _NEAR * _spacing(matrix, sheet):
                reason = rejected[int(np.argmin(off))].reason
        missing.append(Rejected(float(place[0]), float(place[1]), reason, sheet.names[point]))
    return tuple(missing)
