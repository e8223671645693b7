"""The compiled loop over photo points against the stored design matrix: two ways to the same figures.

Both add the same terms in another order, so that they agree to some 1e-13 of what is added; matrices are divided by the
roots of their diagonals before they are compared, as units differ.
"""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.same_lens import with_two_frames
from support.conditioning import EPSILON, condition_of_normals
from support.synthetic_block import DISTORTED, synthetic_block

from orip.adjustment.factorisation.elimination import times_half, times_transposed_half
from orip.adjustment.factorisation.null_space import PointMovements
from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import cofactors
from orip.bundle import problem
from orip.bundle.compiled import photo_loop
from orip.bundle.problem import pose_problem
from orip.bundle.solve import solve_block
from orip.bundle.starting_state import starting_state
from orip.bundle.unknowns import CONSTANT
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import CAMERA_PARAMETERS, AdditionalSet, ReadoutDirection, Sensor
from orip.records.control import ControlDistance
from orip.structs import replace

pytestmark = pytest.mark.skipif(not photo_loop.is_compiled(), reason="the extension was not built: no compiler here")

RELATIVE = 1e-12
MAX_LOST = 12.0
SUMMED = 10.0
"""Rounding errors of the sums of a few hundred terms, in units of the last digit."""
MAX_CONDITION = 1e10
"""Of the blocks below; a larger one would make the tolerances say little."""
FRAME = (36.0, 24.0)
_ROWS = 30
_POINTS_STAY = 1e30
"""Damping with which what the elimination of points takes off is nothing beside the last digit."""


def self_calibrated(distortion_at: str, scene: str = "convergent") -> Block:
    return synthetic_block(
        scene,
        "photo loop",
        noise_mm=0.003,
        distortion=DISTORTED,
        distortion_at=distortion_at,
        unknown=CAMERA_PARAMETERS[:12],
        start_error=0.01,
    ).block


def two_cameras() -> Block:
    """Return a block of a calibrated and an uncalibrated camera, the polynomial at "measured" in one of them."""
    block = self_calibrated("ideal")
    known = replace(block.cameras[0], name="KNOWN", unknown=("DX", "A3"), distortion_at="measured")
    photos = tuple(replace(photo, camera="KNOWN") if row % 2 else photo for row, photo in enumerate(block.photos))
    return replace(
        block, cameras=(*block.cameras, known), photos=photos, photo_camera=np.arange(len(photos), dtype=np.int64) % 2
    )


def held_elements() -> Block:
    return synthetic_block(
        "strip", "photo loop", noise_mm=0.003, start_error=0.01, constant=[("X0", "OMEGA"), (), ("PHI", "KAPPA")]
    ).block


def constant_points() -> Block:
    block = synthetic_block("strip", "photo loop", noise_mm=0.003, start_error=0.01, control="constant").block
    constant = block.constant_points.copy()
    constant[1, 2] = constant[2, :2] = True
    return replace(block, constant_points=constant)


def tied_points() -> Block:
    block = aerial_block("photo loop", 6).block
    tied = (
        ControlDistance("D1", "102", "110", "XYZ", 500.0, 0.1),
        ControlDistance("D2", "101", "105", "X", 700.0, 0.0),
    )
    return replace(block, distances=tied)


def behind() -> Block:
    """Return a block with a point that starts above two of its photos."""
    block = held_elements()
    points, start = block.photo_points, block.point_start.copy()
    often = np.bincount(points.point).argmax()
    photos = points.photo[points.point == often]
    start[often, 2] = np.sort(block.photo_orientation[photos, 2])[1] + 0.5
    return replace(block, point_start=start)


def measured_twice() -> Block:
    """Return a block in which every third photo point is measured again, some a third time."""
    block = self_calibrated("ideal")
    points = block.photo_points
    rows = np.concatenate([np.arange(len(points.photo)), np.arange(0, len(points.photo), 3), np.arange(0, 20, 6)])
    moved = 1e-3 * np.sin(np.arange(2.0 * len(rows))).reshape(-1, 2)
    again = (points.photo[rows], points.point[rows], points.xy[rows] + moved, points.error[rows], points.used[rows])
    return replace(
        block,
        photo_points=IndexedPhotoPoints(*again),
        definition=replace(block.definition, repeated_points="both"),
    )


