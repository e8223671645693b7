"""The drive table's text: nothing is lost in it, and no byte of it can change unnoticed."""

from __future__ import annotations

import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.drive_tables import cameras, vertical_block

from orip.multimodel.processor import table_faults
from orip.multimodel.table_text import (
    LONGEST_LINE,
    MOST_BYTES,
    MOST_LINES,
    drive_table_text,
    read_drive_table,
)
from orip.records.drive_table import DriveCode
from orip.structs import replace

TABLE = vertical_block(rows=1, columns=2, camera=cameras()["measured EBNER"])
DATA = drive_table_text(TABLE).encode("ascii")

finite = st.floats(allow_nan=False, allow_infinity=False)


def sealed(text):
    """Return bytes of a text with an END line that fits it."""
    body = text.encode("utf-8", errors="surrogateescape")
    return body + b"END %d %08x\n" % (body.count(b"\n"), zlib.crc32(body))


def body():
    return DATA.decode("ascii").rpartition("END ")[0]


def faults_after(old, new, count=1):
    """Return the faults of the table after a change of its text; END is made to fit."""
    assert old in body()
    return read_drive_table(sealed(body().replace(old, new, count))).faults


def test_the_form():
    lines = drive_table_text(vertical_block(rows=1, columns=1)).splitlines()
    assert lines[:9] == [
        "ORIPDRIVE 3",
        "BLOCK MAIN",
        "PROJECT Any project",
        "USER A. Nyone",
        "UNITS PLATE mm PHOTO mm OBJECT m",
        "STAGE UPPER 0 240 0 240 0.001",
        "STAGE LOWER 0 240 0 240 0.001",
        "CAMERA CAM PERSPECTIVE 50 0 0 20 24",
        "DISTORTION CAM IDEAL 0 0 0 0 0 0 0 0 0",
    ]
    assert lines[9:13] == [
        "TEMPLATE T1 UPPER",
        "TEMPLATE T2 LOWER",
        "PHOTO P1-1 CAM T1 UPPER 0 0 100 1 0 0 0 1 0 0 0 1",
        "PHOTO P1-2 CAM T2 LOWER 20 0 100 1 0 0 0 1 0 0 0 1",
    ]
    assert lines[13].startswith("AFFINE P1-1 30 0.999 0.02")
    assert lines[15:17] == ["MODEL M1-1 1 1 P1-1 P1-2 NORMAL", "START 10 0 0"]
    assert lines[17].startswith("END 17 ")
    assert int(lines[17].split()[2], 16) == zlib.crc32("".join(f"{line}\n" for line in lines[:17]).encode())


@pytest.mark.parametrize("name", cameras())
def test_reading_gives_an_equal_table(name):
    table = vertical_block(camera=cameras()[name], tilted=True)
    table = replace(table, plate_unit="px", object_unit="US survey foot", project="A b  c")
    read = read_drive_table(drive_table_text(table).encode("ascii"))
    assert read == (table, ())


@pytest.mark.parametrize(
    ("user", "line"),
    [
        ("", "USER -"),
        ("K. Dueholm", "USER K. Dueholm"),
        ("Jørgen 100 %", "USER J%C3%B8rgen 100 %25"),
        ("-", "USER %2D"),
        ("\N{CJK UNIFIED IDEOGRAPH-5F35}", "USER %E5%BC%B5"),
    ],
)
def test_the_name_of_a_user_may_have_any_letters(user, line):
    table = replace(TABLE, user=user)
    assert drive_table_text(table).splitlines()[3] == line
    assert read_drive_table(drive_table_text(table).encode("ascii")).table == table


def test_a_photo_off_a_template():
    table = replace(TABLE, photos=tuple(replace(photo, template=None) for photo in TABLE.photos), templates=())
    assert "PHOTO P1-1 CAM - UPPER" in drive_table_text(table)
    assert read_drive_table(drive_table_text(table).encode("ascii")).table == table


