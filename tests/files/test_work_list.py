"""Lists of points to digitise: names alone, or measurement files with or without coordinates."""

from __future__ import annotations

from orip.files.log.writing import read_work_list


def listed(tmp_path, text):
    path = tmp_path / "list.txt"
    path.write_text(text)
    return read_work_list(path, "list.txt")


def test_names_and_blocks(tmp_path):
    found = listed(
        tmp_path,
        "! again\n7 a comment of no use\n\nPOINTS MAIN P101 ! from 'observations todo'\n  1001  ! predicted 1.2 3.4\n"
        "  1002  35.2310  -12.0040 0.004 0.004\npoints OTHER P102\n  1001\n",
    )
    assert found.complaints == ()
    assert [tuple(row) for row in found.value] == [
        ("7", None, None, 2),
        ("1001", "P101", "MAIN", 5),
        ("1002", "P101", "MAIN", 6),
        ("1001", "P102", "OTHER", 8),
    ]


def test_marks_and_edits_are_passed_over(tmp_path):
    marks = "TEMPLATE T A UPPER\n 1 2.0 3.0\nPHOTO P101 A\n 1 2.0 3.0\n"
    text = f"{marks}KILL POINT MAIN P101 3\nPOINTS MAIN P101\n 5 1.0 1.0\n"
    assert [row.point for row in listed(tmp_path, text).value] == ["5"]


def test_faults(tmp_path):
    found = listed(tmp_path, "-\nPOINTS P101\n 1\n= 3 4\n")
    assert [complaint.line for complaint in found.complaints] == [1, 2, 4]
    assert "write POINTS bundle photo" in found.complaints[1].message
    assert read_work_list(tmp_path / "none.txt", "none.txt").complaints[0].message.startswith("there is no such file")
