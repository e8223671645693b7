"""Names of other programs as orip's."""

from __future__ import annotations

import numpy as np

from orip.exchange.sources.names import distinct_names, mark_names, photo_names, point_names, short_names, unique_names
from orip.records.exchanged import ExchangedPoints


def test_file_names_without_folder_where_they_stay_different() -> None:
    assert photo_names(["sub1/100_7100.JPG", "sub2/100_7101.JPG"]) == ("100_7100", "100_7101")
    assert photo_names([r"D:\a b\IMG 1.JPG", "c/IMG 2.JPG"]) == ("IMG_1", "IMG_2")


def test_folders_stay_where_file_names_repeat() -> None:
    assert photo_names(["left/0001.jpg", "right/0001.jpg"]) == ("left_0001.jpg", "right_0001.jpg")
    assert photo_names(["a/x.jpg", "A/X.jpg"]) == ("a_x.jpg", "A_X.jpg_2")


def test_names_are_one_word_and_differ() -> None:
    assert unique_names(["a b", "a_b", "", "-", "#1", "ü"], "photo", ignoring_case=True) == (
        "a_b", "a_b_2", "photo", "photo_2", "1", "ü",
    )  # fmt: skip


def test_tracks_are_marked_and_never_meet_a_point_of_control() -> None:
    points = ExchangedPoints(("17", "17", "T18", "18"), np.zeros((4, 3)), np.array([True, False, False, True]))
    assert point_names(points, mark_names(points.marks)) == ("T17", "17", "T18", "T18_2")
    # so does one that is not measured
    assert point_names(points, mark_names([*points.marks, "T17"])) == ("T17_2", "17", "T18", "T18_2")


def test_tracks_in_files_with_one_kind_of_point_leave_marks_their_names() -> None:
    points = ExchangedPoints(("17", "17", "T17", "18"), np.zeros((4, 3)), np.array([True, False, False, True]))
    assert distinct_names(points) == ("TT17", "17", "T17", "18")
    assert distinct_names(points, marks_tracks=True) == ("TT17", "17", "T17", "T18")
    assert short_names(["5", "x y", "5"], str.isdigit, first=[2]) == ["1", "2", "5"]
