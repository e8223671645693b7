"""The study of preliminary values: from nothing to the true minimum, block by block.

    PYTHONPATH=tests:benchmarks python -m monte_carlo.preliminary_study blocks.jsonl --runs 2000 --processes 2
    PYTHONPATH=tests:benchmarks python -m monte_carlo.preliminary_study blocks.jsonl --table docs/preliminary-values.md

The first makes and adjusts the blocks that are not in the file of outcomes yet; both print the tables, and `--table`
puts them in the place of those in a document.
"""

from __future__ import annotations

import argparse
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Literal

import numpy as np
from monte_carlo.preliminary_blocks import FAMILIES, simulated_records
from monte_carlo.preliminary_records import SimulatedRecords, gathered, photo_deviations, started_at, true_minimum
from monte_carlo.simulated_blocks import solved
from msgspec import Struct, to_builtins
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from orip.adjustment.convergence import TerminationReason
from orip.bundle.diagnosis import diagnose
from orip.bundle.solve import SolvedBlock
from orip.errors import OripError
from orip.prelim.chain import preliminary_values
from orip.records.block import Block
from orip.records.names import record_key
from orip.solving.starting_values import cameras_as_found
from orip.structs import replace

End = Literal["reached", "lower", "as from the truth", "other", "not converged", "refused"]

SUCCESS: tuple[End, ...] = ("reached", "lower", "as from the truth")

_ENDS: tuple[End, ...] = (*SUCCESS, "other", "not converged", "refused")

_SAME_POSITION = 0.1
"""Of the standard deviations of a photo's centre and rotation; minima that differ are further apart."""

_SAME_SIGMA0 = 1e-6
"""Iterations end when corrections are 1e-4 of the standard deviations, and sigma0 follows with their square."""

_SAME_COST = 1e-9

_LARGE = 1e9
"""Standard residual of what cannot be computed."""

SIZES = ((2, 5), (6, 20), (21, 60), (61, 200))
_PARTS = (("no blunders", 0.0, 0.0), ("up to 2 %", 1e-9, 0.02), ("over 2 %", 0.02, 1.0))


class Comparison(Struct, frozen=True):
    """An adjustment against the true minimum.

    Attributes
    ----------
    end : End
    distance : float
        Largest difference of a photo's centre or rotation, in its standard deviations.
    sigma0, cost : float
        Relative differences.
    iterations : int
    """

    end: End
    distance: float
    sigma0: float
    cost: float
    iterations: int


class Outcome(Struct, frozen=True):
    """What became of one block; `comparison` and `from_truth` are None where nothing could be adjusted.

    `from_truth` is the adjustment with the same settings started at the truth, for blocks that did not succeed.
    `start_distance` is how far off the chain left the worst photo: its centre as a part of the distance to the object,
    its rotation in radians.
    """

    run: int
    family: str
    redrawn: tuple[str, ...]
    photos: int
    points: int
    photo_points: int
    wrong: int
    control: int
    wrong_control: int
    self_calibrating: bool
    models: bool
    end: End
    reason: str
    comparison: Comparison | None
    from_truth: Comparison | None
    start_distance: tuple[float, float] | None
    chain_seconds: float
    bundle_seconds: float


class NotOrientedError(OripError):
    """The chain left photos without an orientation."""


def from_nothing(block: Block) -> tuple[Block, tuple[str, ...]]:
    """Return a gathered block started at what the chain finds, and what the chain says of it.

    Raises
    ------
    NotOrientedError
        With the chain's reasons.
    """
    values = preliminary_values(block)
    missing = [photo.how for photo in values.photos if photo.rotation is None]
    if missing:
        message = "; ".join([*values.findings, *sorted(set(missing))])
        raise NotOrientedError(message)
    started = started_at(
        replace(block, cameras=cameras_as_found(block.cameras, values.cameras)),
        {record_key(photo.name): (photo.centre, photo.rotation) for photo in values.photos},
        dict(zip(values.points.names, values.points.coordinates.tolist(), strict=True)),
    )
    return started, values.findings


def outcome(run: int, family: str | None = None, largest: int = 200) -> Outcome:
    """Make the block of a run, adjust it from nothing, and compare."""
    return outcome_of(simulated_records(run, family, largest))


