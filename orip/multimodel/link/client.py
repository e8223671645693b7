"""The host's end of the link to a plate processor: one request, one reply.

    with open_link("tcp://127.0.0.1:4788") as link:
        link.download(table)
        link.drive_object(1000.0, 2000.0, 100.0)

`open_link` takes the operator's role and raises `LinkError` where somebody else keeps it; `host_link` takes the host's
beside an operator; `observe_link` only reads.
Whatever the other side does, what is raised is a `LinkError` with a sentence for the user: a `ProcessorFault` where
the plate processor refused a request.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from types import TracebackType
from typing import Literal, Self, overload

from orip.errors import LinkError
from orip.multimodel.link.lines import LinkLine, open_line, without_token
from orip.multimodel.link.messages import (
    Greeting,
    ProfilePoint,
    driven_of,
    event_of,
    greeting_of,
    is_moving,
    object_readout_of,
    photo_readouts_of,
    plates_of,
    profile_point_of,
    status_of,
)
from orip.multimodel.readout import ObjectReadout, PhotoReadout
from orip.multimodel.state import Driven, Event, Guide, Position, Side, Status
from orip.records.drive_table import DriveCode, Triple
from orip.records.photo import Stage

FIRST_PAUSE_S = 0.2
"""Before the second attempt to get through; each further pause is twice as long."""

DOWNLOAD_TIMEOUT_S = 600.0
"""For a download, and for its reply: a serial line takes a kilobyte a second, and a large table takes time to check."""


class ProcessorFault(LinkError):  # noqa: N818  # what it refuses is a fault of the request, and its word is fault
    """The plate processor refused a request: the code that it gave (a `DriveCode`), and its sentence."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(f"the plate processor refused, error {code}: {text}")
        self.code = code
        self.text = text


