"""Unknowns of antennas that nothing separates are named with the reason."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import noisy, solution, with_photos
from bundle.stations_of_block import MADE, stations, with_stations

from orip.records.control import NOT_GIVEN
from orip.records.definition import Antenna
from orip.records.results.solution import Diagnosis, Solution
from orip.structs import replace


def diagnosed(antenna: Antenna, *, control: bool = True, camera: tuple[str, ...] = (), **changes) -> list[Diagnosis]:
    """Return the diagnoses of the noisy block that concern the antenna; its kappas are all alike within degrees."""
    block = noisy(MADE, 11)
    block = replace(block, cameras=(replace(block.cameras[0], unknown=camera),))
    if not control:
        block = replace(block, control_points=())
    observed = tuple(replace(station, **changes) for station in stations(error=0.03))
    found = solution(with_stations(observed, antenna, block))
    return [
        each for each in found.diagnosis if each.where.startswith("antenna") or each.code in ("datum", "undetermined")
    ]


def test_lever_arm_z_and_a_height_shift() -> None:
    antenna = Antenna("GNSS", unknown=("LZ",), shift="session", shift_error=(1.0, 1.0, 1.0))
    (found,) = [each for each in diagnosed(antenna) if each.code == "inseparable"]
    assert "LZ of antenna GNSS and SZ of antenna GNSS correlate by -" in found.text
    assert "all photos look in the same direction" in found.text


def test_lever_arm_in_plan_and_a_shift_where_kappas_are_alike() -> None:
    antenna = Antenna("GNSS", unknown=("LX", "LY"), shift="session", shift_error=(5.0, 5.0, 5.0))
    found = [each for each in diagnosed(antenna) if each.code == "inseparable"]
    for arm, shift in (("LX", "SX"), ("LY", "SY")):
        (text,) = [each.text for each in found if f"{arm} of antenna GNSS and {shift}" in each.text]
        assert "all photos are turned alike in kappa" in text


def test_opposite_strips_separate_them() -> None:
    """Turning the camera of the middle strip round takes kappa by 180 degrees; the same points are measured."""
    turned = [5, 6, 7, 8, 9]
    block, orientations = noisy(MADE, 11), MADE.orientations.copy()
    orientations[turned, 5] += 3.141592653589793
    points = block.photo_points
    xy = points.xy - [0.12, -0.07]
    xy[[photo in turned for photo in points.photo.tolist()]] *= -1.0
    block = replace(
        block, photo_orientation=orientations, photo_points=replace(points, xy=xy),
        cameras=(replace(block.cameras[0], parameters=(153.0, *(0.0,) * 12)),),
    )  # fmt: skip
    antenna = Antenna("GNSS", unknown=("LX", "LY"), shift="session", shift_error=(5.0, 5.0, 5.0))
    observed = tuple(replace(each, angles=NOT_GIVEN, angle_error=NOT_GIVEN) for each in stations())
    found = solution(with_stations(observed, antenna, block))
    assert not [each for each in found.diagnosis if each.code == "inseparable"]


def test_lever_arm_z_and_principal_distance_at_one_flying_height() -> None:
    found = diagnosed(Antenna("GNSS", unknown=("LZ",)), camera=("C",))
    (text,) = [each.text for each in found if each.code == "inseparable"]
    assert "LZ of antenna GNSS and C of camera CAM correlate by" in text
    assert "one flying height" in text


def test_a_drift_of_two_stations() -> None:
    antenna = Antenna("GNSS", shift="strip", drift="strip", drift_error=(0.1, 0.1, 0.1))
    block = noisy(MADE, 11)
    observed = tuple(each for each in stations(error=0.03) if each.strip != "3" or each.photo in ("p11", "p12"))
    found = solution(with_stations(observed, antenna, block))
    (short,) = [
        each for each in found.diagnosis if "the drift of antenna GNSS strip 3 comes from 2 stations" in each.text
    ]
    assert short.code == "inseparable"
    assert 'drift = "session"' in short.remedy


def test_boresight_without_an_attitude() -> None:
    found = diagnosed(Antenna("GNSS", unknown=("BX",)), angles=NOT_GIVEN, angle_error=NOT_GIVEN)
    (text,) = [each.text for each in found if each.code == "undetermined"]
    assert text.startswith("BX of antenna GNSS cannot be determined: no station of it has an attitude")


def test_shifts_without_control_leave_the_datum_free() -> None:
    found = diagnosed(Antenna("GNSS", shift="session"), control=False, angles=NOT_GIVEN, angle_error=NOT_GIVEN)
    (datum,) = [each for each in found if each.code == "datum"]
    assert "3 shifts" in datum.text
    assert "unknown shifts of the stations" in datum.text


def test_shifts_that_are_not_significant_are_named_together() -> None:
    found = diagnosed(Antenna("GNSS", shift="strip"), angles=NOT_GIVEN, angle_error=NOT_GIVEN)
    (text,) = [each.text for each in found if each.code == "not-significant"]
    assert text == "the shift of strip 1, 2 and 3 of antenna GNSS is not significant"


@pytest.mark.parametrize(("size", "is_named"), [(1.5, True), (2.4, False)])
def test_of_a_shift_whose_plan_is_held_the_height_alone_is_tested(size: float, is_named: bool) -> None:
    """Fisher's F at 5 % has the limit 1.96² for one unknown, and 2.6, an error of 2.8, if the other two counted."""
    antenna = Antenna("GNSS", shift="session", shift_error=(1e-4, 1e-4, 200.0))
    attitude = {"angles": NOT_GIVEN, "angle_error": NOT_GIVEN}

    def shifted(height: float) -> Solution:
        observed = stations(error=0.03, shifts=np.tile([0.0, 0.0, height], (3, 1)))
        return solution(with_stations(tuple(replace(each, **attitude) for each in observed), antenna, noisy(MADE, 11)))

    (without,) = [each for each in shifted(0.0).antennas if each.name == "SZ"]
    found = shifted(size * without.sd - without.value)
    remedies = [each.remedy for each in found.diagnosis if each.code == "not-significant"]
    assert remedies == ['set shift = "none" in [[antenna]]'] * is_named


