"""Scanned film: each photo with pixels, origin and turn of its own; mirrored scans; what a pixel is on the photo."""

from __future__ import annotations

import numpy as np
import pytest
from films import (
    DEFINITIONS,
    NO_PARAMETERS,
    POINTS,
    TICKS,
    complaints,
    marks_of,
    measured,
    photo,
    photo_coordinates,
    placed,
    points,
    template,
)

from orip.geometry.plane import PlaneTransformation
from orip.interior.in_force import interior_orientation
from orip.records.camera import Camera
from orip.records.photo import Photo, Scan
from orip.structs import replace

MICRO = 1e-9
"""mm."""
SCANS = {
    "S0": (0.0, Scan((0.0127, 0.0127))),
    "S90": (90.0, Scan((0.007, 0.0071), "centre")),
    "S180": (180.0, Scan((0.02, 0.01))),
    "S270": (270.0, Scan((0.05, 0.025), "centre")),
}
KINDS = pytest.mark.parametrize("kind", ["A", "C", "W"])
ALL = replace(
    DEFINITIONS,
    photos={**DEFINITIONS.photos, **{name: Photo(name, "Film", scan=scan) for name, (_, scan) in SCANS.items()}},
)


def in_pixels(place, scan):
    """Return photo millimetres to what a scanner would say: column right, row down."""
    scale = np.array([[1.0 / scan.pixel[0], 0.0], [0.0, -1.0 / scan.pixel[1]]])
    first = 0.5 if scan.origin == "centre" else 0.0
    return PlaneTransformation(scale @ place.matrix, scale @ place.shift - first)


def scanned(name, turn=0.4):
    degrees, scan = SCANS[name]
    return in_pixels(placed(degrees + turn, 40.0, -35.0), scan)


@KINDS
def test_four_scans_with_turns_pixels_and_origins_of_their_own_give_the_photo_coordinates_of_the_plate(kind):
    log = "".join(photo(name, scanned(name), kind) + points(name, scanned(name)) for name in SCANS)
    found = measured(log, definitions=ALL)
    plate = placed(33.0, 40.0, -35.0)
    on_plate = photo_coordinates(measured(photo("P3", plate, kind) + points("P3", plate)), "P3")
    for name in SCANS:
        coordinates = photo_coordinates(found, name, definitions=ALL)
        for point, xy in POINTS.items():
            assert coordinates[point] == pytest.approx(xy, abs=MICRO)
            assert coordinates[point] == pytest.approx(on_plate[point], abs=MICRO)
    interior = interior_orientation(ALL, found)
    assert not any(adjustment.mirrored for adjustment in interior.adjustments)
    assert max(np.abs(adjustment.residuals).max() for adjustment in interior.adjustments) < MICRO


@KINDS
@pytest.mark.parametrize("name", SCANS)
def test_mirrored_scan_is_recognised(kind, name):
    """A scanner that was fed the film upside down, or one whose rows count upwards."""
    upside_down = scanned(name)
    upside_down = PlaneTransformation(upside_down.matrix @ np.diag([-1.0, 1.0]), upside_down.shift)
    found = measured(photo(name, upside_down, kind), definitions=ALL)
    warnings = interior_orientation(ALL, found).warnings
    assert [(warning.code, warning.where) for warning in warnings] == [("mirrored", f"photo {name}")]


@pytest.mark.parametrize("kind", ["C", "W"])
def test_mirrored_scan_of_a_square_of_marks_has_no_conform_orientation_and_is_told_why(kind):
    square = {"1": (-15.0, -15.0), "2": (15.0, -15.0), "3": (15.0, 15.0), "4": (-15.0, 15.0)}
    definitions = ALL.with_camera(Camera("Film", NO_PARAMETERS, fiducials=marks_of(square)))
    mirror = PlaneTransformation(scanned("S90").matrix @ np.diag([-1.0, 1.0]), scanned("S90").shift)
    (fault,) = complaints(photo("S90", mirror, kind, marks=square), definitions=definitions)
    assert "is the film upside down?" in fault


