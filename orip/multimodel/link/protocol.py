"""The protocol of the plate processor: a request is one line, the reply one line, ``OK …`` or ``ERR code text``.

Lines end in LF or CRLF. Words are separated by blanks; verbs and keywords may be written in small letters. A list is
``OK n`` and n lines. Plate, photo and object coordinates have four decimals. Nothing is sent without a request,
except the greeting of a new connection. Error codes are those of `orip.records.drive_table.DriveCode`.

    (greeting), VERSION              OK KDPP-EMU 1 READY|EMPTY [OBSERVER address of the operator, or nobody]
    DOWNLOAD n, and n lines          OK LOADED cameras c photos p models m; the table is replaced as a whole or not
    DIGEST                           OK SHA-256 of the table as it was loaded, with LF at the end of each line
    CLEAR                            OK CLEARED
    STATUS                           OK MODEL m GUIDE g STATE IN|OUTSIDE|LIMIT LOCK NONE|LEFT|RIGHT PRISM l r
                                     AUTO ON|OFF [MOVING YES|NO]
    GUIDE UPPER|LOWER|BOTH|MODEL|OBJECT, AUTO ON|OFF, LOCK LEFT|RIGHT|NONE, PRISM [LEFT|RIGHT] 0|90,
    FOOT LEFT|RIGHT, KEY 0…15|ENTER|ZERO                                                              as STATUS
    DRIVE OBJECT|MODEL x y z, DRIVE PLATE UPPER|LOWER x y, DRIVE PHOTO photo x y, MOVE d1 d2 [d3], FORWARD,
    MODEL name, NEXT                 OK MODEL m UPPER x y LOWER x y
    POS OBJECT|MODEL                 OK x y z [PY y-parallax]
    POS PLATE, POS PHOTO             OK UPPER x y LOWER x y, OK LEFT photo x y RIGHT photo x y
    MODEL?, WHICH x y z              OK name, OK name|NONE
    MODELS                           list: name row column left right NORMAL|SWAPPED
    EVENT                            OK NONE, OK LEFT, OK KEY k, OK RIGHT UPPER x y LOWER x y
    PROFILE x1 y1 z1 x2 y2 z2 step   list: x y z MODEL m UPPER x y LOWER x y, or x y z ERR code
    LIMITS UPPER|LOWER               OK stage x-min x-max y-min y-max LEAST count UNIT mm|px
    OPERATE, OBSERVE                 OK OPERATOR, OK OBSERVER: take the operator's role if it is free; give it back
    HOST                             OK HOST: take the host's role if it is free; OBSERVE gives it back
    HELP, QUIT                       list of the verbs; OK BYE, and the connection ends

One client operates; the others may read, and all else is refused them: 110. A program that guides the operator takes
the host's role: it may do everything, the operator beside it may use the panel (MOVE, DRIVE, GUIDE, LOCK, PRISM, FOOT,
KEY), and tables, models and events are the host's alone. Without a table the stages can be driven and read in plate
coordinates, the model's name is ``-``, and whatever takes an orientation is refused: 200.

Here are no connections: `answer` takes the bytes of a request and returns those of the reply. What concerns the
connection itself (DOWNLOAD, OPERATE, HOST, OBSERVE, QUIT) it only checks; the `Answer` names the verb, to be done by
who has the connection.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from orip.multimodel.link import verbs
from orip.multimodel.link.messages import Refused, Request, error_line, loaded_text, read_request, shown
from orip.multimodel.link.station import Station, TableLoader
from orip.multimodel.link.verbs import Reply, Verb, Words
from orip.records.drive_table import DriveCode, DriveFault

PROTOCOL = "KDPP-EMU 1"

NOBODY = "nobody"
"""Address of the operator where there is none."""

By = Literal["anybody", "operator", "host"]
"""Who may use a verb; where there is no host, the operator does what is the host's."""


class Barred(NamedTuple):
    """Why a client may not use the verbs of the operator, and of the host; None: it may."""

    operator: DriveFault | None = None
    host: DriveFault | None = None


FREE = Barred()
"""The client may use all verbs."""


class Answer(NamedTuple):
    """The station after a request and the bytes of the reply, or instead what the connection has to do."""

    station: Station
    reply: bytes
    connection: Request | None = None


class _Rule(NamedTuple):
    """How a verb may be used: numbers of words, by whom, with what, and what does it (None: the connection)."""

    usage: str
    least: int
    most: int
    run: Verb | None
    by: By = "anybody"
    takes_table: bool = False


def _help(station: Station, _words: Words) -> tuple[Station, Reply]:
    return station, [rule.usage for rule in _RULES.values()]


