"""Names beside marks: none over another, none over a mark, none beyond the frame."""

from __future__ import annotations

import numpy as np

from orip.report.drawings.svg import Box, labels

FRAME = Box(0.0, 0.0, 400.0, 300.0)


def box(label):
    """Where a label stands, as a browser would draw it: at least five pixels a letter and seven high."""
    width = 5.0 * len(label.name)
    left = label.x if label.anchor == "start" else label.x - width
    return Box(left, label.y - 7.0, left + width, label.y)


def test_in_a_crowd_no_name_covers_another_or_leaves_the_frame() -> None:
    random = np.random.default_rng(7)
    marks = random.uniform((0.0, 0.0), (400.0, 300.0), (150, 2))
    found = labels(marks, [f"P{row}" for row in range(len(marks))], FRAME)
    boxes = [box(label) for label in found]
    assert 40 < len(found) < 150
    assert not any(one.meets(other) for place, one in enumerate(boxes) for other in boxes[:place])
    assert all(FRAME.holds(box) for box in boxes)
    inside = [box for box in boxes for x, y in marks if box.left < x < box.right and box.top < y < box.bottom]
    assert not inside, "a name covers a mark"


def test_each_name_stands_beside_its_mark_where_there_is_room() -> None:
    marks = np.array([[50.0, 50.0], [200.0, 150.0], [395.0, 200.0], [np.nan, 10.0]])
    found = labels(marks, ["one", "two", "edge", "nowhere"], FRAME)
    assert [label.name for label in found] == ["one", "two", "edge"]
    assert [label.anchor for label in found] == ["start", "start", "end"], "at the right edge it stands to the left"
    for label, (x, y) in zip(found, marks[:3], strict=True):
        assert abs(label.x - x) <= 5.0
        assert abs(label.y - y) <= 10.0


def test_of_two_marks_at_one_place_both_are_named() -> None:
    found = labels(np.array([[100.0, 100.0], [100.0, 100.0]]), ["upper", "lower"], FRAME)
    assert [label.name for label in found] == ["upper", "lower"]
    assert found[0].y != found[1].y
