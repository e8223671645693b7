"""One or more cases for every function that returns partials.

A case is a vector of variables, the values of a function there and after a change of the variables, and the partials
that the function itself returns. Kinds of observation are changed through `BlockState.moved`, so that the
parametrisation of the rotations is tested with them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import pairwise

import numpy as np
from bundle.same_lens import with_two_frames
from msgspec import Struct
from scipy.spatial.transform import Rotation
from support.drive_tables import cameras as driven_cameras
from support.prelim_references import resection
from support.prelim_references.relative import parallaxes_with_partials
from support.synthetic_block import DISTORTED, synthetic_block

from orip.bundle.kinds.all_kinds import KINDS
from orip.bundle.kinds.observation import Observations, coordinates_with_partials, partials_by_unknowns
from orip.bundle.results.ground import rotation_partials
from orip.bundle.solve import solve_block
from orip.bundle.starting_state import starting_state
from orip.bundle.state import BlockState, PlacedFigures
from orip.bundle.unknowns import CONSTANT, Unknowns, number_unknowns
from orip.geometry.equidistant import equidistant_with_partials
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.height_grid import _weights
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.projection import projected_with_partials
from orip.geometry.rolling_shutter import Motion, moving_image_with_partials, photos_with_partials
from orip.geometry.rotation import (
    angle_rates_from_axes_rotation,
    angles_from_rotation,
    axes_rotation_from_angle_rates,
    rotation_about_axes,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.geometry.similarity import Similarities, similarity_with_partials
from orip.geometry.stereo import TwoPhotos, relative_poses_with_partials
from orip.interior import additional_parameters, image_coordinates
from orip.interior.additional_parameters import PARAMETER_SETS, additional_with_partials, base_of_camera, default_error
from orip.interior.distortion import (
    corrected_by_coefficients,
    corrected_with_partials,
    deformation_with_partials,
    distorted_by_coefficients,
    distorted_with_partials,
    image_polynomial,
    lens_distortion_with_partials,
)
from orip.interior.image_coordinates import SetValues, image_residuals_with_partials
from orip.mistakes.rigs.compared_poses import _by_motion
from orip.multimodel.photo_loop import camera_model
from orip.prelim.relative.solution import Pairs
from orip.records.block import Block, TheodoliteSet
from orip.records.camera import CAMERA_PARAMETERS, ReadoutDirection, Sensor
from orip.records.control import (
    NOT_GIVEN,
    ControlDirection,
    ControlDistance,
    ControlElement,
    FigurePoint,
    GivenDirection,
    PointCorrelation,
    Station,
    StationDifference,
    StationMotion,
)
from orip.records.definition import ANTENNA_PARAMETERS, Antenna
from orip.records.ground import PLAIN, HeightGrid, Terrain, TerrainHeight, TerrainModel
from orip.records.rig import Mounting, Rig, RigExposure, Rigs
from orip.structs import replace

FRAME = np.stack(np.meshgrid(np.linspace(-18.0, 18.0, 5), np.linspace(-12.0, 12.0, 4)), axis=-1).reshape(-1, 2)
SMALL_FORMAT = np.array([1e-3, -8e-5, 6e-8, -2e-11, 3e-14, 3e-5, -2e-5, 4e-4, -3e-4])


class Case(Struct, frozen=True):
    """A function at one place.

    Attributes
    ----------
    of : str
        Full name of the function or method.
    label : str
    at : array (k,)
    value : callable
        Variables (k,) to values (m,).
    partials : array (m, k)
        As the function returns them.
    move : float
        How far the values are moved for a numerical derivative: a thousandth or less of what bends the function, and
        a million times what the values are rounded to.
    rounding : float
        What the change of a value may be off by where it is not.
    """

    of: str
    label: str
    at: np.ndarray
    value: Callable[[np.ndarray], np.ndarray]
    partials: np.ndarray
    move: float = 1e-3
    rounding: float = 0.0

    def __str__(self) -> str:
        return f"{self.of.removeprefix('orip.')}: {self.label}"


def full_name(function: object) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def _block_diagonal(by_row: np.ndarray) -> np.ndarray:
    """Spread partials (n, m, k) of n points by k variables of each point to (n m, n k)."""
    n, m, k = by_row.shape
    result = np.zeros((n, m, n, k))
    result[np.arange(n), :, np.arange(n)] = by_row
    return result.reshape(n * m, n * k)


# geometry


def _perspective() -> Iterator[Case]:
    generator = np.random.default_rng(3)
    views = [(0.1, -0.2, 0.7), (0.0, np.pi / 2.0, 0.0), (0.4, -np.pi / 2.0, 0.3), (2.0, 1.0, -3.0)]
    rotation = rotation_from_angles(np.array(views))
    in_photo = generator.uniform([-3.0, -3.0, -12.0], [3.0, 3.0, -8.0], (len(views), 3))
    offset = (rotation @ in_photo[:, :, None])[:, :, 0]
    at = np.hstack([offset, np.zeros((len(views), 3)), np.full((len(views), 1), 50.0)])

    def image(x: np.ndarray):
        rows = x.reshape(len(views), 7)
        return perspective_with_partials(rows[:, :3], rotation_about_axes(rows[:, 3:6]) @ rotation, rows[:, 6])

    found = image(at)
    by_row = np.concatenate([found.by_point, found.by_rotation, found.by_principal_distance[:, :, None]], axis=2)
    assert found.in_front.all()
    yield Case(
        full_name(perspective_with_partials), "point, turn, principal distance", at.ravel(),
        lambda x: image(x).xy.ravel(), _block_diagonal(by_row),
    )  # fmt: skip


def _equidistant() -> Iterator[Case]:
    """Return cases of fisheye images: points before, beside and behind the camera, and nearly on its axis."""
    generator = np.random.default_rng(4)
    rotation = rotation_from_angles(generator.uniform(-3.0, 3.0, (6, 3)))
    in_photo = np.array(
        [[3.0, -2.0, -8.0], [0.2, 9.0, -1e-3], [-6.0, 2.0, 0.0], [-5.0, 1.0, 4.0], [1.0, 2.0, 9.0], [1e-3, 2e-3, -9.0]]
    )
    offset = (rotation @ in_photo[:, :, None])[:, :, 0]
    at = np.hstack([offset, np.zeros((6, 3)), np.full((6, 1), 50.0)])
    for function in (equidistant_with_partials, projected_with_partials):
        rows = slice(None) if function is equidistant_with_partials else slice(0, 6, 5)

        def image(x: np.ndarray, function: Callable = function, rows: slice = rows):
            given = x.reshape(-1, 7)
            turned = rotation_about_axes(given[:, 3:6]) @ rotation[rows]
            more = () if function is equidistant_with_partials else (np.array([True, False]),)
            return function(given[:, :3], turned, given[:, 6], *more)

        found = image(at[rows])
        by_row = np.concatenate([found.by_point, found.by_rotation, found.by_principal_distance[:, :, None]], axis=2)
        assert found.in_front.all()
        yield Case(
            full_name(function), "point, turn, principal distance", at[rows].ravel(),
            lambda x, image=image: image(x).xy.ravel(), _block_diagonal(by_row),
        )  # fmt: skip


def _moving() -> Iterator[Case]:
    """Return a case of rolling shutters: a fisheye and a frame, with an angular rate that turns far, and with none."""
    generator = np.random.default_rng(8)
    rotation = rotation_from_angles(generator.uniform(-3.0, 3.0, (3, 3)))
    in_photo = generator.uniform([-3.0, -3.0, -12.0], [3.0, 3.0, -8.0], (3, 3))
    offset = (rotation @ in_photo[:, :, None])[:, :, 0]
    velocity, rate = generator.uniform(-2.0, 2.0, (3, 3)), np.array([[0.6, -0.4, 0.5], [0.0, 0.0, 0.0], [1e-4, 0, 0]])
    at = np.hstack([offset, np.zeros((3, 3)), np.full((3, 1), 50.0), velocity, rate, np.full((3, 1), 0.3)])
    fisheye, fraction = np.array([True, False, False]), np.array([0.4, -0.5, 0.3])

    def image(x: np.ndarray):
        rows = x.reshape(3, 14)
        turned = rotation_about_axes(rows[:, 3:6]) @ rotation
        motion = Motion(rows[:, 7:10], rows[:, 10:13])
        return moving_image_with_partials(rows[:, :3], turned, rows[:, 6], fisheye, motion, fraction, rows[:, 13])

    found = image(at)
    by_row = np.concatenate(
        [
            found.image.by_point, found.image.by_rotation, found.image.by_principal_distance[:, :, None],
            found.by_velocity, found.by_rate, found.by_readout[:, :, None],
        ],
        axis=2,
    )  # fmt: skip
    yield Case(
        full_name(moving_image_with_partials), "point, turn, principal distance, motion, readout", at.ravel(),
        lambda x: image(x).image.xy.ravel(), _block_diagonal(by_row),
    )  # fmt: skip


def _rates() -> Iterator[Case]:
    angles = np.array([0.4, -1.1, 2.5])
    rotation = rotation_from_angles(angles)

    def turn(x: np.ndarray) -> np.ndarray:
        """Return the rotation vector, to first order, from the angles to the angles changed by x."""
        turned = rotation_from_angles(angles + x) @ rotation.T
        return 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])

    def change(x: np.ndarray) -> np.ndarray:
        return angles_from_rotation(rotation_about_axes(x) @ rotation) - angles

    for function, value in ((axes_rotation_from_angle_rates, turn), (angle_rates_from_axes_rotation, change)):
        yield Case(full_name(function), "three angles", np.zeros(3), value, function(angles))


def _rotation_vectors() -> Iterator[Case]:
    for vector in ([0.0, 0.0, 0.0], [1e-3, -2e-3, 5e-4], [0.4, -1.1, 0.3], [1.5, 2.0, -1.2]):
        rotation = rotation_about_axes(np.array(vector))

        def value(x: np.ndarray, rotation: np.ndarray = rotation) -> np.ndarray:
            return rotation_vectors_with_partials(rotation_about_axes(x) @ rotation)[0]

        partials = rotation_vectors_with_partials(rotation)[1]
        yield Case(full_name(rotation_vectors_with_partials), str(vector), np.zeros(3), value, partials)


def _shown_rotations() -> Iterator[Case]:
    """Return a case for each photo of a solved block: omega, phi, kappa by the rotations that were estimated."""
    block = solve_block(synthetic_block("convergent", "shown rotations").block, lambda _: None, lambda: False)
    partials, level = rotation_partials(block)
    assert not level.any()
    for photo, rotation in enumerate(block.state.rotations):

        def angles(x: np.ndarray, rotation: np.ndarray = rotation) -> np.ndarray:
            return angles_from_rotation(rotation_about_axes(x) @ rotation) - angles_from_rotation(rotation)

        yield Case(full_name(rotation_partials), f"photo {photo}", np.zeros(3), angles, partials[photo])


def _relative_poses() -> Iterator[Case]:
    """Return the cases of a rig: base, and rotation about the first camera's axes, by the poses of both photos."""
    centres, angles = np.array([[3.0, -2.0, 1.5], [3.4, -1.1, 1.2]]), np.array([[1.5, 0.2, -0.4], [1.3, 0.9, 0.6]])
    rotations = rotation_from_angles(angles)
    found = relative_poses_with_partials(centres[:1], rotations[:1], centres[1:], rotations[1:])

    def moved(x: np.ndarray) -> np.ndarray:
        poses = x.reshape(2, 6)
        at, turned = centres + poses[:, :3], rotation_about_axes(poses[:, 3:]) @ rotations
        now = relative_poses_with_partials(at[:1], turned[:1], at[1:], turned[1:])
        turn = now.rotation[0] @ found.rotation[0].T
        return np.concatenate([now.base[0], Rotation.from_matrix(turn).as_rotvec()])

    partials = np.hstack([found.by_first[0], found.by_second[0]])
    yield Case(full_name(relative_poses_with_partials), "", np.zeros(12), moved, partials)