def outcome_of(records: SimulatedRecords) -> Outcome:
    """Adjust a block from nothing, and compare."""
    reference = true_minimum(records)
    block = gathered(records)
    comparison, found, start, reason, bundle_seconds = None, None, None, "", 0.0
    began = process_time()
    try:
        started, findings = from_nothing(block)
        chain_seconds = process_time() - began
        start = _start_distance(started, records)
        found = solved(started)
        bundle_seconds = process_time() - began - chain_seconds
        comparison = compared(found, reference)
        end = comparison.end
        if end not in SUCCESS:
            reason = "; ".join([*findings, *(diagnosis.text for diagnosis in diagnose(found))])
    except OripError as error:
        chain_seconds = process_time() - began
        end, reason = "refused", str(error)
    from_truth = None
    if end not in SUCCESS:
        true = solved(started_at(block, records.orientations, records.coordinates))
        from_truth = compared(true, reference)
        if found is not None and end == "other" and compared(found, true).end == "reached":
            end = "as from the truth"
    return Outcome(
        run=records.run,
        family=records.family,
        redrawn=records.rejected,
        photos=len(block.photos),
        points=len(block.point_names),
        photo_points=len(block.photo_points.photo),
        wrong=len(records.wrong),
        control=len(block.control_points),
        wrong_control=len(records.wrong_control),
        self_calibrating=records.self_calibrating,
        models=bool(block.definition.models),
        end=end,
        reason=reason,
        comparison=comparison,
        from_truth=from_truth,
        start_distance=start,
        chain_seconds=chain_seconds,
        bundle_seconds=bundle_seconds,
    )


def compared(found: SolvedBlock, reference: SolvedBlock) -> Comparison:
    """Compare where an adjustment ended with the true minimum."""
    here, there = found.state, reference.state
    centre, rotation = photo_deviations(reference)
    turned = Rotation.from_matrix(here.rotations @ there.rotations.transpose(0, 2, 1)).as_rotvec()
    distance = max(np.abs((here.centres - there.centres) / centre).max(), np.abs(turned / rotation).max())
    sigma0 = found.variance.sigma0 / reference.variance.sigma0 - 1.0 if reference.variance.sigma0 else 0.0
    cost = robust_cost(found, reference) / robust_cost(reference, reference) - 1.0
    end: End = "other"
    if found.reason is not TerminationReason.CONVERGED:
        end = "not converged"
    elif found.normals.removed.any():
        end = "other"
    elif distance <= _SAME_POSITION and abs(sigma0) <= _SAME_SIGMA0:
        end = "reached"
    elif cost <= _SAME_COST:
        end = "lower"
    return Comparison(end, float(distance), float(sigma0), float(cost), len(found.iterations))


def robust_cost(found: SolvedBlock, reference: SolvedBlock) -> float:
    """Return what the Danish method makes least: the sum of `loss` over the observations that the reference has.

    Where many do not fit it, photo points count as wholes, by the lengths of their residuals. What cannot be computed
    costs most.
    """
    active, judged = found.equations.active, reference.equations.active & ~reference.equations.exact
    u = np.where(active, np.abs(found.equations.residual), _LARGE)
    if reference.weighing.of_tracks:
        coordinates = found.block.photo_points.xy.size
        lengths = np.linalg.norm(np.where(judged, u, 0.0)[:coordinates].reshape(-1, 2), axis=1)
        u, judged = np.r_[lengths, u[coordinates:]], np.r_[lengths > 0.0, judged[coordinates:]]
    return float(loss(u[judged], found.block.definition.max_standard_residual).sum())


def loss(u: np.ndarray, c: float) -> np.ndarray:
    """Return the integral from 0 to standard residuals u of u times its weight: 1 up to c, exp(-u / c) above it."""
    above = 0.5 * c**2 + 2.0 * c**2 * np.exp(-1.0) - c * (u + c) * np.exp(-u / c)
    return np.where(u <= c, 0.5 * u**2, above)


def _start_distance(started: Block, records: SimulatedRecords) -> tuple[float, float]:
    true = [records.orientations[record_key(photo.name)] for photo in started.photos]
    angles = started.photo_orientation[:, 3:]
    rotations = Rotation.from_euler("Z", angles[:, [2]])
    rotations = Rotation.from_euler("X", angles[:, [0]]) * Rotation.from_euler("Y", angles[:, [1]]) * rotations
    turned = (rotations * Rotation.from_matrix([orientation[1] for orientation in true]).inv()).magnitude()
    points = started.photo_points
    xyz = np.array([records.coordinates[name] for name in started.point_names])
    centres = np.array([orientation[0] for orientation in true])
    distance = float(np.mean(np.linalg.norm(xyz[points.point] - centres[points.photo], axis=1)))
    off = np.linalg.norm(started.photo_orientation[:, :3] - centres, axis=1) / distance
    return float(off.max()), float(turned.max())


