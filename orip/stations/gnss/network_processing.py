"""From the observations of receivers that stand to a network: baselines by RTKLIB, adjusted with one mark held.

All baselines of receivers that observed at the same time are used. Those of n receivers say no more than n - 1 of them:
each counts 2/n, which gives the places and the covariances of a solution of all receivers together (Craymer and Beck
1992, Session versus single-baseline GPS processing, ION GPS-92).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from msgspec import Struct
from scipy.stats import chi2

from orip.arrays import BoolArray, FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.progress import stage
from orip.stations.gnss.processing import GnssFiles, common_epochs, process_gnss
from orip.stations.gnss.receiver_data import ReceiverFile, read_receiver_file
from orip.structs import replace

_ERROR_PROBABILITY = 0.01
"""That any baseline of a network is called wrong which is right."""

_ROUNDING = 1e-4
"""Metres, to which RTKLIB gives coordinates."""


class Baseline(Struct, frozen=True):
    """From one mark to another, by their numbers.

    Parameters
    ----------
    first, second : int
    vector : array (3,)
        Geocentric, m.
    covariance : array (3, 3)
        By itself, m².
    receivers : int
        That observed at the same time.
    """

    first: int
    second: int
    vector: FloatArray
    covariance: FloatArray
    receivers: int = 2


class Network(Struct, frozen=True):
    """n marks by b baselines.

    Parameters
    ----------
    place : array (n, 3)
        Geocentric, m.
    covariance : array (3 n, 3 n)
        m²; zero for the mark that is held.
    residual : array (b, 3)
        Adjusted less observed, m.
    is_wrong : array (b,) of bool
        A baseline does not fit the others.
    sigma0 : float
        NaN without redundancy. Covariances are multiplied by its square where it is above 1: residuals of simultaneous
        baselines are smaller than their errors, and say nothing where they are small.
    redundancy : int
    """

    place: FloatArray
    covariance: FloatArray
    residual: FloatArray
    is_wrong: BoolArray
    sigma0: float
    redundancy: int


def unreached(count: int, held: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Return the marks that no baselines join with the one that is held."""
    reached, grows = {held}, True
    while grows:
        more = {mark for pair in pairs if reached & set(pair) for mark in pair}
        grows = not more <= reached
        reached |= more
    return [mark for mark in range(count) if mark not in reached]


def adjust_network(count: int, held: int, place: FloatArray, baselines: Sequence[Baseline]) -> Network:
    """Return the places of `count` marks, all joined by baselines; `place` (3,) is that of the one held."""
    free = [mark for mark in range(count) if mark != held]
    column = {mark: 3 * at for at, mark in enumerate(free)}
    design, observed = np.zeros((3 * len(baselines), 3 * len(free))), np.zeros(3 * len(baselines))
    weight = np.zeros((len(observed), len(observed)))
    for row, line in enumerate(baselines):
        rows = slice(3 * row, 3 * row + 3)
        observed[rows] = line.vector
        for mark, sign in ((line.second, 1.0), (line.first, -1.0)):
            if mark == held:
                observed[rows] -= sign * place
            else:
                design[rows, column[mark] : column[mark] + 3] = sign * np.eye(3)
        own = line.covariance + np.eye(3) * _ROUNDING**2 / 12.0
        weight[rows, rows] = np.linalg.inv(own * line.receivers / 2.0)
    cofactor = np.linalg.inv(design.T @ weight @ design)
    found = cofactor @ (design.T @ weight @ observed)
    residual = design @ found - observed
    redundancy = len(observed) - len(found)
    sigma0 = float(np.sqrt(residual @ weight @ residual / redundancy)) if redundancy else np.nan
    places, covariance = np.tile(place, (count, 1)), np.zeros((3 * count, 3 * count))
    at = np.concatenate([np.arange(3 * mark, 3 * mark + 3) for mark in free])
    places.reshape(-1)[at] = found
    covariance[np.ix_(at, at)] = cofactor * (max(sigma0, 1.0) ** 2 if redundancy else 1.0)
    return Network(
        places, covariance, residual.reshape(-1, 3), _wrong(residual, weight, design @ cofactor @ design.T),
        sigma0, redundancy,
    )  # fmt: skip