def _rig_photos() -> Iterator[Case]:
    """Return the cases of a photo of a rig: its centre and rotation, by the exposure and by the camera's mounting."""
    for angles in ([0.1, -0.2, 0.7], [0.0, np.pi / 2.0, 0.0], [2.0, 1.0, -3.0]):
        rotation, mounting = rotation_from_angles(np.array([angles, [-0.8, 0.3, 1.9]]))
        at = np.array([3.0, -2.0, 1.5, 0.0, 0.0, 0.0, 0.4, -0.3, 0.2, 0.0, 0.0, 0.0])

        def photo(x: np.ndarray, rotation: np.ndarray = rotation, mounting: np.ndarray = mounting):
            turned, mounted = rotation_about_axes(x[3:6]) @ rotation, rotation_about_axes(x[9:]) @ mounting
            return photos_with_partials(x[None, :3], turned[None], x[None, 6:9], mounted[None])

        found = photo(at)

        def value(x: np.ndarray, photo=photo, found=found) -> np.ndarray:
            now = photo(x)
            turn = now.rotations[0] @ found.rotations[0].T
            return np.concatenate([now.centres[0], Rotation.from_matrix(turn).as_rotvec()])

        partials = np.hstack([found.by_exposure[0], found.by_mounting[0]])
        yield Case(full_name(photos_with_partials), str(angles), at, value, partials)


