"""Free networks of simulated blocks, and their cofactors from dense matrices."""

from __future__ import annotations

import numpy as np
from bundle.aerial_block import aerial_block
from bundle.solving import noisy, redefined
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

from orip.bundle.unknowns import CONSTANT
from orip.structs import replace

_STEP = 1e-6

SUBSET = ("103", "107", "118", "122")
MADE = {
    "aerial": aerial_block("free", 6),
    "around an object": synthetic_block("convergent", "free"),
}


def free(scene, names=(), **changes):
    """Return the block started at the truth: the corrections are then small, and what is linear holds."""
    block = redefined(noisy(MADE[scene], 3), datum="free", datum_points=names)
    return replace(block, **changes)


def datum_points(block):
    names = block.definition.datum_points or block.point_names
    return np.array([block.point_index()[name] for name in names])


def generator(found):
    """Return the seven movements of all unknowns (m + 3 b, 7), from moving the whole block a little."""
    unknowns, state = found.problem.unknowns, found.state
    centre = state.points.mean(axis=0)
    result = np.zeros((unknowns.layout.size, 7))
    for movement in range(7):
        step = _STEP * np.eye(7)[movement]
        turned = np.broadcast_to(step[3:6] / _STEP, (len(state.centres), 3))
        for columns, values in (
            (unknowns.points, (moved(state.points, centre, step) - state.points) / _STEP),
            (unknowns.photos, np.hstack([(moved(state.centres, centre, step) - state.centres) / _STEP, turned])),
        ):
            used = columns != CONSTANT
            result[columns[used], movement] = values[used]
    return result


def moved(xyz, centre, step):
    """Return places after a shift, a small rotation and a change of scale about a centre: step (7,)."""
    rotation = Rotation.from_rotvec(step[3:6]).as_matrix()
    return centre + (1.0 + step[6]) * (xyz - centre) @ rotation.T + step[:3]


def dense_free_cofactors(block, found, movements=slice(None)):
    """Return the inverse of the normal matrix bordered by the inner constraints on the datum points."""
    equations = found.equations
    design = equations.design.toarray()[equations.active]
    free = generator(found)[:, movements]
    inner = np.zeros_like(free)
    columns = found.problem.unknowns.points[datum_points(block)].ravel()
    inner[columns] = free[columns]
    scale = np.linalg.norm(design, axis=0)
    normals = (design / scale).T @ (design / scale)
    # of the constraints only the space that they span counts
    border, _ = np.linalg.qr(inner / scale[:, None])
    count = border.shape[1]
    bordered = np.block([[normals, border], [border.T, np.zeros((count, count))]])
    return np.linalg.inv(bordered)[: len(scale), : len(scale)] / np.outer(scale, scale)
