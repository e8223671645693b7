"""Marks that do not fit any film: in another unit, by too simple a transformation, given wrong; and such that do."""

from __future__ import annotations

import numpy as np
import pytest

from orip.arrays import FloatArray
from orip.errors import OrientationError
from orip.interior.definitions import Definitions
from orip.interior.orientation import OrientedMarks, orient_photo
from orip.mistakes.marks.all_films import marks_of_all_films
from orip.mistakes.marks.misnamed import misnamed_marks
from orip.mistakes.outside_frame import points_in_another_unit
from orip.records.camera import Camera, Mark
from orip.records.measurement import MeasuredMarks, PhotoObservations, PhotoOrientation, TransformationKind
from orip.records.photo import Photo

AROUND = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1.05, 0), (0, 1.05), (1.05, 0), (0, -1.05)]) * 106.0
NAMES = tuple(str(row + 1) for row in range(len(AROUND)))


def _film(
    name: str, given: FloatArray, kind: TransformationKind, skew: float, random: np.random.Generator
) -> OrientedMarks:
    """Return a film whose marks are measured within 3 µm, with coordinates that may be given otherwise."""
    turn = random.normal(0.0, 0.05)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [[1.0, skew], [0.0, 1.0]]
    measured = AROUND @ matrix.T + 140.0 + random.normal(0.0, 0.003, AROUND.shape)
    marks = MeasuredMarks(NAMES, measured, np.zeros(len(NAMES), dtype=bool), np.full_like(measured, np.nan))
    camera = Camera("A", (153.0, *[0.0] * 12), fiducials=tuple(map(Mark, NAMES, *given.T.tolist())))
    return orient_photo(PhotoOrientation(name, kind, marks), camera, on_template=False)


def _said(given: FloatArray, kind: TransformationKind = "A", skew: float = 0.0) -> list[str]:
    random = np.random.default_rng(7)
    films = [_film(str(row), given, kind, skew, random) for row in range(8)]
    photos = {film.adjustment.summary.name: Photo(film.adjustment.summary.name, "A") for film in films}
    definitions = Definitions({"A": Camera("A", (153.0, *[0.0] * 12))}, {}, {}, photos, {})
    return [warning.code for warning in marks_of_all_films(definitions, [film.adjustment for film in films])]


@pytest.mark.parametrize(
    ("factor", "kind", "skew", "said"),
    [
        (1.0, "A", 0.01, []),
        (1.0, "C", 0.0, []),
        (1.0, "C", 0.001, ["mark-transformation"]),
        (1.002, "W", 0.0, ["mark-transformation"]),
        (1e3, "A", 0.0, ["mark-unit"]),
        (1.0 / 25.4, "C", 0.0, ["mark-unit"]),
    ],
)
def test_unit_and_transformation(factor: float, kind: TransformationKind, skew: float, said: list[str]) -> None:
    assert _said(factor * AROUND, kind, skew) == said


@pytest.mark.parametrize(("factor", "said"), [(1.0, []), (10.0, ["mark-unit"]), (1e-3, ["mark-unit"])])
def test_marks_and_frame_in_two_units(factor: float, said: list[str]) -> None:
    film = _film("101", factor * AROUND, "A", 0.0, np.random.default_rng(12)).adjustment
    camera = Camera("A", (153.0, *[0.0] * 12), frame=(230.0, 230.0))
    definitions = Definitions({"A": camera}, {}, {}, {"101": Photo("101", "A")}, {})
    assert [warning.code for warning in marks_of_all_films(definitions, [film])] == said


def test_nominal_coordinates_are_off_in_all_films_alike() -> None:
    assert _said(AROUND + np.random.default_rng(8).normal(0.0, 0.03, AROUND.shape)) == ["marks-given-wrong"]


@pytest.mark.parametrize("seed", range(10))
def test_films_that_scatter_as_they_do_have_no_wrong_marks(seed: int) -> None:
    random = np.random.default_rng(seed)
    films = [_film(str(row), AROUND, "A", 0.0, random) for row in range(8)]
    assert misnamed_marks([film.adjustment for film in films]) == []


def test_films_scanned_from_the_back_have_no_marks_exchanged() -> None:
    random = np.random.default_rng(10)
    camera = Camera("A", (153.0, *[0.0] * 12), fiducials=tuple(map(Mark, NAMES, *AROUND.T.tolist())))
    films = []
    for row in range(6):
        seen = AROUND[[0, 1, 3]] * [-1.0, 1.0] + random.normal(0.0, 0.003, (3, 2))
        marks = MeasuredMarks(("1", "2", "4"), seen, np.zeros(3, dtype=bool), np.full_like(seen, np.nan))
        films.append(orient_photo(PhotoOrientation(str(row), "C", marks), camera, on_template=False).adjustment)
    assert all(film.mirrored for film in films)
    assert misnamed_marks(films) == []


@pytest.mark.parametrize(
    ("kind", "order", "factor", "said"),
    [
        ("A", (1, 0, 2, 3), 1.0, "marks 1 and 2 fit when their names are exchanged"),
        ("C", (2, 1, 0, 3), 1.0, "marks 1 and 3 fit when their names are exchanged"),
        ("C", (0, 1, 2, 3), -1.0, "they fit as a mirror image"),
    ],
)
def test_what_is_wrong_is_named_where_no_transformation_fits(
    kind: TransformationKind, order: tuple[int, ...], factor: float, said: str
) -> None:
    # the corners of a camera are no perfect square
    corners = AROUND[:4] + np.random.default_rng(11).normal(0.0, 0.02, (4, 2))
    measured = corners[list(order)] * [factor, 1.0]
    marks = MeasuredMarks(NAMES[:4], measured, np.zeros(4, dtype=bool), np.full_like(measured, np.nan))
    camera = Camera("A", (153.0, *[0.0] * 12), fiducials=tuple(map(Mark, NAMES, *corners.T.tolist())))
    with pytest.raises(OrientationError, match=said):
        orient_photo(PhotoOrientation("101", kind, marks), camera, on_template=False)


@pytest.mark.parametrize(
    ("marks", "points", "said"),
    [
        (1.0, 1.0, None),
        (1.0, 0.1, None),  # all points near one another
        (1.0, 1e3, "the POINTS lines seem to be in micrometres"),
        (1e3, 1.0, "the PHOTO lines seem to be in micrometres"),
        (1e3, 1e3, None),  # transformation A takes it
    ],
)
def test_points_in_another_unit_than_their_marks(marks: float, points: float, said: str | None) -> None:
    camera = Camera("A", (153.0, *[0.0] * 12), fiducials=tuple(map(Mark, NAMES, *AROUND.T.tolist())))
    measured = MeasuredMarks(NAMES, marks * AROUND, np.zeros(len(NAMES), dtype=bool), np.full_like(AROUND, np.nan))
    film = orient_photo(PhotoOrientation("101", "A", measured), camera, on_template=False)
    definitions = Definitions({"A": camera}, {}, {}, {"101": Photo("101", "A")}, {})
    at = points * np.random.default_rng(9).uniform(-100.0, 100.0, (20, 2))
    names = tuple(map(str, range(len(at))))
    observations = PhotoObservations(
        "MAIN", ("101",) * len(at), names, at, np.full_like(at, np.nan), np.zeros(len(at), dtype=bool)
    )
    warnings = list(points_in_another_unit(definitions, observations, {"101": film.transformation}))
    assert [(warning.code, warning.where) for warning in warnings] == ([("point-unit", "camera A")] if said else [])
    assert not said or said in warnings[0].text