class PlateProcessorLink:
    """An open link to a plate processor; a context manager that closes it.

    All methods raise `ProcessorFault` where the request is refused, and `LinkError` where the other side does not
    answer in time, ends the connection, or says what no plate processor does.
    """

    def __init__(self, line: LinkLine, url: str, greeting: Greeting) -> None:
        self.url = url
        self.greeting = greeting
        self._line = line

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the connection."""
        self._line.close()

    def request(self, line: str) -> str:
        """Send a request and return the reply without its ``OK``."""
        self._line.send(_request_bytes(line))
        return self._reply()

    def request_list(self, line: str) -> list[str]:
        """Send a request with a list for a reply, and return its lines."""
        return [self._line.receive() for _ in range(_count(self.request(line)))]

    def download(self, table: bytes) -> str:
        """Load a drive table from its bytes, check by its digest that it is the one, and return what was loaded."""
        lines = table.count(b"\n")
        if not table.endswith(b"\n"):
            message = "a drive table ends with the end of a line; this one is cut short, make it again"
            raise LinkError(message)
        self._line.send(b"DOWNLOAD %d\n" % lines + table, DOWNLOAD_TIMEOUT_S)
        loaded = self._reply(DOWNLOAD_TIMEOUT_S)
        expected, found = hashlib.sha256(table).hexdigest(), self.digest()
        if found != expected:
            message = f"the plate processor has loaded another table than was sent (SHA-256 {found[:12]}… instead of "
            raise LinkError(message + f"{expected[:12]}…); somebody else downloads at the same time? download again")
        return loaded

    def digest(self) -> str:
        """Return the SHA-256 of the table that is loaded, in hexadecimal digits."""
        return self.request("DIGEST")

    def drive_object(self, x: float, y: float, z: float) -> Driven:
        """Drive to a point of the object, in the table's object system; the model may change."""
        return driven_of(self.request(f"DRIVE OBJECT {_numbers(x, y, z)}"))

    def drive_model(self, x: float, y: float, z: float) -> Driven:
        """Drive to a point given in the axes of the active model."""
        return driven_of(self.request(f"DRIVE MODEL {_numbers(x, y, z)}"))

    def drive_plate(self, stage: Stage, x: float, y: float) -> Driven:
        """Drive one stage to plate coordinates."""
        return driven_of(self.request(f"DRIVE PLATE {stage} {_numbers(x, y)}"))

    def drive_photo(self, photo: str, x: float, y: float) -> Driven:
        """Drive the stage of a photo to photo coordinates, mm."""
        return driven_of(self.request(f"DRIVE PHOTO {photo} {_numbers(x, y)}"))

    def move(self, *increments: float) -> Driven:
        """Move by two or three increments in the guiding system."""
        return driven_of(self.request(f"MOVE {_numbers(*increments)}"))

    def forward(self) -> Driven:
        """Bring both plates to the front."""
        return driven_of(self.request("FORWARD"))

    def change_model(self, name: str) -> Driven:
        """Make a model the active one."""
        return driven_of(self.request(f"MODEL {name}"))

    def next_model(self) -> Driven:
        """Change to the next model."""
        return driven_of(self.request("NEXT"))

    def models(self) -> list[str]:
        """Return a line for each model: name, row, column, left photo, right photo, optics."""
        return self.request_list("MODELS")

    def which(self, x: float, y: float, z: float) -> str | None:
        """Return the model that a point would be driven to in; None where no model shows it."""
        found = self.request(f"WHICH {_numbers(x, y, z)}")
        return None if found == "NONE" else found

    def profile(self, start: Triple, end: Triple, step: float) -> list[ProfilePoint]:
        """Drive from one point of the object to another in equal steps, ground units."""
        return list(map(profile_point_of, self.request_list(f"PROFILE {_numbers(*start, *end, step)}")))

    @overload
    def position(self, system: Literal["OBJECT", "MODEL"]) -> ObjectReadout: ...
    @overload
    def position(self, system: Literal["PLATE"]) -> tuple[Position, Position]: ...
    @overload
    def position(self, system: Literal["PHOTO"]) -> tuple[PhotoReadout, PhotoReadout]: ...
    def position(
        self, system: Literal["OBJECT", "MODEL", "PLATE", "PHOTO"]
    ) -> ObjectReadout | tuple[Position, Position] | tuple[PhotoReadout, PhotoReadout]:
        """Return where the mark is: in the object or model, on the (upper, lower) plate, in the (left, right) photo."""
        reply = self.request(f"POS {system}")
        if system == "PLATE":
            return plates_of(reply)
        return photo_readouts_of(reply) if system == "PHOTO" else object_readout_of(reply)

    def status(self) -> Status:
        """Return what is set."""
        return status_of(self.request("STATUS"))

    def is_moving(self) -> bool:
        """Tell whether the stages are on their way; never so where travel takes no time."""
        return is_moving(self.request("STATUS"))

    def guide(self, system: Guide) -> Status:
        """Choose the guiding system."""
        return status_of(self.request(f"GUIDE {system}"))

    def automatic(self, on: bool) -> Status:
        """Let models change at frame lines, or not."""
        return status_of(self.request(f"AUTO {'ON' if on else 'OFF'}"))

    def lock(self, side: Side | None) -> Status:
        """Lock the plate of the active model's left or right photo; None unlocks."""
        return status_of(self.request(f"LOCK {side or 'NONE'}"))

    def plates(self) -> tuple[Position, Position]:
        """Return where the mark is on the upper and the lower plate."""
        return self.position("PLATE")

    def prism(self, side: Side | None, degrees: Literal[0, 90]) -> Status:
        """Turn what one eye, or with None both, see."""
        return status_of(self.request(f"PRISM {f'{side} ' if side else ''}{degrees}"))

    def foot(self, side: Side) -> Status:
        """Press a foot switch, as the operator would."""
        return status_of(self.request(f"FOOT {side}"))

    def key(self, name: str) -> Status:
        """Press a key, as the operator would: 0 to 15, ENTER or ZERO."""
        return status_of(self.request(f"KEY {name}"))

    def next_event(self) -> Event | None:
        """Return the oldest event that nobody has asked for yet; None if there is none."""
        return event_of(self.request("EVENT"))

    def operate(self) -> None:
        """Take the operator's role."""
        self.request("OPERATE")

    def host(self) -> None:
        """Take the host's role; a plate processor that knows no hosts has the operator's for it."""
        try:
            self.request("HOST")
        except ProcessorFault as fault:
            if fault.code != DriveCode.UNKNOWN_VERB:
                raise
            self.operate()

    def observe(self) -> None:
        """Give the role to who wants it."""
        self.request("OBSERVE")

    def _reply(self, timeout_s: float | None = None) -> str:
        reply = self._line.receive(timeout_s)
        status, _, rest = reply.partition(" ")
        if status == "OK":
            return rest
        code, _, text = rest.partition(" ")
        if status == "ERR" and code.isdecimal():
            raise ProcessorFault(int(code), text)
        raise _no_processor(self.url, reply)