def _rigid_motions() -> Iterator[Case]:
    arm = np.array([0.3, -0.2, 0.5])

    def value(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[:3] + rotation_about_axes(x[3:]) @ arm, x[3:]])

    yield Case(full_name(_by_motion), str(arm), np.zeros(6), value, _by_motion(arm[None])[0])


def _frame() -> GroundFrame:
    return ground_frame("EPSG:32633", "m", np.array([410_000.0, 5_320_000.0, 600.0]))


def _ground_frame() -> Iterator[Case]:
    frame = _frame()
    local = np.array([[0.0, 0.0, 0.0], [2500.0, -1800.0, 400.0], [-30_000.0, 20_000.0, 1000.0]])
    project = frame.to_project(local)
    forward = frame.project_with_partials(local)
    yield Case(
        full_name(type(frame).project_with_partials), "UTM", local.ravel(),
        lambda x: (frame.to_project(x.reshape(-1, 3)) - project).ravel(), _block_diagonal(forward.by_local), 10.0,
    )  # fmt: skip


def _plain_ground() -> Iterator[Case]:
    local = np.array([[0.0, 0.0, 0.0], [2500.0, -1800.0, 400.0], [-3000.0, 2000.0, 1000.0]])
    yield Case(
        full_name(type(PLAIN).project_with_partials), "plain", local.ravel(),
        lambda x: PLAIN.project_with_partials(x.reshape(-1, 3)).value.ravel(),
        _block_diagonal(PLAIN.project_with_partials(local).by_local), 10.0,
    )  # fmt: skip
    axis = np.tile(np.arange(3), len(local))
    for label, ground in (("plain", PLAIN), ("UTM", _frame())):
        found = coordinates_with_partials(ground, np.repeat(local, 3, axis=0), axis)
        yield Case(
            full_name(coordinates_with_partials), label, local.ravel(),
            lambda x, ground=ground, value=found.value: coordinates_with_partials(
                ground, np.repeat(x.reshape(-1, 3), 3, axis=0), axis
            ).value - value,
            _block_diagonal(found.by_local.reshape(-1, 3, 3)), 10.0,
        )  # fmt: skip


def _height_grid() -> Iterator[Case]:
    at, size = np.array([-0.3, 0.2, 1.7, 20.4, 45.6, 46.9, 47.4]), 48
    _, found, by_place = _weights(at, size)
    yield Case(
        full_name(_weights), "cubic", at, lambda x: (_weights(x, size)[1] - found).ravel(),
        _block_diagonal(by_place[:, :, None]), 0.01,
    )  # fmt: skip


def _similarity() -> Iterator[Case]:
    generator = np.random.default_rng(9)
    at = Similarities(
        np.array([0.8, 4.0]), rotation_from_angles(generator.uniform(-3.0, 3.0, (2, 3))), generator.normal(size=(2, 3))
    )
    xyz = generator.normal(0.0, 2.0, (5, 3))
    for k in range(2):
        one = at.only(np.arange(2) == k)
        yield Case(
            full_name(similarity_with_partials), f"similarity {k + 1}", np.zeros(7),
            lambda x, one=one: similarity_with_partials(one.moved(x[None]), xyz).value.ravel(),
            similarity_with_partials(one, xyz).by_unknowns.reshape(-1, 7),
        )  # fmt: skip


# interior


