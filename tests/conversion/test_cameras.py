"""Cameras of other programs in orip's form: the two formulas show the same directions at the same pixels."""

from __future__ import annotations

import numpy as np
import pytest
from conversion.exchanged_blocks import PINHOLE

from orip.exchange.conversion.cameras import (
    convert_camera,
    directions_of_pixels,
    export_camera,
    lens_pixels,
    pixels_of_directions,
)
from orip.exchange.conversion.determined import unknown_parameters
from orip.exchange.conversion.image_axes import UnsuitableCameraError, axes_from_pixels, pixels_from_axes
from orip.exchange.conversion.lens_exact import parameters_from_polynomial, polynomial_from_parameters
from orip.exchange.conversion.lens_table import LENSES, directions_of_image, image_of_directions
from orip.records.camera import CAMERA_PARAMETERS, Camera, Sensor
from orip.records.exchanged import PIXELS, ExchangedCamera, ImageAxes, Lens
from orip.structs import replace

CORNER, CENTRE_OF_PIXEL, MIDDLE_UP = (
    ImageAxes(),
    ImageAxes(origin="first_pixel"),
    ImageAxes(origin="frame_centre", y="up"),
)
MM_UP = ImageAxes("mm", "frame_centre", "up")

EXACT = {
    "SIMPLE_RADIAL": ("opencv", {"fx": 3000, "fy": 3000, "cx": 2010, "cy": 1490, "k1": -0.16}, CORNER),
    "OPENCV": (
        "opencv",
        {"fx": 3000, "fy": 3000, "cx": 2010, "cy": 1490, "k1": -0.1, "k2": 0.03, "k3": -0.01, "p1": 1e-3, "p2": -7e-4},
        CENTRE_OF_PIXEL,
    ),
    "unequal without distortion": ("opencv", {"fx": 3009, "fy": 3000, "cx": 2010, "cy": 1490}, CORNER),
    "Metashape": (
        "agisoft",
        {"f": 3000, "cx": 2012, "cy": 1488, "k1": -0.1, "k2": 0.03, "k3": -0.01, "p1": 1e-3, "p2": -7e-4},
        CORNER,
    ),
    "Metashape of a drone": (
        "agisoft",
        {"f": 3000, "cx": 2012, "cy": 1488, "k1": -0.11, "k2": 0.05, "k3": 0.08, "k4": -0.076, "p1": 1e-3},
        CORNER,
    ),
    "OpenCV fisheye": (
        "equidistant",
        {"fx": 2000, "fy": 2000, "cx": 2012, "cy": 1488, "k1": 0.04, "k2": -0.012, "k3": 0.006, "k4": -0.0014},
        CORNER,
    ),
    "Metashape fisheye": (
        "agisoft_fisheye",
        {"f": 2000, "cx": 2012, "cy": 1488, "k1": 0.04, "k2": -0.012, "k4": -0.0014, "p1": 1e-3, "p2": -7e-4, "b1": 3},
        CORNER,
    ),
    "OPENCV with unequal focal lengths": (
        "opencv",
        {"fx": 3003, "fy": 3000, "cx": 2010, "cy": 1490, "k1": -0.1, "k2": 0.03, "p1": 1e-3, "p2": -7e-4},
        CENTRE_OF_PIXEL,
    ),
    "OpenCV fisheye with unequal focal lengths": (
        "equidistant",
        {"fx": 2006, "fy": 2000, "cx": 2012, "cy": 1488, "k1": 0.04, "k2": -0.012, "k3": 0.006, "k4": -0.0014},
        CORNER,
    ),
    "Metashape with b1": (
        "agisoft",
        {"f": 3000, "cx": 2012, "cy": 1488, "k1": -0.11, "k2": 0.05, "k3": 0.08, "k4": -0.076, "p1": 1e-3, "b1": 5},
        MIDDLE_UP,
    ),
    "Metashape, affinity alone": ("agisoft", {"f": 3000, "cx": 2012, "cy": 1488, "b1": 2.0, "b2": -3.0}, CORNER),
    "MicMac Fraser": (
        "fraser",
        {"f": 3000, "cx": 2012, "cy": 1488, "c1": -1e-8, "c2": 3e-16, "c3": -2e-23, "p1": 3e-7, "p2": -2e-7,
         "b1": 1e-3, "b2": -2e-3},
        CORNER,
    ),
    "Bundler": ("opencv", {"fx": 3000, "fy": 3000, "k1": -0.1, "k2": 0.03}, MIDDLE_UP),
    "VisualSFM": ("measured", {"f": 3000, "cx": 2012, "cy": 1488, "k1": 8e-9, "p1": 3e-7, "p2": -2e-7}, CORNER),
    "PhotoModeler": (
        "measured",
        {"f": 7.5, "cx": 0.05, "cy": -0.04, "k1": 1.2e-3, "k2": -2e-6, "p1": 1e-4, "p2": -2e-4, "b1": 1e-3},
        MM_UP,
    ),
    "AICON": (
        "isp",
        {"f": 7.5, "cx": 0.05, "cy": -0.04, "r0": 4.0, "a1": -1e-3, "a2": 2e-6, "a3": 1e-8, "p1": 1e-4, "p2": -2e-4,
         "b1": 1e-3, "b2": -3e-4},
        MM_UP,
    ),
}  # fmt: skip