def open_link(url: str, *, timeout_s: float = 5.0, retries: int = 3) -> PlateProcessorLink:
    """Open a link as the operator of a plate processor.

    Parameters
    ----------
    url : str
        ``tcp://host:port``, ``tcp://token@host:port``, or a serial device or URL that pyserial knows.
    timeout_s : float
        For a connection, and for each reply.
    retries : int
        Further attempts where nobody answers, or where somebody else operates, with pauses of 0.2, 0.4, 0.8 … s.

    Raises
    ------
    LinkError
        If nobody answers, who answers is no plate processor, or somebody else operates it.
    """
    return _in_role(url, PlateProcessorLink.operate, timeout_s, retries)


def host_link(url: str, *, timeout_s: float = 5.0, retries: int = 3) -> PlateProcessorLink:
    """Open a link as the host of a plate processor, which guides the operator and hears what he does.

    The operator may be at another link: he moves the measuring mark and presses foot switches and keys. See
    `open_link` for the parameters, and what is raised.
    """
    return _in_role(url, PlateProcessorLink.host, timeout_s, retries)


def _in_role(
    url: str, take: Callable[[PlateProcessorLink], None], timeout_s: float, retries: int
) -> PlateProcessorLink:
    link = observe_or_operate(url, timeout_s, retries)
    try:
        _take_role(link, take, retries)
    except BaseException:
        link.close()
        raise
    return link


def observe_link(url: str, *, timeout_s: float = 5.0, retries: int = 3) -> PlateProcessorLink:
    """Open a link that only reads, and leaves the operator's role to others; see `open_link`."""
    link = observe_or_operate(url, timeout_s, retries)
    try:
        link.observe()
    except BaseException:
        link.close()
        raise
    return link


def observe_or_operate(url: str, timeout_s: float, retries: int) -> PlateProcessorLink:
    """Open a link in whichever role the plate processor gives."""
    for attempt in range(retries + 1):
        try:
            line, first = open_line(url, timeout_s)
        except ConnectionError as error:
            if attempt == retries:
                where = f"no plate processor answers at {without_token(url)} ({error})"
                message = f"{where}; start it ('orip drive emulate'), or check --link"
                raise LinkError(message) from error
            time.sleep(FIRST_PAUSE_S * 2**attempt)
            continue
        greeting = greeting_of(first)
        if greeting is None:
            line.close()
            raise _no_processor(without_token(url), first)
        return PlateProcessorLink(line, without_token(url), greeting)
    message = f"retries has to be 0 or more, not {retries}"
    raise ValueError(message)


def _take_role(link: PlateProcessorLink, take: Callable[[PlateProcessorLink], None], retries: int) -> None:
    for attempt in range(retries + 1):
        try:
            take(link)
            return
        except ProcessorFault as fault:
            if fault.code != DriveCode.BUSY:
                raise
            if attempt == retries:
                who = fault.text.partition(";")[0]  # operated, or hosted, by whom
                message = f"the plate processor at {link.url} is {who}; wait, or stop that session"
                raise LinkError(message) from None
            time.sleep(FIRST_PAUSE_S * 2**attempt)


def _no_processor(url: str, said: str) -> LinkError:
    return LinkError(f"what answers at {url} is not a plate processor: it said '{said[:60]}'; check --link")


def _request_bytes(line: str) -> bytes:
    if not line.isascii() or not line.isprintable():
        message = f"a request is one line of printable ASCII, not {line!a}"
        raise LinkError(message)
    return line.encode("ascii") + b"\n"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def _count(reply: str) -> int:
    if not reply.isdecimal():
        message = f"the plate processor was asked for a list, and said '{reply[:60]}'; is it of another version?"
        raise LinkError(message)
    return int(reply)