_RULES = {
    rule.usage.split()[0]: rule
    for rule in (
        _Rule("DOWNLOAD n", 1, 1, None, by="host"),
        _Rule("DIGEST", 0, 0, verbs.digest, takes_table=True),
        _Rule("CLEAR", 0, 0, verbs.clear, by="host"),
        _Rule("STATUS", 0, 0, verbs.status),
        _Rule("GUIDE UPPER|LOWER|BOTH|MODEL|OBJECT", 1, 1, verbs.guide, by="operator"),
        _Rule("DRIVE OBJECT|MODEL x y z, PLATE UPPER|LOWER x y, PHOTO photo x y", 4, 4, verbs.drive, by="operator"),
        _Rule("MOVE d1 d2 [d3]", 2, 3, verbs.move, by="operator"),
        _Rule("POS OBJECT|MODEL|PLATE|PHOTO", 1, 1, verbs.position),
        _Rule("MODEL?", 0, 0, verbs.which_model, takes_table=True),
        _Rule("MODEL name", 1, 1, verbs.change_model, by="host", takes_table=True),
        _Rule("NEXT", 0, 0, verbs.next_model, by="host", takes_table=True),
        _Rule("MODELS", 0, 0, verbs.models, takes_table=True),
        _Rule("WHICH x y z", 3, 3, verbs.which, takes_table=True),
        _Rule("AUTO ON|OFF", 1, 1, verbs.automatic, by="host"),
        _Rule("LOCK LEFT|RIGHT|NONE", 1, 1, verbs.lock, by="operator"),
        _Rule("PRISM [LEFT|RIGHT] 0|90", 1, 2, verbs.prism, by="operator"),
        _Rule("FOOT LEFT|RIGHT", 1, 1, verbs.foot, by="operator"),
        _Rule("KEY 0-15|ENTER|ZERO", 1, 1, verbs.key, by="operator"),
        _Rule("EVENT", 0, 0, verbs.event, by="host"),
        _Rule("PROFILE x1 y1 z1 x2 y2 z2 step", 7, 7, verbs.profile, by="host", takes_table=True),
        _Rule("FORWARD", 0, 0, verbs.forward, by="host"),
        _Rule("LIMITS UPPER|LOWER", 1, 1, verbs.limits),
        _Rule("OPERATE", 0, 0, None),
        _Rule("HOST", 0, 0, None),
        _Rule("OBSERVE", 0, 0, None),
        _Rule("VERSION", 0, 0, None),
        _Rule("HELP", 0, 0, _help),
        _Rule("QUIT", 0, 0, None),
    )
}


def greeting(station: Station, operator: str | None) -> bytes:
    """Return the greeting of a client; the operator's address if that is another one."""
    role = "" if operator is None else f" OBSERVER {operator}"
    return ok(f"{PROTOCOL} {'READY' if station.is_ready else 'EMPTY'}{role}")


def answer(station: Station, line: bytes, barred: Barred = FREE, operator: str | None = None) -> Answer:
    """Answer a request.

    Parameters
    ----------
    line : bytes
        Without its end.
    barred : Barred
        What the client that asks may not do.
    operator : str or None
        Address of the operator, if it is not this client.
    """
    try:
        request = read_request(line)
        rule = _rule(request)
        if request.verb == "VERSION":
            return Answer(station, greeting(station, operator))
        if rule.run is None:
            return Answer(station, b"", request)
        fault = {"anybody": None, "operator": barred.operator, "host": barred.host}[rule.by]
        if fault is not None:
            return Answer(station, error(fault))
        if rule.takes_table:
            verbs.require_table(station)
        return Answer(*_done(rule.run, station, request.words))
    except Refused as refused:
        return Answer(station, error(refused.fault))
    except Exception as fault:  # noqa: BLE001  # whatever a request has hit upon, the next one is answered
        text = f"internal error: {type(fault).__name__}: {fault}"
        return Answer(station, error(DriveFault(DriveCode.INTERNAL, text)))


def downloaded(station: Station, data: bytes, load: TableLoader) -> Answer:
    """Answer a download that has come to its end: another table, or the old one and what is wrong with the new."""
    try:
        found = station.loaded(data, load)
    except Exception as fault:  # noqa: BLE001  # as in `answer`
        found = (DriveFault(DriveCode.INTERNAL, f"internal error: {type(fault).__name__}: {fault}"),)
    if isinstance(found, Station):
        return Answer(found, ok(loaded_text(found.block.table)))
    code, text = found[0]
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return Answer(station, error(DriveFault(code, text + more)))


def ok(text: str) -> bytes:
    """Return the bytes of a good reply."""
    return f"OK {text}\n".encode("ascii")


def error(fault: DriveFault) -> bytes:
    """Return the bytes of a refusal."""
    return f"{error_line(fault)}\n".encode("ascii")


def busy(operator: str) -> DriveFault:
    """Return the fault of a request that is the operator's alone."""
    what = "OPERATE takes the role" if operator == NOBODY else "OPERATE takes the role when it is free"
    return DriveFault(DriveCode.BUSY, f"operated by {operator}; {what}")


def hosted(host: str) -> DriveFault:
    """Return the fault of a request that is the host's alone."""
    text = f"hosted by {host}; the operator may MOVE, DRIVE, GUIDE, LOCK, PRISM, FOOT and KEY"
    return DriveFault(DriveCode.BUSY, text)


def _rule(request: Request) -> _Rule:
    rule = _RULES.get(request.verb)
    if rule is None:
        raise Refused(DriveCode.UNKNOWN_VERB, f"there is no verb '{shown(request.verb)}'; HELP lists them")
    if not rule.least <= len(request.words) <= rule.most:
        raise Refused(DriveCode.ARGUMENT_COUNT, f"{len(request.words)} words after the verb; write {rule.usage}")
    return rule


def _done(run: Verb, station: Station, words: Words) -> tuple[Station, bytes]:
    with np.errstate(all="ignore"):  # what cannot be driven to has a code, whatever numbers are on the way to it
        after, reply = run(station, words)
    if isinstance(reply, str):
        return after, ok(reply)
    return after, ok(str(len(reply))) + "".join(f"{line}\n" for line in reply).encode("ascii")
