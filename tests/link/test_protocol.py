"""The protocol without connections: every verb, every error code, and any line whatever."""

from __future__ import annotations

import hashlib
import re
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link.served import TABLE, loaded_station
from support.drive_tables import C, vertical_block

from orip.multimodel.link import verbs
from orip.multimodel.link.protocol import FREE, Barred, answer, busy, downloaded, greeting, hosted
from orip.multimodel.link.station import DSR_STAGES, bare_stages
from orip.multimodel.table_step import load_drive_table
from orip.multimodel.table_text import LONGEST_LINE, drive_table_text
from orip.records.drive_table import DriveCode
from orip.structs import replace

READY = loaded_station()
EMPTY = bare_stages()
REPLY = re.compile(rb"(OK( [ -~]+)?|ERR [1-9][0-9][0-9] [ -~]+)\n")
OBSERVER = Barred(busy("10.0.0.7:999"), busy("10.0.0.7:999"))
BESIDE_A_HOST = Barred(None, hosted("10.0.0.7:999"))
SETTINGS = "GUIDE OBJECT STATE IN LOCK NONE PRISM 0 0 AUTO ON"


def talk(station, *lines, barred=FREE):
    """Send lines, and return the station and all replies, without the ends of their lines."""
    replies = []
    for line in lines:
        found = answer(station, line.encode(), barred)
        assert found.connection is None
        station = found.station
        replies.append(found.reply.decode().removesuffix("\n"))
    return station, replies


def said(*lines, station=READY, barred=FREE):
    """Return the last reply."""
    return talk(station, *lines, barred=barred)[1][-1]


def code(*lines, station=READY, barred=FREE):
    """Return the code of the last reply, which changed nothing."""
    station, _ = talk(station, *lines[:-1])
    after, (reply,) = talk(station, lines[-1], barred=barred)
    assert after == station
    assert reply.startswith("ERR ")
    return int(reply.split()[1])


# With C = 50 mm, 100 m above the ground and photos 20 m from each other, (30, 0, 0) is 5 mm from the middle of the
# photos P1-2 and P1-3; their middles are on the plates at (30, 60) and (50, 60), with the affine transformations
# x = 30 + 0.999 x' + 0.02 y', y = 60 - 0.021 x' + 1.001 y'.


