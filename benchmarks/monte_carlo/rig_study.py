"""Simulated blocks of rigs: errors over stated standard deviations, starts from nothing, planted mistakes."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation
from support.rig_blocks import HEADS, RigBlock, from_nothing, rig_block, single, without_common_view

from orip.bundle.results.ground import photo_cofactors
from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block
from orip.solving.solve import solve


class Errors(Struct, frozen=True):
    """Errors over stated standard deviations, and the deviation of points without the rig.

    `unknowns` are those of exposures and mountings, without their correlations; `photos` and `points` each by itself.
    """

    unknowns: np.ndarray
    photos: np.ndarray
    points: np.ndarray
    sd_of_points: float
    sd_alone: float


def made(run: int, **settings: object) -> RigBlock:
    heads = list(HEADS)
    weighted = (0.01, 0.05) if run % 3 == 0 else None
    return rig_block(
        heads[run % len(heads)], f"study {run}", mounting_error=weighted, missing=run % 4, **{"points": 150, **settings}
    )


def adjusted(block: Block) -> SolvedBlock:
    return solve_block(block, lambda _: None, lambda: False)


def errors_of(run: int) -> Errors:
    """Return the errors of one block: down-weighting is off, all errors are normal."""
    truth = made(run, start_down_weight=60)
    solved, alone = adjusted(truth.block), adjusted(single(truth.block))
    rigs, columns = solved.state.rigs, solved.problem.unknowns.rigs
    used = [int(name[1:]) - 1 for name in truth.block.places_on_rigs().exposures]
    exposures = np.hstack([rigs.centres - truth.centres[used], _turns(rigs.rotations, truth.rotations[used])])
    mountings = np.hstack([rigs.offsets - truth.offsets, _turns(rigs.mountings, truth.mountings)])
    error = np.concatenate([exposures.ravel(), mountings.ravel()])
    column = np.concatenate([columns.exposures.ravel(), columns.mountings.ravel()])
    unknown = np.flatnonzero(column >= 0)
    factor = np.linalg.cholesky(solved.cofactors_of(column[unknown]))
    variances = np.einsum("nii->ni", solved.cofactors.blocks)
    known = (variances > 0.0).all(axis=1)
    of_points = (solved.state.points - truth.points)[known] / np.sqrt(variances[known])
    return Errors(
        np.linalg.solve(factor, error[unknown]),
        _of_photos(truth, solved),
        of_points.ravel(),
        *_mean_deviations(solved, alone),
    )


def _of_photos(truth: RigBlock, solved: SolvedBlock) -> np.ndarray:
    """Return the errors of the elements of photos over their standard deviations."""
    rigs = solved.state.rigs
    names = [int(name[1:]) - 1 for name in truth.block.places_on_rigs().exposures]
    exposure = np.array(names)[rigs.exposure]
    rotations, mounted = truth.rotations[exposure], rigs.mounted
    centres = truth.centres[exposure] + (rotations @ truth.offsets[mounted][:, :, None])[:, :, 0]
    error = np.hstack(
        [
            solved.state.centres[rigs.photo] - centres,
            _turns(solved.state.rotations[rigs.photo], rotations @ truth.mountings[mounted]),
        ]
    )
    return (error / np.sqrt(np.einsum("nii->ni", photo_cofactors(solved)[rigs.photo]))).ravel()


def _turns(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the rotations (n, 3) from the true to the found ones, about the axes that these lead to."""
    return Rotation.from_matrix(found @ np.swapaxes(true, 1, 2)).as_rotvec()


def _mean_deviations(solved: SolvedBlock, alone: SolvedBlock) -> tuple[float, float]:
    """Return root mean squares of the standard deviations of the points that both adjustments determine."""
    one, other = (np.einsum("nii->n", each.cofactors.blocks) for each in (solved, alone))
    both = (solved.normals.blocks.removed | alone.normals.blocks.removed).any(axis=1)
    return float(np.sqrt(np.median(one[~both]))), float(np.sqrt(np.median(other[~both])))


def is_right_from_nothing(run: int) -> bool:
    """Return whether a block without any starting value ends where one that starts at the truth does."""
    return _is_right_from_nothing(made(run).block)


def is_right_without_common_view(run: int) -> bool:
    """Return the same of a block whose cameras show no common point, and only the first one control."""
    head = ("apart", "three", "around")[run % 3]
    weighted = (0.01, 0.05) if run % 2 else None
    truth = rig_block(head, f"no common view {run}", points=400, mounting_error=weighted)
    return _is_right_from_nothing(without_common_view(truth))


def _is_right_from_nothing(block: Block) -> bool:
    solution, found = solve(from_nothing(block))
    known = adjusted(block)
    if len(found.block.photos) < len(block.photos) or solution.status == "not_converged":
        return False
    return bool(np.abs(found.state.rigs.offsets - known.state.rigs.offsets).max() < 1e-3)


PLANTED = ("mounting", "exposure", "exchanged", "nothing")
CODES = {"mounting": "mounting", "exposure": "not-synchronous", "exchanged": "exchanged-cameras"}


def named(what: str, run: int) -> tuple[bool, list[str]]:
    """Return whether a planted mistake is named, and what else is named of rigs."""
    random = np.random.default_rng(run)
    direction, turn = random.normal(size=(2, 3))
    values: dict[str, object] = {
        "mounting": tuple(0.4 * turn / np.linalg.norm(turn)),
        "exposure": (4, tuple(0.6 * direction / np.linalg.norm(direction)), tuple(0.3 * turn / np.linalg.norm(turn))),
        "exchanged": True,
    }
    heads = ("stereo", "three", "around", "penta")
    planted = {} if what == "nothing" else {what: values[what]}
    truth = rig_block(heads[run % len(heads)], f"planted {run}", mounting_error=(0.01, 0.03), planted=planted)
    solution, _ = solve(truth.block)
    of_rigs = [(code, where) for code, where, _ in solution.warnings if code in CODES.values()]
    last = truth.block.cameras[-1].name
    right = {"mounting": f"camera {last}", "exposure": "exposure E5", "exchanged": "rig HEAD", "nothing": ""}[what]
    others = [where for code, where in of_rigs if (code, where) != (CODES.get(what), right)]
    return (CODES.get(what), right) in of_rigs, others