@KINDS
def test_scanned_template_mounted_again_needs_its_ticks_alone(kind):
    scan = Scan((0.0127, 0.0127))
    template_record = replace(DEFINITIONS.templates["T1"], scan=scan)
    definitions = replace(ALL, templates={**DEFINITIONS.templates, "T1": template_record})
    first, again = placed(0.5, 10.0, 5.0), placed(90.7, 250.0, 3.0)
    on_film = placed(0.0, 40.0, 60.0)
    log = template(in_pixels(first, scan), kind, ticks=TICKS)
    log += photo("P1", in_pixels(first.after(on_film), scan), kind) + points(
        "P1", in_pixels(first.after(on_film), scan)
    )
    log += template(in_pixels(again, scan), kind, ticks=TICKS)
    log += points("P1", in_pixels(again.after(on_film), scan), {"9": (1.0, 2.0)})
    coordinates = photo_coordinates(measured(log, definitions=definitions), "P1", definitions=definitions)
    for point, xy in {**POINTS, "9": (1.0, 2.0)}.items():
        assert coordinates[point] == pytest.approx(xy, abs=MICRO)


# what a pixel is on the photo


def errors_of(found):
    observations = found.observations["MAIN"]
    return dict(zip(observations.points, observations.errors.tolist(), strict=True))


@pytest.mark.parametrize(("name", "along"), [("S0", (0, 1)), ("S90", (1, 0)), ("S180", (0, 1)), ("S270", (1, 0))])
def test_error_in_pixels_is_along_the_photo_axes_however_the_scan_lies(name, along):
    place = scanned(name, turn=0.0)
    ends = {"1001": "0.5px 2px", "1002": "0.004 1px"}
    found = measured(photo(name, place) + points(name, place, ends=ends), definitions=ALL)
    pixel = [SCANS[name][1].pixel[axis] for axis in along]
    assert errors_of(found)["1001"] == pytest.approx([0.5 * pixel[0], 2.0 * pixel[1]], rel=1e-9)
    assert errors_of(found)["1002"] == pytest.approx([0.004, pixel[1]], rel=1e-9)
    assert interior_orientation(ALL, found).pixel_sizes[name] == pytest.approx(pixel, rel=1e-9)


def test_error_in_pixels_of_points_measured_before_the_marks_is_that_of_their_mounting():
    place = scanned("S90", turn=0.0)
    early = measured(points("S90", place, ends={"1001": "1px 1px"}) + photo("S90", place), definitions=ALL)
    assert errors_of(early)["1001"] == pytest.approx([0.0071, 0.007], rel=1e-9)


def test_pixel_of_a_scan_that_lies_askew_is_the_mean_of_its_sides():
    """At 45 degrees a column and a row contribute alike."""
    scan = SCANS["S180"][1]
    place = in_pixels(placed(45.0, 10.0, 10.0), scan)
    definitions = replace(ALL, photos={**ALL.photos, "P4": Photo("P4", "Film", scan=scan)})
    found = measured(photo("P4", place) + points("P4", place, ends={"1001": "1px 1px"}), definitions=definitions)
    expected = np.sqrt((0.02**2 + 0.01**2) / 2.0)
    assert errors_of(found)["1001"] == pytest.approx([expected, expected], rel=1e-9)


def test_pixels_of_a_photo_turned_on_a_scanned_template():
    scan = Scan((0.02, 0.03))
    template_record = replace(DEFINITIONS.templates["T1"], scan=scan)
    definitions = replace(ALL, templates={**DEFINITIONS.templates, "T1": template_record})
    mounted, turned = placed(0.0, 10.0, 5.0), placed(90.0, 60.0, 40.0)
    place = in_pixels(mounted.after(turned), scan)
    log = template(in_pixels(mounted, scan)) + photo("P1", place) + points("P1", place, ends={"1001": "1px 1px"})
    found = measured(log, definitions=definitions)
    assert errors_of(found)["1001"] == pytest.approx([0.03, 0.02], rel=1e-9)
    assert interior_orientation(definitions, found).pixel_sizes["P1"] == pytest.approx([0.03, 0.02], rel=1e-9)
    # on top of the stores, with the template and the photo oriented there
    later = points("P1", place, {"7": (1.0, 1.0)}, ends={"7": "1px 1px"})
    on_top = measured(later, start=found, definitions=definitions)
    assert errors_of(on_top)["7"] == pytest.approx([0.03, 0.02], rel=1e-9)


def test_film_without_fiducials_measured_is_taken_to_lie_upright_in_its_scan():
    assert interior_orientation(ALL, measured("", definitions=ALL)).pixel_sizes["S90"] == (0.007, 0.0071)