def camera(lens: Lens, parameters: dict[str, float], axes: ImageAxes = CORNER) -> ExchangedCamera:
    return ExchangedCamera("1", 4000, 3000, lens, parameters, lens_axes=axes, ray_axes=axes, sensor_mm=(10.0, 7.5))


def directions() -> np.ndarray:
    """Over the frame of a camera of 3000 px and 4000 by 3000 pixels."""
    x, y = np.meshgrid(np.linspace(-0.66, 0.66, 9), np.linspace(-0.5, 0.5, 9))
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("name", EXACT)
def test_an_exact_camera_images_as_the_formula_it_comes_from(name: str) -> None:
    source = camera(*EXACT[name])
    converted = convert_camera(source, "K1")
    assert converted.is_exact
    of_orip = pixels_of_directions(converted.camera, directions())
    of_source = lens_pixels(source, (10.0, 7.5), directions())
    assert np.isfinite(of_orip).all()
    # 1e-9 px: Newton's method ends at 1e-13 of the largest coordinate
    assert np.abs(of_orip - of_source).max() < 1e-9


def test_signs_of_the_decentring_terms() -> None:
    """From y down to y up: P1 = p2 / C, P2 = -p1 / C for OpenCV's order; P1 = p1 / C, P2 = -p2 / C for Agisoft's."""
    for lens, by_name in (
        ("opencv", {"P1": 2e-4 / 7.5, "P2": -1e-3 / 7.5}),
        ("agisoft", {"P1": 1e-3 / 7.5, "P2": -2e-4 / 7.5}),
    ):
        focal = {"fx": 3000.0, "fy": 3000.0} if lens == "opencv" else {"f": 3000.0}
        source = camera(lens, {**focal, "cx": 2010.0, "cy": 1490.0, "p1": 1e-3, "p2": 2e-4})
        found = dict(zip(CAMERA_PARAMETERS, convert_camera(source, "K1").camera.parameters, strict=True))
        assert {name: found[name] for name in by_name} == pytest.approx(by_name)
        assert (found["C"], found["DX"], found["DY"]) == pytest.approx((7.5, 0.025, 0.025))


@pytest.mark.parametrize(
    ("source", "worst", "rms"),
    [
        # worst and root mean square misfit over the frame, pixels: computed independently, by numerical least squares
        (camera("division", {"fx": 3000.0, "fy": 3000.0, "cx": 2000.0, "cy": 1500.0, "k1": -0.2}), 0.026, None),
        (camera("division", {"fx": 3000.0, "fy": 3000.0, "cx": 2000.0, "cy": 1500.0, "k1": -0.05}), 2.4e-5, None),
    ],
)
def test_a_fit_is_as_near_as_was_found_independently(source: ExchangedCamera, worst: float, rms: float | None) -> None:
    converted = convert_camera(source, "K1")
    # figures printed with one or two digits, and on another grid
    assert converted.worst_px == pytest.approx(worst, rel=0.35)
    assert rms is None or converted.rms_px == pytest.approx(rms, rel=0.15)


def test_what_a_fit_leaves_is_taken_by_the_measurements() -> None:
    source = camera(
        "agisoft",
        {
            "f": 3000.0,
            "cx": 2010.0,
            "cy": 1490.0,
            "k1": 0.02,
            "k2": -0.03,
            "k3": 0.01,
            "p3": 0.5,
            "p1": 2e-3,
            "b1": 5.0,
        },
    )
    converted = convert_camera(source, "K1", accepts_any_fit=True)
    assert not converted.is_exact
    seen = lens_pixels(source, (10.0, 7.5), directions())
    assert np.abs(pixels_of_directions(converted.camera, directions()) - seen).max() > 1e-3
    corrected = converted.corrected_pixels(seen)
    assert np.abs(pixels_of_directions(converted.camera, directions()) - corrected).max() < 1e-7