def with_set(name: AdditionalSet, distortion_at: str) -> Block:
    block = self_calibrated(distortion_at)
    return replace(block, cameras=(replace(block.cameras[0], additional_set=name, frame=FRAME, unknown=()),))


def two_cameras_with_sets() -> Block:
    block = two_cameras()
    one, other = (replace(camera, frame=FRAME) for camera in block.cameras)
    return replace(block, cameras=(replace(one, additional_set="EBNER"), replace(other, additional_set="GRUEN")))


def fisheye_and_plain() -> Block:
    """Return a block of two cameras and projections: points that the perspective shows are in both of them."""
    block = self_calibrated("ideal")
    fisheyes = replace(block.cameras[0], name="FISHEYE", unknown=("DX", "A3"), projection="equidistant")
    photos = tuple(replace(photo, camera="FISHEYE") if row % 3 else photo for row, photo in enumerate(block.photos))
    return replace(
        block,
        cameras=(*block.cameras, fisheyes),
        photos=photos,
        photo_camera=np.minimum(np.arange(len(photos), dtype=np.int64) % 3, 1),
    )


def fisheye_with_set(name: AdditionalSet, distortion_at: str) -> Block:
    block = self_calibrated(distortion_at, "room")
    return replace(block, cameras=(replace(block.cameras[0], additional_set=name, frame=FRAME, unknown=()),))


def rolling(block: Block, direction: ReadoutDirection = "down") -> Block:
    """Return a block whose first camera exposes its rows, or columns, one after the other."""
    first = block.cameras[0]
    sensor = Sensor(3600, 2400, *FRAME)
    moving = replace(
        first, parameters=(*first.parameters[:-1], -0.03), sensor=sensor, unknown=(*first.unknown, "READOUT"),
        readout_direction=direction,
    )  # fmt: skip
    return replace(block, cameras=(moving, *block.cameras[1:]))


def with_motions(block: Block) -> Block:
    """Return a rolling shutter's block with the motions of its photos as unknowns."""
    return replace(with_velocities(block), definition=replace(block.definition, velocity_error=0.3, rate_error=2.0))


def with_velocities(block: Block) -> Block:
    """Return a rolling shutter's block with the velocities of its photos as unknowns."""
    return replace(rolling(block), definition=replace(block.definition, velocity_error=0.3))


BLOCKS = {
    "motions": lambda: with_motions(two_cameras()),
    "motions with sets": lambda: with_motions(two_cameras_with_sets()),
    "motions of a fisheye": lambda: with_motions(self_calibrated("measured", "room")),
    "motions with held elements": lambda: with_motions(held_elements()),
    "motions of a free network": lambda: with_motions(
        replace(self_calibrated("ideal"), definition=replace(self_calibrated("ideal").definition, datum="free"))
    ),
    "velocities": lambda: with_velocities(two_cameras()),
    "velocities with sets": lambda: with_velocities(two_cameras_with_sets()),
    "velocities with held elements": lambda: with_velocities(held_elements()),
    "velocities of a free network": lambda: with_velocities(
        replace(self_calibrated("ideal"), definition=replace(self_calibrated("ideal").definition, datum="free"))
    ),
    "rolling": lambda: rolling(two_cameras()),
    "rolling to the right": lambda: rolling(two_cameras(), "right"),
    "rolling to the left with sets": lambda: rolling(two_cameras_with_sets(), "left"),
    "rolling with sets": lambda: rolling(two_cameras_with_sets()),
    "rolling fisheye": lambda: rolling(self_calibrated("measured", "room")),
    "rolling with held elements": lambda: rolling(held_elements()),
    "ideal": lambda: self_calibrated("ideal"),
    "measured": lambda: self_calibrated("measured"),
    "two cameras": two_cameras,
    "held elements": held_elements,
    "constant points": constant_points,
    "tied points": tied_points,
    "behind": behind,
    "measured twice": measured_twice,
    "same lens": lambda: with_two_frames(self_calibrated("ideal")),
    "same lens at measured": lambda: with_two_frames(self_calibrated("measured")),
    "Ebner": lambda: with_set("EBNER", "ideal"),
    "Gruen": lambda: with_set("GRUEN", "ideal"),
    "Gruen at measured": lambda: with_set("GRUEN", "measured"),
    "two cameras with sets": two_cameras_with_sets,
    "fisheye": lambda: self_calibrated("ideal", "room"),
    "fisheye at measured": lambda: self_calibrated("measured", "room"),
    "fisheye and plain": fisheye_and_plain,
    "fisheye with Ebner": lambda: fisheye_with_set("EBNER", "ideal"),
    "fisheye with Gruen at measured": lambda: fisheye_with_set("GRUEN", "measured"),
    "free": lambda: replace(
        self_calibrated("ideal"), definition=replace(self_calibrated("ideal").definition, datum="free")
    ),
}