STRIP = with_photos(MADE, 5)
BORESIGHT_ALONE, WITH_LEVER_ARM = ("BX", "BY", "BZ"), ("LX", "LY", "BX", "BY", "BZ")


def of_boresight(antenna: Antenna, camera: tuple[str, ...], *, forth_and_back: bool) -> list[Diagnosis]:
    """Return what is said of the boresight in a strip with two control points close to its axis.

    A turn of the strip about these points moves the projection centres sideways, and only attitudes observed in both
    directions tell the boresight from it. Forth and back, every second photo is turned by 180 degrees.
    """
    block, orientations = noisy(STRIP, 11), STRIP.orientations.copy()
    turned = np.array([False, True, False, True, False]) & forth_and_back
    orientations[turned, 5] += np.pi
    points, principal_point = block.photo_points, STRIP.cameras[0, 1:3]
    xy = points.xy - principal_point
    xy[turned[points.photo]] *= -1.0
    control = sorted(block.control_points, key=lambda point: abs(point.coordinates[1]))[:2]
    block = replace(
        block, photo_orientation=orientations, photo_points=replace(points, xy=xy + principal_point),
        cameras=(replace(block.cameras[0], unknown=camera),), control_points=tuple(control),
    )  # fmt: skip
    observed = tuple(
        replace(station, angles=(*station.angles[:2], station.angles[2] + np.pi * turn), angle_error=(1e-4,) * 3)
        for station, turn in zip(stations(error=0.03), turned.tolist(), strict=False)
    )
    found = solution(with_stations(observed, antenna, block))
    return [each for each in found.diagnosis if each.code == "inseparable" and "BX" in each.text]


@pytest.mark.parametrize(
    ("antenna", "camera", "named"),
    [
        (Antenna("INS", unknown=BORESIGHT_ALONE, shift="session"), (), "BX of antenna INS and SY of antenna INS"),
        (Antenna("INS", unknown=WITH_LEVER_ARM), (), "LY of antenna INS and BX of antenna INS"),
        (Antenna("INS", unknown=BORESIGHT_ALONE), ("DX", "DY"), "BX of antenna INS and DY of camera CAM"),
        (
            Antenna("INS", unknown=BORESIGHT_ALONE, shift="session"), ("DX", "DY"),
            "SY of antenna INS and DY of camera CAM together",
        ),
        (Antenna("INS", unknown=WITH_LEVER_ARM), ("DX", "DY"), "LY of antenna INS and DY of camera CAM together"),
    ],
)  # fmt: skip
def test_boresight_without_opposite_strips(antenna: Antenna, camera: tuple[str, ...], named: str) -> None:
    (found,) = of_boresight(antenna, camera, forth_and_back=False)
    assert named in found.text
    assert found.text.endswith("all photos are turned alike in kappa")
    assert found.remedy == "opposite strips separate them, or hold one constant"
    assert not of_boresight(antenna, camera, forth_and_back=True)


def test_several_strips_and_good_control_determine_the_boresight_in_one_direction() -> None:
    antenna = Antenna("GNSS", unknown=BORESIGHT_ALONE, shift="session")
    texts = [each.text for each in diagnosed(antenna, camera=("DX", "DY")) if each.code == "inseparable"]
    assert not [text for text in texts if any(kind in text for kind in BORESIGHT_ALONE)]


@pytest.mark.parametrize("unknown", [("LX", "LY", "LZ"), ("BX", "BY", "BZ")])
def test_with_control_and_no_shift_nothing_is_inseparable(unknown: tuple[str, ...]) -> None:
    assert not [each for each in diagnosed(Antenna("GNSS", unknown=unknown)) if each.code == "inseparable"]