@given(
    st.lists(finite, min_size=40, max_size=40), st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1)
)
@settings(max_examples=100)
def test_any_numbers_and_names_are_kept(numbers, name):
    value = iter(numbers)

    def some(count):
        return tuple(next(value) for _ in range(count))

    camera = replace(TABLE.cameras[0], parameters=some(12), frame=some(2))
    first = replace(TABLE.photos[0], centre=some(3), rotation=some(9), affine=some(6))
    limits = replace(TABLE.upper, x_min=some(1)[0], least_count=some(1)[0])
    table = replace(
        TABLE,
        cameras=(camera,),
        photos=(first, *TABLE.photos[1:]),
        upper=limits,
        start=some(3),
        block=name,
        project=name,
    )
    assert read_drive_table(drive_table_text(table).encode("ascii")) == (table, ())


@pytest.mark.parametrize("change", [1, 32, 128])
def test_no_byte_can_be_changed(change):
    for position in range(len(DATA)):
        damaged = bytearray(DATA)
        damaged[position] ^= change
        read = read_drive_table(bytes(damaged))
        assert read.table is None
        assert read.faults[0].code in (DriveCode.TABLE_FORMAT, DriveCode.TABLE_DAMAGED, DriveCode.TABLE_TOO_LARGE)


@given(st.data())
@settings(max_examples=200)
def test_cut_doubled_or_exchanged_parts_are_refused(data):
    start, end = sorted(data.draw(st.integers(0, len(DATA))) for _ in range(2))
    put = data.draw(st.binary(max_size=20) | st.just(DATA[start:end] * 2) | st.just(b"\n"))
    changed = DATA[:start] + put + DATA[end:]
    if changed != DATA:
        read = read_drive_table(changed)
        assert read.table is None
        assert read.faults


@given(st.binary(max_size=300))
@settings(max_examples=200)
def test_any_bytes_are_refused(data):
    assert read_drive_table(data).table is None