def _distortion() -> Iterator[Case]:
    coefficients = tuple(SMALL_FORMAT)
    for function in (distorted_with_partials, corrected_with_partials, lens_distortion_with_partials):
        yield _mapped_case(lambda x, y, function=function: function(coefficients, x, y), "coordinates", function)
    x, y = FRAME.T
    for by_coefficients, function, partials in (
        (distorted_by_coefficients, distorted_with_partials, distorted_by_coefficients(x, y)),
        (corrected_by_coefficients, corrected_with_partials, corrected_by_coefficients(coefficients, x, y)),
    ):
        yield Case(
            full_name(by_coefficients), "coefficients", SMALL_FORMAT,
            lambda k, function=function: np.stack(function(k, x, y)[:2], axis=1).ravel(), partials.reshape(-1, 9),
        )  # fmt: skip


def _image_residuals() -> Iterator[Case]:
    """Return cases by everything at once: ideal coordinates, principal point, coefficients and additional values."""
    camera = np.concatenate([[0.12, -0.07], SMALL_FORMAT])
    for at_measured in (False, True):
        for additional in (None, *(_set_values(name) for name in PARAMETER_SETS)):
            measured = FRAME + np.random.default_rng(2).normal(0.0, 0.01, FRAME.shape)
            none = np.empty(0) if additional is None else additional.values

            def residuals(x: np.ndarray, at_measured=at_measured, additional=additional, measured=measured):
                ideal, rest = x[: FRAME.size].reshape(-1, 2), x[FRAME.size :]
                cameras = np.broadcast_to(rest[:11], (len(ideal), 11))
                values = None if additional is None else additional._replace(values=rest[11:])
                return image_residuals_with_partials(ideal, measured, cameras, at_measured, values)

            at = np.concatenate([FRAME.ravel(), camera, none])
            found = residuals(at)
            by_camera = np.concatenate(
                [found.by_principal_point, found.by_coefficients, found.by_additional], axis=2
            ).reshape(FRAME.size, -1)
            yield Case(
                full_name(image_residuals_with_partials),
                f"{'measured' if at_measured else 'ideal'} {additional.name if additional else ''}", at,
                lambda x, residuals=residuals: residuals(x).value.ravel(),
                np.hstack([_block_diagonal(found.by_ideal), by_camera]),
            )  # fmt: skip


def _image_equation() -> Iterator[Case]:
    for name, camera in driven_cameras().items():
        yield _mapped_case(camera_model(camera).image.explicit_with_partials, name)
    for at_measured in (False, True):
        for name in PARAMETER_SETS:
            polynomial = image_polynomial(*_set_values(name))
            yield _mapped_case(
                lambda x, y, at_measured=at_measured, polynomial=polynomial: image_coordinates._deformed(
                    at_measured, (x, y, *_unit(x)), deformation_with_partials(polynomial, x, y)
                ),
                f"{'measured' if at_measured else 'ideal'} {name}", image_coordinates._deformed,
            )  # fmt: skip
    for name in PARAMETER_SETS:
        polynomial = image_polynomial(*_set_values(name))
        yield _mapped_case(
            lambda x, y, polynomial=polynomial: deformation_with_partials(polynomial, x, y), name,
            deformation_with_partials,
        )  # fmt: skip


