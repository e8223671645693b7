"""The plate processor under a pair of rectified photos: one floating mark, driven in the object or plate by plate.

It is the processor of the emulator (`orip.multimodel.movement`) with what a stereo page needs besides: movements in
pixels of what is seen, one plate set to a place of its image, and the readings in log coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.stereo import PARALLEL, meeting
from orip.images.matching.one_point import Transfer
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.movement import automatic, change_model, drive_object, drive_plate, guide, move, next_model
from orip.multimodel.oriented_block import ModelLoop, OrientedBlock
from orip.multimodel.photo_loop import DrivenPhoto
from orip.multimodel.processor import Loaded
from orip.multimodel.readout import object_position, photo_positions, plate_position
from orip.multimodel.rectified_model import ImageOnPlate, RectifiedModel, rectified_model
from orip.multimodel.state import Condition, Guide, Position, ProcessorState, active_model, inside_model
from orip.records.drive_table import DriveCode, DriveFault, Triple
from orip.records.ground import GroundSystem
from orip.records.measurement import StereoVertex

_LEAST_DEPTH_OF_Z = 0.5
"""Part of the object's Z along the model's z axis from which on Z is height in the model; below it guides in MODEL."""


class StereoReading(NamedTuple):
    """Everything that moves.

    Attributes
    ----------
    model : int
        Place of the active model in the block.
    xyz : tuple (X, Y, Z) or None
        Of the mark, in the project; None where the rays do not meet.
    y_parallax : float
        mm in the photo; NaN where the rays do not meet.
    plates : tuple (upper, lower) of positions
        As they are read out, rounded to the least counts.
    photos, logs : tuples (left, right) of positions
        mm in the photo, and log coordinates.
    places : tuple (left, right) of positions
        Column and row in the rectified photos.
    """

    model: int
    guide: Guide
    automatic: bool
    condition: Condition
    xyz: Triple | None
    y_parallax: float
    plates: tuple[Position, Position]
    photos: tuple[Position, Position]
    logs: tuple[Position, Position]
    places: tuple[Position, Position]


class StereoPhoto(Struct, frozen=True):
    """A photo of the block: its name in the project, its image, and whether what is measured stands in pixels."""

    name: str
    image: ImageOnPlate
    is_digital: bool


class StereoProcessor:
    """A plate processor with rectified photos; not for several threads at once.

    Methods that move raise `ProcessorFault` where the plate processor refuses.

    Parameters
    ----------
    photos : mapping of StereoPhoto
        By the names in the drive table.
    ground : GroundSystem
        Of the table.
    points : dict of tuples (X, Y, Z)
        Adjusted points, in the project.
    warnings : tuple of ProjectWarning
        Of the drive table.
    """

    def __init__(
        self,
        loaded: Loaded,
        photos: Mapping[str, StereoPhoto],
        ground: GroundSystem,
        points: Mapping[str, Triple],
        warnings: tuple[ProjectWarning, ...],
    ) -> None:
        self._block, self._state = loaded
        self._photos, self._ground = photos, ground
        self._rectified: dict[int, RectifiedModel] = {}
        self.points, self.warnings = points, warnings
        across = abs(active_model(self._block, self._state).axes[8])
        self.guide("OBJECT" if across > _LEAST_DEPTH_OF_Z else "MODEL")

    @property
    def block(self) -> OrientedBlock:
        """Return the block that is driven in."""
        return self._block

    def photo_names(self, model: int) -> tuple[str, str]:
        """Return the names of the left and right photo of a model, as the project has them."""
        left, right = (self._photos[photo.name].name for photo in self._block.models[model].photos)
        return left, right

    def rectified(self, model: int) -> RectifiedModel:
        """Return a model with its photos rectified."""
        if model not in self._rectified:
            loop = self._block.models[model]
            left, right = (self._photos[photo.name].image for photo in loop.photos)
            self._rectified[model] = rectified_model(loop, (left, right))
        return self._rectified[model]

    def read(self) -> StereoReading:
        """Return where everything is."""
        block, state = self._block, self._state
        found, pair = object_position(block, state), self.rectified(state.model)
        left, right = (state.plate(photo.stage) for photo in pair.model.photos)
        met = None if isinstance(found, DriveFault) else found
        one, other = photo_positions(block, state)
        return StereoReading(
            state.model, state.guide, state.automatic, state.condition,
            None if met is None else self._to_project(met.xyz),
            np.nan if met is None else met.y_parallax,
            plate_position(block, state), (one.xy, other.xy),
            (_log(pair.images[0], left), _log(pair.images[1], right)),
            (pair.place(0, left), pair.place(1, right)),
        )  # fmt: skip

    def vertex(self) -> StereoVertex:
        """Return what is measured, as restitution takes it."""
        reading = self.read()
        left, right = self.photo_names(reading.model)
        digital = [self._photos[photo.name].is_digital for photo in self._block.models[reading.model].photos]
        one, other = (
            log if is_digital else photo
            for is_digital, log, photo in zip(digital, reading.logs, reading.photos, strict=True)
        )
        return StereoVertex(left, one, right, other)

    def place_of(self, vertex: StereoVertex) -> Triple | None:
        """Return where the rays of a vertex meet, in the object system; None where they do not, or a photo is missing.

        The photos need not be those of a model.
        """
        left, right = self._block.photo(vertex.left), self._block.photo(vertex.right)
        if left is None or right is None:
            return None
        rays = [self._ray(photo, xy) for photo, xy in ((left, vertex.left_xy), (right, vertex.right_xy))]
        if rays[0] is None or rays[1] is None:
            return None
        found = meeting(left.centre, right.centre, rays[0], rays[1])
        return found.middle if found.sine_square > PARALLEL else None

    def project_place_of(self, vertex: StereoVertex) -> Triple | None:
        """Return `place_of`, in the project."""
        place = self.place_of(vertex)
        return None if place is None else self._to_project(place)

    def ground_pixel(self) -> tuple[float, float]:
        """Return what a rectified pixel is at the mark, ground units: across, and as x-parallax in height."""
        pair = self.rectified(self._state.model)
        depth = -pair.model.model_of_object(*(self._state.mark or self._where_rays_meet()))[2]
        pixel = pair.pitch * depth / pair.c
        return pixel, pixel * depth / _base(pair.model)

    def _ray(self, photo: DrivenPhoto, xy: Position) -> Triple | None:
        known = self._photos[photo.name]
        return photo.ray(*(_plate(known.image, xy) if known.is_digital else photo.plate_of_photo(*xy)))

    # movements

    def drive(self, xyz: Triple) -> None:
        """Drive to a point of the project."""
        x, y, z = self._ground.to_local(np.array([xyz]))[0].tolist()
        if not np.isfinite([x, y, z]).all():
            raise ProcessorFault(DriveCode.BEHIND_CAMERA, "the project's crs has no such place; correct X Y Z")
        self._take(drive_object(self._block, self._state, (x, y, z)))

    def move(self, right: float, up: float, higher: float) -> None:
        """Move by pixels of the rectified photos in the guiding system: in its plane, and by x-parallax to the eyes.

        In OBJECT the mark keeps its Z when it moves in the plane, in MODEL its z; each by what is seen as the movement.
        The others move the plates.
        """
        state, pair = self._state, self.rectified(self._state.model)
        if state.guide in ("OBJECT", "MODEL"):
            mark = state.mark or self._where_rays_meet()
            self._take(move(self._block, state, _increments(pair, state.guide, mark, (right, up, higher))))
            return
        if higher:
            text = f"guiding system {state.guide} moves plates; choose OBJECT or MODEL to change the height"
            raise ProcessorFault(DriveCode.WRONG_GUIDE, text)
        side = 1 if state.guide == pair.model.photos[1].stage else 0
        at = state.plate(pair.model.photos[side].stage)
        column, row = pair.place(side, at)
        x, y = pair.plates(side, np.array([[column + right, row - up]]))[0].tolist()
        if not np.isfinite([x, y]).all():
            raise ProcessorFault(DriveCode.NOT_INVERTIBLE, "the photo shows nothing there")
        self._take(move(self._block, state, (x - at[0], y - at[1])))

    def set_plate(self, side: int, log: Position) -> None:
        """Drive the plate of the left (0) or right photo to log coordinates of it; the other one stays."""
        photo, image = (
            active_model(self._block, self._state).photos[side],
            self.rectified(self._state.model).images[side],
        )
        self._take(drive_plate(self._block, self._state, photo.stage, _plate(image, log)))

    def go_to_vertex(self, vertex: StereoVertex) -> None:
        """Set the plates to what was measured: those of its photos, in another model to where its rays meet."""
        model = active_model(self._block, self._state)
        pair = zip(model.photos, (vertex.left_xy, vertex.right_xy), strict=True)
        if (vertex.left, vertex.right) == self.photo_names(self._state.model):
            for photo, xy in pair:
                known = self._photos[photo.name]
                plate = _plate(known.image, xy) if known.is_digital else photo.plate_of_photo(*xy)
                self._take(drive_plate(self._block, self._state, photo.stage, plate))
        elif (place := self.place_of(vertex)) is not None:
            self._take(drive_object(self._block, self._state, place))

    def change_model(self, name: str) -> None:
        """Change to a model: at the same place, or in its middle where it does not show that."""
        self._take(change_model(self._block, self._state, name))
        self._go_inside()

    def other_models(self) -> list[str]:
        """Return the names of the other models that show the mark, farthest from their borders first."""
        mark = np.array([self._state.mark or self._where_rays_meet()])
        inside: list[tuple[float, str]] = []
        for number, model in enumerate(self._block.models):
            if number != self._state.model and inside_model(self._block, number, mark)[0]:
                pair = self.rectified(number)
                places = np.array([pair.places(side, mark)[0] for side in (0, 1)])
                sizes = np.array([[columns, pair.rows] for columns in pair.columns])
                inside.append((float(np.minimum(places, sizes - places).min()), model.name))
        return [name for _, name in sorted(inside, reverse=True)]

    def next_model(self) -> None:
        """Change to the next model, as `change_model`."""
        self._take(next_model(self._block, self._state))
        self._go_inside()

    def guide(self, system: Guide) -> None:
        """Choose the guiding system."""
        self._take(guide(self._block, self._state, system))

    def automatic(self, on: bool) -> None:
        """Let models change at frame lines, or not."""
        self._take(automatic(self._block, self._state, on))

    def transfer_to_right(self) -> Transfer:
        """Return where the right image is expected to show what the left plate is at: at the height of the mark."""
        state, pair = self._state, self.rectified(self._state.model)
        mark = state.mark or self._where_rays_meet()
        depth = -pair.model.model_of_object(*mark)[2]
        parallax = pair.c * _base(pair.model) / depth
        shift = (pair.first[0] - pair.first[1] - parallax) / pair.pitch
        left = np.array(_log(pair.images[0], state.plate(pair.model.photos[0].stage)))
        around = np.add(left, [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        places = [pair.place(0, _plate(pair.images[0], (x, y))) for x, y in around.tolist()]
        places += [(places[0][0] + 1.0, places[0][1])]
        found = pair.logs_of(1, np.add(places, [shift, 0.0]))
        if not np.isfinite(found).all():
            raise ProcessorFault(DriveCode.NOT_INVERTIBLE, "the right photo does not show what is there")
        along = found[5] - found[0]
        affine = 0.5 * np.column_stack([found[1] - found[2], found[3] - found[4]])
        return Transfer(self.photo_names(state.model)[1], found[0], affine, along / np.linalg.norm(along))

    def local(self, xyz: FloatArray) -> FloatArray:
        """Return points (n, 3) of the project in the object system."""
        return self._ground.to_local(xyz)

    def _go_inside(self) -> None:
        """Drive to the adjusted point in the middle of those that the model shows, if the mark is not inside of it."""
        if self._state.condition == "IN" or not self.points:
            return
        points = self.local(np.array(list(self.points.values())))
        inside = points[inside_model(self._block, self._state.model, points)]
        if len(inside):
            away = np.linalg.norm(inside - inside.mean(axis=0), axis=1)
            x, y, z = inside[int(away.argmin())].tolist()
            self._take(drive_object(self._block, self._state, (x, y, z)))

    def _where_rays_meet(self) -> Triple:
        found = object_position(self._block, self._state)
        if isinstance(found, DriveFault):
            raise ProcessorFault(found.code, found.text)
        return found.xyz

    def _to_project(self, xyz: Triple) -> Triple:
        x, y, z = self._ground.to_project(np.array([xyz]))[0].tolist()
        return x, y, z

    def _take(self, outcome: tuple[ProcessorState, object]) -> None:
        self._state, reply = outcome
        if isinstance(reply, DriveFault):
            raise ProcessorFault(reply.code, reply.text)


def _base(model: ModelLoop) -> float:
    left, right = (np.array(photo.centre) for photo in model.photos)
    return float(np.linalg.norm(right - left))


def _increments(pair: RectifiedModel, system: Guide, mark: Triple, by: tuple[float, float, float]) -> Triple:
    """Return the increments of the mark, ground units, that are seen as a movement by pixels right, up and nearer."""
    model, (right, up, higher) = pair.model, by
    depth = -model.model_of_object(*mark)[2]
    if not depth > 0.0:
        raise ProcessorFault(DriveCode.BEHIND_CAMERA, "the mark is not in front of the photos")
    pixel = pair.pitch * depth / pair.c
    scaled = pair.c * _base(model)
    nearer_by = scaled / depth + higher * pair.pitch
    if not nearer_by > 0.0:
        raise ProcessorFault(DriveCode.BEHIND_CAMERA, "there is nothing so far away")
    rise = depth - scaled / nearer_by
    if system == "MODEL":
        return right * pixel, up * pixel, rise
    dx, dy, dz = model.object_direction(right * pixel, up * pixel, 0.0)
    height_of_z = model.axes[8]
    eyes = [0.5 * (a + b) for a, b in zip(model.photos[0].centre, model.photos[1].centre, strict=True)]
    look = np.subtract(mark, eyes)
    if abs(height_of_z) > _LEAST_DEPTH_OF_Z:
        # along the line of sight back to the plane of the mark's Z: there the movement is seen as it was asked for
        dx, dy, _ = (np.array([dx, dy, dz]) - look * (dz / look[2])).tolist()
        return dx, dy, rise / height_of_z
    return dx, dy, higher * pixel


def _log(image: ImageOnPlate, plate: Position) -> Position:
    x, y = image.to_plate.inverse().apply(np.array([plate]))[0].tolist()
    return x, y


def _plate(image: ImageOnPlate, log: Position) -> Position:
    x, y = image.to_plate.apply(np.array([log]))[0].tolist()
    return x, y
