"""PRELIM_RESULT.OUT and its tables, from values made by hand: units, decimals, words, and lines that fit the page."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from orip.files.listings.preliminary import (
    failure_lines,
    model_coordinate_lines,
    preliminary_listing,
    relative_orientation_lines,
    relative_overview,
    relative_remarks,
    similarity_lines,
    similarity_overview,
    similarity_remarks,
)
from orip.files.text.table import PAGE_WIDTH
from orip.records.control import PreliminaryPoint
from orip.records.preliminary import (
    CameraStart,
    ModelCoordinates,
    NotOriented,
    PartialBlock,
    PhotoStart,
    PointStarts,
    PreliminaryValues,
    RelativeOrientation,
    SimilarityStep,
)
from orip.structs import replace

NAN = np.nan
MODEL = PartialBlock(
    "M1", np.array([0, 1]), np.stack([np.eye(3)] * 2), np.array([[0.0, 0.0, 0.0], [0.0904, -0.0012, 0.0007]]),
    np.array([0, 1]), np.array([[0.01, 0.02, -0.15], [0.03, -0.02, -0.1512345]]), np.full((2, 3), 4e-6),
)  # fmt: skip


def relative() -> RelativeOrientation:
    return RelativeOrientation(
        model="M1", left="101", right="102", row=1, column=2, points=("7", "8"),
        left_xy=np.array([[10.1234, -3.0], [2.5, 1.0]]), right_xy=np.array([[-80.5, -3.2], [-70.0, 0.9]]),
        parallax=np.array([0.00312, -0.21]), parallax_deviation=np.array([0.0021, 0.0022]),
        weight_factor=np.array([1.0, 0.1]), in_front=np.array([True, True]),
        base=np.array([0.0904, -0.0012, 0.0007]), base_deviation=np.array([0.0, 3e-6, 4e-6]),
        angles=np.radians([1.5, -0.25, 90.0]), angle_deviation=np.radians([0.001, 0.002, 0.003]),
        iterations=5, seuw=1.234, max_residual=0.0031, block=MODEL, remarks=("point 8 does not fit",),
    )  # fmt: skip


def similarity(step: str = "bridge", unit: float = 1.0) -> SimilarityStep:
    return SimilarityStep(
        step=step, source="M2", target="" if step == "absolute" else "M1",
        common_photo="102" if step == "bridge" else "", points=("7", "8"),
        coordinates=unit * np.array([[0.01, 0.02, -0.15], [0.03, NAN, -0.1512345]]),
        residuals=unit * np.array([[2e-6, -1e-6, 2.5e-5], [1e-6, NAN, -9e-5]]),
        weight_factor=np.array([[1.0, 1.0, 1.0], [1.0, NAN, 0.2]]),
        scale=1.0123 if unit == 1.0 else 2365.495, scale_deviation=2e-4, shift=unit * np.array([0.0904, -0.0012, 0.0]),
        shift_deviation=unit * np.array([4e-6, 5e-6, 6e-6]), angles=np.radians([0.1, 0.2, 0.3]),
        angle_deviation=np.radians([0.01] * 3), iterations=3, s0=0.987, max_residual=unit * 2.5e-5,
        remarks=("point 8 does not fit",),
    )  # fmt: skip


def fields(lines: list[str], first: str) -> list[str]:
    (row,) = [line.split() for line in lines if line.split()[:1] == [first]]
    return row


def test_a_relative_orientation_is_in_millimetres_and_degrees() -> None:
    overview = relative_overview([relative()])
    assert overview[0].split() == ["Model", "Left", "Right", "npts", "its", "seuw", "mres"]
    assert fields(overview, "M1") == ["M1", "101", "102", "2", "5", "1.234", "0.0031", "1", "down-weighted"]
    assert relative_remarks([relative()]) == ["", "  model M1: point 8 does not fit"]
    lines = relative_orientation_lines(relative())
    assert "  Model M1:  photo 101 (left) and photo 102 (right), row 1, column 2" in lines
    assert fields(lines, "7") == ["7", "10.1234", "-3.0000", "-80.5000", "-3.2000", "0.00312", "0.00210"]
    assert fields(lines, "8")[-1] == "down-weighted"
    assert fields(lines, "value") == ["value", "90.4000", "-1.2000", "0.7000", "1.50000", "-0.25000", "90.00000"]
    # the component that fixes the scale has no standard deviation
    assert fields(lines, "sd") == ["sd", "-", "(0.0030)", "(0.0040)", "(0.00100)", "(0.00200)", "(0.00300)"]


def test_a_bridging_is_in_millimetres_at_photo_scale() -> None:
    overview = similarity_overview([similarity()])
    assert fields(overview, "M2") == ["M2", "M1", "102", "2", "3", "0.987", "0.0250", "1", "down-weighted"]
    assert "(mm)" in overview[1]
    assert similarity_remarks([similarity()]) == ["", "  M2 to M1: point 8 does not fit"]
    lines = similarity_lines(similarity(), "m")
    assert "  Model M2 to model M1, photo 102 in both:  pnt 2  its 3  s0 0.987" in lines
    assert fields(lines, "7") == ["7", "10.0000", "20.0000", "-150.0000", "0.0020", "-0.0010", "0.0250"]
    # what is not known has no residual
    assert fields(lines, "8") == ["8", "30.0000", "-", "-151.2345", "0.0010", "-", "-0.0900", "down-weighted"]
    assert fields(lines, "value")[:5] == ["value", "1.01230", "90.4000", "-1.2000", "0.0000"]
    assert fields(lines, "sd")[:5] == ["sd", "(0.00020)", "(0.0040)", "(0.0050)", "(0.0060)"]
    assert not any("(m)" in line for line in lines)


@pytest.mark.parametrize(
    ("step", "title"),
    [("connect", "Strip of model M2 to strip of model M1:"), ("absolute", "Block of model M2 to the ground:")],
)
def test_what_is_moved_to_what(step: str, title: str) -> None:
    assert similarity_lines(similarity(step), "m")[1].startswith(f"  {title}  pnt 2")


def test_an_absolute_orientation_is_in_ground_units() -> None:
    lines = similarity_lines(similarity("absolute", unit=2000.0), "ft")
    assert fields(lines, "7") == ["7", "20.000", "40.000", "-300.000", "0.004", "-0.002", "0.050"]
    assert any("(ft)" in line for line in lines)
    assert not any("(mm)" in line for line in lines)
    # ground units per metre at photo scale
    assert any(line.split() == ["(ft/m)", *["(ft)"] * 3, *["(degrees)"] * 3] for line in lines)
    assert fields(lines, "value")[1] == "2365.49500"


def test_model_coordinates_before_and_after_the_ground() -> None:
    found = ModelCoordinates("relative", ("101", "102"), ("7", "8"), (MODEL,))
    lines = model_coordinate_lines(found, "m")
    assert "  System of model M1:" in lines
    photos = [line.split() for line in lines if line.split()[:1] == ["photo"]]
    assert photos[1] == ["photo", "102", "90.4000", "-1.2000", "0.7000", "-", "-", "-"]
    points = [line.split() for line in lines if line.split()[:1] == ["point"]]
    assert points[1] == ["point", "8", "30.0000", "-20.0000", "-151.2345", "0.0040", "0.0040", "0.0040"]
    assert any("(mm)" in line for line in lines)
    on_ground = model_coordinate_lines(ModelCoordinates("absolute", ("101", "102"), ("7", "8"), (MODEL,)), "m")
    assert "  Ground:" in on_ground
    assert any("(m)" in line for line in on_ground)
    assert not any("(mm)" in line for line in on_ground)


def test_failures_name_both_sides() -> None:
    assert failure_lines([NotOriented("M3", "", "no"), NotOriented("M3", "M1", "never")]) == [
        "  M3: no",
        "  M3 and M1: never",
    ]


def values(how: str = "relative orientation") -> PreliminaryValues:
    return PreliminaryValues(
        relative=(relative(),), bridges=(similarity(),), connections=(), absolute=similarity("absolute", 2000.0),
        failures=(NotOriented("M3", "", "photo 104 and photo 105 share 3 points, 5 are needed"),),
        photos=(PhotoStart("101", np.eye(3), np.zeros(3), how), PhotoStart("104", None, None, how)),
        points=PointStarts(("7",), np.array([[1.0, 2.0, 3.0]]), np.array([[0.01, 0.02, 0.03]])), findings=(how,),
    )  # fmt: skip


POINTS = [PreliminaryPoint("7", (1.0, 2.0, 3.0), (0.012, 0.022, 0.032)), PreliminaryPoint("8", (4.0, 5.0, 6.0), None)]


def listing(found: PreliminaryValues) -> list[str]:
    orientations = [[1.0, 2.0, 3.0, 10.0, 20.0, 30.0], [NAN] * 6]
    text = preliminary_listing(found, orientations, POINTS, "ft", (("Project", "CLIFF"),), "abc")
    assert text.endswith("\n")
    return text.splitlines()


def test_the_whole_listing() -> None:
    lines = listing(values())
    titles = [line for line, rule in pairwise(lines) if rule and not rule.strip("=")]
    assert titles[1:] == [
        "FINDINGS",
        "HOW EACH PHOTO WAS ORIENTED",
        "WHAT COULD NOT BE ORIENTED",
        "RELATIVE ORIENTATION",
        "MODEL BRIDGING",
        "ABSOLUTE ORIENTATION",
        "PHOTOS",
        "POINTS",
        "RELATIVE ORIENTATION: POINTS AND PARAMETERS",
        "MODEL BRIDGING: POINTS AND PARAMETERS",
    ]
    photos = lines[lines.index("PHOTOS") :]
    assert fields(photos, "101") == ["101", "1.000", "2.000", "3.000", "10.0000", "20.0000", "30.0000"]
    assert fields(photos, "104") == ["104", *"------"]
    points = lines[lines.index("POINTS") : lines.index("RELATIVE ORIENTATION: POINTS AND PARAMETERS")]
    assert fields(points, "7") == ["7", "1.000", "2.000", "3.000", "0.012", "0.022", "0.032"]
    # a point that was determined once has no deviations
    assert fields(points, "8") == ["8", "4.000", "5.000", "6.000", "-", "-", "-"]


def test_unknown_cameras() -> None:
    parameters = (35.0284, -0.16061, 0.13064, 0.0, -8.2e-6, *(0.0,) * 7)
    lines = listing(replace(values(), cameras=(CameraStart("LEICA", parameters),)))
    cameras = lines[lines.index("CAMERAS") : lines.index("PHOTOS")]
    assert fields(cameras, "LEICA") == ["LEICA", "35.028", "-0.161", "0.131", "-8.200e-06"]
    assert cameras[3].split() == ["(mm)", "(mm)", "(mm)", "(1/mm²)"]
    assert "CAMERAS" not in listing(values())


def test_long_sentences_are_wrapped() -> None:
    sentence = "photo P7 shares 3 points with its neighbours, 5 are needed; " * 5
    lines = listing(values(sentence))
    assert max(map(len, lines)) <= PAGE_WIDTH
    assert " ".join(sentence.split()) in " ".join(" ".join(lines).split())


def test_nothing_at_all() -> None:
    empty = PreliminaryValues((), (), (), None, (), (PhotoStart("1", None, None, "no points"),), (), ())
    text = preliminary_listing(empty, [[NAN] * 6], [], "m", (), "abc")
    titles = [line for line in text.splitlines() if line.isupper()]
    assert titles == ["HOW EACH PHOTO WAS ORIENTED", "PHOTOS", "POINTS"]
    assert text.splitlines()[-1].strip() == "none"
