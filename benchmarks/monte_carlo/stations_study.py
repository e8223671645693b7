"""Blocks with exposure stations: what is planted in their antennas, and wrong stations among right ones."""

from __future__ import annotations

from typing import Literal

import numpy as np
from bundle.stations_of_block import MADE, stations
from monte_carlo.simulated_blocks import NO_DOWN_WEIGHTING, random_numbers, solved, with_noise
from msgspec import Struct

from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.records.block import Block
from orip.records.control import Station
from orip.records.definition import BORESIGHT, LEVER_ARM, Antenna
from orip.structs import replace

Design = Literal["lever arm and boresight", "shift and drift"]

FACTOR = np.array([[0.02, 0.0, 0.0], [0.01, 0.02, 0.0], [-0.015, 0.01, 0.03]])
"""Cholesky factor of the covariance of a position, m."""

ANGLE_ERROR = 2e-4
MINIMAL_SIZES = 6.0

_ARM, _TURN = np.array([0.4, -0.3, 1.2]), np.array([0.6, -0.4, 2.5])
_SHIFTS = np.array([[0.4, -0.3, 0.5], [-0.2, 0.1, 0.3], [0.6, 0.2, -0.4]])
_DRIFTS = np.array([[0.02, -0.01, 0.03], [0.0, 0.01, 0.0], [-0.02, 0.04, 0.01]])

_PLANTED = {
    "lever arm and boresight": {"arm": _ARM, "turn": _TURN},
    "shift and drift": {"shifts": _SHIFTS, "drifts": _DRIFTS},
}
_ANTENNAS = {
    "lever arm and boresight": Antenna("GNSS", unknown=(*LEVER_ARM, *BORESIGHT)),
    "shift and drift": Antenna("GNSS", shift="strip", drift="strip"),
}


class WrongStations(Struct, frozen=True):
    """What snooping found in a block with one wrong position and one wrong attitude; see `KindRun`."""

    named: int
    planted: int
    others: int
    right: int


def observed(exact: tuple[Station, ...], random: np.random.Generator) -> tuple[Station, ...]:
    """Return stations with correlated errors of their positions and independent ones of their angles."""
    covariance = FACTOR @ FACTOR.T
    error = tuple(np.sqrt(np.diag(covariance)).tolist())
    return tuple(
        replace(
            station,
            position=tuple((np.array(station.position) + FACTOR @ random.normal(size=3)).tolist()),
            position_error=error,
            covariance=tuple(map(tuple, covariance.tolist())),
            angles=tuple((np.array(station.angles) + ANGLE_ERROR * random.normal(size=3)).tolist()),
            angle_error=(ANGLE_ERROR,) * 3,
        )
        for station in exact
    )


def block_with_stations(purpose: str, run: int, antenna: Antenna | None = None, **planted: np.ndarray) -> Block:
    random = random_numbers(purpose, run)
    block = with_noise(MADE, random)
    return replace(
        block,
        definition=replace(block.definition, **NO_DOWN_WEIGHTING),
        stations=observed(stations(**planted), random),
        antennas=() if antenna is None else (antenna,),
    )


def antenna_errors(case: tuple[Design, int]) -> np.ndarray:
    """Return the errors of all antenna unknowns of a design, divided by their standard deviations for sigma0 = 1."""
    design, run = case
    planted = _PLANTED[design]
    found = solved(block_with_stations(design, run, _ANTENNAS[design], **planted))
    unknowns, state = found.problem.unknowns, found.state
    if design == "lever arm and boresight":
        columns = unknowns.antennas[0, :6]
        error = state.antennas[0, :6] - np.concatenate([_ARM, np.radians(_TURN)])
    else:
        columns = np.concatenate([unknowns.shifts.ravel(), unknowns.drifts.ravel()])
        error = np.concatenate([(state.shifts - _SHIFTS).ravel(), (state.drifts - _DRIFTS).ravel()])
    return error / np.sqrt(found.cofactors.reduced.diagonal()[columns])


def wrong_stations(run: int) -> WrongStations:
    """Spoil a coordinate of a position and an angle of another station by six minimal detectable sizes."""
    block = block_with_stations("wrong stations", run)
    clean, random = solved(block), random_numbers("wrong stations, blunders", run)
    kinds = [kind.rows.kind.name for kind in clean.problem.observations]
    first = np.cumsum([0, *(len(kind.rows.error) for kind in clean.problem.observations)])
    number, wrong = clean.variance.redundancy_numbers, set()
    changed = list(block.stations)
    for kind, station in zip(("station", "attitude"), random.choice(len(changed), 2, replace=False), strict=True):
        axis = int(random.integers(3))
        row = int(first[kinds.index(kind)] + 3 * station + axis)
        error = np.array(changed[station].position_error if kind == "station" else changed[station].angle_error)[axis]
        size = MINIMAL_SIZES * NON_CENTRALITY * error / np.sqrt(number[row]) * random.choice([-1.0, 1.0])
        field = "position" if kind == "station" else "angles"
        values = np.array(getattr(changed[station], field))
        values[axis] += size
        changed[station] = replace(changed[station], **{field: tuple(values.tolist())})
        wrong.add(row)
    found = snoop(replace(block, stations=tuple(changed)), SnoopingSettings(), lambda _: None, lambda: False)
    named = [set(finding.rows) for finding in found.findings]
    return WrongStations(
        named=sum(any(row in rows for rows in named) for row in wrong),
        planted=len(wrong),
        others=sum(rows.isdisjoint(wrong) for rows in named),
        right=int(np.count_nonzero(clean.equations.active)) - len(wrong),
    )