@given(st.lists(st.text(st.characters(max_codepoint=300), max_size=30), max_size=10), st.integers(0, 30))
@settings(max_examples=200)
def test_any_lines_with_a_proper_end_never_raise(lines, place):
    parts = body().split("\n")
    read = read_drive_table(sealed("\n".join([*parts[:place], *lines, *parts[place:]])))
    if read.table is not None:
        table_faults(read.table)
    else:
        assert read.faults


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_any_word_with_a_proper_end_is_read_or_refused(data):
    words = body().split(" ")
    place = data.draw(st.integers(0, len(words) - 1))
    words[place] = data.draw(
        st.sampled_from(["-", "0", "1e400", "nan", "-1", "UPPER", "P1-1", "1_0", "0x1", "١", "\r", "é", "9" * 400])
    )
    read = read_drive_table(sealed(" ".join(words)))
    if read.table is not None:
        table_faults(read.table)
    else:
        assert read.faults


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "the last line is not END"),
        (DATA[:-1], "the last line is not END"),
        (DATA.replace(b"\n", b"\r\n"), "the last line is not END"),
        (DATA + b"\n", "the last line is not END"),
        (DATA.replace(b"END ", b"END  "), "the last line is not END"),
        (DATA[:-10] + DATA[-10:].upper(), None),
        (DATA.replace(b"START 10", b"START 11"), "the CRC-32 is"),
        (DATA.replace(b"BLOCK MAIN\n", b""), "20 lines before END, which states 21"),
    ],
)
def test_what_is_damaged(data, text):
    if data == DATA:  # a CRC without letters is the same in upper case
        return
    read = read_drive_table(data)
    assert read.table is None
    assert read.faults[0].code == DriveCode.TABLE_DAMAGED
    assert text is None or text in read.faults[0].text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("ORIPDRIVE 3", "ORIPDRIVE 1", "line 1 is not: ORIPDRIVE 3"),
        ("BLOCK", "BLOK", "line 2 is not: BLOCK <name>"),
        ("PHOTO mm", "PHOTO cm", "line 5 is not: UNITS PLATE mm|px PHOTO mm OBJECT <ground unit>"),
        ("STAGE LOWER", "STAGE UPPER", "line 7 is not: STAGE LOWER"),
        ("240", "24O", "line 6: '24O' is not a finite number"),
        ("240", "1e999", "line 6: '1e999' is not a finite number"),
        ("240", "nan", "line 6: 'nan' is not a finite number"),
        ("240", "1_0", "line 6: '1_0' is not a finite number"),
        ("240 ", "", "line 6: 6 words separated by single blanks; 7 are needed"),
        ("CAMERA CAM ", "CAMERA CAM  ", "line 8: 9 words"),
        ("PERSPECTIVE", "FISHEYE", "line 8: 'FISHEYE' is not one of PERSPECTIVE, EQUIDISTANT"),
        ("MEASURED", "measured", "line 9: 'measured' is not one of IDEAL, MEASURED"),
        ("EBNER", "BROWN", "line 10: 'BROWN' is not one of EBNER, GRUEN"),
        ("TEMPLATE T1 UPPER", "TEMPLATE T1 MIDDLE", "line 11: 'MIDDLE' is not one of UPPER, LOWER"),
        ("MODEL M1-1 1", "MODEL M1-1 0", "'0' is not a whole number from 1"),
        ("MODEL M1-1 1", "MODEL M1-1 1.0", "'1.0' is not a whole number from 1"),
        ("NORMAL", "CROSSED", "'CROSSED' is not one of NORMAL, SWAPPED"),
        ("START", "BEGIN", "line 21 is not: START <X> <Y> <Z>"),
        ("MODEL", "MODELL", "line 19 is not: START <X> <Y> <Z>"),
        ("START 10 0 0\n", "START 10 0 0\nSTART 10 0 0\n", "line 22: this line is out of order"),
        ("Any project", "Any\tproject", "line 3: a character is not printable ASCII"),
        ("Any project", "Änderung", "line 3: a character is not printable ASCII"),
        ("BLOCK MAIN\n", "BLOCK MAIN\r\n", "line 2: a character is not printable ASCII"),
    ],
)
def test_what_has_not_the_form(old, new, text):
    faults = faults_after(old, new)
    assert faults[0].code == DriveCode.TABLE_FORMAT
    assert text in faults[0].text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("DISTORTION CAM", "DISTORTION CAN", "camera CAM has no line DISTORTION"),
        ("DISTORTION CAM", "DISTORTION CAN", "DISTORTION of camera CAN, which is not in the table"),
        ("SET CAM", "SET CAN", "SET of camera CAN, which is not in the table"),
        ("AFFINE P1-1", "AFFINE P1-2", "photo P1-1 has no line AFFINE"),
        ("AFFINE P1-1", "AFFINE P1-2", "affine of photo P1-2 is there twice"),
        ("PHOTO P1-1", "PHOTO P1-2", "line 14: photo P1-2 is there twice"),
        ("TEMPLATE T1", "TEMPLATE T2", "line 12: template T2 is there twice"),
        ("MODEL M1-1", "MODEL M1-2", "model M1-2 is there twice"),
    ],
)
def test_what_does_not_belong_together(old, new, text):
    faults = faults_after(old, new)
    assert {fault.code for fault in faults} == {DriveCode.TABLE_INCONSISTENT}
    assert any(text in fault.text for fault in faults)


def test_all_faults_are_told_at_once():
    changed = body().replace("NORMAL", "CROSSED").replace("MEASURED", "FELT").replace("240", "x", 1)
    codes = [fault.text.split(":")[0] for fault in read_drive_table(sealed(changed)).faults]
    assert codes == ["line 6", "line 9", "line 19"]


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"x" * (LONGEST_LINE + 1), "line 1 has 4097 bytes"),
        (b"\n" * (MOST_LINES + 1), "100001 lines"),
        (b"\n" * (MOST_BYTES + 1), "bytes; at most"),
    ],
    ids=["line", "lines", "bytes"],
)
def test_what_is_too_large(data, text):
    (fault,) = read_drive_table(data).faults
    assert fault.code == DriveCode.TABLE_TOO_LARGE
    assert text in fault.text
