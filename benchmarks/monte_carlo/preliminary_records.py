"""Records of a scene as a user would have them, without a single preliminary value, and the truth behind them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from monte_carlo.simulated_blocks import solved
from msgspec import Struct
from support.block_scenes import Scene
from support.tie_points import TiePoints

from orip.bundle.assemble import BlockInput, gather, with_starting_values
from orip.bundle.solve import SolvedBlock
from orip.errors import InputError, NotSolvableError
from orip.geometry.plane import PlaneTransformation
from orip.geometry.rotation import angles_from_rotation
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.control import Control, ControlPoint, PreliminaryPoint
from orip.records.definition import BundleDefinition, Precision, StereoModel
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.structs import replace

NOISE_MM = 0.005

SELF_CALIBRATION = ("C", "DX", "DY", "A3")


class SimulatedRecords(Struct, frozen=True):
    """What a user would have measured, and what it was made from.

    Attributes
    ----------
    family : str
    run : int
    rejected : tuple of str
        Why earlier draws were not taken.
    inputs : BlockInput
        Without any preliminary value.
    camera : Camera
        The true one.
    orientations : mapping of photo to (centre, rotation)
    coordinates : mapping of point to true coordinates
    wrong : frozenset of (photo, point)
        Photo points with a blunder.
    wrong_control : frozenset of str
    self_calibrating : bool
    """

    family: str
    run: int
    rejected: tuple[str, ...]
    inputs: BlockInput
    camera: Camera
    orientations: Mapping[str, tuple[np.ndarray, np.ndarray]]
    coordinates: Mapping[str, np.ndarray]
    wrong: frozenset[tuple[str, str]] = frozenset()
    wrong_control: frozenset[str] = frozenset()
    self_calibrating: bool = False

    @property
    def blunders(self) -> float:
        """Return the part of the photo points that is wrong."""
        return len(self.wrong) / len(self.inputs.observations.photos)


def gathered(records: SimulatedRecords, **settings: object) -> Block:
    """Return the block without any starting value, with changes of its settings."""
    inputs = records.inputs
    try:
        return gather(replace(inputs, definition=replace(inputs.definition, **settings)))
    except InputError as error:
        message = "; ".join(str(complaint) for complaint in error.complaints)
        raise NotSolvableError(message) from None


def started_at(
    block: Block, orientations: Mapping[str, tuple[np.ndarray, np.ndarray]], coordinates: Mapping[str, np.ndarray]
) -> Block:
    """Return a gathered block started at (centre, rotation) of its photos and coordinates of its points."""
    both = [orientations[record_key(photo.name)] for photo in block.photos]
    centres, rotations = (np.array(part) for part in zip(*both, strict=True))
    start = np.column_stack([centres, angles_from_rotation(rotations)])
    known = np.array([*coordinates.values()], dtype=np.float64).reshape(-1, 3).tolist()
    preliminary = tuple(PreliminaryPoint(name, tuple(xyz)) for name, xyz in zip(coordinates, known, strict=True))
    return with_starting_values(replace(block, photo_orientation=start, preliminary=preliminary))[0]


def true_minimum(records: SimulatedRecords) -> SolvedBlock:
    """Return the adjustment from the truth, the camera's too, with weights reduced from the first iteration on.

    Residuals at the truth are errors and blunders alone, so that each weight is decided by its own observation.
    """
    block = gathered(records, start_down_weight=1)
    cameras = tuple(replace(camera, parameters=records.camera.parameters) for camera in block.cameras)
    return solved(started_at(replace(block, cameras=cameras), records.orientations, records.coordinates))


def photo_deviations(found: SolvedBlock) -> tuple[np.ndarray, np.ndarray]:
    """Return standard deviations of centres (n, 3) and of rotations about the ground axes (n, 3), radians."""
    columns = found.problem.unknowns.photos
    deviations = found.deviation_scale * np.sqrt(found.cofactors.reduced.diagonal())[columns]
    return deviations[:, :3], deviations[:, 3:]


def cameras_of(scene: Scene, random: np.random.Generator, *, wrong: bool) -> tuple[Camera, Camera]:
    """Return the camera as given and the true one."""
    c, radius = scene.principal_distance, 0.5 * float(np.linalg.norm(scene.frame))
    film = min(1.0, float(scene.frame.min()) / 24.0)
    dx, dy = random.uniform(-0.3, 0.3, 2) * film
    a3 = random.uniform(-1.0, 1.0) * 0.15 * film / radius**3
    frame = tuple(scene.frame.tolist())
    true = Camera("CAM", (c, float(dx), float(dy), 0.0, float(a3), *(0.0,) * 8), frame=frame)
    if not wrong:
        return true, true
    nominal = c * (1.0 + random.uniform(-0.02, 0.02))
    return replace(true, parameters=(nominal, *(0.0,) * 12), unknown=SELF_CALIBRATION), true


def records_of(
    family: str,
    run: int,
    scene: Scene,
    ties: TiePoints,
    random: np.random.Generator,
    cameras: tuple[Camera, Camera],
) -> SimulatedRecords:
    given, true = cameras
    photos = len(scene.centres)
    number = random.permutation(photos) if random.random() < 0.5 else np.arange(photos)
    labels = [f"P{index + 1}" for index in number]
    places = np.unique(ties.place)
    names = dict(zip(places.tolist(), (str(number) for number in 101 + random.permutation(len(places))), strict=True))
    x, y = ties.xy.T
    ideal = ties.xy * (1.0 + true.parameters[4] * (x**2 + y**2))[:, None] + np.array(true.parameters[1:3])
    measured = ideal + NOISE_MM * random.normal(size=ideal.shape)
    order = np.lexsort([ties.place, number[ties.photo]])
    n = len(order)
    observations = PhotoObservations(
        "SIM",
        tuple(labels[row] for row in ties.photo[order]),
        tuple(names[place] for place in ties.place[order].tolist()),
        measured[order],
        np.full((n, 2), np.nan),
        np.zeros(n, dtype=bool),
    )
    models = tuple(
        StereoModel(f"M{row}-{column}", labels[left], labels[right], row, column)
        for left, right, row, column in (scene.pairs if random.random() < 0.5 else ())
    )
    identity = PlaneTransformation(np.eye(2), np.zeros(2))
    keys = [record_key(label) for label in labels]
    inputs = BlockInput(
        definition=BundleDefinition("SIM", Precision(NOISE_MM), models=models),
        records=Definitions(
            {record_key(given.name): given},
            {},
            {},
            {key: Photo(label, given.name) for key, label in zip(keys, labels, strict=True)},
            {},
        ),
        measured=Measured(observations={record_key("SIM"): observations}),
        interior=Interior((), {}, dict.fromkeys(keys, identity), {}, (), ()),
        control=Control(points=_control(scene, ties, names, random)),
    )
    return SimulatedRecords(
        family,
        run,
        (),
        inputs,
        true,
        dict(zip(keys, zip(scene.centres, scene.rotations, strict=True), strict=True)),
        {names[place]: scene.surface[place] for place in places.tolist()},
    )


def _control(
    scene: Scene, ties: TiePoints, names: dict[int, str], random: np.random.Generator
) -> tuple[ControlPoint, ...]:
    """Return three control points that lie far apart, or more of them; of many, some lack Z or X and Y."""
    places = np.unique(ties.place)
    kind = random.random()
    most = max(4, len(places) // 4)
    number = 3 if kind < 0.4 else int(random.integers(4, 9)) if kind < 0.7 else int(random.integers(4, most + 1))
    first = _far_apart(scene.surface[places])
    others = np.setdiff1d(random.permutation(len(places)), first, assume_unique=True)
    chosen = places[np.r_[first, random.permutation(others)[: number - 3]]]
    distance = np.mean(np.linalg.norm(scene.surface[ties.place] - scene.centres[ties.photo], axis=1))
    constant = random.random() < 0.3
    error = 0.0 if constant else random.uniform(0.5, 4.0) * NOISE_MM * distance / scene.principal_distance
    mixed = number >= 6 and random.random() < 0.5
    control = []
    for index, place in enumerate(chosen.tolist()):
        lacking = ((), (0, 1), (2,))[index % 3] if mixed and index >= 3 else ()
        xyz = scene.surface[place] + error * random.normal(size=3)
        control.append(
            ControlPoint(
                names[place],
                tuple(None if axis in lacking else float(xyz[axis]) for axis in range(3)),
                tuple(None if axis in lacking else error for axis in range(3)),
            )
        )
    return tuple(control)


def _far_apart(points: np.ndarray) -> np.ndarray:
    """Return indices of three points that make a large triangle."""
    first = np.linalg.norm(points - points.mean(axis=0), axis=1).argmax()
    second = np.linalg.norm(points - points[first], axis=1).argmax()
    third = np.linalg.norm(np.cross(points - points[first], points[second] - points[first]), axis=1).argmax()
    return np.array([first, second, third])
