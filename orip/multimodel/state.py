"""The state of the plate processor, what it replies, and which model it switches to by itself."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.multimodel.oriented_block import ModelLoop, OrientedBlock
from orip.multimodel.photo_loop import PlatePlace
from orip.records.drive_table import STAGES, DriveFault, Triple
from orip.records.photo import Stage
from orip.structs import replace

# A command is a function ``command(block, state, …) -> (state, reply)``. Nothing is changed in place: a command that
# cannot be done returns the state that it was given, and a `DriveFault`. Which module has which:
#
#     orip.multimodel.movement    drive_object drive_model drive_plate drive_photo move change_model next_model forward
#     orip.multimodel.movement       guide automatic lock prism foot key next_event
#     orip.multimodel.readout     status which and positions; they change nothing and return the reply alone
#     orip.multimodel.readout     drive_objects and profile: many points at once
#
# `orip.multimodel.processor.load` makes the block and its first state from a drive table.

Guide = Literal["UPPER", "LOWER", "BOTH", "MODEL", "OBJECT"]
GUIDES: tuple[Guide, ...] = ("UPPER", "LOWER", "BOTH", "MODEL", "OBJECT")
"""Guiding systems in the order of their numbers 1 to 5."""

Side = Literal["LEFT", "RIGHT"]
SIDES: tuple[Side, Side] = ("LEFT", "RIGHT")

Condition = Literal["IN", "OUTSIDE", "LIMIT"]
"""The mark is inside the active model; it is not; the plates are at the front."""

Rotation = Literal[0, 90]
"""Degrees by which a prism turns what the eye sees."""

Position = tuple[float, float]
"""Plate coordinates x, y."""

MOST_EVENTS = 1000
"""Most events in the queue; of more that nobody asks for the oldest are forgotten."""


class Event(NamedTuple):
    """What the operator did.

    Attributes
    ----------
    kind : {"RIGHT", "LEFT", "KEY"}
        Foot switches: right to digitise, left to skip or to lock; or a key.
    key : str
        ``0`` to ``15``, ``ENTER`` or ``ZERO``; empty for a foot switch.
    plates : tuple (upper, lower) of positions, or None
        Read-out of both stages at the moment of a RIGHT.
    """

    kind: Literal["RIGHT", "LEFT", "KEY"]
    key: str = ""
    plates: tuple[Position, Position] | None = None


class ProcessorState(Struct, frozen=True):
    """Everything that a command may change.

    Parameters
    ----------
    model : int
        Place of the active model in the block.
    plates : tuple (upper, lower) of positions
        Plate units, unrounded.
    mark : tuple (X, Y, Z) or None
        Where the measuring mark was driven to in the object; None after plates were moved individually: it is then
        where the two rays meet.
    condition : {"IN", "OUTSIDE", "LIMIT"}
    automatic : bool
        Models change at frame lines.
    locked : {"UPPER", "LOWER"} or None
        The stage that does not move. While one is locked, models do not change automatically: its photo would change.
    prisms : tuple (left, right)
    events : tuple of Event
        Oldest first.
    """

    model: int
    plates: tuple[Position, Position]
    mark: Triple | None
    condition: Condition
    guide: Guide = "OBJECT"
    automatic: bool = True
    locked: Stage | None = None
    prisms: tuple[Rotation, Rotation] = (0, 0)
    events: tuple[Event, ...] = ()

    @property
    def switches(self) -> bool:
        """Return whether the model may change when the mark leaves it."""
        return self.automatic and self.locked is None

    def plate(self, stage: Stage) -> Position:
        """Return the position of a stage."""
        return self.plates[STAGES.index(stage)]

    def with_plate(self, stage: Stage, position: Position) -> ProcessorState:
        """Return the state with one stage at another position."""
        upper, lower = self.plates
        return replace(self, plates=(position, lower) if stage == "UPPER" else (upper, position))


class Driven(NamedTuple):
    """Reply to a movement: the active model and the read-out of both stages."""

    model: str
    upper: Position
    lower: Position


class Status(NamedTuple):
    """Reply to settings: everything that is set; `lock` is the locked photo's side in the active model."""

    model: str
    guide: Guide
    condition: Condition
    lock: Side | None
    prisms: tuple[Rotation, Rotation]
    automatic: bool


Outcome = tuple[ProcessorState, Driven | DriveFault]
"""What a movement returns."""


def active_model(block: OrientedBlock, state: ProcessorState) -> ModelLoop:
    """Return the active model."""
    return block.models[state.model]


def driven(block: OrientedBlock, state: ProcessorState) -> Driven:
    """Return the reply to a movement that has led to a state."""
    return Driven(active_model(block, state).name, *read_out(block, state))


def read_out(block: OrientedBlock, state: ProcessorState) -> tuple[Position, Position]:
    """Return the plate positions rounded to the least counts."""
    return _rounded(state.plates[0], block.table.upper.least_count), _rounded(
        state.plates[1], block.table.lower.least_count
    )


def _rounded(position: Position, least_count: float) -> Position:
    x, y = position
    # adding zero takes the sign from a rounded -0
    return round(x / least_count) * least_count + 0.0, round(y / least_count) * least_count + 0.0


