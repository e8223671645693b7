"""Control compared with where the photos see it: which change of one thing makes all of it fit.

The photos are adjusted without control, as a free network or held by observed positions. Its points and those given
differ by a similarity, or by a shift, and by their errors, of which the covariances are known. So each hypothesis costs
no more than the solution of a few equations, and all are compared with each other: what changes least and fits wins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np

from orip.bundle.results.covariance import covariance, point_figures
from orip.bundle.solve import SolvedBlock
from orip.bundle.verdict import group_findings
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_from_rotation
from orip.mistakes.control.contradicting_control import control_warnings, without_control
from orip.mistakes.control.free_network import free_network
from orip.mistakes.control.network_fits import (
    CHANCE,
    FEWEST_POINTS,
    LOOKS_UP,
    OPTIMISTIC,
    Change,
    Fitted,
    Seen,
    fitted,
)
from orip.mistakes.doubted_observations import doubted_control, doubted_photo_points
from orip.mistakes.hypothesis import DECIDED, Misfit, Readjuster, fit_of_adjustment, is_good
from orip.mistakes.mistake import ANOTHER_START, ON_GROUND, Consequence, declare
from orip.mistakes.other_units import FEET_AND_METRES, LENGTH_UNITS
from orip.records.block import Block
from orip.records.ground import PlainGround
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import METRES_PER_GROUND_UNIT
from orip.wording import MOST_TO_CHANGE, counted_names

_OFF = Consequence(warnings=ANOTHER_START, groups=(*ON_GROUND, "check point", "camera"))
"""Control that is somewhere else takes all photos with it."""

EXCHANGED_CONTROL = declare("exchanged-control", "two control points are exchanged", _OFF, places_photos=True)
SOME_HEIGHTS = declare("heights-of-some", "the heights of some control points are off alike", _OFF, places_photos=True)
CONTROL_HEIGHTS = declare(
    "control-heights", "Z of the control fits only if it is read otherwise", _OFF, places_photos=True
)

_MOST = 24
"""Most points of which pairs are tried."""

_SHORTEST_POLE, _LONGEST_POLE = 0.05, 5.0
"""Metres: less and more is no pole; other systems differ by more."""

_OF_ONE, _OF_ALL = 5.0, 10.0
"""What a change costs: a coordinate that is left out or two names that are exchanged, and other heights of all points.
A choice among so many makes the sum of squares smaller by chance."""

_MARK = 1.0
"""A-priori error, without its sign, that marks a check point and says nothing else."""


def misread_control_points(misfit: Misfit) -> list[ProjectWarning]:
    """Return which two control points are exchanged, which one is wrong, or how all heights are; often nothing."""
    solution, solved, readjuster = misfit
    block = readjuster.block
    if not (readjuster.is_worthwhile and _can_be_compared(block) and _is_doubted(solution, solved, block)):
        return []
    seen = _seen(readjuster, solved)
    if seen is None:
        return []
    as_given = next(iter(fitted(seen, [_as_given(seen)])), None)
    if as_given is not None and as_given.fits:
        return []
    cost = np.inf if as_given is None else as_given.cost
    tried = [found for found in fitted(seen, _changes(seen, as_given)) if found.fits and found.gain(cost) > DECIDED]
    if not tried:
        return []
    best = min(tried, key=lambda found: found.score)
    others = [found for found in tried if found is not best and found.score < best.score + DECIDED]
    is_of_heights = len(best.change.points) > 1 and best.change.left_out.any()
    if is_of_heights and any(group.of == "CAMERA" and group.doubted for group in solution.groups):
        return []  # a held distortion bends the block, and its rim is off in height alike
    return _said(block, seen, best, others)


def _can_be_compared(block: Block) -> bool:
    is_control = any(point.kind == "control" for point in block.control_points)
    free = not block.is_free_network and not any(photo.constant for photo in block.photos)
    return is_control and free and isinstance(block.ground, PlainGround)


def _is_doubted(solution: Solution, solved: SolvedBlock, block: Block) -> bool:
    """Tell whether control may be wrong: of a sound block nothing is adjusted again."""
    if solution.status not in ("converged", "doubtful") or doubted_control(solution) or group_findings(solution):
        return True
    if solved.state.rotations[:, 2, 2].mean() < LOOKS_UP:
        return True
    names = {block.point_names[row] for row in block.photo_points.point[doubted_photo_points(block, solution)].tolist()}
    return any(point.name in names for point in block.control_points)


# ------------------------------------------------------------------------------------------------------- what is seen


def _seen(readjuster: Readjuster, solved: SolvedBlock) -> Seen | None:
    """Return control and check points as the photos see them; None where the photos do not fit without them."""
    block = readjuster.block
    placed = without_control(block, [point.name for point in block.control_points])
    networks = [(placed, True)] if _has_positions(block) else []
    orientation = np.hstack([solved.state.centres, angles_from_rotation(solved.state.rotations)])
    free = free_network(block)
    if solved.block.photos == block.photos and np.isfinite(orientation).all():
        networks.append((replace(free, photo_orientation=orientation), False))
    networks.append((free, False))
    for network, is_placed in networks:
        adjusted = readjuster.adjust_roughly(network)
        if adjusted is not None and is_good(fit_of_adjustment(adjusted)):
            return _in_network(block, adjusted, is_placed)
    return None


def _has_positions(block: Block) -> bool:
    of_elements = any(element.group == "PHOTO" and element.kind in PHOTO_PARAMETERS[:3] for element in block.elements)
    return of_elements or any(station.has_position for station in block.stations)


def _in_network(block: Block, adjusted: SolvedBlock, is_placed: bool) -> Seen | None:
    place = adjusted.block.point_index()
    points = [
        point
        for point in block.control_points
        if point.name in place and point.kind in ("control", "check") and None not in point.coordinates[:2]
    ]
    if not FEWEST_POINTS <= len(points) <= _MOST:
        return None
    figures = [point_figures(adjusted, place[point.name]) for point in points]
    spread = covariance(adjusted, figures, figures)
    if not np.isfinite(spread).all():
        return None
    given, errors = (
        np.array([getattr(point, which) for point in points], dtype=np.float64) for which in ("coordinates", "errors")
    )
    # 1 marks a check point and says nothing of its survey
    usual = float(np.nanmedian(np.where(errors >= 0.0, errors, np.nan)))
    errors = np.where(errors == -_MARK, usual, np.abs(errors))
    found = adjusted.block.ground.to_project(adjusted.state.points[[place[point.name] for point in points]])
    names = tuple(point.name for point in points)
    return Seen(names, given, errors, found, spread, adjusted.state.rotations, is_placed)


# ---------------------------------------------------------------------------------------------------------- hypotheses


def _as_given(seen: Seen) -> Change:
    return Change(seen.given, np.zeros(seen.given.shape, dtype=bool), 0.0, (), 1.0)


def _changes(seen: Seen, as_given: Fitted | None) -> Iterator[Change]:
    """Yield what may have been mistaken: names of two, axes or coordinates of one, heights of some or of all."""
    given = _as_given(seen)
    rows = range(len(seen.names))
    some = [chosen for number in (2, 3) for chosen in combinations(rows, number) if len(rows) > 2 * number]
    for chosen in (*some, *_highest_and_lowest(as_given)):
        left_out = given.left_out.copy()
        left_out[list(chosen), 2] = True
        yield given._replace(left_out=left_out, price=_OF_ONE * len(chosen), points=chosen)
    for pair in combinations(rows, 2):
        order = np.arange(len(rows))
        order[list(pair)] = pair[::-1]
        yield given._replace(meant=seen.given[order], price=_OF_ONE, points=pair)
    for row in rows:
        meant = seen.given.copy()
        meant[row] = meant[row, [1, 0, 2]]
        yield given._replace(meant=meant, price=_OF_ONE, points=(row,))
        for axes in ([2], [0], [1], [0, 1], [0, 1, 2]):
            left_out = given.left_out.copy()
            left_out[row, axes] = True
            yield given._replace(left_out=left_out, price=_OF_ONE * len(axes), points=(row,))
    for factor in (-1.0, *FEET_AND_METRES):
        yield given._replace(meant=seen.given * [1.0, 1.0, factor], price=_OF_ALL, factor=factor)


def _highest_and_lowest(as_given: Fitted | None) -> Iterator[tuple[int, ...]]:
    """Yield the points that are given highest above the network, or farthest below it: four of them, or more."""
    if as_given is None:
        return
    off = as_given.change.meant[:, 2] - as_given.placed[:, 2]
    order = np.argsort(off)[: np.count_nonzero(np.isfinite(off))].tolist()
    for number in range(4, (len(order) + 1) // 2):
        yield tuple(sorted(order[:number]))
        yield tuple(sorted(order[-number:]))


# -------------------------------------------------------------------------------------------------------------- texts


def _said(block: Block, seen: Seen, best: Fitted, others: list[Fitted]) -> list[ProjectWarning]:
    """Return the warning of the change that explains most; of single points that explain as much, of all of them."""
    kinds = {point.name: point.kind for point in block.control_points}
    change = best.change
    if not change.points:
        return [_of_heights(change.factor)]
    if not any(kinds[seen.names[row]] == "control" for found in (best, *others) for row in found.change.points):
        return []  # check points have warnings of their own
    if len(change.points) > 1 and change.left_out.any():
        return _of_other_heights(block, seen, best)
    if len(change.points) == 2:
        return [_of_exchange(block, *sorted(seen.names[row] for row in change.points))]
    (row,) = change.points
    alike = {row: best}
    for other in others:
        if len(other.change.points) == 1:
            alike.setdefault(other.change.points[0], other)
    if len(alike) > 1:
        return [_of_one_of(block, seen, alike)]
    # coordinates that are not left out are where they are given
    left_out = change.left_out[row]
    position = np.where(left_out, best.placed[row], seen.given[row]) if left_out.any() else best.placed[row]
    return control_warnings(block, {seen.names[row]: (position, best.sd[row])})


def _of_heights(factor: float) -> ProjectWarning:
    if factor < 0.0:
        text = "Z fits with the opposite sign (depths in place of heights): reverse the sign of Z"
    else:
        unit, other = LENGTH_UNITS[factor]
        text = (
            f"Z fits when it is multiplied by {factor:.5g}: Z seems to be in {unit}, X and Y in {other}; use one unit"
        )
    return ProjectWarning(CONTROL_HEIGHTS, "control points", text)


def _of_other_heights(block: Block, seen: Seen, best: Fitted) -> list[ProjectWarning]:
    """Return that the heights of some points are off alike, if they are."""
    rows = list(best.change.points)
    off, sd = seen.given[rows, 2] - best.placed[rows, 2], best.sd[rows, 2]
    by = float(np.mean(off))
    size = abs(by) * METRES_PER_GROUND_UNIT.get(block.ground_unit, np.inf)
    if np.abs(off - by).max() > CHANCE * OPTIMISTIC * float(sd.max()) or size < _SHORTEST_POLE:
        return []
    is_pole = size < _LONGEST_POLE
    cause = (
        "the height of the pole or the instrument was probably not taken off, or taken off twice; correct Z of these"
        if is_pole
        else "their heights are probably in another system (above the ellipsoid, above the geoid); take all from one"
    )
    too = f"{abs(by):.2f} {block.ground_unit} too {'high' if by > 0.0 else 'low'}"
    where = counted_names("control point", [seen.names[row] for row in rows], MOST_TO_CHANGE)
    return [ProjectWarning(SOME_HEIGHTS, where, f"they alone are given about {too} in Z: {cause}")]


def _of_exchange(block: Block, one: str, other: str) -> ProjectWarning:
    check = [point.name for point in block.control_points if point.name in (one, other) and point.kind == "check"]
    which = f" ({check[0]} is a check point)" if check else ""
    text = "fit when they are exchanged; exchange their names in the control file, or in the photos"
    return ProjectWarning(EXCHANGED_CONTROL, "", f"control points {one} and {other} {text}{which}")


def _of_one_of(block: Block, seen: Seen, alike: Mapping[int, Fitted]) -> ProjectWarning:
    """Return that one of several points is wrong, with what each would be off by."""
    off = []
    for row, found in alike.items():
        axes = np.flatnonzero(found.change.left_out[row]).tolist() or [0, 1]
        parts = [
            f"{'XYZ'[axis]} {seen.given[row, axis] - found.placed[row, axis]:+.3f} ± {found.sd[row, axis]:.2g}"
            for axis in axes
        ]
        off.append(f"{seen.names[row]} by {', '.join(parts)} {block.ground_unit}")
    text = (
        f"one of them is wrong, and all others fit without it, whichever it is: either {' or '.join(off)}; check "
        "them, or measure one more point that tells which"
    )
    names = [seen.names[row] for row in alike]
    return ProjectWarning("contradicting-control", counted_names("control point", names), text)
