"""What of an adjustment becomes a preliminary value."""

from __future__ import annotations

import math

import numpy as np
import pytest
from workflow.quiet import run_quietly
from workflow.small_projects import first_project

from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.records.control import PreliminaryPoint
from orip.records.photo import PHOTO_PARAMETERS, Photo
from orip.records.results.solution import Estimates, Solution
from orip.solving.updated_values import (
    ChangedValue,
    EstimatedParameter,
    KeptValue,
    updated_camera,
    updated_photo,
    updated_points,
)
from orip.structs import replace

NAN, INF = math.nan, math.inf


def estimates(parameters: tuple[str, ...], sd: dict[str, float], value: float = 5.0) -> tuple[EstimatedParameter, ...]:
    return tuple(EstimatedParameter(parameter, value, sd.get(parameter, NAN)) for parameter in parameters)


def camera(**given: object) -> Camera:
    return Camera("C35", tuple(float(place) for place in range(13)), **given)  # type: ignore[arg-type]


def photo(**given: object) -> Photo:
    return replace(Photo("left", "C35", orientation=(1.0, 2.0, None, 10.0, 20.0, 30.0)), **given)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def solution(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    (outcome,) = run_quietly(first_project(tmp_path_factory.mktemp("first")))
    return outcome.solution


def test_unknowns_of_a_camera_alone_take_their_values() -> None:
    before = camera(unknown=("C", "A3"))
    after, found = updated_camera(before, estimates(CAMERA_PARAMETERS, {"C": 0.1, "A3": 0.1}))
    assert after == replace(before, parameters=(5.0, *before.parameters[1:4], 5.0, *before.parameters[5:]))
    assert found == [ChangedValue("C35", "C", 0.0, 5.0), ChangedValue("C35", "A3", 4.0, 5.0)]


def test_a_parameter_that_was_unknown_and_is_constant_by_now_stays() -> None:
    before = camera(unknown=("C",))
    after, found = updated_camera(before, estimates(CAMERA_PARAMETERS, {"DX": 0.1}))
    assert after == before
    assert found == [KeptValue("C35", "DX", "it is now held constant")]


def test_a_distortion_curve_goes_when_the_polynomial_is_another() -> None:
    curve = camera(unknown=("A3", "C"), distortion_curve=((0.0, 0.0), (1.0, 0.1)), distortion_isp=(1.0, 0.0, 0.0, 0.0))
    only_c, _ = updated_camera(curve, estimates(CAMERA_PARAMETERS, {"C": 0.1}))
    assert only_c.distortion_curve == curve.distortion_curve
    a3_too, _ = updated_camera(curve, estimates(CAMERA_PARAMETERS, {"A3": 0.1}))
    assert a3_too.distortion_curve is a3_too.distortion_isp is None


@pytest.mark.parametrize(("value", "sd"), [(5.0, INF), (NAN, 0.1), (INF, 0.1)])
def test_undetermined_and_diverged_unknowns_keep_their_values(value: float, sd: float) -> None:
    after, found = updated_photo(photo(), estimates(PHOTO_PARAMETERS, {"X0": sd}, value))
    assert after == photo()
    assert [value.parameter for value in found if isinstance(value, KeptValue)] == ["X0"]


def test_a_value_that_was_not_known_becomes_known() -> None:
    after, found = updated_photo(photo(), estimates(PHOTO_PARAMETERS, {"Z0": 0.1}))
    assert after.orientation == (1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
    assert found == [ChangedValue("left", "Z0", None, 5.0)]


def test_the_angles_of_an_undetermined_rotation_stay_together() -> None:
    sd = {"X0": 0.1, "OMEGA": 0.1, "PHI": INF, "KAPPA": 0.1}
    after, found = updated_photo(photo(), estimates(PHOTO_PARAMETERS, sd))
    assert after.orientation == (5.0, 2.0, None, 10.0, 20.0, 30.0)
    assert [value.parameter for value in found if isinstance(value, KeptValue)] == ["OMEGA", "PHI", "KAPPA"]


def test_a_constant_angle_is_no_reason_to_keep_the_others() -> None:
    after, _ = updated_photo(photo(constant=("KAPPA",)), estimates(PHOTO_PARAMETERS, {"OMEGA": 0.1, "PHI": 0.1}))
    assert after.orientation[3:] == (5.0, 5.0, 30.0)


def with_points(solution: Solution, **rows: tuple[tuple[float, ...], tuple[float, ...]]) -> Solution:
    values = np.array([value for value, _ in rows.values()])
    return replace(solution, points=Estimates(tuple(rows), values, np.array([sd for _, sd in rows.values()])))


def test_points_of_all_kinds(solution: Solution) -> None:
    adjusted = with_points(
        solution,
        new=((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
        held=((1.0, 2.0, 3.0), (NAN, NAN, NAN)),
        known_plan=((1.0, 2.0, 3.0), (NAN, NAN, 0.3)),
        sliding=((1.0, 2.0, 3.0), (0.1, 0.1, INF)),
        unlisted=((1.0, 2.0, 3.0), (0.1, 0.1, INF)),
        old=((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
    )
    here = (9.0, 9.0, 9.0)
    file = [PreliminaryPoint(name, here) for name in ("sliding", "by_hand", "old", "held")]
    after = updated_points(file, adjusted, wanted=None)
    there, deviations = (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)
    assert after.points == (
        PreliminaryPoint("sliding", here),
        PreliminaryPoint("by_hand", here),
        PreliminaryPoint("old", there, deviations),
        PreliminaryPoint("held", here),
        PreliminaryPoint("new", there, deviations),
        PreliminaryPoint("known_plan", there),
    )
    assert after.changed == ("old", "new", "known_plan")
    assert ChangedValue("old", "X", 9.0, 1.0) in after.values
    assert ChangedValue("new", "Z", None, 3.0) in after.values
    assert [(value.name, value.parameter) for value in after.kept] == [("sliding", "XYZ"), ("unlisted", "XYZ")]
    again = updated_points(after.points, adjusted, wanted=None)
    assert again.points == after.points
    assert not again.changed


def test_points_by_name(solution: Solution) -> None:
    one = ((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    after = updated_points([PreliminaryPoint("a", (9.0, 9.0, 9.0))], with_points(solution, a=one, b=one), {"b"})
    assert [point.coordinates[0] for point in after.points] == [9.0, 1.0]
    assert after.changed == ("b",)


def test_new_deviations_alone_are_a_change(solution: Solution) -> None:
    adjusted = with_points(solution, a=((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)))
    after = updated_points([PreliminaryPoint("a", (1.0, 2.0, 3.0))], adjusted, None)
    assert after.changed == ("a",)
    assert not after.values