@pytest.fixture(params=BLOCKS)
def block(request: pytest.FixtureRequest) -> Block:
    return BLOCKS[request.param]()


def both_ways(block):
    """Return the layout and the equations by the loop and with the stored matrix."""
    posed, state = pose_problem(block), starting_state(block)
    assert posed.streamed is not None
    random = np.random.default_rng(9)
    state = replace(state, motions=random.normal(size=state.motions.shape))
    if (posed.unknowns.motions != CONSTANT).any():
        state = replace(state, motion_corrections=0.03 * random.normal(size=state.motions.shape))
    return posed.layout, posed.linearise(state), replace(posed, streamed=None).linearise(state)


def weights_of(equations):
    """Return weight factors of all sizes; a few observations are left out, and every point stays determined."""
    count = len(equations.residual)
    return np.random.default_rng(7).uniform(0.1, 1.0, count) * (np.arange(count) % 29 != 3)


def test_residuals(block):
    _, streamed, stored = both_ways(block)
    size = np.abs(stored.residual).max()
    assert np.allclose(streamed.residual, stored.residual, rtol=RELATIVE, atol=RELATIVE * size)
    assert np.array_equal(streamed.active, stored.active)
    assert np.array_equal(streamed.exact, stored.exact)
    assert np.array_equal(streamed.design.toarray(), stored.design.toarray())


COMPARED = {
    "residuals": "test_residuals",
    "points": "test_normal_equations_of_points_alone, test_partials_of_single_photo_coordinates",
    "right": "test_right_hand_side_with_nothing_eliminated",
    "eliminate": "test_normal_equations_with_eliminated_points, test_partials_of_single_photo_coordinates",
    "movements": "test_sums_of_movements",
    "precision": "test_solution_and_precision",
    "forward": "test_coupling_of_points_forwards_and_backwards",
    "backward": "test_coupling_of_points_forwards_and_backwards",
}
"""Functions of the extension that compute, and the tests that compare them with numpy."""


def test_every_function_of_the_extension_is_compared():
    functions = {name for name, value in vars(photo_loop.compiled).items() if callable(value)}
    assert functions - {"layout", "turns"} == COMPARED.keys()
    here = globals()
    assert all(test in here for tests in COMPARED.values() for test in tests.split(", "))


def test_partials_of_single_photo_coordinates(block):
    """The right-hand side A^T y with a unit vector for y is a row of A, where points are damped to stay."""
    layout, streamed, stored = both_ways(block)
    design, root = stored.design.toarray(), stored.active.astype(float)
    photo = np.flatnonzero(np.repeat(streamed.rows.loop.eliminated, 2))
    largest = np.abs(design).max(axis=0)
    unit = np.where(largest > 0.0, largest, 1.0)
    for row in np.random.default_rng(4).permutation(photo)[:_ROWS].tolist():
        y = np.zeros(len(design))
        y[row] = root[row]
        reduced = streamed.rows.eliminated(root, -y, layout, MAX_LOST, _POINTS_STAY).right
        points = streamed.rows.block_normals(root, y, layout).right
        free = ~layout.fixed
        found = np.concatenate([reduced, points.ravel()])
        assert np.abs(np.where(free, found - design[row] * root[row], 0.0) / unit).max() < RELATIVE