def test_a_camera_too_far_from_the_polynomial_is_refused_by_name() -> None:
    source = camera("division", {"fx": 2000.0, "fy": 2000.0, "cx": 2000.0, "cy": 1500.0, "k1": -0.4})
    with pytest.raises(UnsuitableCameraError, match=r"camera '1': orip.*px.*--exact-distortion"):
        convert_camera(source, "K1")
    with pytest.raises(UnsuitableCameraError, match=r"camera '7' \(FOV\): orip has perspective and fisheye lenses"):
        convert_camera(ExchangedCamera("7", 100, 100, "unsupported", {}, "FOV"), "K1")
    with pytest.raises(UnsuitableCameraError, match="--frame"):
        convert_camera(ExchangedCamera("7", 0, 0, "opencv", {"fx": 1.0, "fy": 1.0}), "K1")
    with pytest.raises(UnsuitableCameraError, match="focal length"):
        convert_camera(ExchangedCamera("7", 10, 10, "opencv", {"fx": 0.0, "fy": 1.0}), "K1")


@pytest.mark.parametrize("k1", [0.0, -0.4])
def test_width_and_height_exchanged_are_named(k1: float) -> None:
    given = {"fx": 2000.0, "fy": 2000.0, "cx": 1511.0, "cy": 1980.0, "k1": k1}
    with pytest.raises(UnsuitableCameraError, match="of a frame of 3000 x 4000 pixels, and not of one of 4000 x 3000"):
        convert_camera(camera("opencv", given), "K1")
    assert convert_camera(replace(camera("opencv", {**given, "k1": 0.0}), columns=3000, rows=4000), "K1").is_exact
    assert convert_camera(camera("opencv", {**given, "cx": 1700.0, "k1": 0.0}), "K1").is_exact


def test_a_formula_that_no_camera_comes_near_gives_none_whatever_fit_is_accepted() -> None:
    source = camera("agisoft", {"f": 3000.0, "cx": 0.0, "cy": -10.0, "k1": 2.0**63, "b2": 0.3})
    with pytest.raises(UnsuitableCameraError, match="cannot be fitted"):
        convert_camera(source, "K1", accepts_any_fit=True)


@pytest.mark.parametrize("lens", LENSES)
def test_every_formula_is_undone_by_its_inverse(lens: Lens) -> None:
    focal = {"f": 3000.0} if "f" in LENSES[lens].names else {"fx": 3000.0, "fy": 3010.0}
    small = {"k1": 1e-10 if lens == "measured" else -0.05, "p1": 1e-9, "c1": 1e-9, "c5": 1e-36, "ex": 10.0, "k2": 1e-20}
    given = {name: value for name, value in small.items() if name in LENSES[lens].names}
    source = camera(lens, {**focal, "cx": 2010.0, "cy": 1490.0, **given})
    there = image_of_directions(source, directions())
    assert np.allclose(directions_of_image(source, there), directions(), atol=1e-12)


def test_a_parameter_that_the_lens_has_not_is_a_fault_of_its_reader() -> None:
    with pytest.raises(KeyError, match="k9"):
        convert_camera(camera("opencv", {"fx": 1.0, "fy": 1.0, "k9": 1.0}), "K1")


@pytest.mark.parametrize("axes", [CORNER, CENTRE_OF_PIXEL, MIDDLE_UP, MM_UP])
def test_axes_and_polynomials_are_undone(axes: ImageAxes) -> None:
    pixels = np.array([[0.0, 0.0], [0.5, 0.5], [4000.0, 3000.0], [17.25, 2900.5]])
    there = axes_from_pixels(pixels, axes, (4000, 3000), (10.0, 7.5))
    assert np.allclose(pixels_from_axes(there, axes, (4000, 3000), (10.0, 7.5)), pixels, atol=1e-12)
    given = (*(0.1 * (n + 1) * 10.0**-n for n in range(len(CAMERA_PARAMETERS) - 1)), 0.0)
    polynomial = polynomial_from_parameters(given, axes, (4000, 3000), 0.0025, at_measured=False)
    again = parameters_from_polynomial(polynomial, axes, (4000, 3000), 0.0025)
    assert again == pytest.approx(given, rel=1e-12, abs=1e-12)