def _wrong(residual: FloatArray, weight: FloatArray, adjusted: FloatArray) -> BoolArray:
    """Return the baseline that leaving out would better most, if that is significant: a group of three observations."""
    cofactor = np.linalg.inv(weight) - adjusted
    statistic = np.zeros(len(residual) // 3)
    for row in range(len(statistic)):
        at = slice(3 * row, 3 * row + 3)
        own = weight[at, at] @ cofactor[at, at] @ weight[at, at]
        if np.linalg.cond(own) < 1e10:
            weighted = weight[at, at] @ residual[at]
            statistic[row] = weighted @ np.linalg.solve(own, weighted)
    wrong = np.zeros(len(statistic), dtype=np.bool_)
    worst = int(np.argmax(statistic))
    wrong[worst] = statistic[worst] > chi2.isf(_ERROR_PROBABILITY / len(statistic), 3)
    return wrong


_LEAST_COMMON = 10
"""Epochs of two receivers, for a baseline."""


class NetworkResult(Struct, frozen=True):
    """Marks by name, the pairs of the baselines, the network, and what is to be said."""

    names: tuple[str, ...]
    held: int
    pairs: tuple[tuple[int, int], ...]
    network: Network
    fixed: tuple[bool, ...]
    warnings: tuple[ProjectWarning, ...]


def process_network(marks: list[Path], held: tuple[str, FloatArray] | None, settings: GnssFiles) -> NetworkResult:
    """Compute a network of all baselines of receivers that observed at the same time.

    Parameters
    ----------
    marks : list of Path
        Observations, a file a mark.
    held : tuple of str and array (3,), or None
        Name and geocentric place of the mark that is held; None: the first one with the place in its header.
    settings : GnssFiles
        Orbits, satellites and antennas; rover, base and way are those of the baselines.

    Raises
    ------
    InputError
        With everything that is wrong with the files, or if marks are not joined.
    """
    parts = _read(marks)
    names = tuple(part.marker or part.path.name.split(".")[0] for part in parts)
    number, place = _held(parts, names, held)
    pairs = [
        (one, other) for one, other in combinations(range(len(parts)), 2)
        if common_epochs(parts[other], parts[one]) >= _LEAST_COMMON
    ]  # fmt: skip
    alone = unreached(len(parts), number, pairs)
    if alone:
        text = f"no baselines of at least {_LEAST_COMMON} epochs in common join this mark with {names[number]}"
        raise InputError([Complaint(text, parts[mark].shown) for mark in alone])
    places: dict[int, FloatArray] = {number: place}
    baselines, fixed, warnings = [], [], list[ProjectWarning]()
    waiting = pairs
    with stage("baselines", total=len(pairs)) as advance:
        while waiting:
            pair = next(pair for pair in waiting if places.keys() & set(pair))
            waiting = [other for other in waiting if other != pair]
            first, second = pair if pair[0] in places else pair[::-1]
            base = places[first]
            one = replace(
                settings, rover=parts[second].path, base=parts[first].path, way="static",
                base_place=(float(base[0]), float(base[1]), float(base[2])),
            )  # fmt: skip
            found = process_gnss(one)
            places.setdefault(second, found.place)
            at_once = sum(_observed_at_once(part, parts[first], parts[second]) for part in parts)
            baselines.append(Baseline(first, second, found.vector, found.covariance, max(at_once, 2)))
            fixed.append(bool(found.joined.solution.is_fixed[-1]))
            warnings += found.warnings
            advance(len(baselines))
    network = adjust_network(len(parts), number, place, baselines)
    done = tuple((line.first, line.second) for line in baselines)
    warnings += _doubts(names, done, network, fixed)
    return NetworkResult(names, number, done, network, tuple(fixed), tuple(warnings))


def _read(marks: list[Path]) -> list[ReceiverFile]:
    read = [read_receiver_file(path, path.name) for path in marks]
    near = next((part.time[0] for part in read if isinstance(part, ReceiverFile)), None)
    parts, complaints = [], list[Complaint]()
    for path, part in zip(marks, read, strict=True):
        again = read_receiver_file(path, path.name, near=near) if isinstance(part, list) else part
        if isinstance(again, list):
            complaints += again
        elif again.kind != "O":
            complaints.append(Complaint("these are no observations; give orbits with --orbits", again.shown))
        else:
            parts.append(again)
    if len(marks) < 2:
        complaints.append(Complaint("a network needs the observations of two marks at least", marks[0].name))
    if complaints:
        raise InputError(complaints)
    return parts


def _held(
    parts: list[ReceiverFile], names: tuple[str, ...], held: tuple[str, FloatArray] | None
) -> tuple[int, FloatArray]:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        text = f"marks have the same name: {', '.join(twice)}; give each its MARKER NAME in the header"
        raise InputError([Complaint(text, parts[names.index(twice[0])].shown)])
    if held is None:
        if not np.isfinite(parts[0].place).all():
            text = (
                "the header has no place of this mark; give one that is held: --hold NAME=X,Y,Z, or hold and "
                "hold_place of [gnss_network]"
            )
            raise InputError([Complaint(text, parts[0].shown)])
        return 0, parts[0].place
    if held[0] not in names:
        text = f"no mark is called {held[0]}, which is to be held; there are {', '.join(names)}"
        raise InputError.single(text)
    return names.index(held[0]), held[1]


def _observed_at_once(part: ReceiverFile, first: ReceiverFile, second: ReceiverFile) -> bool:
    """Return whether a receiver observed for most of the time of a baseline."""
    begin, end = max(first.time[0], second.time[0]), min(first.time[-1], second.time[-1])
    return bool(min(part.time[-1], end) - max(part.time[0], begin) > 0.5 * (end - begin))


def _doubts(
    names: tuple[str, ...], pairs: tuple[tuple[int, int], ...], network: Network, fixed: list[bool]
) -> list[ProjectWarning]:
    found = []
    for row, (first, second) in enumerate(pairs):
        line = f"{names[first]} to {names[second]}"
        if not fixed[row]:
            text = "ambiguities are not fixed: decimetres at best"
            found.append(ProjectWarning("baseline-float", line, text))
        if network.is_wrong[row]:
            size = 1000.0 * float(np.linalg.norm(network.residual[row]))
            text = (
                f"the baseline does not fit the others, by {size:.0f} mm and more; leave one of its files out, or check"
            )
            found.append(ProjectWarning("baseline-wrong", line, f"{text} check its antenna heights"))
    return found