def outcomes(runs: Sequence[int], processes: int, largest: int = 200) -> Iterator[Outcome]:
    """Return the outcomes of runs, in their order, as they come."""
    if processes == 1:
        with threadpool_limits(1):
            yield from (outcome(run, largest=largest) for run in runs)
        return
    # fork would copy the threads' locks of this process
    pool = ProcessPoolExecutor(processes, get_context("spawn"), initializer=threadpool_limits, initargs=(1,))
    with pool:
        yield from pool.map(outcome, runs, [None] * len(runs), [largest] * len(runs))


def read_outcomes(path: Path) -> list[dict]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def success(found: Sequence[dict]) -> float:
    """Return the part of the blocks whose adjustment reached the true minimum or a lower one."""
    return sum(outcome["end"] in SUCCESS for outcome in found) / max(len(found), 1)


def tables(found: Sequence[dict]) -> str:
    """Return the tables of the study as Markdown."""
    groups: list[tuple[str, Callable[[dict], bool]]] = [("all", lambda _: True)]
    groups += [(family, lambda outcome, family=family: outcome["family"] == family) for family in FAMILIES]
    groups += [
        (f"{low} to {high} photos", lambda outcome, low=low, high=high: low <= outcome["photos"] <= high)
        for low, high in SIZES
    ]
    groups += [
        (name, lambda outcome, low=low, high=high: low <= outcome["wrong"] / outcome["photo_points"] <= high)
        for name, low, high in _PARTS
    ]
    groups += [
        ("a control point wrong", lambda outcome: outcome["wrong_control"] > 0),
        ("three control points", lambda outcome: outcome["control"] == 3),
        ("camera unknown", lambda outcome: outcome["self_calibrating"]),
    ]
    occurring = Counter(outcome["end"] for outcome in found)
    shown = [end for end in _ENDS if occurring[end]]
    lines = [f"| blocks | number | {' | '.join(shown)} | success |", "|---" * (3 + len(shown)) + "|"]
    for name, belongs in groups:
        group = [outcome for outcome in found if belongs(outcome)]
        ends = Counter(outcome["end"] for outcome in group)
        figures = [ends[end] for end in shown]
        lines.append(f"| {name} | {len(group)} | {' | '.join(map(str, figures))} | {100.0 * success(group):.2f} % |")
    return "\n".join([*lines, "", *_failures(found)]) + "\n"


def _failures(found: Sequence[dict]) -> list[str]:
    failed = [outcome for outcome in found if outcome["end"] not in SUCCESS]
    if not failed:
        return []
    lines = [
        "| run | family | photos | wrong photo points | control | end | from the truth | message |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for failure in sorted(failed, key=lambda one: one["run"]):
        truth = failure["from_truth"]["end"] if failure["from_truth"] else ""
        message = re.sub(r"\s+", " ", failure["reason"]).replace("|", "/")[:200]
        figures = [failure[key] for key in ("run", "family", "photos", "wrong", "control", "end")]
        lines.append(f"| {' | '.join(map(str, figures))} | {truth} | {message} |")
    return lines


def write_tables(document: Path, text: str) -> None:
    """Put the tables between the marks in a document."""
    before, rest = document.read_text(encoding="utf-8").split("<!-- tables -->\n")
    _, after = rest.split("<!-- end of tables -->\n")
    document.write_text(f"{before}<!-- tables -->\n{text}<!-- end of tables -->\n{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description="Adjust simulated blocks from nothing.")
    parser.add_argument("outcomes", type=Path, help="JSON lines, one a block; blocks that are there are not done again")
    parser.add_argument("--runs", type=int, default=0, help="number of blocks")
    parser.add_argument("--first", type=int, default=0, help="first run")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--largest", type=int, default=200, help="most photos of a block")
    parser.add_argument("--table", type=Path, help="document to put the tables in")
    arguments = parser.parse_args()
    done = {outcome["run"] for outcome in read_outcomes(arguments.outcomes)}
    wanted = [run for run in range(arguments.first, arguments.first + arguments.runs) if run not in done]
    with arguments.outcomes.open("a", encoding="utf-8") as file:
        for found in outcomes(wanted, arguments.processes, arguments.largest):
            file.write(json.dumps(to_builtins(found)) + "\n")
            file.flush()
    text = tables(read_outcomes(arguments.outcomes))
    print(text)
    if arguments.table:
        write_tables(arguments.table, text)


if __name__ == "__main__":
    main()
