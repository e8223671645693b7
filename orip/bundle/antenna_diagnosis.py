"""Which unknowns of antennas cannot be told apart from each other or from those of cameras, and why."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtri

from orip.arrays import FloatArray, IntArray
from orip.bundle.antennas import name_of_stretch, station_places
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT, UnknownName
from orip.records.definition import BORESIGHT, BORESIGHT_PLACES, DRIFT, LEVER_ARM, SHIFT, TIME_OFFSET
from orip.records.results.solution import Diagnosis
from orip.wording import counted, joined

_STRONG = 0.95
"""Correlation above which an unknown is named with another one, or with several together: it triples its deviation."""

_ALIKE = 0.1
"""Root mean square change of the direction of an axis between photos (radians) below which they are turned alike."""

_MOST_NAMED = 4
"""Unknowns that are named as hiding one together."""

_FOR_A_DRIFT = 3

_ALPHA = 0.05
"""Error probability of a test for significance, as for camera parameters."""

_HELD = 0.1
"""Redundancy number of an unknown's own a-priori value below which that value holds it, and the stations do not."""

_CAMERA = ("C", "DX", "DY")

_PLAN = frozenset((*LEVER_ARM[:2], *SHIFT[:2], "DX", "DY"))
"""What moves the image on the ground in plan, as a small turn of the photo about x or y does."""

_ONE_HEIGHT = "photos from one flying height do not separate them: fly a second height, or hold one constant"
_SAME_DIRECTION = "all photos are turned alike in kappa: opposite strips separate them, or hold one constant"
_SAME_AXIS = "all photos look in the same direction: nothing separates them, hold one constant"
_BOTH = "judge them together, or hold one constant"


