"""Blocks with observations of all kinds, and one of each kind wrong by twice its minimal detectable size."""

from __future__ import annotations

from typing import Literal

import numpy as np
from bundle.aerial_block import PRECISION_MM
from monte_carlo.simulated_blocks import NO_DOWN_WEIGHTING, random_numbers, solved, with_noise
from msgspec import Struct
from support.synthetic_block import SyntheticBlock, synthetic_block

from orip.bundle.results.reliability import NON_CENTRALITY
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block, TheodoliteSet
from orip.records.control import ControlDirection, ControlDistance, ControlElement
from orip.structs import replace

CONTROL_ERROR = 0.0009
DISTANCE_ERROR = 0.001
ELEMENT_ERROR = 0.002
ANGLE_ERROR = 0.02
DIRECTION_ERROR = 0.05
KINDS = ("photo", "control", "distance", "direction", "zenith", "centre", "rotation")
Sigma0 = Literal["apriori", "posteriori"]
LEAST_REDUNDANCY = 0.3
MINIMAL_SIZES = 2.0


class KindRun(Struct, frozen=True):
    """What snooping found in one block.

    Attributes
    ----------
    named : dict
        Kind of the wrong observation: whether it was named, alone or among what cannot be told apart from it.
    left_out : dict
        Kind: whether it was left out itself.
    others : int
        Findings that name no wrong observation.
    right : int
        Right observations.
    """

    named: dict[str, bool]
    left_out: dict[str, bool]
    others: int
    right: int


def observed_block(run: int) -> SyntheticBlock:
    """Return a block with noise, weighted control, distances, two theodolite sets, and stations with angles."""
    made = synthetic_block("convergent", f"kinds {run}", precision_mm=PRECISION_MM, **NO_DOWN_WEIGHTING)
    random = random_numbers("kinds", run)
    block = with_noise(made, random)
    names, place = block.point_names, block.point_index()
    distances = tuple(
        ControlDistance(
            f"D{number}", start, end, "XYZ", _length(made, place[start], place[end], random), DISTANCE_ERROR
        )
        for number, (start, end) in enumerate(zip(names[1:13:2], names[20:32:2], strict=True))
    )
    sets = (("S1", names[0], names[3:31:4]), ("S2", names[10], names[1:33:4]))
    return replace(
        made,
        block=replace(
            block,
            distances=distances,
            directions=tuple(_directions(made, block, sets, random)),
            theodolites=tuple(TheodoliteSet(name, np.radians(40.0)) for name, *_ in sets),
            elements=tuple(_elements(made, block, random)),
        ),
    )


def kind_run(case: tuple[int, Sigma0]) -> KindRun:
    """Spoil one observation of each kind by twice its minimal detectable size, and search for them.

    They have redundancy numbers of 0.3 and more. Each block has a geometry and errors of its own.
    """
    run, sigma0 = case
    block = observed_block(run).block
    clean = solved(block)
    spoilt, wrong = _spoilt(block, clean, random_numbers("kinds, blunders", run))
    found = snoop(spoilt, SnoopingSettings(sigma0), lambda _: None, lambda: False)
    left_out = {row for finding in found.findings for row in finding.rows}
    named = [{row for rows in (finding.rows, *finding.alternatives) for row in rows} for finding in found.findings]
    return KindRun(
        named={kind: any(row in rows for rows in named) for kind, row in wrong.items()},
        left_out={kind: row in left_out for kind, row in wrong.items()},
        others=sum(rows.isdisjoint(wrong.values()) for rows in named),
        right=int(np.count_nonzero(clean.equations.active)) - len(wrong),
    )


def _spoilt(block: Block, clean: SolvedBlock, random: np.random.Generator) -> tuple[Block, dict[str, int]]:
    """Return the block with a wrong observation of each kind, and their rows."""
    rows = [kind.rows for kind in clean.problem.observations]
    kind = np.array([part.kind.name for part in rows for _ in part.photo])
    component = np.array([name for part in rows for name in part.component])
    error = np.concatenate([part.error for part in rows])
    number = clean.variance.redundancy_numbers
    first = {name: int(np.flatnonzero(kind == name)[0]) for name in np.unique(kind)}
    wrong = {}
    for name in KINDS:
        chosen = _of_kind(name, kind, component) & (number >= LEAST_REDUNDANCY)
        if not chosen.any():
            continue
        row = int(random.choice(np.flatnonzero(chosen)))
        size = MINIMAL_SIZES * NON_CENTRALITY * error[row] / np.sqrt(number[row]) * random.choice([-1.0, 1.0])
        block = _with_error(block, kind[row], row - first[kind[row]], component[row], size)
        wrong[name] = row
    return block, wrong


def _of_kind(name: str, kind: np.ndarray, component: np.ndarray) -> np.ndarray:
    if name in ("direction", "zenith"):
        return (kind == "direction") & (component == name)
    if name in ("centre", "rotation"):
        return (kind == "element") & (np.isin(component, ("X0", "Y0", "Z0")) == (name == "centre"))
    return kind == name


def _with_error(block: Block, kind: str, row: int, component: str, size: float) -> Block:
    if kind == "photo":
        xy = block.photo_points.xy.copy()
        xy[row // 2, row % 2] += size
        return replace(block, photo_points=replace(block.photo_points, xy=xy))
    if kind == "control":
        point = block.control_points[row // 3]
        coordinates = tuple(value + size * (axis == row % 3) for axis, value in enumerate(point.coordinates))
        return replace(block, control_points=_exchanged(block.control_points, row // 3, coordinates=coordinates))
    if kind == "distance":
        return replace(block, distances=_exchanged(block.distances, row, distance=block.distances[row].distance + size))
    if kind == "element":
        return replace(block, elements=_exchanged(block.elements, row, value=block.elements[row].value + size))
    old = getattr(block.directions[row // 2], component)
    return replace(block, directions=_exchanged(block.directions, row // 2, **{component: old + size}))


def _exchanged(records: tuple, index: int, **values: object) -> tuple:
    return (*records[:index], replace(records[index], **values), *records[index + 1 :])


def _length(made: SyntheticBlock, start: int, end: int, random: np.random.Generator) -> float:
    return float(np.linalg.norm(made.points[end] - made.points[start]) + DISTANCE_ERROR * random.normal())


def _directions(made: SyntheticBlock, block: Block, sets: tuple, random: np.random.Generator) -> list[ControlDirection]:
    place = block.point_index()
    found = []
    for name, station, targets in sets:
        for target in targets:
            dx, dy, dz = made.points[place[target]] - made.points[place[station]]
            azimuth, zenith = np.degrees(np.arctan2(dx, dy)), np.degrees(np.arctan2(np.hypot(dx, dy), dz))
            noise = DIRECTION_ERROR * random.normal(size=2)
            direction = float((azimuth - 40.0 + noise[0]) % 360.0)
            found.append(
                ControlDirection(name, station, target, direction, DIRECTION_ERROR, float(zenith + noise[1]),
                                 DIRECTION_ERROR)
            )  # fmt: skip
    return found


def _elements(made: SyntheticBlock, block: Block, random: np.random.Generator) -> list[ControlElement]:
    found = []
    for photo, values in zip(block.photos, made.orientations, strict=True):
        for kind, value in zip(("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA"), values, strict=True):
            angle = kind in ("OMEGA", "PHI", "KAPPA")
            error = ANGLE_ERROR if angle else ELEMENT_ERROR
            true = float(np.degrees(value)) if angle else float(value)
            found.append(ControlElement(photo.name, "PHOTO", kind, true + error * random.normal(), error))
    return found