# A point is inside a model if it is within the frame lines of both its photos, and both stages can be driven there. The
# active model is kept while the point is inside it. Otherwise all models that it is inside of are candidates: the
# one with the smallest |row difference| + |column difference| from the active one is taken, of equals the one in whose
# photos the point is farthest from the frame lines (the smallest ratio), of equals again the first by row and column.

_LARGEST_CHUNK = 8192
_CHUNK_ENTRIES = 1 << 20
"""Points times photos that are computed at a time: some ten megabytes of memory."""


class Selected(NamedTuple):
    """A model and where a point is shown in its left and right photo."""

    model: int
    places: tuple[PlatePlace, PlatePlace]

    @property
    def inside(self) -> bool:
        """Return whether the point is inside the model."""
        return self.places[0].inside and self.places[1].inside


class SelectedModels(NamedTuple):
    """The models (n,) of points that are driven to one after the other, and whether each is inside its model (n,)."""

    model: NDArray[np.int64]
    inside: NDArray[np.bool_]


def select_model(block: OrientedBlock, active: int, xyz: Triple) -> Selected:
    """Return the model that a point is seen in; the active one, with the point outside, where there is none."""
    kept = places_in_model(block, active, xyz)
    if kept.inside:
        return kept
    distances = block.distances(active)
    seen: dict[int, PlatePlace | None] = {}
    best, best_distance, best_ratio = kept, -1, np.inf
    for model in np.argsort(distances, kind="stable").tolist():
        distance = int(distances[model])
        if best is not kept and distance > best_distance:
            break
        record = block.models[model]
        left, right = (_place_inside(block, photo, xyz, seen) for photo in (record.left, record.right))
        if left is not None and right is not None and max(left.ratio, right.ratio) < best_ratio:
            best, best_distance, best_ratio = Selected(model, (left, right)), distance, max(left.ratio, right.ratio)
    return best


def _place_inside(
    block: OrientedBlock, photo: int, xyz: Triple, seen: dict[int, PlatePlace | None]
) -> PlatePlace | None:
    """Return where a point is shown within the frame of a photo, else None; what has been `seen` is kept there."""
    if photo not in seen:
        loop = block.photos[photo]
        place = loop.plate_place(*xyz) if loop.may_be_inside(*xyz) else None
        seen[photo] = place if place is not None and place.inside else None
    return seen[photo]


def places_in_model(block: OrientedBlock, model: int, xyz: Triple) -> Selected:
    """Return where a point is shown in one model."""
    left, right = block.models[model].photos
    return Selected(model, (left.plate_place(*xyz), right.plate_place(*xyz)))


def select_models(block: OrientedBlock, active: int, xyz: FloatArray) -> SelectedModels:
    """Return the models of points (n, 3) that are driven to one after the other: `select_model`, n times."""
    size = max(1, min(_LARGEST_CHUNK, _CHUNK_ENTRIES // max(1, len(block.photos))))
    models, insides = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.bool_)]
    for start in range(0, len(xyz), size):
        inside, ratio = _inside_models(block, xyz[start : start + size])
        model = _walk(block, active, inside, ratio)
        models.append(model)
        insides.append(inside[model, np.arange(len(model))])
        active = int(model[-1])
    return SelectedModels(np.concatenate(models), np.concatenate(insides))


def inside_model(block: OrientedBlock, model: int, xyz: FloatArray) -> NDArray[np.bool_]:
    """Tell which points (n, 3) are inside one model."""
    left, right = block.models[model].photos
    return left.plate_places(xyz).inside & right.plate_places(xyz).inside


def _inside_models(block: OrientedBlock, xyz: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which points are inside each photo pair and their ratios there, (number of models, n)."""
    inside = np.zeros((len(block.photos), len(xyz)), dtype=np.bool_)
    ratio = np.full(inside.shape, np.inf)
    columns = np.ascontiguousarray(xyz.T)
    for place, photo in enumerate(block.photos):
        near = np.flatnonzero(photo.may_be_inside(*columns))
        if len(near):
            found = photo.plate_places(xyz[near])
            inside[place, near], ratio[place, near] = found.inside, found.ratio
    left, right = ([getattr(model, side) for model in block.models] for side in ("left", "right"))
    return inside[left] & inside[right], np.maximum(ratio[left], ratio[right])


def _walk(block: OrientedBlock, active: int, inside: NDArray[np.bool_], ratio: FloatArray) -> NDArray[np.int64]:
    """Return the active model after each point, going from one change of model to the next."""
    count = inside.shape[1]
    outside = [
        row.tobytes() for row in ~inside
    ]  # bytes, in which the next point outside is found at the speed of a memory scan
    points, models_of_points = np.nonzero(inside.T)
    first, models = np.searchsorted(points, np.arange(count + 1)).tolist(), models_of_points.tolist()
    sequence, starts = [active], [0]
    point = outside[active].find(1)
    while point >= 0:
        candidates = models[first[point] : first[point + 1]]
        if candidates:
            active = candidates[0] if len(candidates) == 1 else _nearest(block, active, candidates, ratio[:, point])
            sequence.append(active)
            starts.append(point)
        point = outside[active].find(1, point + 1)
    return np.repeat(sequence, np.diff([*starts, count]))


def _nearest(block: OrientedBlock, active: int, candidates: list[int], ratio: FloatArray) -> int:
    distance = block.distances(active)
    # the first of equals: candidates are in the order of rows and columns
    return min(candidates, key=lambda model: (distance[model], ratio[model]))
