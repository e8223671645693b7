"""Warnings of one kind are one line with the first names and the number of the others."""

from __future__ import annotations

from orip.errors import ProjectWarning, by_kind

TEXT = "is seen by one ray, without preliminary coordinates: the distance from the photo is assumed"


def test_84_points_with_one_ray_are_one_line() -> None:
    (line,) = by_kind(ProjectWarning("one-ray", f"point {number}", TEXT) for number in range(1, 85))
    assert str(line).startswith("points 1, 2, 3 and 81 more are seen by one ray, without ")


def test_the_name_of_a_photo_has_no_plural() -> None:
    elements = [ProjectWarning("unused", f"element PHOTO 23FD05617 {kind}", "is not used") for kind in ("X0", "Y0")]
    (line,) = by_kind(elements)
    assert str(line) == "elements PHOTO 23FD05617 X0, Y0 are not used"
    (line,) = by_kind(ProjectWarning("unused", f"direction S1 A {target}", "is not used") for target in "BCDEF")
    assert str(line) == "directions S1 A B, C, D and 2 more are not used"


def test_single_warnings_and_their_order_stay() -> None:
    warnings = [
        ProjectWarning("a", "photo 1", "is dark"),
        ProjectWarning("b", "", "no file"),
        ProjectWarning("a", "x 1", "y"),
    ]
    assert by_kind(warnings) == warnings


def test_many_different_ones_of_a_code_are_shortened() -> None:
    given = [ProjectWarning("left-out", "", f"photo {number} is left out: {number} points") for number in range(40)]
    shown = by_kind(given)
    assert shown[:3] == given[:3]
    assert len(shown) == 4
    assert "37 more warnings of the kind 'left-out'" in shown[3].text


def test_a_text_that_is_a_sentence_about_its_place_follows_without_a_colon() -> None:
    assert str(ProjectWarning("a", "point 7", "is seen by one ray")) == "point 7 is seen by one ray"
    assert str(ProjectWarning("a", "photo 7", "no fiducial marks")) == "photo 7: no fiducial marks"
    assert str(ProjectWarning("a", "", "no control")) == "no control"