def test_normal_equations_with_eliminated_points(block):
    layout, streamed, stored = both_ways(block)
    weights = weights_of(stored) * stored.active
    found, wanted = (
        version.rows.eliminated(weights, version.residual, layout, MAX_LOST, 0.0) for version in (streamed, stored)
    )
    scale = np.sqrt(np.where(wanted.diagonal > 0.0, wanted.diagonal, 1.0))
    assert np.allclose(found.diagonal, wanted.diagonal, rtol=RELATIVE)
    assert np.allclose(found.matrix / np.outer(scale, scale), wanted.matrix / np.outer(scale, scale), atol=RELATIVE)
    right = np.abs(wanted.right / scale).max()
    assert np.allclose(found.right / scale, wanted.right / scale, atol=RELATIVE * max(right, 1.0) * 10.0)
    assert np.array_equal(found.blocks.removed, wanted.blocks.removed)
    # the order of the pivots may differ where diagonals are equal up to rounding: the inverses are compared
    inverse, other = (np.swapaxes(version.blocks.half, 1, 2) @ version.blocks.half for version in (found, wanted))
    size = np.sqrt(np.einsum("bii->bi", other))
    unit = np.where(size > 0.0, size, 1.0)
    # the inverse of a block has lost as many digits as its pivots
    lost = 10.0 ** wanted.blocks.lost_digits[~wanted.blocks.removed].max(initial=0.0)
    assert np.allclose(
        inverse / (unit[:, :, None] * unit[:, None, :]), other / (unit[:, :, None] * unit[:, None, :]),
        atol=RELATIVE * lost,
    )  # fmt: skip


def test_normal_equations_of_points_alone(block):
    layout, streamed, stored = both_ways(block)
    root = np.sqrt(weights_of(stored) * stored.active)
    misclosure = -streamed.residual * np.where(streamed.active, root, 1.0)
    found, wanted = (version.rows.block_normals(root, misclosure, layout) for version in (streamed, stored))
    size = np.sqrt(np.einsum("bii->bi", wanted.matrices))
    unit = np.where(size > 0.0, size, 1.0)
    free = ~layout.fixed[layout.reduced :].reshape(-1, 3)
    both = free[:, :, None] & free[:, None, :]
    relative = np.where(both, found.matrices - wanted.matrices, 0.0) / (unit[:, :, None] * unit[:, None, :])
    assert np.abs(relative).max() < RELATIVE
    right = np.where(free, (found.right - wanted.right).reshape(-1, 3), 0.0) / unit
    assert np.abs(right).max() < 10.0 * RELATIVE * np.sqrt(wanted.square_sums.max())
    seen = free.any(axis=1)
    assert np.allclose(found.square_sums[seen], wanted.square_sums[seen], rtol=RELATIVE)
    assert wanted.square_sums[seen].all()


def test_right_hand_side_with_nothing_eliminated(block):
    layout, streamed, stored = both_ways(block)
    root = np.sqrt(weights_of(stored) * stored.active)
    misclosure = -root * np.where(stored.active, stored.residual, 0.0)
    found, wanted = (version.rows.right_side(root, misclosure, layout) for version in (streamed, stored))
    size = np.sqrt(stored.design.power(2).sum(axis=0)) * np.linalg.norm(misclosure)
    assert (np.abs(found - wanted)[~layout.fixed] <= RELATIVE * size[~layout.fixed]).all()


def test_solution_and_precision(block):
    layout, streamed, stored = both_ways(block)
    weights = weights_of(stored)
    found, wanted = (solve_normals(version, weights, layout, MAX_LOST, 0.0) for version in (streamed, stored))
    assert np.array_equal(found.removed, wanted.removed)
    precise, expected = cofactors(streamed, found), cofactors(stored, wanted)
    deviation = np.sqrt(np.concatenate([np.diag(expected.reduced), np.einsum("bii->bi", expected.blocks).ravel()]))
    used = deviation > 0.0
    # solving loses the digits of the condition, which is 5e9 for two cameras with sets and 1e4 for plain blocks
    condition = condition_of_normals(stored, weights, ~layout.fixed & ~wanted.removed)
    assert condition < MAX_CONDITION
    tolerance = SUMMED * EPSILON * condition
    difference, size = (
        np.abs(version[used] / deviation[used]).max()
        for version in (found.correction - wanted.correction, wanted.correction)
    )
    assert difference < tolerance * max(size, 1.0)
    assert np.allclose(np.diag(precise.reduced), np.diag(expected.reduced), rtol=tolerance)
    assert np.allclose(np.einsum("bii->bi", precise.blocks), np.einsum("bii->bi", expected.blocks), rtol=tolerance)
    assert np.allclose(precise.leverage, expected.leverage, rtol=tolerance, atol=tolerance)