def antenna_diagnosis(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Return a diagnosis for each drift of too few stations, and for unknowns that hardly differ."""
    if not solved.block.antennas or solved.block.is_free_network:
        return
    yield from _short_drifts(solved)
    yield from _strong_pairs(solved)
    yield from _hidden_boresights(solved)
    yield from _not_significant(solved)


def cause_of_antenna(solved: SolvedBlock, name: str, kinds: list[str]) -> tuple[str, str]:
    """Return why unknowns of an antenna, or of a strip of its stations, are not determined, and what to do."""
    block = solved.block
    with_position = any(station.has_position and min(station.position_error) >= 0.0 for station in block.stations)
    with_angles = any(station.has_angles and min(station.angle_error) >= 0.0 for station in block.stations)
    if set(kinds) & set(BORESIGHT):
        if not with_angles:
            return "no station of it has an attitude", "hold the boresight constant, or give OMEGA PHI KAPPA in .STA"
        return "its strips do not separate it from the other unknowns", "add control, or strips of opposite direction"
    if not with_position:
        return "no station of it has a position", "hold it constant, or give positions in .STA"
    if TIME_OFFSET in kinds and not np.any(station_places(block).velocity):
        return "the stations have no times", "hold it constant, or give times in .STA"
    if set(kinds) & set(DRIFT) and any(own == name for own, _ in _few(solved)):
        return f"it has fewer than {_FOR_A_DRIFT} stations with different times", 'set drift = "session" or "none"'
    return _inseparable(solved, kinds)


def _inseparable(solved: SolvedBlock, kinds: list[str]) -> tuple[str, str]:
    """Return why lever arm and shift cannot be told apart, or what else they hang together with."""
    of_arm = [column for column in solved.problem.unknowns.names.reduced if column.kind in LEVER_ARM]
    of_shift = [column for column in solved.problem.unknowns.names.reduced if column.kind in SHIFT]
    if of_arm and of_shift:
        along_axis = {kind[1] for kind in kinds} == {"Z"}
        text = _SAME_AXIS if along_axis else _SAME_DIRECTION
        return f"lever arm and shift are the same here: {text.partition(':')[0]}", "hold the lever arm constant"
    if not any(point.kind == "control" for point in solved.block.control_points):
        return "without control points the whole block shifts with it", "add control, or give its a-priori error"
    return "the stations do not determine it", "hold it constant, or give its a-priori error"


def _not_significant(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name the shifts, drifts, boresights and time offsets that do not differ from zero: Fisher's F, three together."""
    if solved.variance.redundancy <= 0:
        return
    block, state, unknowns = solved.block, solved.state, solved.problem.unknowns
    places = station_places(block)
    of_strips: dict[tuple[str, str], list[str]] = {}
    for kind, stretches, values, columns in (
        ("shift", places.shifts, state.shifts, unknowns.shifts),
        ("drift", places.drifts, state.drifts, unknowns.drifts),
    ):
        for stretch, value, column in zip(stretches, values, columns, strict=True):
            antenna = block.antennas[stretch.antenna]
            errors = antenna.shift_error if kind == "shift" else antenna.drift_error
            if not _differs(solved, value, column, errors):
                of_strips.setdefault((antenna.name, kind), []).append("" if stretch.strip is None else stretch.strip)
    for (name, kind), strips in of_strips.items():
        of = f" of strip {joined(strips)}" if any(strips) else ""
        text = f"the {kind}{of} of antenna {name} is not significant"
        others = "name those that are with strips = [...] in [[antenna]], or " if any(strips) else ""
        remedy = f'{others}set {kind} = "none"' + ("" if others else " in [[antenna]]")
        yield Diagnosis("not-significant", f"antenna {name}", text, remedy)
    for antenna, value, column in zip(block.antennas, state.antennas, unknowns.antennas, strict=True):
        for parameters, place in ((BORESIGHT, BORESIGHT_PLACES), ((TIME_OFFSET,), slice(6, 7))):
            if (column[place] != CONSTANT).all() and not _differs(solved, value[place], column[place]):
                text = f"{', '.join(parameters)} of antenna {antenna.name} is not significant"
                yield Diagnosis("not-significant", f"antenna {antenna.name}", text, "hold it constant at zero")


def _differs(
    solved: SolvedBlock, values: FloatArray, columns: IntArray, errors: tuple[float, ...] | None = None
) -> bool:
    """Return whether unknowns are significant, or cannot be tested; those that their a-priori errors hold are not."""
    if solved.normals.removed[columns].any():
        return True
    cofactor = solved.cofactors_of(columns)
    if errors is not None:
        tested = np.diag(cofactor) < (1.0 - _HELD) * np.square(errors)
        if not tested.any():
            return True
        values, columns, cofactor = values[tested], columns[tested], cofactor[np.ix_(tested, tested)]
    scale = np.sqrt(np.diag(cofactor))
    scaled = values / scale
    quantity = float(scaled @ np.linalg.solve(cofactor / np.outer(scale, scale), scaled)) / len(columns)
    limit = float(fdtri(len(columns), solved.variance.redundancy, 1.0 - _ALPHA))
    return quantity > limit * solved.deviation_scale**2


def _few(solved: SolvedBlock) -> Iterator[tuple[str, int]]:
    """Yield the strips or sessions with a drift that have too few stations at different times, and their number."""
    places, block = station_places(solved.block), solved.block
    for row, stretch in enumerate(places.drifts):
        count = len({block.stations[member].time for member in np.flatnonzero(places.drift == row).tolist()})
        if count < _FOR_A_DRIFT:
            yield name_of_stretch(block.antennas[stretch.antenna], stretch), count


def _short_drifts(solved: SolvedBlock) -> Iterator[Diagnosis]:
    for name, count in _few(solved):
        text = f"the drift of antenna {name} comes from {counted(count, 'station')}: it hides every error of theirs"
        yield Diagnosis("inseparable", f"antenna {name}", text, 'set drift = "session" or "none" in [[antenna]]')


def _strong_pairs(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name each unknown of an antenna with the unknown that it correlates with most, if that is too much."""
    names, cofactor = solved.problem.unknowns.names.reduced, solved.cofactors.reduced
    usable = [column for column in range(len(names)) if _is_usable(solved, column)]
    said: set[frozenset[int]] = set()
    for a in (column for column in usable if names[column].group == "ANTENNA"):
        others = [column for column in usable if column != a]
        r = np.array([cofactor[a, b] / np.sqrt(cofactor[a, a] * cofactor[b, b]) for b in others])
        if not others or np.abs(r).max() <= _STRONG:
            continue
        b = others[int(np.argmax(np.abs(r)))]
        if frozenset((a, b)) not in said:
            said.add(frozenset((a, b)))
            pair = f"{_name(names[a])} and {_name(names[b])}"
            text = f"{pair} correlate by {float(r[np.argmax(np.abs(r))]):.3f}"
            yield _inseparable_ones(solved, text, [names[a], names[b]])


def _hidden_boresights(solved: SolvedBlock) -> Iterator[Diagnosis]:
    """Name each boresight with the fewest others that it correlates with too much together, though with none alone.

    A shift and the principal point, for instance, share between them what one of them would hide.
    """
    names = solved.problem.unknowns.names.reduced
    usable = [column for column in range(len(names)) if _is_usable(solved, column)]
    plan = [column for column in usable if names[column].kind in _PLAN]
    for a in (column for column in usable if names[column].kind in BORESIGHT):
        cofactor = solved.cofactors_of(np.array([a, *plan]))
        scale = np.sqrt(np.diag(cofactor))
        places, r = _fewest_that_hide(cofactor / np.outer(scale, scale))
        if len(places) > 1:
            hiding = [names[plan[place - 1]] for place in places]
            others = [_name(unknown) for unknown in hiding[:_MOST_NAMED]]
            if len(hiding) > _MOST_NAMED:
                others.append("others")
            text = f"{_name(names[a])} correlates by {r:.3f} with {joined(others)} together"
            yield _inseparable_ones(solved, text, [names[a], *hiding])


def _fewest_that_hide(correlation: FloatArray) -> tuple[list[int], float]:
    """Return the unknowns that correlate too much with the first one together, and how much; none if all do not.

    They are chosen one by one, each as the one that raises the multiple correlation most, as far as they are named.
    """
    places = list(range(1, len(correlation)))
    of_all = _multiple_correlation(correlation, places)
    if of_all <= _STRONG:
        return [], of_all
    chosen: list[int] = []
    for _ in range(min(_MOST_NAMED, len(places))):
        found = [0.0 if place in chosen else _multiple_correlation(correlation, [*chosen, place]) for place in places]
        chosen.append(places[int(np.argmax(found))])
        if max(found) > _STRONG:
            return chosen, max(found)
    return places, of_all


def _multiple_correlation(correlation: FloatArray, places: list[int]) -> float:
    """Return the multiple correlation of the first variable with others: R² = r' C^-1 r, C of the others."""
    with_first = correlation[places, 0]
    square = with_first @ np.linalg.lstsq(correlation[np.ix_(places, places)], with_first, rcond=None)[0]
    return float(np.sqrt(np.clip(square, 0.0, 1.0)))


def _inseparable_ones(solved: SolvedBlock, text: str, unknowns: list[UnknownName]) -> Diagnosis:
    """Return the diagnosis of unknowns that hardly differ; the first is an antenna's."""
    reason, _, remedy = _reason(solved, {unknown.kind for unknown in unknowns}).partition(": ")
    text, remedy = (f"{text}: {reason}", remedy) if remedy else (text, reason)
    return Diagnosis("inseparable", f"antenna {unknowns[0].name}", text, remedy)


def _is_usable(solved: SolvedBlock, column: int) -> bool:
    name = solved.problem.unknowns.names.reduced[column]
    concerned = name.group == "ANTENNA" or (name.group == "CAMERA" and name.kind in _CAMERA)
    determined = not solved.normals.removed[column] and solved.cofactors.reduced[column, column] > 0.0
    return concerned and bool(determined)


def _name(unknown: UnknownName) -> str:
    return f"{unknown.kind} of {unknown.group.lower()} {unknown.name}"


def _reason(solved: SolvedBlock, kinds: set[str]) -> str:
    """Return why unknowns hardly differ, then what to do."""
    if "C" in kinds and kinds & {"LZ", "SZ"}:
        return _ONE_HEIGHT
    if kinds <= {"LZ", "SZ"} and _turns_least(solved, 2):
        return _SAME_AXIS
    if kinds <= _PLAN.union(BORESIGHT) and _turns_least(solved, 0):
        return _SAME_DIRECTION
    return _BOTH


def _turns_least(solved: SolvedBlock, axis: int) -> bool:
    """Return whether an axis of the photos with stations has nearly the same direction in each strip of them."""
    places = station_places(solved.block)
    rotations = solved.state.rotations[places.photo][:, :, axis]
    stretch = places.shift if len(places.shifts) else np.zeros(len(rotations), dtype=np.int64)
    return bool(_spread(rotations, stretch) < _ALIKE)


def _spread(directions: FloatArray, stretch: IntArray) -> float:
    means = np.array([directions[stretch == row].mean(axis=0) for row in stretch.tolist()])
    return float(np.sqrt(((directions - means) ** 2).sum(axis=1).mean())) if len(directions) else 0.0