@pytest.mark.parametrize(
    ("lines", "reply"),
    [
        (["STATUS"], f"OK MODEL M1-1 {SETTINGS}"),
        (["DRIVE OBJECT 30 0 0"], "OK MODEL M1-2 UPPER 45.0050 60.1050 LOWER 34.9950 59.8950"),
        (["drive object 30.0 0e0 +0"], "OK MODEL M1-2 UPPER 45.0050 60.1050 LOWER 34.9950 59.8950"),
        (["DRIVE MODEL 16 0 -100"], "OK MODEL M1-1 UPPER 37.9920 59.8320 LOWER 28.0020 60.0420"),
        (["DRIVE PLATE UPPER 30 60"], "OK MODEL M1-1 UPPER 30.0000 60.0000 LOWER 25.0050 60.1050"),
        (["DRIVE PHOTO p1-2 10 0"], "OK MODEL M1-1 UPPER 34.9950 59.8950 LOWER 39.9900 59.7900"),
        (["MOVE 10 0"], "OK MODEL M1-1 UPPER 39.9900 59.7900 LOWER 30.0000 60.0000"),
        (["GUIDE B", "MOVE 1 -1"], "OK MODEL M1-1 UPPER 35.9950 58.8950 LOWER 26.0050 59.1050"),
        (["GUIDE 4", "MOVE 0 0 1"], "OK MODEL M1-1 UPPER 35.0450 59.8940 LOWER 24.9550 60.1060"),
        (["FORWARD"], "OK MODEL M1-1 UPPER 120.0000 0.0000 LOWER 120.0000 0.0000"),
        (["MODEL m2-1"], "OK MODEL M2-1 UPPER 35.4750 123.9190 LOWER 25.4850 124.1290"),
        (["NEXT"], "OK MODEL M1-2 UPPER 35.0150 60.3150 LOWER 25.0050 60.1050"),
        (["POS OBJECT"], "OK 10.0000 0.0000 0.0000"),
        (["POS MODEL"], "OK 10.0000 0.0000 -100.0000"),
        (["POS PLATE"], "OK UPPER 34.9950 59.8950 LOWER 25.0050 60.1050"),
        (["POS PHOTO"], "OK LEFT P1-1 5.0000 0.0000 RIGHT P1-2 -5.0000 0.0000"),
        (["MODEL?"], "OK M1-1"),
        (["WHICH 30 0 0"], "OK M1-2"),
        (["WHICH 30 400 0"], "OK NONE"),
        (["AUTO OFF"], f"OK MODEL M1-1 {SETTINGS.replace('AUTO ON', 'AUTO OFF')}"),
        (["AUTO OFF", "DRIVE OBJECT 21 0 0", "STATUS"],
         f"OK MODEL M1-1 {SETTINGS.replace('AUTO ON', 'AUTO OFF').replace('IN', 'OUTSIDE')}"),
        (["LOCK LEFT"], f"OK MODEL M1-1 {SETTINGS.replace('NONE', 'LEFT')}"),
        (["PRISM 90"], f"OK MODEL M1-1 {SETTINGS.replace('0 0', '90 90')}"),
        (["PRISM RIGHT 90"], f"OK MODEL M1-1 {SETTINGS.replace('0 0', '0 90')}"),
        (["GUIDE l"], f"OK MODEL M1-1 {SETTINGS.replace('OBJECT', 'LOWER')}"),
        (["EVENT"], "OK NONE"),
        (["FOOT LEFT"], f"OK MODEL M1-1 {SETTINGS}"),
        (["FOOT LEFT", "KEY 15", "EVENT"], "OK LEFT"),
        (["FOOT RIGHT", "NEXT", "EVENT"], "OK RIGHT UPPER 34.9950 59.8950 LOWER 25.0050 60.1050"),
        (["KEY enter", "EVENT"], "OK KEY ENTER"),
        (["KEY 3", "EVENT", "EVENT"], "OK NONE"),
        (["LIMITS LOWER"], "OK LOWER 0.0000 240.0000 0.0000 240.0000 LEAST 0.0010 UNIT mm"),
        (["VERSION"], "OK KDPP-EMU 1 READY"),
        (["DIGEST"], f"OK {hashlib.sha256(TABLE).hexdigest()}"),
        (["CLEAR"], "OK CLEARED"),
        (["CLEAR", "VERSION"], "OK KDPP-EMU 1 EMPTY"),
    ],
)  # fmt: skip
def test_verbs(lines, reply):
    assert said(*lines) == reply


def test_y_parallax_is_told_where_the_rays_do_not_meet():
    """Half a millimetre apart in y. The rays, t·(±5, ±0.25, -50) from their centres, are nearest to each other where
    (10 t - 20)² + (t / 2)² is least: t = 200 / 100.25."""
    reply = said("DRIVE PHOTO P1-1 5 0.25", "DRIVE PHOTO P1-2 -5 -0.25", "POS OBJECT")
    *xyz, keyword, parallax = reply.split()[1:]
    assert keyword == "PY"
    assert float(parallax) == pytest.approx(0.5, abs=6e-5)
    assert [float(value) for value in xyz] == pytest.approx([10.0, 0.0, 100.0 - C * 200.0 / 100.25], abs=6e-5)


