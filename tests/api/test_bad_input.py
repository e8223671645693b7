"""Whatever is wrong in the arrays of a block is named with its table, column and index, all of it at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import orip
from orip.structs import replace

NAN, INF = float("nan"), float("inf")
XY = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
GROUND = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def photo_points(**changes: Any) -> dict[str, Any]:
    given = {"photo": ["1", "1", "2"], "point": ["A", "B", "A"], "xy": XY, "error": None}
    return {"photo_points": orip.PhotoPoints(**{**given, **changes})}


def photos(**changes: Any) -> dict[str, Any]:
    return {"photos": orip.Photos(**{"name": ["1", "2"], "camera": "C", **changes})}


def control(**changes: Any) -> dict[str, Any]:
    return {
        "control_points": orip.ControlPoints(**{"name": ["A", "B"], "coordinates": GROUND, "error": 0.1, **changes})
    }


def distance(**changes: Any) -> dict[str, Any]:
    given = {"name": ["L"], "start": ["A"], "end": ["B"], "distance": [5.0], "error": 0.1, "code": "XYZ"}
    return {"distances": orip.Distances(**{**given, **changes})}


def direction(**changes: Any) -> dict[str, Any]:
    given = {"set": ["S"], "station": ["A"], "target": ["B"], "direction": [5.0], "error": 0.1}
    return {"directions": orip.Directions(**{**given, **changes})}


def covariance(given: Any, **changes: Any) -> dict[str, Any]:
    return control(error=None, covariance=given, **changes)


def given_direction(**changes: Any) -> dict[str, Any]:
    given = {"name": ["G"], "start": ["A"], "end": ["B"], "direction": [[0.0, 0.0, 1.0]], "error": 0.1}
    return {"given_directions": orip.GivenDirections(**{**given, **changes})}


def element(**changes: Any) -> dict[str, Any]:
    given = {"name": ["1"], "group": "PHOTO", "kind": ["Z0"], "value": [5.0], "error": 0.1}
    return {"elements": orip.Elements(**{**given, **changes})}


def camera(**changes: Any) -> dict[str, Any]:
    return {"cameras": [orip.Camera(**{"name": "C", "c": 35.0, **changes})]}


def complaints(**changes: Any) -> list[str]:
    """Return the message for a block that is valid except for some arguments."""
    sound = {**camera(), **photos(), **photo_points(), **control()}
    try:
        orip.Block(**{**sound, **changes})
    except orip.InputError as error:
        return [str(complaint) for complaint in error.complaints]
    return []


def test_the_sound_block_is_sound() -> None:
    assert complaints(**distance(), **direction(), **element()) == []


WRONG: list[tuple[dict[str, Any], str]] = [
    # shapes and types
    (photo_points(xy=[1.0, 2.0, 3.0]), "photo_points.xy: has the shape (3,); (3, 2) is needed as photo_points.photo"),
    (
        photo_points(xy=XY[:2]),
        "photo_points.xy: has the shape (2, 2); (3, 2) is needed as photo_points.photo has",
    ),
    (photo_points(xy=[["1", "2"]] * 3), "photo_points.xy: is an array of <U1; numbers are needed"),
    (photo_points(xy=[[1.0, 2.0], [3.0]]), "photo_points.xy: is not an array; its shape is (n, 2)"),
    (photo_points(xy=np.array(XY) * 1j), "photo_points.xy: is an array of complex128; numbers are needed"),
    (photo_points(point=["A", "B"]), "photo_points.point: has 2 rows; 3 are needed as photo_points.photo has them"),
    (photo_points(point="ABA"), "photo_points.point: has the shape (); a list of names is needed"),
    (photo_points(error=[0.1, 0.2, 0.3]), "photo_points.error: has the shape (3,); (3, 2) is needed"),
    (photos(constant=np.ones((2, 6))), "photos.constant: is an array of float64; True and False are needed"),
    (photos(orientation=np.ones((6, 2))), "photos.orientation: has the shape (6, 2); (2, 6) is needed"),
    (control(coordinates=np.ones((3, 3))), "control_points.coordinates: has the shape (3, 3); (2, 3) is needed"),
    ({"cameras": [{"c": 35.0}]}, "cameras[0]: is {'c': 35.0}; an orip.Camera is needed"),
    ({"cameras": None}, "cameras: is None; a list of orip.Camera is needed"),
    ({"photos": [["1", "C"]]}, "photos: is [['1', 'C']]; an orip.Photos is needed"),
    ({"distances": [5.0]}, "distances: is [5.0]; an orip.Distances is needed"),
    ({"antennas": None}, "antennas: is None; a list of dicts is needed"),
    ({"antennas": [{"name": "GNSS"}, 5]}, "antennas[1]: is 5; a dict is needed"),
    # numbers
    (photo_points(xy=np.ma.masked_equal(XY, 4.0)), "photo_points.xy[1, 1]: is masked; leave out the row, or write"),
    (photo_points(point=np.ma.masked_equal(["A", "B", "A"], "B")), "photo_points.point[1]: is masked"),
    (photo_points(xy=[XY[0], [NAN, 4.0], XY[2]]), "photo_points.xy[1, 0]: 'nan' is not allowed; write a finite"),
    (photo_points(xy=[XY[0], XY[1], [5.0, INF]]), "photo_points.xy[2, 1]: 'inf' is not allowed; write a finite"),
    (photo_points(xy=[[1e31, 0.0], *XY[1:]]), "photo_points.xy[0, 0]: '1e+31' is too large for a number"),
    (photo_points(error=[[0.1, 0.0]]), "photo_points.error[0, 1]: an a-priori error of 0 is not allowed here"),
    (photo_points(error=-INF), "photo_points.error[0, 0]: '-inf' is not allowed"),
    (photos(orientation=[[INF] * 6] * 2), "photos.orientation[0, 0]: 'inf' is not allowed"),
    (control(coordinates=[[INF, 0, 0], GROUND[1]]), "control_points.coordinates[0, 0]: 'inf' is not allowed"),
    (
        control(error=[[0.1, NAN, 0.1]]),
        "control_points.error[0, 1]: the error of Y is NaN but its coordinate is",
    ),
    (control(coordinates=[[NAN] * 3, GROUND[1]]), "control_points[0]: point 'A' has no coordinate at all"),
    (control(error=None), "control_points: has both or none of error and covariance"),
    (control(covariance=np.eye(6)), "control_points: has both or none of error and covariance"),
    (covariance(np.eye(5)), "control_points.covariance: has the shape (5, 5); (2, 3, 3) or (6, 6) is needed"),
    (covariance("x"), "control_points.covariance: is no array of numbers"),
    (covariance(np.eye(6) - 1.0), "control_points.covariance[0, 0]: has to be finite, and above 0"),
    (covariance(np.eye(6) + np.eye(6, k=1)), "control_points.covariance: is not symmetric"),
    (covariance(2.0 * np.ones((6, 6))), "control_points.covariance: is not positive definite"),
    (covariance(np.eye(6), coordinates=np.full((2, 3), NAN)), "control_points.covariance: needs all coordinates"),
    (given_direction(direction=[[0.0, 0.0, 0.0]]), "given_directions.direction[0, 0]: direction 'G' has no length"),
    (given_direction(end=["A"]), "given_directions.end[0]: direction 'G' goes from 'A' to itself"),
    (given_direction(error=0.0), "given_directions.error[0]: an a-priori error of 0"),
    (given_direction(direction=[1.0]), "given_directions.direction"),
    (distance(distance=[-5.0]), "distances.distance[0]: distance 'L' of code XYZ is -5.0; write a length above 0"),
    (distance(error=NAN), "distances.error[0]: 'nan' is not allowed"),
    (direction(error=0.0), "directions.error[0]: an a-priori error of 0 is not possible for a direction"),
    (direction(zenith=[90.0], zenith_error=0.0), "directions.zenith_error[0]: an a-priori error of 0 is not possible"),
    (direction(zenith=[90.0]), "directions.zenith_error[0]: 'nan' is not allowed"),
    (element(value=[NAN]), "elements.value[0]: 'nan' is not allowed"),
    (camera(c=-35.0), "cameras[0]: c of camera 'C' is -35.0, but a number above 0 is required"),
    (
        camera(distortion={"A3": NAN}),
        "cameras[0]: A3 of distortion of camera 'C' is nan, but a finite number",
    ),
    # names
    (photo_points(photo=["1", "1", "3"]), "photo_points.photo[2]: photo 3 is not defined; known are: 1, 2"),
    (photo_points(point=["A", "B C", "A"]), "photo_points.point[1]: 'B C' has a blank; names are one word"),
    (photo_points(point=["A", 7, "A"]), "photo_points.point[1]: 7 is not text; a name is text"),
    (photo_points(point=["A", "A", "A"]), "photo_points[1]: point 'A' of photo '1' is already in row 0"),
    (photos(name=["1", ""]), "photos.name[1]: an empty name; choose another name"),
    (photos(name=["a", "A"]), "photos[1]: photo 'A' differs from 'a' in row 0 only in case"),
    (photos(camera=["C", "D"]), "photos[1]: photo '2' names camera 'D', which is not defined"),
    (control(name=["A", "A"]), "control_points[1]: point 'A' is already in row 0; keep one of the two rows"),
    (distance(end=["A"]), "distances.end[0]: distance 'L' goes from 'A' to itself; name two points"),
    (distance(code="ZY"), "distances.code[0]: 'ZY' is not a distance code"),
    (element(kind=["Z"]), "elements.kind[0]: 'Z' is not a kind of PHOTO"),
    (camera(unknown=["C", "A2"]), "cameras[0]: unknown of camera 'C': 'A2' is not a parameter"),
    (
        {"cameras": [orip.Camera("C", 35.0), orip.Camera("C", 36.0)]},
        "cameras[1]: camera 'C' is already defined",
    ),
    (
        {"preliminary_points": orip.PreliminaryPoints(["A"], [[1.0, NAN, 3.0]])},
        "preliminary_points.coordinates[0, 1]: 'nan' is not allowed",
    ),
    # settings
    ({"measurement_precision": -1}, "measurement_precision of bundle 'MAIN' is -1, but a precision is above 0"),
    ({"measurement_precision": "0.5px"}, "measurement_precision in pixels, but photo '1' and 1 more have"),
    ({"datum": "none"}, "datum of bundle 'MAIN' is \"none\", but 'control' or 'free' is required"),
    ({"datum_points": ["A"]}, "bundle 'MAIN' has datum_points, but they belong to a free datum"),
    ({"max_iterations": 2.5}, "max_iterations of bundle 'MAIN' is 2.5, but a whole number is required"),
    ({"crs": "EPSG:0"}, "EPSG:0"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG, ids=[message[:40] for _, message in WRONG])
def test_it_is_named_by_table_column_and_index(changes: dict[str, Any], message: str) -> None:
    assert any(message in complaint for complaint in complaints(**changes)), complaints(**changes)


def test_all_at_once() -> None:
    together = [
        photo_points(xy=[XY[0], [NAN, 4.0], XY[2]], error=0.0),
        photos(camera="D"),
        control(error=[[0.1, NAN, 0.1]]),
        distance(code="ZY"),
        direction(error=0.0),
        element(kind=["Z"]),
        camera(c=-35.0),
        {"datum": "none"},
    ]
    alone = [complaint for changes in together for complaint in complaints(**changes)]
    found = complaints(**{name: value for changes in together for name, value in changes.items()})
    assert sorted(found) == sorted(alone)
    assert len(found) >= 15


def test_thousands_of_wrong_numbers_are_counted() -> None:
    count = 1000
    names = [str(number) for number in range(count)]
    found = complaints(**photo_points(photo=["1"] * count, point=names, xy=np.full((count, 2), NAN)))
    assert found[0].startswith("photo_points.xy[0, 0]:")
    assert found[-1] == "photo_points.xy: and 1980 more of this kind"
    assert len(found) == 21


def test_messages_cannot_be_forged() -> None:
    """Control characters of names do not reach the terminal."""
    found = complaints(**photo_points(point=["A", "B\x1b[2J", "A"]))
    assert found
    assert all(complaint.isprintable() for complaint in found)


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=3),
    st.lists(st.text(max_size=2), max_size=3),
    arrays(st.sampled_from([np.float64, np.int64, np.bool_, "U2"]), st.tuples(st.integers(0, 3), st.integers(0, 6))),
)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_nothing_else_is_ever_raised(data: st.DataObject) -> None:
    table = data.draw(st.sampled_from((photo_points, photos, control, distance, direction, element)))
    ((argument, sound),) = table().items()
    column = data.draw(st.sampled_from(sound.__struct_fields__))
    complaints(**{argument: replace(sound, **{column: data.draw(ANYTHING)})})
