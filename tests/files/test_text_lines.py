"""Lines, fields and numbers of text files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.files.text.decimal_numbers import is_number, parse_number, parse_photo_error
from orip.files.text.lines import FieldReader, decode_lines, field_lines, read_lines, split_line
from orip.files.text.regular_file import file_digest


@pytest.mark.parametrize(
    ("token", "value"),
    [("1", 1.0), ("-.5", -0.5), ("+3.", 3.0), ("1.5D-3", 0.0015), ("1.5d3", 1500.0), ("2e2", 200.0), ("-0.0", 0.0)],
)
def test_plain_and_fortran_numbers_are_read(token: str, value: float) -> None:
    assert parse_number(token) == value


@pytest.mark.parametrize(
    ("token", "words"),
    [
        ("-.062.821", "'-.062.821' is not a number; write a plain decimal such as -0.062821"),
        ("1,012.40", "'1,012.40' has marks between thousands; write 1012.40"),
        ("-1.015,30", "'-1.015,30' has marks between thousands; write -1015.30"),
        ("1'234'567.8", "write 1234567.8"),
        ("1,234,567", "write 1234567"),
        ("561,971", "decimal comma; write a decimal point: 561.971"),
        ("12,5", "'12,5' has a decimal comma; write a decimal point: 12.5"),
        ("-,5", "write a decimal point: -0.5"),
        ("12.5,", "ends in a comma; separate fields by blanks and write 12.5"),
        ("nan", "'nan' is not allowed; write a finite decimal number"),
        ("-Inf", "not allowed"),
        ("1e999", "'1e999' is too large"),
        ("-1.1e30", "too large"),
        ("−5.0", "such as -5.0"),
        ("1_000", "not a number"),
        ("١٢", "not a number"),
        ("±0.02", "'±0.02' is not a number; write a plain decimal such as 0.02"),
        ("1436.4".translate({ord("0") + n: 0xFF10 + n for n in range(10)}), "a plain decimal such as 1436.4"),
        ("١٠١٢٫٤٠", "write a plain decimal such as 1012.40"),
        ("2cm", "'2cm' is written with a unit; write the number alone, in the unit that this field has"),
        ("0,5mm", "is written with a unit"),
        ("abc", "'abc' is not a number; write a plain decimal such as 12.345"),
        ("", "not a number"),
        ("\x1b[31m", "'\\x1b[31m' is not a number"),
    ],
)
def test_what_is_no_number_is_refused_with_a_remedy(token: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"write|check") as fault:
        parse_number(token)
    assert words in str(fault.value)
    assert not is_number(token)


def test_long_tokens_are_shown_short() -> None:
    with pytest.raises(ValueError, match=r"\.\.\.' is not a number") as fault:
        parse_number("x" * 100_000)
    assert len(str(fault.value)) < 200


@pytest.mark.parametrize(
    ("data", "line", "words"),
    [
        ("a b\n".encode("utf-16"), 1, "the file is UTF-16"),
        ("a b\nc\n".encode("utf-16-le"), 1, "zero bytes: it is UTF-16, or damaged"),
        (b"a b\nc d\n\0\0\0\0", 3, "zero bytes"),
        (b"a b\nc d\n\x1a", 3, "Ctrl-Z, 0x1A); remove it"),
        (b"a b\r\nc d\x1a\r\n", 2, "Ctrl-Z"),
    ],
)
def test_what_is_no_text_is_one_complaint(data: bytes, line: int, words: str) -> None:
    parsed = decode_lines(data, "Z")
    assert parsed.value == []
    (complaint,) = parsed.complaints
    assert str(complaint).startswith(f"Z:{line}: ")
    assert words in str(complaint)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"PK\x03\x04\x14\0\x06\0\x08\0", "this is no text, but a workbook (.xlsx, .ods), a document or another ZIP"),
        (
            bytes.fromhex("d0cf11e0a1b11ae1") + bytes(504),
            "an older Office (.xls, .doc); save its content as plain text",
        ),
        (b"{\\rtf1\\ansi\\deff0\n1 2 3\\par\n}", "formatted text (RTF); save its content as plain text (UTF-8)"),
        (b"\x1f\x8b\x08\0\0", "compressed (gzip); unpack it"),
    ],
)
def test_documents_in_the_place_of_a_text_are_called_by_their_kind(data: bytes, words: str) -> None:
    parsed = decode_lines(data, "Z.PNT")
    assert parsed.value == []
    (complaint,) = parsed.complaints
    assert words in str(complaint)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1;2.5;3.5", "separate fields by blanks or tabs, not by ';'; the line"),
        ("1;2,5;3,5", "separate fields by blanks or tabs, not by ';', and write decimal points; the line"),
        ("1,2.5,3.5", "separate fields by blanks or tabs, not by ','; the line"),
    ],
)
def test_separators_of_other_programs_are_named(line: str, words: str) -> None:
    split = split_line(line, 1)
    assert split is not None
    reader = FieldReader(split, "Z")
    assert not reader.has_fields((3,), "name x y")
    assert words in str(reader.complaints[0])


def test_photo_errors_are_millimetres_or_pixels() -> None:
    assert parse_photo_error("0.004") == (0.004, False)
    assert parse_photo_error("-0.5px") == (-0.5, True)
    with pytest.raises(ValueError, match=r"'halfpx' is not a number of pixels; write for example 0\.5px"):
        parse_photo_error("halfpx")


@given(st.floats(-1e30, 1e30))
def test_every_number_survives_its_repr(value: float) -> None:
    assert parse_number(repr(value)) == value


def test_fields_are_parted_by_blanks_and_tabs_up_to_a_comment() -> None:
    line = split_line("\t P#1  2.5\t!no 3", 7)
    assert line is not None
    assert [(field.text, field.column) for field in line.fields] == [("P#1", 3), ("2.5", 8)]
    assert split_line("  # all comment", 1) is None
    assert split_line(" \t", 1) is None


@pytest.mark.parametrize("data", [b"a 1\r\nb 2\r\n", b"\xef\xbb\xbfa 1\nb 2", b"a 1\rb 2\r"])
def test_line_ends_and_byte_order_mark(data: bytes) -> None:
    lines = list(field_lines(decode_lines(data, "F").value))
    assert [(line.number, line.fields[0].text, line.fields[0].column) for line in lines] == [(1, "a", 1), (2, "b", 1)]


def test_bytes_that_are_not_utf8_are_named_with_line_and_column() -> None:
    parsed = decode_lines("ä 1\nb \xe9\nc\n\xff".encode("latin-1"), "A.PNT")
    assert [str(complaint)[:40] for complaint in parsed.complaints] == [
        "A.PNT:1:1: byte 0xE4 is not UTF-8; save ",
        "A.PNT:2:3: byte 0xE9 is not UTF-8; save ",
        "A.PNT:4:1: byte 0xFF is not UTF-8; save ",
    ]
    assert "UTF-16" in str(decode_lines("a".encode("utf-16"), "A.PNT").complaints[0])


def test_a_missing_file_and_a_folder_are_complaints(tmp_path: Path) -> None:
    (missing,) = read_lines(tmp_path / "S1.MEA", "S1.MEA").complaints
    assert str(missing) == "S1.MEA: there is no such file; correct the name, or put the file in its place"
    (folder,) = read_lines(tmp_path, "here").complaints
    assert "folder" in folder.message
    (odd,) = read_lines(tmp_path / "a\0b", "odd").complaints
    assert "cannot be read" in odd.message
    assert read_lines(tmp_path / "S1.MEA", "S1.MEA", may_be_absent=True).complaints == ()


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs a user whom the system can refuse a file")
def test_a_file_that_may_not_be_read_is_a_complaint(tmp_path: Path) -> None:
    path = tmp_path / "A.PNT"
    path.write_text("1")
    path.chmod(0)
    (refused,) = read_lines(path, "A.PNT").complaints
    assert "may not be read" in refused.message


def test_digest_is_sha256(tmp_path: Path) -> None:
    (tmp_path / "f").write_bytes(b"abc")
    assert file_digest(tmp_path / "f") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