def test_lists():
    assert said("MODELS").split("\n")[:3] == ["OK 8", "M1-1 1 1 P1-1 P1-2 NORMAL", "M1-2 1 2 P1-2 P1-3 SWAPPED"]
    assert said("PROFILE 10 0 0 30 0 0 10").split("\n") == [
        "OK 3",
        "10.0000 0.0000 0.0000 MODEL M1-1 UPPER 34.9950 59.8950 LOWER 25.0050 60.1050",
        "20.0000 0.0000 0.0000 MODEL M1-1 UPPER 39.9900 59.7900 LOWER 30.0000 60.0000",
        "30.0000 0.0000 0.0000 MODEL M1-2 UPPER 45.0050 60.1050 LOWER 34.9950 59.8950",
    ]
    assert said("PROFILE 10 0 0 10 0 200 200").endswith("\n10.0000 0.0000 200.0000 ERR 310")
    verbs_listed = [line.split()[0] for line in said("HELP").split("\n")[1:]]
    assert len(verbs_listed) == int(said("HELP").split()[1]) == len(set(verbs_listed)) == 28


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["WALK 1 2"], 100), ([""], 100), (["\xff\x00"], 100), (["DRIVEOBJECT 1 2 3"], 100),
        (["STATUS now"], 101), (["DRIVE OBJECT 1 2"], 101), (["MOVE 1"], 101), (["DOWNLOAD"], 101), (["QUIT 1"], 101),
        (["DRIVE OBJECT 1 2 x"], 102), (["DRIVE OBJECT 1 2 nan"], 102), (["DRIVE OBJECT 1 2 1e999"], 102),
        (["DRIVE OBJECT 1 2 1_0"], 102), (["MOVE 1,5 2"], 102), (["PRISM LEFT x"], 102), (["WHICH 1 2 1e11"], 102),
        (["STATUS" + " " * 507], 103),
        (["DRIVE GROUND 1 2 3"], 104), (["GUIDE 6"], 104), (["POS SKY"], 104), (["AUTO 1"], 104),
        (["LOCK UPPER"], 104), (["PRISM 45"], 104), (["PRISM UP 0"], 104), (["FOOT 1"], 104), (["KEY 16"], 104),
        (["LIMITS LEFT"], 104), (["DRIVE PLATE LEFT 1 2"], 104), (["PROFILE 0 0 0 1 1 1 0"], 104),
        (["PROFILE 0 0 0 1 1 1 1e-5"], 104),
        (["MODEL M9-9"], 201),
        (["DRIVE PHOTO P9-9 1 2"], 202),
        (["LOCK LEFT", "DRIVE PLATE UPPER 1 2"], 204), (["LOCK RIGHT", "GUIDE BOTH", "MOVE 1 1"], 204),
        (["GUIDE UPPER", "MOVE 1 1 1"], 205),
        (["DRIVE OBJECT 10 0 100"], 310), (["DRIVE PHOTO P1-1 -5 0", "DRIVE PHOTO P1-2 5 0", "POS OBJECT"], 310),
        (["DRIVE OBJECT 10 0 99"], 311), (["DRIVE PLATE UPPER -0.001 5"], 311),
        (["DRIVE PHOTO P1-1 1 0", "DRIVE PHOTO P1-2 1 0", "POS OBJECT"], 313),
    ],
)  # fmt: skip
def test_refusals_change_nothing(lines, expected):
    assert code(*lines) == expected


def test_a_line_of_512_bytes_is_read():
    assert said("STATUS" + " " * 506) == f"OK MODEL M1-1 {SETTINGS}"


def test_distortion_without_an_inverse():
    """R - R³/300 never exceeds 20/3 mm."""
    table = vertical_block()
    camera = replace(table.cameras[0], parameters=(50.0, 0.0, 0.0, 0.0, -1.0 / 300.0, *(0.0,) * 7), frame=(8.0, 8.0))
    station = loaded_station(drive_table_text(replace(table, cameras=(camera,))).encode())
    assert code("AUTO OFF", "DRIVE OBJECT 32 0 0", station=station) == 312
    assert code("DRIVE PLATE UPPER 40 60", "POS OBJECT", station=station) == 312


@pytest.mark.parametrize(
    "line",
    ["DIGEST", "GUIDE MODEL", "GUIDE 5", "DRIVE OBJECT 1 2 3", "DRIVE MODEL 1 2 3", "DRIVE PHOTO LEFT 1 2",
     "POS OBJECT", "POS MODEL", "POS PHOTO", "MODEL?", "MODEL -", "MODELS", "NEXT", "WHICH 1 2 3",
     "PROFILE 1 2 3 4 5 6 1"],
)  # fmt: skip
def test_without_a_table_nothing_has_an_orientation(line):
    assert code(line, station=EMPTY) == 200


def test_without_a_table_the_bare_stages_are_driven():
    status = "MODEL - GUIDE {} STATE IN LOCK NONE PRISM 0 0 AUTO ON"
    lines = {
        "STATUS": f"OK {status.format('UPPER')}",
        "DRIVE PLATE LOWER -100.5 20": "OK MODEL - UPPER 0.0000 0.0000 LOWER -100.5000 20.0000",
        "MOVE 1 2": "OK MODEL - UPPER 1.0000 2.0000 LOWER -100.5000 20.0000",
        "GUIDE BOTH": f"OK {status.format('BOTH')}",
        "FOOT RIGHT": f"OK {status.format('BOTH')}",
        "POS PLATE": "OK UPPER 1.0000 2.0000 LOWER -100.5000 20.0000",
        "EVENT": "OK RIGHT UPPER 1.0000 2.0000 LOWER -100.5000 20.0000",
        "VERSION": "OK KDPP-EMU 1 EMPTY",
    }
    assert talk(EMPTY, *lines)[1] == list(lines.values())


