"""Angles in degrees, minutes and seconds."""

from __future__ import annotations

import pytest

from orip.files.text.decimal_numbers import degrees_and_side, parse_degrees, parse_number

NORTH = [
    "53°30'00\"N",
    "53 30 00 N",
    "N53.5",
    "53.5°",
    "53:30:00",
    "53° 30,0' N",
    "53°30′0″N",
    "N 53°30'00.000''",
    "53.5",
]


@pytest.mark.parametrize("text", NORTH)
def test_forms_of_a_latitude_are_the_same(text: str) -> None:
    assert parse_degrees(text, "NS") == 53.5


@pytest.mark.parametrize("text", ["0°30'36\"W", "-0:30:36", "W 0 30 36", "W0.51", "−0°30'36\""])
def test_west_and_minus_are_negative(text: str) -> None:
    assert parse_degrees(text, "EW") == pytest.approx(-0.51, abs=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "53 30",
        "53.5 30 00",
        "53 60 00",
        "53 30 60",
        "-53N",
        "N53N",
        "5330N",
        "53'",
        "",
        "E",
        "53 30 00 O",
        "12,5",
    ],
)
def test_what_is_ambiguous_is_no_angle(text: str) -> None:
    assert degrees_and_side(text) is None
    with pytest.raises(ValueError, match="write"):
        parse_degrees(text, "NS")


def test_a_latitude_is_no_longitude() -> None:
    with pytest.raises(ValueError, match=r"'53°N' should end in E or W; are longitude and latitude exchanged\?"):
        parse_degrees("53°N", "EW")


def test_where_a_number_should_be_decimal_degrees_are_told() -> None:
    with pytest.raises(
        ValueError, match=r"is an angle in degrees, minutes and seconds; write decimal degrees: -8\.2575"
    ):
        parse_number("8°15'27\"W")
