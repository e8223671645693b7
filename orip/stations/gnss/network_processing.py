"""From the observations of receivers that stand to a network: its baselines by RTKLIB, adjusted with one mark held."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.progress import stage
from orip.stations.gnss.network import Baseline, Network, adjust_network, unreached
from orip.stations.gnss.processing import GnssFiles, common_epochs, process_gnss
from orip.stations.gnss.receiver_data import ReceiverFile, read_receiver_file
from orip.structs import replace

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