READING = ["STATUS", "POS OBJECT", "POS MODEL", "POS PLATE", "POS PHOTO", "MODEL?", "MODELS", "WHICH 1 2 3",
           "LIMITS UPPER", "VERSION", "HELP", "DIGEST"]  # fmt: skip
CHANGING = ["CLEAR", "GUIDE MODEL", "DRIVE OBJECT 1 2 3", "MOVE 1 1", "MODEL M1-2", "NEXT", "AUTO ON", "LOCK LEFT",
            "PRISM 0", "FOOT LEFT", "KEY 1", "EVENT", "PROFILE 0 0 0 1 1 1 1", "FORWARD"]  # fmt: skip


@pytest.mark.parametrize("line", READING)
def test_observers_read(line):
    assert said(line, barred=OBSERVER).startswith("OK ")


@pytest.mark.parametrize("line", CHANGING)
def test_observers_change_nothing(line):
    assert code(line, barred=OBSERVER) == 110
    assert "operated by 10.0.0.7:999" in said(line, barred=OBSERVER)


HOST_ALONE = ("CLEAR", "MODEL M1-2", "NEXT", "AUTO ON", "EVENT", "PROFILE 0 0 0 1 1 1 1", "FORWARD")


@pytest.mark.parametrize("line", CHANGING)
def test_beside_a_host_the_operator_has_the_panel(line):
    reply = said(line, barred=BESIDE_A_HOST)
    if line in HOST_ALONE:
        assert reply.startswith("ERR 110 hosted by 10.0.0.7:999; the operator may MOVE, DRIVE, GUIDE, ")
    else:
        assert reply.startswith("OK ")


def test_the_stages_end_where_they_do_whatever_a_table_says():
    """240 mm of a DSR: the film of the table may lie beyond; a table in pixels is of other stages."""
    station = bare_stages(stages=DSR_STAGES)
    assert (
        said("LIMITS UPPER", station=station) == "OK UPPER -120.0000 120.0000 -120.0000 120.0000 LEAST 0.0010 UNIT mm"
    )
    assert said("DRIVE PLATE UPPER 120.001 0", station=station).startswith("ERR 311")
    loaded = station.loaded(TABLE, load_drive_table)
    assert said("LIMITS LOWER", station=loaded).startswith("OK LOWER -120.0000 120.0000 ")
    assert said("DRIVE OBJECT 30 0 0", station=loaded) == "OK MODEL M1-2 UPPER 45.0050 60.1050 LOWER 34.9950 59.8950"
    assert said("MODEL M2-1", station=loaded) == "OK MODEL M2-1 UPPER 34.9950 59.8950 LOWER 25.0050 60.1050"  # y 124 mm
    assert said("CLEAR", "LIMITS LOWER", station=loaded).startswith("OK LOWER -120.0000 120.0000 ")
    in_pixels = station.loaded(edited((b"PLATE mm", b"PLATE px")), load_drive_table)
    assert said("LIMITS UPPER", station=in_pixels) == "OK UPPER 0.0000 240.0000 0.0000 240.0000 LEAST 0.0010 UNIT px"


def test_greetings():
    assert greeting(EMPTY, None) == b"OK KDPP-EMU 1 EMPTY\n"
    assert greeting(READY, "[::1]:5") == b"OK KDPP-EMU 1 READY OBSERVER [::1]:5\n"


def edited(*replacements):
    """Return the table with other words in it, and the CRC that belongs to them."""
    body = TABLE[: TABLE.rfind(b"END ")]
    for old, new in replacements:
        assert old in body
        body = body.replace(old, new)
    return body + b"END %d %08x\n" % (body.count(b"\n"), zlib.crc32(body))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (edited((b"UNITS PLATE mm", b"UNITS PLATE in")), 120),
        (TABLE[:-2], 121),
        (TABLE.replace(b"M1-1", b"M1-0"), 121),
        (b"", 121),
        (edited((b"MODEL M1-1 1 1", b"MODEL M1-1 1 2")), 122),
        (edited((b"PROJECT Any project", b"PROJECT " + b"x" * LONGEST_LINE)), 123),
        (edited((b"P1-2 CAM T2 LOWER", b"P1-2 CAM T1 UPPER")), 203),
    ],
)
def test_a_table_with_a_fault_is_not_loaded(data, expected):
    found = downloaded(READY, data, load_drive_table)
    assert found.station == READY
    assert REPLY.fullmatch(found.reply)
    assert int(found.reply.split()[1]) == expected


