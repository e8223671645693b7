"""Antennas that are not as orip.toml has them, and stations that are late: behind or ahead of their photos.

A lever arm is written in millimetres or with the wrong sign; and a station that is late lies ahead along the flight,
which the axes of the photos cannot tell from a lever arm where the camera always looks the same way. Without times
positions of another moment than the exposures show in the same way: no lever arm on board is so long.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import NONE, antenna_of, station_places
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.doubted_observations import down_weighted_share
from orip.mistakes.hypothesis import Hypothesis, Misfit, explains, finding, fit_of_adjustment, is_good
from orip.mistakes.mistake import STATIONS_OFF, declare
from orip.mistakes.stations.doubted_camera import are_doubted, has_positions, is_better, without_positions
from orip.mistakes.stations.given_positions import GivenPositions, given_positions
from orip.records.block import Block
from orip.records.definition import ANTENNA_PARAMETERS, TIME_OFFSET, Antenna
from orip.records.results.solution import Solution
from orip.structs import replace

ANTENNA = declare("lever-arm", "the lever arm is not as orip.toml has it", STATIONS_OFF)
LATE = declare("time-offset", "the stations are late or early", STATIONS_OFF)

_LONGEST = 5.0
"""Metres: no lever arm on board of a drone or an aircraft is longer, but for mistakes of the unit."""

_READINGS = (
    (1e-3, "it seems to be in millimetres"),
    (1e-2, "it seems to be in centimetres"),
    (-1.0, "its sign is wrong: it goes from the projection centre to the antenna, along the photo's axes"),
)
"""Factors of lever arms, and what is wrong with the arm that fits with them."""

_NEAR, _ARMS = 200.0, (1.0, 10.0)
"""Metres: distance of a camera from the ground up to which what carries it is small, and the longest lever arm on board
of what is small, and of others."""

_SAME_INTERVAL = 0.1
"""Part of the interval of exposures by which a time offset is one: speed and intervals vary by less on a strip."""

_DECIMALS = 4

_MANY = 0.25
"""Part of the coordinates of stations that loses weight where all of one axis are off."""


def misread_antennas(misfit: Misfit) -> list[ProjectWarning]:
    """Return what is wrong with the lever arm of an antenna, or with its times, if the stations fit without that."""
    block = misfit.readjuster.block
    has_positions = any(station.has_position for station in block.stations)
    if not (has_positions and block.ground_unit == "m" and misfit.readjuster.is_worthwhile):
        return []
    if not (are_doubted(misfit.solution) or down_weighted_share(misfit.solution, "station") > _MANY):
        return []
    for hypothesis in (*_other_arms(block), *_late_stations(block)):
        tried = misfit.readjuster.adjust(hypothesis.block)
        if tried is not None and _fits_better(tried, misfit.solved) and hypothesis.holds(tried):
            return hypothesis.findings(tried)
    return []


def _fits_better(tried: SolvedBlock, solved: SolvedBlock) -> bool:
    """Tell whether another adjustment explains the misfit; a block may take up a small one, and costs more then."""
    fit = fit_of_adjustment(tried)
    return explains(fit, fit_of_adjustment(solved)) or (is_good(fit) and is_better(tried, solved))


def _other_arms(block: Block) -> Iterator[Hypothesis]:
    for row, antenna in enumerate(block.antennas):
        longest = max(map(abs, antenna.lever_arm))
        for factor, how in _READINGS:
            if longest == 0.0 or (longest < _LONGEST) == (factor > 0.0):
                continue
            arm = tuple(round(factor * value, _DECIMALS) + 0.0 for value in antenna.lever_arm)
            listed = ", ".join(f"{value:g}" for value in arm)
            text = f"the stations fit with lever_arm = [{listed}]: {how}; write that in orip.toml"
            x, y, z = arm
            changed = _with_antenna(block, row, replace(antenna, lever_arm=(x, y, z)))
            yield Hypothesis(changed, finding(ANTENNA, f"antenna {antenna.name}", text))


def _with_antenna(block: Block, row: int, antenna: Antenna) -> Block:
    return replace(block, antennas=(*block.antennas[:row], antenna, *block.antennas[row + 1 :]))


def _late_stations(block: Block) -> Iterator[Hypothesis]:
    """Yield the stations of each antenna with an unknown time offset; of one for all cameras where none is defined."""
    if not all(np.isfinite(station.time) for station in block.stations if station.has_position):
        return
    if not block.antennas:
        yield _late(replace(block, antennas=(Antenna("GNSS"),)), 0, 'write [[antenna]] with name = "GNSS" and')
        return
    used = {antenna_of(block.antennas, camera.name) for camera in block.cameras} - {NONE}
    for row in sorted(used):
        if TIME_OFFSET not in block.antennas[row].unknown:
            yield _late(block, row, f"set in [[antenna]] {block.antennas[row].name}")


def _late(block: Block, row: int, where: str) -> Hypothesis:
    antenna = block.antennas[row]
    unknown = (*antenna.unknown, TIME_OFFSET)
    column = ANTENNA_PARAMETERS.index(TIME_OFFSET)

    def findings(solved: SolvedBlock) -> list[ProjectWarning]:
        seconds = float(solved.state.antennas[row, column])
        metres = abs(seconds - antenna.time_offset) * _speed(solved, row)
        listed = ", ".join(f'"{name}"' for name in unknown)
        named = (
            "as much as from one exposure to the next: the names of photos are probably shifted by one in the .MEA or "
            "the .STA file, correct them there; else "
        )
        text = (
            f"they are {abs(seconds):.3f} s {'late' if seconds > 0.0 else 'early'}, as all are off by about "
            f"{metres:.2f} m along the flight, {named if _is_interval(block, seconds) else 'more than a lever arm: '}"
            f"{where} unknown = [{listed}] in orip.toml, or correct the times of the exposures"
        )
        return [ProjectWarning(LATE, "exposure stations", text)]

    def is_longer_than_arms(solved: SolvedBlock) -> bool:
        offset = abs(float(solved.state.antennas[row, column]) - antenna.time_offset) * _speed(solved, row)
        return offset > longest_arm(solved)

    return Hypothesis(_with_antenna(block, row, replace(antenna, unknown=unknown)), findings, holds=is_longer_than_arms)


def _is_interval(block: Block, seconds: float) -> bool:
    """Tell whether a time offset is the usual interval of the exposures."""
    times = sorted(station.time for station in block.stations if station.has_position)
    interval = float(np.median(np.diff(times)))
    return abs(abs(seconds) - interval) < _SAME_INTERVAL * interval


def _speed(solved: SolvedBlock, row: int) -> float:
    """Return the usual speed of an antenna, metres a second."""
    places = station_places(solved.block)
    return float(np.median(np.linalg.norm(places.velocity[places.antenna == row], axis=1)))


def longest_arm(solved: SolvedBlock) -> float:
    """Return how long a lever arm may be on board of what flies so high, metres."""
    return _ARMS[0 if _distance(solved) < _NEAR else 1]


def _distance(solved: SolvedBlock) -> float:
    """Return the usual distance of the points from their cameras."""
    state, points = solved.state, solved.block.photo_points
    return float(np.median(np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)))


_FEWEST = 6
"""Photos of which it is seen that all are off alike."""

_STRAIGHT = float(np.cos(np.radians(20.0)))
"""Cosine of the largest change of direction on a strip."""

_ALIKE = 0.2
"""Part of the shift along the flight that its scatter, and the shift across, have at most."""


def along_the_flight(misfit: Misfit) -> list[ProjectWarning]:
    """Return that positions, none of them with a time, are all off along the flight by more than a lever arm."""
    block = misfit.readjuster.block
    can_be_told = has_positions(block) and block.ground_unit == "m" and misfit.readjuster.is_worthwhile
    has_times = any(np.isfinite(station.time) for station in block.stations)
    if has_times or not (can_be_told and are_doubted(misfit.solution)):
        return []
    without = misfit.readjuster.adjust(without_positions(block))  # a camera takes up what it can of such a shift
    if without is None or not is_good(fit_of_adjustment(without)):
        return []
    return _ahead(given_positions(block), solution_of(without), longest_arm(misfit.solved))


def _ahead(positions: GivenPositions, without: Solution, longest: float) -> list[ProjectWarning]:
    place = {name: row for row, name in enumerate(without.photos.names)}
    known = [row for row, name in enumerate(positions.photos) if name in place]
    if len(known) < _FEWEST:
        return []
    found = without.photos.values[[place[positions.photos[row]] for row in known], :3]
    off = positions.given[known] - found
    ahead, straight = _directions(found[:, :2])
    if np.count_nonzero(straight) < _FEWEST:
        return []
    along = np.sum(off[straight, :2] * ahead[straight], axis=1)
    across = off[straight, 0] * ahead[straight, 1] - off[straight, 1] * ahead[straight, 0]
    by = float(np.median(along))
    scatter = float(np.median(np.abs(along - by))) / MEDIAN_OF_NORMAL
    if abs(by) < longest or max(scatter, abs(float(np.median(across)))) > _ALIKE * abs(by):
        return []
    text = (
        f"they are all {abs(by):.2f} m {'ahead of' if by > 0.0 else 'behind'} their photos along the flight, more than "
        "a lever arm: they are those of another moment than the exposures; match events and exposures again; or write "
        'the times of the exposures in the .STA file, and [[antenna]] with name = "GNSS" and unknown = '
        '["time_offset"] in orip.toml'
    )
    return [ProjectWarning(LATE, "exposure stations", text)]


def _directions(places: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return unit vectors (n, 2) of the flight at places in its order, and (n,) bool where it is straight."""
    steps = np.diff(places, axis=0)
    steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    ahead, straight = np.zeros_like(places), np.zeros(len(places), dtype=bool)
    ahead[1:-1] = steps[:-1] + steps[1:]
    ahead[1:-1] /= np.maximum(np.linalg.norm(ahead[1:-1], axis=1, keepdims=True), 1e-9)
    straight[1:-1] = np.sum(steps[:-1] * steps[1:], axis=1) > _STRAIGHT
    return ahead, straight
