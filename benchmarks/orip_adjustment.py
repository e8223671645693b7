"""A block adjusted by orip; run by `against_peers.py` in a process of its own.

    python orip_adjustment.py 500
    python orip_adjustment.py BAL
    python orip_adjustment.py 5000 --points 100 --threads 2

Prints one line of JSON: seconds (CPU and on the clock) to the minimum and of the precision, cost in pixels, iterations,
peak memory, and a digest of all results, which tells whether two runs agree bit for bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import time

import numpy as np
from aerial_blocks import POINTS_A_PHOTO, VARIANTS, aerial_block, variant_of
from peer_problem import block_of, pixel_mm

from orip.adjustment.iteration import Adjustment, adjust
from orip.adjustment.precision import Cofactors, cofactors
from orip.bundle.problem import pose_problem
from orip.bundle.solve import iteration_settings
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState
from orip.threads import limited_threads


def adjustment(case: str, points_a_photo: int, variant: str | None) -> dict[str, float | str]:
    """Return the figures of one adjustment."""
    block = block_of(case, points_a_photo) if variant is None else variant_of(aerial_block(int(case)), variant)
    clock = [_now()]
    problem, state, settings = pose_problem(block), starting_state(block), iteration_settings(block.definition)
    clock.append(_now())
    with limited_threads(None):
        adjusted = adjust(problem, state, settings, lambda _: None, lambda: False)
        clock.append(_now())
        peak = _peak_mb()
        equations = adjusted.equations
        computed = equations.residual[equations.active]
        clock.append(_now())
        precise = cofactors(equations, adjusted.normals, problem.inner_constraints(adjusted.state))
        clock.append(_now())
    (setup, minimum, _, precision) = np.diff(np.array(clock), axis=0)
    size = block.photo_points.error[0, 0] / pixel_mm(case)
    return {
        "setup": setup[0],
        "minimum": minimum[0],
        "minimum_wall": minimum[1],
        "precision": precision[0],
        "precision_wall": precision[1],
        "cost": 0.5 * float(computed @ computed) * size**2,
        "not_computed": len(equations.residual) - len(computed),
        "iterations": len(adjusted.iterations),
        "photos": len(block.photos),
        "points": len(block.point_names),
        "photo_points": len(block.photo_points.photo),
        "peak": peak,
        "peak_precision": _peak_mb(),
        "digest": digest(adjusted, precise),
        "ended": adjusted.reason.name,
    }


def digest(adjusted: Adjustment[BlockState], precise: Cofactors) -> str:
    """Return the SHA-256 of everything that was found."""
    state = adjusted.state
    found = hashlib.sha256()
    for array in (state.cameras, state.centres, state.rotations, state.points, precise.blocks, precise.leverage):
        found.update(np.ascontiguousarray(array).tobytes())
    found.update(adjusted.equations.residual.tobytes())
    return found.hexdigest()


def _now() -> tuple[float, float]:
    return time.process_time(), time.perf_counter()


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Adjust and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", help="number of photos, or BAL")
    parser.add_argument("--points", type=int, default=POINTS_A_PHOTO, help="points a photo")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--variant", choices=VARIANTS, help="of an aerial block, with weighted control")
    given = parser.parse_args()
    with limited_threads(given.threads):
        print(json.dumps(adjustment(given.case, given.points, given.variant)))


if __name__ == "__main__":
    main()
