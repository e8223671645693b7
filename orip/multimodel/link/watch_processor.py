"""The plate processor that a page shows: one in this process, or one at the other end of a link."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeVar

from orip.errors import LinkError
from orip.multimodel.link.client import PlateProcessorLink, ProcessorFault, observe_link
from orip.multimodel.movement import automatic, drive_object, foot, key, next_model
from orip.multimodel.processor import Loaded
from orip.multimodel.readout import ObjectReadout, object_position, plate_position, status
from orip.multimodel.state import Position, ProcessorState, Side, Status
from orip.records.drive_table import DriveFault, Triple

T = TypeVar("T")

REPLY_S = 2.0
"""A page waits no longer for a plate processor."""

PAUSE_S = 2.0
"""Between two attempts to get through again."""


class Reading(NamedTuple):
    """Everything that moves: what is set, the (upper, lower) plates, and the mark; None: the rays do not meet."""

    status: Status
    plates: tuple[Position, Position]
    mark: ObjectReadout | None


class WatchedProcessor(Protocol):
    """A plate processor to be shown.

    All methods raise `ProcessorFault` where it refuses, and `LinkError` where it cannot be reached.
    """

    def read(self) -> Reading:
        """Return where everything is."""

    def drive_object(self, xyz: Triple) -> None:
        """Drive to a point of the object."""

    def next_model(self) -> None:
        """Change to the next model."""

    def automatic(self, on: bool) -> None:
        """Let models change at frame lines, or not."""

    def foot(self, side: Side) -> None:
        """Press a foot switch."""

    def key(self, name: str) -> None:
        """Press a key."""

    def close(self) -> None:
        """Do nothing."""


class OwnProcessor:
    """A plate processor in this process."""

    def __init__(self, loaded: Loaded) -> None:
        self._block, self._state = loaded

    def read(self) -> Reading:
        """Return where everything is."""
        found = object_position(self._block, self._state)
        mark = None if isinstance(found, DriveFault) else found
        return Reading(status(self._block, self._state), plate_position(self._block, self._state), mark)

    def drive_object(self, xyz: Triple) -> None:
        """Drive to a point of the object."""
        self._take(drive_object(self._block, self._state, xyz))

    def next_model(self) -> None:
        """Change to the next model."""
        self._take(next_model(self._block, self._state))

    def automatic(self, on: bool) -> None:
        """Let models change at frame lines, or not."""
        self._take(automatic(self._block, self._state, on))

    def foot(self, side: Side) -> None:
        """Press a foot switch."""
        self._take(foot(self._block, self._state, side))

    def key(self, name: str) -> None:
        """Press a key."""
        self._take(key(self._block, self._state, name))

    def close(self) -> None:
        """Do nothing: there is nobody else."""

    def _take(self, outcome: tuple[ProcessorState, object]) -> None:
        self._state, reply = outcome
        if isinstance(reply, DriveFault):
            raise ProcessorFault(reply.code, reply.text)


class LinkedProcessor:
    """A plate processor at the other end of a link.

    It is observed; for each command the operator's role is taken and given back, so that others can operate too. A
    link that has broken off is opened again after a pause.

    Parameters
    ----------
    digest : str
        SHA-256 of the drive table that the page is drawn from; another one must not be shown in its place.

    Raises
    ------
    LinkError
        If nobody answers, or another table is loaded there.
    """

    def __init__(self, url: str, digest: str) -> None:
        self._url, self._digest = url, digest
        self._fault, self._again_at = LinkError("the link is closed"), 0.0
        self._link: PlateProcessorLink | None = observe_link(url, timeout_s=REPLY_S)
        self.read()

    def read(self) -> Reading:
        """Return where everything is."""
        return self._asked(self._read)

    def drive_object(self, xyz: Triple) -> None:
        """Drive to a point of the object."""
        self._operated(lambda link: link.drive_object(*xyz))

    def next_model(self) -> None:
        """Change to the next model."""
        self._operated(lambda link: link.next_model())

    def automatic(self, on: bool) -> None:
        """Let models change at frame lines, or not."""
        self._operated(lambda link: link.automatic(on))

    def foot(self, side: Side) -> None:
        """Press a foot switch."""
        self._operated(lambda link: link.foot(side))

    def key(self, name: str) -> None:
        """Press a key."""
        self._operated(lambda link: link.key(name))

    def close(self) -> None:
        """End the connection."""
        if self._link is not None:
            self._link.close()
        self._link = None

    def _read(self, link: PlateProcessorLink) -> Reading:
        if link.digest() != self._digest:
            message = (
                f"the plate processor at {self._url} has another drive table; 'orip drive download' loads this one"
            )
            raise LinkError(message)
        try:
            mark = link.position("OBJECT")
        except ProcessorFault:
            mark = None
        return Reading(link.status(), link.position("PLATE"), mark)

    def _operated(self, command: Callable[[PlateProcessorLink], object]) -> None:
        def in_role(link: PlateProcessorLink) -> None:
            link.operate()
            try:
                command(link)
            finally:
                link.observe()

        self._asked(in_role)

    def _asked(self, request: Callable[[PlateProcessorLink], T]) -> T:
        try:
            return request(self._opened())
        except ProcessorFault:
            raise
        except LinkError as error:
            self._fault = error
            self.close()
            raise

    def _opened(self) -> PlateProcessorLink:
        if self._link is None:
            now = time.monotonic()
            if now < self._again_at:
                raise LinkError(str(self._fault))
            self._again_at = now + PAUSE_S
            self._link = observe_link(self._url, timeout_s=REPLY_S, retries=0)
        return self._link
