"""A block of sixty photos with a drifting receiver: stations alone, and together with differences between them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from bundle.aerial_block import Flight, aerial_block
from monte_carlo.simulated_blocks import NO_DOWN_WEIGHTING, random_numbers, solved, with_noise
from monte_carlo.stations_study import MINIMAL_SIZES
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.results.solution import solution_of
from orip.bundle.snooping.findings import blunders_of
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.records.block import Block
from orip.records.control import Station, StationDifference
from orip.records.definition import BORESIGHT, Antenna
from orip.records.observation_kinds import DIFFERENCE
from orip.structs import replace

MADE = aerial_block("relative", 15, Flight(strips=4, photos=15))
LAST = len(MADE.orientations) - 1

_ARM, _TURN = np.array([0.2, -0.3, 0.9]), np.array([0.4, -0.6, 1.5])
_SHIFT, _DRIFT = np.array([0.4, -0.3, 0.6]), np.array([0.5e-3, -0.4e-3, 0.8e-3])
_INTERVAL, _TURN_TIME = 4.0, 60.0
_ROOT = np.tril(np.random.default_rng(11).normal(size=(6, 6)), -1) * 0.25 + np.eye(6)
_ABSOLUTE = np.repeat([0.03, 3e-4], 3)[:, None] * _ROOT
_RELATIVE = np.repeat([0.004, 2e-5], 3)[:, None] * _ROOT
_ANTENNA = Antenna("GNSS", lever_arm=tuple(_ARM.tolist()), unknown=BORESIGHT, shift="session", drift="session")


class PointErrors(Struct, frozen=True):
    """Errors (n, 3) of new points, and their standard deviations for sigma0 = 1."""

    error: np.ndarray
    sd: np.ndarray


def block(run: int, *, with_differences: bool) -> Block:
    """Return a block with one control point whose stations drift together over the session."""
    random = random_numbers("relative", run)
    noisy = with_noise(MADE, random)
    control = noisy.control_points[len(noisy.control_points) // 2]
    row = np.arange(LAST + 1)
    time = _INTERVAL * row + _TURN_TIME * (row // 15)
    attitude = Rotation.from_euler("XYZ", MADE.orientations[:, 3:])
    inertial = attitude * Rotation.from_euler("XYZ", _TURN, degrees=True).inv()
    true = MADE.orientations[:, :3] + attitude.apply(_ARM)
    stations, differences = [], []
    for place in row:
        noise = _ABSOLUTE @ random.normal(size=6)
        position = true[place] + _SHIFT + _DRIFT * (time[place] - time.mean()) + noise[:3]
        angles = inertial[place].as_euler("XYZ") + noise[3:]
        stations.append(
            Station(f"P{place + 1}", *_six(position, angles, _ABSOLUTE), time=float(time[place]), strip="1")
        )
    for one, other in pairwise(row):
        if one // 15 == other // 15:
            noise = _RELATIVE @ random.normal(size=6)
            turned = Rotation.from_rotvec(noise[3:]) * (inertial[one].inv() * inertial[other])
            moved = true[other] - true[one] + _DRIFT * (time[other] - time[one]) + noise[:3]
            six = _six(moved, turned.as_euler("XYZ"), _RELATIVE)
            differences.append(StationDifference(f"P{one + 1}", f"P{other + 1}", *six))
    return replace(
        noisy,
        definition=replace(noisy.definition, **NO_DOWN_WEIGHTING),
        control_points=(control,),
        stations=tuple(stations),
        differences=tuple(differences) if with_differences else (),
        antennas=(_ANTENNA,),
    )


def _six(position: np.ndarray, angles: np.ndarray, root: np.ndarray) -> tuple[object, ...]:
    covariance = root @ root.T
    error = np.sqrt(np.diag(covariance)).tolist()
    return (
        tuple(position.tolist()), tuple(error[:3]), tuple(angles.tolist()), tuple(error[3:]),
        tuple(map(tuple, covariance.tolist())),
    )  # fmt: skip


def point_errors(case: tuple[int, bool]) -> PointErrors:
    """Return what the points of a run are off by."""
    run, with_differences = case
    solution = solution_of(solved(block(run, with_differences=with_differences)))
    place = MADE.block.point_index()
    rows = [place[name] for name in solution.points.names]
    new = np.array([kind == "tie" for kind in solution.point_kinds])
    error = solution.points.values - MADE.points[rows]
    return PointErrors(error[new], solution.points.sd[new] / solution.sigma0)


def wrong_difference(run: int) -> tuple[bool, int]:
    """Return whether a difference off by six minimal detectable sizes is named, and how many others are."""
    made = block(run, with_differences=True)
    clean = solved(made)
    lines, row = list(made.differences), int(random_numbers("wrong difference", run).integers(len(made.differences)))
    kinds = [kind.rows.kind for kind in clean.problem.observations]
    first = sum(len(kind.rows.error) for kind in clean.problem.observations[: kinds.index(DIFFERENCE)])
    number = clean.variance.redundancy_numbers[first + 6 * row]
    x, y, z = lines[row].position
    size = MINIMAL_SIZES * NON_CENTRALITY * lines[row].position_error[0] / float(np.sqrt(number))
    lines[row] = replace(lines[row], position=(x + size, y, z))
    found = snoop(replace(made, differences=tuple(lines)), SnoopingSettings(), lambda _: None, lambda: False)
    named = {one.point or one.photo for one in blunders_of(found.solved, found.findings)}
    return lines[row].name in named, len(named - {lines[row].name})
