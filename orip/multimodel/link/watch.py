"""What the page `orip drive watch` shows, as JSON documents: the scene, which stays, and the state, which moves."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from importlib.resources import files

import numpy as np

from orip.errors import LinkError
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.link.watch_processor import WatchedProcessor
from orip.multimodel.movement import KEYS
from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.photo_loop import DrivenPhoto
from orip.multimodel.plan_view import PlanView
from orip.multimodel.plate_pictures import NO_PICTURES, PlatePictures
from orip.multimodel.state import SIDES, Side
from orip.records.drive_table import STAGES, Triple
from orip.records.photo import Stage
from orip.web.page_server import Document, RequestError

FRESH_S = 0.04
"""A state as old as this is still shown: many pages ask the plate processor no more often than one."""

AXES = ("X", "Y", "Z")
"""What the object axes are called; in the local frame of a crs they are `LOCAL_AXES`."""

LOCAL_AXES = ("east", "north", "up")


class Watch:
    """A plate processor, and what a page shows of it. Its methods may be called from several threads at once.

    Parameters
    ----------
    block : OrientedBlock
        Of the table that the processor drives with.
    plan : PlanView
        Of this block.
    axes : tuple of 3 strings
        Names of the object axes.
    pictures : PlatePictures
        Of the photos that have images.
    """

    def __init__(
        self,
        block: OrientedBlock,
        plan: PlanView,
        processor: WatchedProcessor,
        axes: tuple[str, str, str] = AXES,
        pictures: PlatePictures = NO_PICTURES,
    ) -> None:
        self.page = files("orip.multimodel.link") / "page" / "watch.html"
        self.scene = {**scene_document(block, plan, axes), "pictures": pictures.document()}
        self.picture = pictures.picture
        self.commands: Mapping[str, Callable[[Document], Document]] = {
            "drive": self.drive,
            "next": self.next_model,
            "automatic": self.automatic,
            "press": self.press,
        }
        self._plan, self._processor = plan, processor
        self._lock = threading.Lock()
        self._state: Document = {}
        self._read_at = -math.inf

    def state(self) -> Document:
        """Return where everything is; `serial` counts up whenever anything has changed."""
        with self._lock:
            if time.monotonic() > self._read_at + FRESH_S:
                self._read()
            return self._state

    def drive(self, request: Document) -> Document:
        """Drive to ``{"plan": [right, up]}``, at the height of the points around, or to ``{"object": [X, Y, Z]}``.

        Returns
        -------
        document
            ``state``, and ``refused``: null, or code and text where the plate processor refuses.

        Raises
        ------
        RequestError
            If the request is neither of the two.
        """
        if request.keys() == {"plan"}:
            xyz = self._plan.object_place(*_numbers(request["plan"], 2))
        elif request.keys() == {"object"}:
            x, y, z = _numbers(request["object"], 3)
            xyz = x, y, z
        else:
            message = "drive takes 'plan' with two numbers, or 'object' with three"
            raise RequestError(message)
        return self._commanded(lambda: self._processor.drive_object(xyz))

    def next_model(self, request: Document) -> Document:
        """Change to the next model; the request is empty."""
        if request:
            message = "next takes nothing"
            raise RequestError(message)
        return self._commanded(self._processor.next_model)

    def automatic(self, request: Document) -> Document:
        """Let models change at frame lines, or not: ``{"on": true}``."""
        if request.keys() != {"on"} or not isinstance(request["on"], bool):
            message = "automatic takes 'on', true or false"
            raise RequestError(message)
        on: bool = request["on"]
        return self._commanded(lambda: self._processor.automatic(on))

    def press(self, request: Document) -> Document:
        """Press a foot switch, ``{"foot": "LEFT"}``, or a key, ``{"key": "ENTER"}``; for who digitises at the link."""
        if request.keys() == {"foot"} and request["foot"] in SIDES:
            side: Side = request["foot"]
            return self._commanded(lambda: self._processor.foot(side))
        if request.keys() == {"key"} and request["key"] in KEYS:
            name: str = request["key"]
            return self._commanded(lambda: self._processor.key(name))
        message = "press takes 'foot', LEFT or RIGHT, or 'key', 0 to 15, ENTER or ZERO"
        raise RequestError(message)

    def close(self) -> None:
        """Leave the plate processor alone."""
        with self._lock:
            self._processor.close()

    def _commanded(self, command: Callable[[], None]) -> Document:
        refused: Document | None = None
        with self._lock:
            try:
                command()
            except ProcessorFault as fault:
                refused = {"code": int(fault.code), "text": fault.text}
            except LinkError as error:
                refused = {"code": None, "text": str(error)}
            self._read()
            return {"state": self._state, "refused": refused}

    def _read(self) -> None:
        try:
            moving = _moving(self._processor)
        except LinkError as error:
            moving = {"lost": str(error)}
        serial = self._state.get("serial", 0)
        if {**moving, "serial": serial} != self._state:
            self._state = {**moving, "serial": serial + 1}
        self._read_at = time.monotonic()


def scene_document(block: OrientedBlock, plan: PlanView, axes: tuple[str, str, str]) -> Document:
    """Return what does not move: names and units, the plan, and the plates with all photo frames."""
    table, plane = block.table, plan.plane
    shown = plan.points.xyz[:, (plane.right, plane.up)]
    templates = {photo.name: photo.template for photo in table.photos}
    return {
        "block": table.block,
        "project": table.project,
        "user": table.user,
        "object_unit": table.object_unit,
        "plate_unit": table.plate_unit,
        "axes": list(axes),
        "plan": {
            "right": plane.right,
            "up": plane.up,
            "third": plane.third,
            "mirrored": plane.mirrored,
            "points": [
                [name, kind, right, up]
                for name, kind, (right, up) in zip(plan.points.names, plan.points.kinds, shown.tolist(), strict=True)
            ],
        },
        "models": [
            {
                "name": model.name,
                "row": model.row,
                "column": model.column,
                "photos": [photo.name for photo in model.photos],
                "swapped": model.swapped,
                "outline": outline.tolist(),
            }
            for model, outline in zip(block.models, plan.outlines, strict=True)
        ],
        "plates": {stage: _plate(block, stage, templates) for stage in STAGES},
    }


def _plate(block: OrientedBlock, stage: Stage, templates: dict[str, str | None]) -> Document:
    limits = block.table.limits(stage)
    return {
        "limits": [limits.x_min, limits.x_max, limits.y_min, limits.y_max],
        "decimals": max(0, math.ceil(-math.log10(limits.least_count) - 1e-9)),
        "photos": [
            {"name": photo.name, "template": templates[photo.name], "frame": _frame(photo)}
            for photo in block.photos
            if photo.stage == stage
        ],
    }


def _frame(photo: DrivenPhoto) -> list[list[float]]:
    """Return the corners of a photo frame on the plate; none where the camera has no frame."""
    half_x, half_y = photo.camera.half_frame
    if not (math.isfinite(half_x) and math.isfinite(half_y)):
        return []
    signs = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    x, y = photo.plate_of_photo(half_x * signs[:, 0], half_y * signs[:, 1])
    corners: list[list[float]] = np.stack([x, y], axis=1).tolist()
    return corners


def _moving(processor: WatchedProcessor) -> Document:
    reading = processor.read()
    status, mark = reading.status, reading.mark
    return {
        "model": status.model,
        "guide": status.guide,
        "condition": status.condition,
        "lock": status.lock,
        "automatic": status.automatic,
        "plates": dict(zip(STAGES, map(_finite, reading.plates), strict=True)),
        "mark": _finite(mark.xyz) if mark is not None else None,
        "y_parallax": _finite([mark.y_parallax])[0] if mark is not None else None,
    }


def _finite(values: Triple | tuple[float, ...] | list[float]) -> list[float | None]:
    """Return numbers that JSON can hold."""
    return [value if math.isfinite(value) else None for value in values]


def _numbers(given: object, count: int) -> list[float]:
    if isinstance(given, list) and len(given) == count and all(_is_number(value) for value in given):
        return [float(value) for value in given]
    message = f"expected {count} finite numbers"
    raise RequestError(message)


def _is_number(given: object) -> bool:
    # beyond that a coordinate is no coordinate, and an integer might be no float
    return isinstance(given, int | float) and not isinstance(given, bool) and abs(given) < 1e15