def test_the_centre_of_the_first_pixel() -> None:
    assert pixels_from_axes(np.zeros((1, 2)), CENTRE_OF_PIXEL, (4000, 3000), None).tolist() == [[0.5, 0.5]]
    assert pixels_from_axes(np.zeros((1, 2)), MIDDLE_UP, (4000, 3000), None).tolist() == [[2000.0, 1500.0]]
    assert pixels_from_axes(np.array([[5.0, 3.75]]), MM_UP, (4000, 3000), (10.0, 7.5)).tolist() == [[4000.0, 0.0]]


def test_a_sensor_of_unknown_size_is_said_to_be_assumed() -> None:
    converted = convert_camera(PINHOLE, "K1")
    assert converted.size_is_assumed
    assert converted.camera.sensor is not None
    assert (converted.camera.sensor.width, converted.camera.sensor.height) == (36.0, 27.0)
    assert not convert_camera(camera("opencv", {"fx": 1.0, "fy": 1.0}), "K1").size_is_assumed


@pytest.mark.parametrize("name", [name for name in EXACT if EXACT[name][0] in ("opencv", "agisoft", "equidistant")])
def test_an_exact_camera_comes_back_as_it_was(name: str) -> None:
    source = camera(*EXACT[name])
    there = convert_camera(source, "K1").camera
    back = export_camera(there, "1", source.lens, source.lens_axes, source.ray_axes)
    assert back.worst_px == 0.0
    # columns of some thousand pixels have 1e-13 relative after the multiplications by the size of a pixel
    given = {**dict.fromkeys(back.camera.parameters, 0.0), **source.parameters}
    assert back.camera.parameters == pytest.approx(given, rel=1e-12, abs=1e-12)


def test_a_shear_after_distortion_is_all_that_is_fitted() -> None:
    """B2 stretches what is ideal: with b1 and b2 beside a large k4 the corners are off by hundredths of a pixel."""
    source = camera(
        "agisoft",
        {"f": 3000, "cx": 2012, "cy": 1488, "k1": -0.09, "k2": -0.08, "k3": 0.12, "k4": -0.076, "b1": 0.5, "b2": -0.3},
    )
    assert convert_camera(replace(source, parameters={**source.parameters, "b2": 0.0}), "K1").is_exact
    converted = convert_camera(source, "K1")
    assert 0.0 < converted.worst_px < 0.03
    seen = lens_pixels(source, (10.0, 7.5), directions())
    found = pixels_of_directions(converted.camera, directions())
    assert np.abs(found - converted.corrected_pixels(seen)).max() < 1e-7


def orip_camera(at_measured: bool = False, **values: float) -> Camera:
    given = {"C": 7.5, "DX": 0.03, "DY": -0.02, **values}
    parameters = tuple(given.get(name, 0.0) for name in CAMERA_PARAMETERS)
    sensor = Sensor(4000, 3000, 10.0, 7.5)
    return Camera("K1", parameters, "measured" if at_measured else "ideal", sensor=sensor)


HELD_BY = {
    "opencv": {"A1": 1e-3, "A3": -1e-3, "A5": 4e-6, "A7": -2e-8, "P1": 1e-4, "P2": -2e-4},
    "agisoft": {"A1": 1e-3, "A3": -1e-3, "A5": 4e-6, "A7": -2e-8, "P1": 1e-4, "P2": -2e-4},
    "fraser": {"A1": 1e-3, "A3": -1e-3, "A5": 4e-6, "A7": -2e-8, "P1": 1e-4, "P2": -2e-4, "B1": 1e-3, "B2": 2e-3},
}


@pytest.mark.parametrize("lens", HELD_BY)
@pytest.mark.parametrize("axes", [CORNER, CENTRE_OF_PIXEL, MIDDLE_UP, MM_UP])
def test_a_camera_is_exported_exactly_where_the_lens_holds_it(lens: Lens, axes: ImageAxes) -> None:
    camera = orip_camera(**HELD_BY[lens])
    exported = export_camera(camera, "7", lens, axes, axes)
    assert exported.worst_px == 0.0
    found = lens_pixels(exported.camera, (10.0, 7.5), directions())
    # coordinates of 2000 px, of 1e-16 relative, through polynomials of the seventh degree
    assert np.abs(found - pixels_of_directions(camera, directions())).max() < 1e-8
    again = convert_camera(exported.camera, "K1")
    assert again.is_exact
    assert np.abs(pixels_of_directions(again.camera, directions()) - found).max() < 1e-8


