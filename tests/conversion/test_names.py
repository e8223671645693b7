"""Names of other programs as orip's."""

from __future__ import annotations

from orip.conversion.names import photo_names, point_names, unique_names


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
    assert point_names(["17", "17", "T18", "18"], [True, False, False, True]) == ("T17", "17", "T18", "T18_2")
