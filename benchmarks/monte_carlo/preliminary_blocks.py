"""Blocks for the study of preliminary values: scenes of four families, their records and blunders.

Everything that is random is seeded with the family and the number of the run. A block that is not connected, or
whose adjustment from the truth leaves unknowns without a good determination, is drawn again; how often is counted.
"""

from __future__ import annotations

import zlib
from itertools import count

import numpy as np
from monte_carlo.preliminary_blunders import with_blunders
from monte_carlo.preliminary_records import SimulatedRecords, cameras_of, photo_deviations, records_of, true_minimum
from support.block_scenes import SCENES
from support.tie_points import holds_together, measured_points

from orip.adjustment.convergence import TerminationReason
from orip.bundle.solve import SolvedBlock
from orip.errors import NotSolvableError
from orip.records.names import record_key
from orip.structs import replace

FAMILIES = tuple(SCENES)
PHOTOS = {"aerial strips": (2, 200), "convergent": (4, 60), "oblique strips": (2, 200), "all-round": (4, 200)}

_ATTEMPTS = 200


def simulated_records(run: int, family: str | None = None, largest: int = 200) -> SimulatedRecords:
    """Return the block of a run; families take turns unless one is named."""
    family = FAMILIES[run % len(FAMILIES)] if family is None else family
    seed = [zlib.crc32(f"preliminary values {family}".encode()), run]
    least, most = PHOTOS[family]
    photos = round(np.exp(np.random.default_rng(seed).uniform(np.log(least), np.log(min(most, largest)))))
    rejected = []
    for attempt in count():
        if attempt == _ATTEMPTS:
            message = f"run {run} of {family} with {photos} photos: {rejected}"
            raise RuntimeError(message)
        made = _drawn(family, run, photos, np.random.default_rng([*seed, attempt]))
        if isinstance(made, SimulatedRecords):
            return replace(made, rejected=tuple(rejected))
        rejected.append(made)
    raise AssertionError


def _drawn(family: str, run: int, photos: int, random: np.random.Generator) -> SimulatedRecords | str:
    scene = SCENES[family](random, photos)
    wanted = round(np.exp(random.uniform(np.log(7.0), np.log(55.0))))
    measured = random.uniform(0.75, 1.0)
    ties = measured_points(scene, random, wanted, measured, von_gruber=random.random() < 0.5)
    if np.bincount(ties.photo, minlength=photos).min() < 6 or not holds_together(scene, ties):
        return "does not hold together"
    self_calibrating = random.random() < 0.8
    given, true = cameras_of(scene, random, wrong=self_calibrating)
    records = records_of(family, run, scene, ties, random, (given, true))
    try:
        found = true_minimum(records)
        if self_calibrating and not _calibrated(found):
            self_calibrating = False
            definitions = replace(records.inputs.records, cameras={record_key(true.name): true})
            records = replace(records, inputs=replace(records.inputs, records=definitions))
            found = true_minimum(records)
        if reason := weakness(found):
            return reason
        records = replace(records, self_calibrating=self_calibrating)
        return with_blunders(records, found, random)
    except NotSolvableError as error:
        return str(error)


def _calibrated(found: SolvedBlock) -> bool:
    """Whether the camera's unknowns are determined, C to a thousandth and the principal point to 0.1 mm."""
    columns = found.problem.unknowns.cameras[0, [0, 1, 2]]
    deviations = found.deviation_scale * np.sqrt(np.diag(found.cofactors_of(columns)))
    c = found.block.cameras[0].parameters[0]
    return not weakness(found) and bool((deviations < [1e-3 * c, 0.1, 0.1]).all())


def weakness(found: SolvedBlock) -> str:
    """Return what makes a block without blunders unfit for the study, or nothing."""
    if found.reason is not TerminationReason.CONVERGED:
        return "does not converge from the truth"
    if found.normals.removed.any():
        return "singular"
    if (found.weight_factors[found.equations.active] < 1.0).any():
        return "down-weighted without blunders"
    centre, rotation = photo_deviations(found)
    state, points = found.state, found.block.photo_points
    distance = np.mean(np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1))
    return "weak" if centre.max() > 0.02 * distance or rotation.max() > 0.02 else ""