@pytest.mark.parametrize(
    ("lens", "camera", "worst"),
    [
        # fits to a hundredth of a pixel and better are found; an affinity has no home in OpenCV's model but fx, fy
        ("opencv", orip_camera(A3=-1e-3, B1=1e-3), 0.2),
        ("opencv", orip_camera(at_measured=True, A3=-1e-3, A5=2e-6), 0.1),
        ("fraser", orip_camera(at_measured=True, A3=-1e-3), 0.2),
        ("agisoft", orip_camera(A3=-1e-3, B1=1e-3, B2=-1e-3), 0.2),
        ("measured", orip_camera(A3=-1e-3), 0.5),
    ],
)
def test_where_it_does_not_the_fit_is_near_and_its_misfit_said(lens: Lens, camera: Camera, worst: float) -> None:
    exported = export_camera(camera, "7", lens, CORNER, CORNER)
    assert 0.0 < exported.worst_px < worst
    x, y = np.meshgrid(np.linspace(1.0, 3999.0, 7), np.linspace(1.0, 2999.0, 7))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    seen = directions_of_pixels(camera, pixels)
    off = np.hypot(*(lens_pixels(exported.camera, (10.0, 7.5), seen) - pixels).T)
    assert off.max() <= 1.05 * exported.worst_px


def test_a_measured_lens_is_exported_exactly() -> None:
    camera = orip_camera(at_measured=True, A3=-1e-3, A5=2e-6, P1=1e-4, B1=1e-3)
    exported = export_camera(camera, "7", "measured", MM_UP, CORNER)
    assert exported.worst_px == 0.0
    assert convert_camera(exported.camera, "K1").camera.parameters == pytest.approx(camera.parameters)


def test_a_fisheye_is_not_exported_as_a_perspective() -> None:
    lens, parameters, axes = EXACT["OpenCV fisheye"]
    converted = convert_camera(camera(lens, parameters, axes), "K1").camera
    assert converted.projection == "equidistant"
    with pytest.raises(UnsuitableCameraError, match="camera K1 has a fisheye lens"):
        export_camera(converted, "1", "opencv", axes, axes)
    found = export_camera(converted, "1", "equidistant", axes, axes)
    assert found.worst_px < 1e-6


def test_a_fisheye_camera_is_exported_exactly() -> None:
    camera = replace(orip_camera(A3=-1e-3, A5=4e-6, A9=1e-11), projection="equidistant")
    exported = export_camera(camera, "7", "equidistant", CORNER, CORNER)
    assert exported.worst_px == 0.0
    again = convert_camera(exported.camera, "K1")
    assert again.is_exact
    assert again.camera.parameters == pytest.approx(camera.parameters, abs=1e-20)


@pytest.mark.parametrize(
    ("lens", "free", "is_exact", "unknown"),
    [
        ("agisoft", ("f", "cx", "cy", "k1", "k4", "p1", "b1"), True, ("C", "DX", "DY", "A3", "A9", "P1", "B1")),
        ("agisoft", ("f", "k1", "k4", "b2"), False, ("C", "A3", "A5", "A7", "A9", "B2")),
        ("agisoft", ("f", "k1"), False, ("C", "A3", "A5", "A7")),
        ("opencv", ("fx", "fy", "k1", "k5", "p1"), False, ("C", "A3", "A5", "A7", "A9", "P2")),
        ("fraser", ("f", "c4"), True, ("C", "A9")),
    ],
)
def test_what_the_other_program_estimated_is_unknown(
    lens: Lens, free: tuple[str, ...], is_exact: bool, unknown: tuple[str, ...]
) -> None:
    source = replace(camera(lens, {}), free=free)
    assert unknown_parameters(source, is_exact=is_exact) == unknown


def test_equal_focal_lengths_stay_equal() -> None:
    """Not only to the last digit: COLMAP's models with one focal length hold cameras with equal ones alone."""
    source = replace(
        PINHOLE, columns=2832, rows=2128, parameters={"fx": 2971.1, "fy": 2971.1, "cx": 1416.0, "cy": 1064.0}
    )
    camera = convert_camera(source, "C").camera
    parameters = (camera.parameters[0] * 1.0001, *camera.parameters[1:])
    found = export_camera(replace(camera, parameters=parameters), "C", "opencv", PIXELS, PIXELS).camera.parameters
    assert found["fx"] == found["fy"]