def test_the_line_of_a_fault_is_told():
    found = downloaded(READY, edited((b"UNITS PLATE mm", b"UNITS PLATE in")), load_drive_table)
    assert b"line 5" in found.reply


def test_a_table_is_loaded_in_place_of_the_old():
    table = drive_table_text(vertical_block(rows=1, columns=2)).encode()
    moved, _ = talk(READY, "DRIVE OBJECT 30 0 0", "GUIDE UPPER", "FOOT LEFT")
    found = downloaded(moved, table, load_drive_table)
    assert found.reply == b"OK LOADED cameras 1 photos 3 models 2\n"
    assert said("DIGEST", station=found.station) == f"OK {hashlib.sha256(table).hexdigest()}"
    assert said("STATUS", station=found.station) == f"OK MODEL M1-1 {SETTINGS}"
    assert said("EVENT", station=found.station) == "OK NONE"


def test_what_goes_wrong_inside_is_an_error_900(monkeypatch):
    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(verbs.readout, "status", fail)
    assert code("STATUS") == 900
    assert b"ERR 900" in downloaded(READY, TABLE, fail).reply


def test_connections_are_not_the_protocols():
    for line in ("DOWNLOAD 7", "OPERATE", "OBSERVE", "QUIT"):
        found = answer(READY, line.encode(), "10.0.0.7:999")
        assert (found.station, found.reply) == (READY, b"")
        assert found.connection == (line.split()[0], tuple(line.split()[1:]))


def test_every_code_is_known_here():
    """A code that is added needs a test that it is given."""
    # 403 is tested with the token of the emulated processor
    here = {100, 101, 102, 103, 104, 110, 120, 121, 122, 123, 200, 201, 202, 203, 204, 205, 310, 311, 312, 313, 900}
    assert here | {0, 403} == set(map(int, DriveCode))


WORDS = st.sampled_from(
    [*" ".join([*READING, *CHANGING]).split(), "DOWNLOAD", "OPERATE", "OBSERVE", "QUIT", "LEFT", "RIGHT", "UPPER",
     "LOWER", "OBJECT", "PHOTO", "PLATE", "BOTH", "P1-1", "P2-3", "M2-2", "OFF", "NONE", "90", "0", "10", "30.5",
     "-48", "1e9", "-1e10", "1e-300", "99.9999999", "MODEL", "POS", "DRIVE"]
)  # fmt: skip
LIKELY = st.tuples(
    st.sampled_from(["DRIVE OBJECT", "DRIVE MODEL", "DRIVE PLATE", "DRIVE PHOTO", "MOVE", "GUIDE", "POS", "MODEL",
                     "PROFILE", "WHICH", "LOCK", "PRISM", "FOOT", "KEY", "NEXT", "FORWARD", "AUTO", "EVENT"]),
    st.lists(WORDS | st.floats(width=32).map(str) | st.integers(-50, 150).map(str), max_size=7),
).map(lambda parts: " ".join([parts[0], *parts[1]]).encode())  # fmt: skip
ANY_LINE = st.one_of(
    LIKELY,
    LIKELY,
    st.lists(WORDS | st.text(max_size=5), max_size=8).map(lambda words: " ".join(words).encode()),
    st.binary(max_size=600),
)


def check_any_lines(lines):
    """Whatever is sent, what comes back are lines of the protocol; the table stays until it is cleared."""
    for before in (READY, EMPTY):
        station, table = before, before.table
        for line in lines:
            found = answer(station, line.replace(b"\n", b" "))
            if found.connection is None:
                first, *rest = found.reply.splitlines(keepends=True)
                assert REPLY.fullmatch(first), found.reply
                assert not rest or len(rest) == int(first.split()[1])
                assert not first.startswith(b"ERR 9"), (line, first)
                table = b"" if first == b"OK CLEARED\n" else table
            station = found.station
            assert station.table == table
        assert answer(station, b"STATUS").reply.startswith(b"OK MODEL ")


@settings(max_examples=150, deadline=None)
@given(st.lists(ANY_LINE, min_size=1, max_size=8))
def test_any_lines(lines):
    check_any_lines(lines)


@pytest.mark.long
@settings(max_examples=13_000, deadline=None)
@given(st.lists(ANY_LINE, min_size=8, max_size=12))
def test_a_hundred_thousand_lines(lines):
    check_any_lines(lines)