def test_what_a_set_holds_already_is_what_loses_the_digits():
    """A1, B1 and B2 are sums of C, rotation, EBNER.1 and .2; P1 and P2 complete the second order, DX and DY follow."""
    block = two_cameras_with_sets()
    calibrated, known = block.cameras
    apart = tuple(name for name in calibrated.unknown if name not in ("A1", "P1", "P2", "B1", "B2"))
    conditions = []
    for camera in (calibrated, replace(calibrated, unknown=apart)):
        layout, _, stored = both_ways(replace(block, cameras=(camera, known)))
        weights = weights_of(stored)
        removed = solve_normals(stored, weights, layout, MAX_LOST, 0.0).removed
        conditions.append(condition_of_normals(stored, weights, ~layout.fixed & ~removed))
    assert conditions[0] > 1e9
    assert conditions[1] < 0.01 * conditions[0]


def test_without_the_extension_the_stored_matrix_is_used(monkeypatch):
    block = self_calibrated("ideal")
    compiled = solve_block(block, lambda _: None, lambda: False)
    monkeypatch.setattr(problem, "is_compiled", lambda: False)
    assert pose_problem(block).streamed is None
    stored = solve_block(block, lambda _: None, lambda: False)
    assert compiled.variance.sigma0 == pytest.approx(stored.variance.sigma0, rel=1e-10)
    assert compiled.reason is stored.reason


def test_coupling_of_points_forwards_and_backwards(block):
    layout, streamed, stored = both_ways(block)
    weights = weights_of(stored)
    found, wanted = (solve_normals(version, weights, layout, MAX_LOST) for version in (streamed, stored))
    random = np.random.default_rng(3)
    unit = np.where(wanted.scale > 0.0, wanted.scale, 1.0)[:, None]
    reduced = random.normal(size=(layout.reduced, 2)) / unit
    # H itself may differ by a rotation where the order of pivots does: H^T H N_pr is compared
    either = [
        times_transposed_half(version.blocks.half, version.coupling.times(reduced)) for version in (found, wanted)
    ]
    lost = 10.0 ** wanted.blocks.lost_digits[~wanted.blocks.removed].max(initial=0.0)
    assert np.allclose(*either, rtol=RELATIVE * lost * 10.0, atol=RELATIVE * lost * np.abs(either[1]).max())
    points = random.normal(size=(3 * layout.blocks, 2))
    either = [
        version.coupling.transposed_times(times_half(version.blocks.half, points)) / unit for version in (found, wanted)
    ]
    assert np.allclose(*either, rtol=RELATIVE * lost * 10.0, atol=RELATIVE * lost * np.abs(either[1]).max())


def test_sums_of_movements(block):
    layout, streamed, stored = both_ways(block)
    weights, random = weights_of(stored), np.random.default_rng(5)
    found, wanted = (solve_normals(version, weights, layout, MAX_LOST) for version in (streamed, stored))
    defining = random.uniform(size=(layout.blocks, 3)) < 0.5
    points = PointMovements(
        random.normal(size=(layout.blocks, 4)), random.normal(size=(3, 5, 4)), np.ones_like(defining), defining
    )
    one, other = (version.coupling.movement_sums(points) for version in (found, wanted))
    unit = np.where(wanted.scale > 0.0, wanted.scale, 1.0)[:, None]
    tolerance = RELATIVE * 10.0 ** wanted.blocks.lost_digits[~wanted.blocks.removed].max(initial=0.0)
    for sums, expected in ((one.reduced / unit, other.reduced / unit), (one.own, other.own)):
        assert np.allclose(sums, expected, rtol=10.0 * tolerance, atol=tolerance * np.abs(expected).max())


def test_arrays_that_do_not_belong_together_are_refused():
    posed, state = pose_problem(held_elements()), starting_state(held_elements())
    loop, _ = posed.streamed
    with pytest.raises(ValueError, match="do not belong together"):
        loop.residuals(replace(state, centres=state.centres[1:]))