def _unit(x: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the partials of what maps every point to itself."""
    return np.ones_like(x), np.zeros_like(x), np.zeros_like(x), np.ones_like(x)


def _mapped_case(function: Callable[..., tuple], label: str, of: object = None) -> Case:
    """Return the case of a function of x and y (n,) that returns two values and their partials xx, xy, yx, yy."""
    places = 0.6 * FRAME
    by_xy = np.stack(function(*places.T)[2:], axis=1).reshape(-1, 2, 2)
    return Case(
        full_name(of or function), label, places.ravel(),
        lambda x: np.stack(function(*x.reshape(-1, 2).T)[:2], axis=1).ravel(), _block_diagonal(by_xy),
    )  # fmt: skip


def _set_values(name: str) -> SetValues:
    """Return a set whose every parameter deforms the image by some ten micrometres."""
    count, base = len(PARAMETER_SETS[name].parameter_names), 9.6
    errors = np.array([default_error(name, index, base, 0.005) for index in range(count)])
    return SetValues(name, base, errors * np.random.default_rng(6).normal(size=count))


def _bases() -> Iterator[Case]:
    at = np.linspace(-12.0, 12.0, 7)
    bases = np.full(len(at), 9.6)
    for basis in (additional_parameters._ebner_basis, additional_parameters._gruen_basis):
        yield Case(
            full_name(basis), "polynomials", at, lambda t, basis=basis: basis(t, bases).value.ravel(),
            _block_diagonal(basis(at, bases).derivative[:, :, None]),
        )  # fmt: skip


def _additional() -> Iterator[Case]:
    for name in PARAMETER_SETS:
        _, base, values = _set_values(name)
        found = additional_with_partials(name, FRAME, base, values)
        yield Case(
            full_name(additional_with_partials), f"{name} coordinates", FRAME.ravel(),
            lambda x, name=name, base=base, values=values: additional_with_partials(
                name, x.reshape(-1, 2), base, values
            ).value.ravel(),
            _block_diagonal(found.by_xy),
        )  # fmt: skip
        yield Case(
            full_name(additional_with_partials), f"{name} parameters", values,
            lambda x, name=name, base=base: additional_with_partials(name, FRAME, base, x).value.ravel(),
            found.by_values.reshape(-1, len(values)),
        )  # fmt: skip


# preliminary values


def _parallaxes() -> Iterator[Case]:
    generator = np.random.default_rng(8)
    for label, base, angles in (
        ("aerial", (90.0, 3.0, -2.0), (0.02, -0.03, 0.05)),
        ("forward", (1.0, 2.0, -40.0), (0.1, 0.2, 3.0)),
        ("at right angles", (-150.0, 5.0, 150.0), (0.4, -np.pi / 2.0, 0.0)),
    ):
        rotation = rotation_from_angles(np.array(angles))
        # rays that miss each other by millimetres, so that the partials of the gradient count
        left, right = (
            np.hstack([generator.uniform(-100.0, 100.0, (6, 2)), np.full((6, 1), -c)]) for c in (153.0, 152.0)
        )
        pairs = Pairs(left, right, np.full(6, 0.007))
        at = np.array([*base, 0.0, 0.0, 0.0])

        def value(x: np.ndarray, rotation: np.ndarray = rotation, pairs: Pairs = pairs) -> np.ndarray:
            return parallaxes_with_partials(TwoPhotos(x[:3], rotation_about_axes(x[3:]) @ rotation), pairs).value

        found = parallaxes_with_partials(TwoPhotos(at[:3], rotation), pairs)
        partials = np.hstack([found.by_base, found.by_rotation])
        yield Case(full_name(parallaxes_with_partials), label, at, value, partials)


def _resection() -> Iterator[Case]:
    generator = np.random.default_rng(12)
    rotation, centre = rotation_from_angles(np.array([0.3, -0.2, 2.0])), np.array([1.0, -2.0, 8.0])
    in_photo = generator.uniform([-3.0, -3.0, -9.0], [3.0, 3.0, -7.0], (6, 3))
    vectors = np.column_stack([50.0 * in_photo[:, :2] / -in_photo[:, 2:], np.full(6, -50.0)])
    known = resection.KnownPoints(vectors, centre + in_photo @ rotation.T, np.zeros(6), 0.005)
    problem = resection._Resection(known)

    def linearised(x: np.ndarray) -> resection.ResectionEquations:
        turned = rotation_about_axes(x[:3]) @ rotation
        at = resection.Orientations(turned[None], (centre + x[3:])[None])
        return problem.linearised(at, np.ones((1, 6)), np.zeros((1, 6)))

    yield Case(
        full_name(resection._Resection.linearised), "rotation and centre", np.zeros(6),
        lambda x: linearised(x).residual.ravel(), linearised(np.zeros(6)).partials.reshape(-1, 6),
    )  # fmt: skip


# kinds of observation


_ARGUMENTS = ("ideal", "measured")


def blocks() -> dict[str, Block]:
    """Return blocks in which every kind of observation occurs, all 12 camera parameters unknown."""
    plain = {
        f"{scene}, {argument}": _with_everything(
            synthetic_block(
                scene, "partials", distortion=DISTORTED, distortion_at=argument, unknown=CAMERA_PARAMETERS[:12],
                constant=_CONSTANT[scene], noise_mm=0.01, start_error=_START_ERROR[scene],
            ).block
        )
        for scene in ("strip", "convergent", "terrestrial")
        for argument in _ARGUMENTS
    }  # fmt: skip
    fisheyes = {
        f"room, {argument}": synthetic_block(
            "room", "partials", distortion=DISTORTED, distortion_at=argument, unknown=CAMERA_PARAMETERS[:12],
            noise_mm=0.01, start_error=0.003,
        ).block
        for argument in _ARGUMENTS
    }  # fmt: skip
    with_set = {
        f"{label}, {name}": _with_set(plain[label], name)
        for label, name in (
            ("convergent, ideal", "EBNER"),
            ("terrestrial, measured", "EBNER"),
            ("strip, ideal", "GRUEN"),
        )
    }
    rolling = {
        f"rolling {label}, {direction}": _rolling({**plain, **fisheyes, **with_set}[label], direction)
        for label, direction in (
            ("strip, ideal", "down"),
            ("convergent, measured", "right"),
            ("room, ideal", "left"),
            ("convergent, ideal, EBNER", "up"),
        )
    }
    same_lens = {f"same lens, {argument}": with_two_frames(plain[f"convergent, {argument}"]) for argument in _ARGUMENTS}
    strip = _in_a_crs(plain["strip, ideal"])
    correlated = {"correlated, in a crs": _correlated(strip), "correlated": _correlated(plain["convergent, ideal"])}
    others = {"strip in a crs": strip, "rig": _on_a_rig(plain["strip, ideal"])}
    return plain | fisheyes | with_set | rolling | same_lens | others | correlated


def _correlated(block: Block) -> Block:
    """Return a block whose first control points have correlated errors, with others and among themselves."""
    whole = [point for point in block.control_points if all(point.errors)][:3]
    own = {point.name: replace(point, correlations=(0.3, -0.2, 0.1)) for point in whole[1:]}
    matrix = ((0.3, 0.1, 0.0), (-0.1, 0.2, 0.1), (0.0, 0.1, 0.4))
    pairs = tuple(PointCorrelation(whole[0].name, point.name, matrix) for point in whole[1:])
    points = tuple(own.get(point.name, point) for point in block.control_points)
    return replace(block, control_points=points, control_correlations=pairs)


def _on_a_rig(block: Block) -> Block:
    """Return a block whose photos are of two cameras on one body, but for the last two."""
    other = replace(block.cameras[0], name="CAM2")
    photos = tuple(
        replace(photo, camera=("CAM", "CAM2")[row % 2], constant=()) for row, photo in enumerate(block.photos)
    )
    rotation, error = (3.0, -2.0, 30.0), (0.1, 0.1, 0.1)
    mountings = (Mounting("CAM"), Mounting("CAM2", (490.0, 30.0, -20.0), (1.0, 1.0, 1.0), rotation, error))
    exposures = tuple(RigExposure(f"E{row}", (f"P{row}", f"P{row + 1}")) for row in (1, 3))
    return replace(
        block,
        cameras=(block.cameras[0], other),
        photos=photos,
        photo_camera=np.arange(len(photos)) % 2,
        rigs=Rigs((Rig("BODY", mountings),), exposures),
        elements=tuple(element for element in block.elements if element.name != "P5"),
    )


def _in_a_crs(block: Block) -> Block:
    """Return a block in a local frame, with constants of every kind that are equations there.

    How the project's axes turn when their place moves is no part of the partials: photos with observed rotations and
    the stations of directions do not move. Of a place all three coordinates are observed or none, since of one alone
    the partials by the other axes are so small that a numerical derivative is nothing but rounding.
    """
    at_rest = {"P5": ("X0", "Y0", "Z0"), "P6": ("X0", "Y0", "Z0")}
    held = [direction.station for direction in block.directions] + [line.start for line in block.given_directions]
    stations = np.isin(block.point_names, held)
    left_out = ("P1", "P2", block.point_names[11])
    position, xyz = (("X0", 400_000.0), ("Y0", 5_300_000.0), ("Z0", 1000.0)), "XYZ"
    observed, constant = block.point_names[2:4]
    return replace(
        block,
        ground=_frame(),
        terrains=(_rolling_terrain(410_000.0, 5_320_000.0),),
        photos=tuple(replace(photo, constant=at_rest.get(photo.name, ())) for photo in block.photos),
        constant_points=np.broadcast_to(stations[:, None], (len(stations), 3)),
        # a short arm moves coordinates on a map grid by little more than they are rounded to
        antennas=tuple(replace(antenna, lever_arm=(30.0, -20.0, 80.0)) for antenna in block.antennas),
        stations=tuple(
            replace(station, position_error=(0.0, 0.0, 0.0), covariance=None)
            if station.photo == "P4"
            else replace(station, covariance=None)
            if station.has_joint_covariance
            else station
            for station in block.stations
        ),
        # nor do photos with a rotation between them
        differences=tuple(
            replace(line, covariance=None)
            if line.name == "P5-P6"
            else replace(line, angles=NOT_GIVEN, angle_error=NOT_GIVEN, covariance=None)
            for line in block.differences
            if line.second != "P5"
        ),
        elements=(
            *(element for element in block.elements if element.name not in left_out),
            *(ControlElement("P4", "PHOTO", kind, value, 0.1) for kind, value in position),
            *(ControlElement(observed, "POINT", kind, 0.0, 0.1) for kind in xyz),
        ),
        constant_elements=(
            *(ControlElement("P3", "PHOTO", kind, value, 0.0) for kind, value in position),
            *(ControlElement("P6", "PHOTO", kind, 0.0, 0.0) for kind in ("OMEGA", "PHI", "KAPPA")),
            *(ControlElement(constant, "POINT", kind, 0.0, 0.0) for kind in xyz),
        ),
    )


def _with_set(block: Block, name: str) -> Block:
    largest = np.abs(block.photo_points.xy).max(axis=0)
    camera = replace(block.cameras[0], additional_set=name, frame=tuple(2.0 * largest))
    held = (camera.name, PARAMETER_SETS[name].parameter_names[2])
    return replace(block, cameras=(camera,), held_additional=frozenset([held]))


def _rolling(block: Block, direction: ReadoutDirection) -> Block:
    """Return a block of a rolling shutter, with unknown readout and motions."""
    camera, photo = block.cameras[0], block.photos[0].name
    said = StationMotion((8.0, 1.0, -2.0), (0.1, 0.2, 0.1), (0.1, -0.2, 0.1), (0.01, 0.02, 0.01))
    own = next((one for one in block.stations if one.photo == photo), Station(photo, NOT_GIVEN, NOT_GIVEN))
    others = tuple(one for one in block.stations if one.photo != photo)
    height = 2.5 * float(np.abs(block.photo_points.xy).max())
    return replace(
        block,
        definition=replace(block.definition, velocity_error=0.3, rate_error=2.0),
        stations=(*others, replace(own, motion=said)),
        cameras=(
            replace(
                camera, parameters=(*camera.parameters[:-1], 0.05), sensor=Sensor(3000, 2000, 1.5 * height, height),
                unknown=(*camera.unknown, "READOUT"), readout_direction=direction,
            ),
        ),
    )  # fmt: skip


def state_of(block: Block) -> BlockState:
    """Return the starting state, with additional parameters, shifts and drifts that are not zero."""
    state = starting_state(block)
    values = np.zeros_like(state.additional)
    for row, camera in enumerate(block.cameras):
        names = PARAMETER_SETS[camera.additional_set].parameter_names if camera.additional_set else ()
        errors = [
            default_error(camera.additional_set, index, base_of_camera(camera), 0.005) for index in range(len(names))
        ]
        values[row, : len(names)] = np.random.default_rng(row).normal(size=len(names)) * errors
    random = np.random.default_rng(17)
    shifts, drifts, motions, corrections = (
        random.normal(size=table.shape)
        for table in (state.shifts, state.drifts, state.motions, state.motion_corrections)
    )
    return replace(
        state, additional=values, shifts=shifts, drifts=drifts, motions=motions, motion_corrections=0.1 * corrections,
        figures=_figures(state),
    )  # fmt: skip


def _figures(state: BlockState) -> PlacedFigures:
    """Return figures above the points that do not fit them: residuals bend the partials, little far from an axis."""
    count, size = len(state.figures.origins), np.ptp(state.points, axis=0).max()
    axes = rotation_from_angles(np.random.default_rng(18).uniform(-1.0, 1.0, (count, 3)))
    level = np.ptp(state.figures.axes - np.eye(3), axis=(1, 2)) == 0.0
    return PlacedFigures(
        np.where(level[:, None], state.figures.origins, state.points.mean(axis=0) + size * np.eye(3)[2]),
        np.where(level[:, None, None], np.eye(3), axes),
        np.where(state.figures.radii > 0.0, 0.3 * size, 0.0),
    )


# at phi = ±90 no angle can be held, and the photos stay exactly there
_CONSTANT = {
    "strip": [("OMEGA",), ("PHI", "X0"), ("KAPPA",), ("OMEGA", "PHI", "KAPPA")],
    "convergent": [("KAPPA", "Z0"), (), ("OMEGA", "KAPPA")],
    "terrestrial": [("X0",)],
}
_START_ERROR = {"strip": 0.01, "convergent": 0.01, "terrestrial": 0.0}


def _with_everything(block: Block) -> Block:
    a, b, c, d = block.point_names[1], block.point_names[6], block.point_names[11], block.point_names[14]
    codes = ("X", "Y", "Z", "XY", "YZ", "ZX", "XYZ")
    elements = [
        ControlElement("CAM", "CAMERA", "C", block.cameras[0].parameters[0], 0.01),
        ControlElement("CAM", "CAMERA", "A3", 0.0, 1e-6),
        ControlElement("P2", "PHOTO", "Y0", 3.0, 0.1),
        ControlElement(c, "POINT", "Z", 1.0, 0.1),
        ControlElement("S1", "THEODOLITE", "R", 30.0, 0.01),
    ]
    # at phi = ±90 an observed rotation; a dozen degrees away, so that its residual bends the partials
    elements += [
        ControlElement("P5", "PHOTO", kind, value, 0.01)
        for kind, value in zip(("OMEGA", "PHI", "KAPPA"), _observed_angles(block, "P5"), strict=True)
    ]
    if not _looks_along_x(block):
        # of a photo with a constant angle the other unknowns are angles themselves
        elements += [ControlElement("P1", "PHOTO", "PHI", 1.0, 0.01)]
    return replace(
        block,
        elements=tuple(elements),
        distances=tuple(
            ControlDistance(f"{code}{error}", start, end, code, 1.0, error)
            for code in codes
            for start, end, error in ((a, b, 0.01), (b, c, 0.0))
        ),
        directions=(
            ControlDirection("S1", a, b, 10.0, 0.01, 80.0, 0.01),
            ControlDirection("S1", a, d, 350.0, 0.01),
            ControlDirection("S2", d, c, 200.0, 0.01, 100.0, 0.01),
        ),
        theodolites=(TheodoliteSet("S1", 0.4), TheodoliteSet("S2", -2.0, constant=True)),
        given_directions=tuple(
            GivenDirection(f"G{number}", start, end, direction, 0.01)
            for number, (start, end, direction) in enumerate(((a, b, (0.3, -1.0, 0.4)), (c, d, (0.0, 0.0, 1.0))))
        ),
        figure_points=tuple(
            FigurePoint(f"{kind}{number}", kind, name, 0.01)
            for kind in ("LINE", "PLANE", "CYLINDER", "HEIGHT")
            for number in (1, 2)
            for name in block.point_names[number : number + 14 : 2]
        ),
        terrains=(_rolling_terrain(),),
        terrain_heights=tuple(TerrainHeight("HILLS", name, 0.1) for name in block.point_names[2:12:3]),
        stations=_stations(block),
        differences=_differences(block),
        antennas=(_ANTENNA,),
    )


def _rolling_terrain(x0: float = 0.0, y0: float = 0.0) -> TerrainModel:
    """Return hills, whose pixels lie across the axes and are much wider than the steps of the partials."""
    column, row = np.meshgrid(np.arange(-60.0, 60.0), np.arange(-60.0, 60.0))
    heights = 300.0 * np.sin(0.7 * column) + 200.0 * np.cos(0.9 * row + 0.2 * column)
    turn = np.array([[0.8, 0.6], [0.6, -0.8]]) / 400.0
    at = 60.0 - turn @ [x0, y0]
    return TerrainModel(
        Terrain("HILLS", "hills.tif", 0.1),
        HeightGrid(heights, (*turn[0].tolist(), float(at[0]), *turn[1].tolist(), float(at[1]))),
    )


_ANTENNA = Antenna(
    "GNSS", lever_arm=(0.3, -0.2, 0.8), lever_arm_error=(0.1, 0.1, 0.1), boresight=(0.5, -0.7, 3.0),
    boresight_error=(1.0, 1.0, 1.0), time_offset=0.02, time_offset_error=0.1, unknown=ANTENNA_PARAMETERS,
    shift="strip", shift_error=(1.0, 1.0, 1.0), drift="session", drift_error=(0.1, 0.1, 0.1),
)  # fmt: skip


def _looks_along_x(block: Block) -> bool:
    return bool(np.isclose(np.abs(np.cos(block.photo_orientation[-1, 4])), 0.0))


def _observed_angles(block: Block, name: str) -> list[float]:
    """Return angles (degrees) far enough from those of a photo that the residuals bend the partials."""
    place = next((row for row, photo in enumerate(block.photos) if photo.name == name), None)
    if place is None or not _looks_along_x(block):
        return [1.0, 1.0, 1.0]
    given = rotation_from_angles(block.photo_orientation[place, 3:])
    rotation = rotation_about_axes(np.array([0.1, -0.05, 0.02])) @ given
    return np.degrees(angles_from_rotation(rotation)).tolist()


def _stations(block: Block) -> tuple[Station, ...]:
    """Return a station of each photo but the first: two with covariances, some coordinates and angles constant."""
    covariance = ((0.04, 0.01, -0.02), (0.01, 0.09, 0.015), (-0.02, 0.015, 0.0625))
    errors = {"P3": (0.2, 0.3, 0.25), "P4": (0.1, 0.0, -0.2)}
    nothing = (np.nan, np.nan, np.nan)
    joint = _joint_covariance()
    root = tuple(np.sqrt(np.diag(joint)).tolist())
    angle_errors = {"P5": (0.001, 0.0, -0.002), "P6": root[3:]}
    errors["P6"], covariances = root[:3], {"P3": covariance, "P6": joint}
    return tuple(
        Station(
            photo.name, tuple(place[:3].tolist()), errors.get(photo.name, (0.1, 0.1, 0.1)),
            tuple(place[3:].tolist()) if photo.name in angle_errors else nothing,
            angle_errors.get(photo.name, nothing), covariances.get(photo.name),
            time=20.0 + 3.0 * row**1.1, strip="2" if row > 3 else "1",
        )
        for row, (photo, place) in enumerate(zip(block.photos, block.photo_orientation, strict=True))
        if row
    )  # fmt: skip


def _joint_covariance() -> tuple[tuple[float, ...], ...]:
    """Return a covariance of positions and rotations that are all correlated."""
    root = np.tril(np.random.default_rng(3).normal(size=(6, 6)), -1) * 0.3 + np.eye(6)
    covariance = (root @ root.T) * np.outer(*[np.repeat([0.1, 0.02], 3)] * 2)
    return tuple(map(tuple, covariance.tolist()))


def _differences(block: Block) -> tuple[StationDifference, ...]:
    """Return differences between successive photos: one with a covariance, one without a rotation, one compared."""
    covariance = _joint_covariance()
    errors = np.sqrt(np.diag(covariance))
    nothing = (np.nan, np.nan, np.nan)
    found = []
    for row, (one, other) in enumerate(pairwise(block.photo_orientation)):
        turned = rotation_from_angles(one[3:]).T @ rotation_from_angles(other[3:])
        angles = angles_from_rotation(rotation_about_axes(np.array([0.1, -0.05, 0.02])) @ turned)
        found.append(
            StationDifference(
                block.photos[row].name, block.photos[row + 1].name, tuple(other[:3] - one[:3]),
                tuple(errors[:3]) if row == 1 else (0.1, -0.1, 0.2), nothing if row == 2 else tuple(angles),
                nothing if row == 2 else tuple(errors[3:]) if row == 1 else (0.001, 0.002, -0.001),
                covariance if row == 1 else None,
            )
        )  # fmt: skip
    return tuple(found)


def observations_of(block: Block) -> tuple[Unknowns, list[Observations]]:
    """Return the unknowns of a block and its observations of every kind."""
    tied = frozenset[int]().union(*(kind.tied_points(block) for kind in KINDS))
    unknowns = number_unknowns(block, tied)
    return unknowns, [kind.observe(block, unknowns) for kind in KINDS]


def method_of(observations: Observations) -> str:
    """Return the full name of the method that linearises a kind of observation, wherever it is inherited from."""
    return full_name(type(observations).linearise_with_partials)


def _kinds(label: str, block: Block) -> Iterator[Case]:
    state = state_of(block)
    unknowns, kinds = observations_of(block)
    size = unknowns.layout.size
    for observations in kinds:
        found = observations.linearise_with_partials(state)
        if not len(found.residual):
            continue
        _, (by_unknowns, columns) = partials_by_unknowns(observations, state, unknowns)
        rows = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
        partials = np.zeros((len(columns), size))
        free = columns != CONSTANT
        np.add.at(partials, (rows[free], columns[free]), by_unknowns[free])
        assert found.computable.all()
        for part, move, rounding in _parts(block, observations):
            yield Case(
                method_of(observations), f"{observations.rows.kind.name}, {label}", np.zeros(size),
                lambda x, of=observations, state=state, unknowns=unknowns, part=part: of.linearise_with_partials(
                    state.moved(x, unknowns)
                ).residual[part],
                partials[part], move, rounding,
            )  # fmt: skip


def _parts(block: Block, observations: Observations) -> list[tuple[np.ndarray, float, float]]:
    """Return rows of cases, their moves and rounding: millions of metres on a map grid are rounded to 1e-9.

    Angles are not; they bend with larger moves. A lever arm changes little between two photos that look alike. Heights
    change with X and Y by a ten-thousandth.
    """
    rows, kind = np.arange(len(observations.rows.error)), observations.rows.kind.name
    if kind == "difference" and block.ground is not PLAIN:
        of_position = np.isin(observations.rows.component, ("X", "Y", "Z"))
        return [(rows[of_position], 0.1, 1e-8), (rows[~of_position], 1e-3, 0.0)]
    if kind == "terrain" and block.ground is not PLAIN:
        return [(rows, 0.1, 1e-8)]
    if kind == "height" and block.ground is not PLAIN:
        return [(rows, 100.0, 0.0)]
    is_small = block.ground is PLAIN or kind in ("photo", "attitude", "constant attitude")
    return [(rows, 1e-3 if is_small else 0.1, 0.0)]


GROUPS: dict[str, Callable[[], Iterator[Case]]] = {
    **{
        function.__name__: function
        for function in (
            _perspective, _equidistant, _moving, _distortion, _additional, _ground_frame, _plain_ground, _height_grid,
            _similarity, _image_residuals, _image_equation, _bases, _rates, _rotation_vectors, _shown_rotations,
            _relative_poses, _rig_photos, _rigid_motions, _parallaxes, _resection,
        )
    },
    **{f"all kinds, {label}": partial(_kinds, label, block) for label, block in blocks().items()},
}  # fmt: skip


@cache
def cases_of(group: str) -> tuple[Case, ...]:
    """Return the cases of one of `GROUPS`, which are made when they are asked for first."""
    return tuple(GROUPS[group]())


def all_cases() -> list[Case]:
    return [case for group in GROUPS for case in cases_of(group)]
