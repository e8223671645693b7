"""Stereo measurements and restituted features as text: read, written, and all that is wrong in them at once."""

from __future__ import annotations

from orip.files.log.stereo import feature_header, read_stereo, vertex_line
from orip.records.measurement import StereoFeature, StereoVertex
from orip.restitution.feature import Feature, Stereo, Vertex, read_features, snapped, text_with

ROAD = Feature(
    "LINE", "ROAD", "17",
    (
        Vertex((1.0, -2.5, 3.25), (0.01, 0.02, 0.03), Stereo("101", "102", -0.0042)),
        Vertex((4.0, 5.0, 6.0), (0.01, 0.02, 0.03)),
        Vertex((7.0, 8.0, 9.0)),
    ),
)  # fmt: skip
TREE = Feature("POINT", "TREE", "4", (Vertex((1.0, 1.0, 1.0)),))


VERTEX = "left photo, x, y, right photo, x, y, and an error of its own if it has one"


def faults(found):
    return [(fault.line, fault.message) for fault in found.complaints]


def features(found):
    return [(one.kind, one.code, one.name, one.vertices) for one in found]


def test_stereo_measurements_are_read_as_they_are_written(tmp_path):
    vertices = (
        StereoVertex("101", (1234.5, -987.25), "102", (910.2, 985.75)),
        StereoVertex("102", (1.0, 2.0), "103", (3.0, 4.0), 0.3),
    )
    path = tmp_path / "A.STE"
    path.write_text("\n".join([feature_header("LINE", "ROAD", "17"), *map(vertex_line, vertices)]), encoding="utf-8")
    found = read_stereo(path, "A.STE")
    assert not found.complaints
    (road,) = found.value
    read = tuple((one.left, one.left_xy, one.right, one.right_xy, one.error) for one in road.vertices)
    assert read == tuple((one.left, one.left_xy, one.right, one.right_xy, one.error) for one in vertices)
    assert isinstance(road, StereoFeature)
    assert [one.line for one in road.vertices] == [2, 3]


def test_all_that_is_wrong_in_stereo_measurements_is_said_at_once(tmp_path):
    path = tmp_path / "A.STE"
    path.write_text(
        "ROAD 17\n  1 2 3 4 5 6\nLINE A 1\n  101 1 2 102 3\n  101 1 2 101 3 4\n  101 1 x 102 3 4 -1\n"
        "AREA A 1\n  101 1 2 102 3 4\nPOINT B\n",
        encoding="utf-8",
    )
    assert faults(read_stereo(path, "A.STE")) == [
        (1, "'ROAD' is not the beginning of a feature; write one of POINT, LINE, AREA"),
        (4, f"a field is missing, 5 found; the line is: {VERTEX}"),
        (5, "left and right are one photo; a vertex is measured in two"),
        (6, "'x' is not a number; write a plain decimal such as 12.345"),
        (6, "the error of a measurement is above 0"),
        (7, "this AREA has 1 of at least 3 vertices; measure the others"),
        (9, "a field is missing, 2 found; the line is: POINT, LINE or AREA, then code and name"),
        (7, "A 1 is already on line 3; give one of them another name"),
    ]  # fmt: skip


def test_features_are_read_as_they_are_written(tmp_path):
    path = tmp_path / "A.GEO"
    path.write_text(text_with(None, (), (ROAD, TREE)), encoding="utf-8")
    found = read_features(path, "A.GEO")
    assert not found.complaints
    assert features(found.value) == features((ROAD, TREE))


def test_a_feature_takes_its_own_place_and_comments_stay(tmp_path):
    path = tmp_path / "A.GEO"
    text = "! mine\nPOINT TREE 4\n  1 1 1\nLINE ROAD 17 ! old\n  1 2 3\n  4 5 6\n! behind the road\n"
    path.write_text(text, encoding="utf-8")
    there = read_features(path, "A.GEO").value
    hut = Feature("AREA", "HUT", "1", tuple(Vertex((float(n), float(n * n), 0.0)) for n in range(3)))
    path.write_text(text_with(text, there, (hut, ROAD)), encoding="utf-8")
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[:4] == ["! mine", "POINT TREE 4", "  1 1 1", "LINE ROAD 17"]
    assert lines[7] == "! behind the road"
    assert features(read_features(path, "A.GEO").value) == features((TREE, ROAD, hut))


def test_all_that_is_wrong_in_features_is_said_at_once(tmp_path):
    path = tmp_path / "A.GEO"
    path.write_text("1 2 3\nLINE A 1\n  1 2\n  1 2 3 4 -5 6\n", encoding="utf-8")
    assert [line for line, _ in faults(read_features(path, "A.GEO"))] == [1, 3, 4]


def test_vertices_snap_to_the_nearest_and_a_line_to_its_own_start():
    square = [(0.0, 0.0, 0.0), (9.0, 0.0, 0.0), (9.0, 9.0, 0.0), (0.05, 0.0, 0.0)]
    ring = Feature("LINE", "RING", "1", tuple(Vertex(xyz) for xyz in square))
    near = Feature("POINT", "P", "1", (Vertex((1.0, 1.0, 1.08)),))
    (new_ring, new_near), count = snapped([TREE], [ring, near], 0.1)
    assert count == 2
    assert new_ring.vertices[-1] is new_ring.vertices[0]
    assert new_near.vertices[0] is TREE.vertices[0]
    assert snapped([TREE], [ring, near], 0.01)[1] == 0
