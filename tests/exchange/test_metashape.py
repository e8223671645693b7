"""Metashape: cameras XML, markers, lenses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, sample, written

from orip.exchange.conversion.cameras import convert_camera, export_camera, lens_pixels, pixels_of_directions
from orip.exchange.conversion.lens_table import image_of_directions
from orip.exchange.metashape.source import READING, is_metashape, read_metashape
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.geometry.rotation import rotation_from_angles
from orip.records.exchanged import ExchangedProject
from orip.structs import replace

SCALE = 2.5
TURN = rotation_from_angles(np.array([0.3, -0.2, 0.9]))
SHIFT = np.array([100.0, -50.0, 20.0])

SENSOR = """<sensors><sensor id="7" label="lens" type="frame"><resolution width="4000" height="3000"/>
<property name="pixel_width" value="0.006"/><property name="pixel_height" value="0.006"/>
<calibration type="frame" class="initial"><f>1</f></calibration>
<calibration type="frame" class="adjusted"><resolution width="4000" height="3000"/><f>3000</f><cx>10</cx><cy>-10</cy>
</calibration><covariance><params>f cx cy k1</params><coeffs>1 0 0 0</coeffs></covariance></sensor></sensors>
"""


def words(values: np.ndarray) -> str:
    return " ".join(str(float(value)) for value in np.ravel(values))


def document(project: ExchangedProject) -> str:
    """Return a chunk whose transform has to be applied; all points of the project are markers."""
    cameras = []
    for n, photo in enumerate(project.photos):
        matrix = np.eye(4)
        matrix[:3, :3] = TURN.T @ np.array(photo.rotation).reshape(3, 3)
        matrix[:3, 3] = TURN.T @ (np.array(photo.position) - SHIFT) / SCALE
        cameras.append(
            f'<camera id="{n + 3}" sensor_id="7" component_id="0" label="{photo.name}"><transform>{words(matrix)}'
            "</transform><location_covariance>1 0 0 0 1 0 0 0 1</location_covariance>"
            f'<reference x="{n}" y="2" z="3" sxyz="0.5" enabled="{"true" if n else "false"}"/></camera>'
        )
    cameras.append('<camera id="90" sensor_id="7" label="not aligned"/>')
    markers = [
        f'<marker id="{n}" label="M{n}"><reference x="{x}" y="{y}" z="{z}" sxy="0.01" sz="0.02" '
        f'enabled="{"false" if n == 1 else "1"}"/></marker>'
        for n, (x, y, z) in enumerate(project.points.coordinates.tolist())
    ]
    markers[2] = '<marker id="2" label="M0"/>'
    locations = "".join(
        f'<marker marker_id="{point}">'
        + "".join(
            f'<location camera_id="{photo + 3}" pinned="{"false" if point == 5 else "1"}" x="{x!r}" y="{y!r}"/>'
            for photo, ray_point, (x, y) in zip(
                project.rays.photo, project.rays.point, project.rays.image.tolist(), strict=True
            )
            if ray_point == point
        )
        + '<location camera_id="3" valid="0"/></marker>'
        for point in range(len(project.points.names))
    )
    return (
        '<?xml version="1.0"?><document version="1.5.0"><chunk label="Chunk 1">\n' + SENSOR
        + f'<components><component id="0"><transform><rotation>{words(TURN)}</rotation><translation>{words(SHIFT)}'
        f'</translation><scale>{SCALE}</scale></transform></component></components>\n<cameras><group id="0">'
        + "\n".join(cameras) + '</group></cameras>\n<markers><group id="1">' + "".join(markers) + "</group></markers>\n"
        + '<scalebars><scalebar id="0" label="bar"><marker id="0"/><marker id="1"/><reference distance="5" '
        'accuracy="0.01" enabled="true"/></scalebar></scalebars>'
        + f"<frames><frame id='0'><markers>{locations}</markers></frame></frames>\n"
        '<reference>LOCAL_CS["x"]</reference>'
        '<settings><property name="accuracy_tiepoints" value="0.7"/><property name="accuracy_projections" value="0.3"/>'
        "</settings></chunk></document>\n"
    )  # fmt: skip


def test_a_block_is_read_through_the_transform_of_its_chunk(tmp_path: Path) -> None:
    given = block(READING)
    source = written(tmp_path / "cameras.xml", document(given))
    assert is_metashape(source)
    project = read_well(read_metashape, source)
    assert len(project.photos) == len(given.photos)
    for found, expected in zip(project.photos, given.photos, strict=True):
        assert found.rotation == pytest.approx(expected.rotation, abs=1e-12)
        assert found.position == pytest.approx(expected.position, abs=1e-10)
        assert found.position_deviation == pytest.approx((SCALE, SCALE, SCALE))
    found_block, is_declared = reprojected(project)
    assert is_declared
    # markers are intersected: the document has no coordinates of them that are adjusted
    assert found_block.rms < 1e-6
    assert project.cameras[0].free == ("f", "cx", "cy", "k1")
    assert project.cameras[0].sensor_mm == pytest.approx((24.0, 18.0))
    assert project.precision == 0.7


def test_references_have_their_accuracies_and_signs(tmp_path: Path) -> None:
    project = read_well(read_metashape, written(tmp_path / "cameras.xml", document(block(READING))))
    control = {point.name: point for point in project.control}
    assert control["M0"].errors == (0.01, 0.01, 0.02)
    assert control["M1"].errors == (-0.01, -0.01, -0.02)
    assert control["M1"].kind == "check"
    assert "M0_2" in project.points.names  # a second marker of the label M0, without a reference
    assert "M0_2" not in control
    assert "M5" not in project.points.names  # not pinned
    assert [station.position_error[0] for station in project.stations[:2]] == [-0.5, 0.5]
    assert [(bar.start, bar.end, bar.distance, bar.error) for bar in project.distances] == [("M0", "M1", 5.0, 0.01)]
    assert set(project.rays.deviation.tolist()) == {0.3}
    assert any(note.startswith("1 camera ") for note in project.notes)


def test_a_chunk_on_the_earth_is_geocentric() -> None:
    project = read_well(read_metashape, sample("metashape", "geograypher", "camera.xml"))
    assert project.frame.kind == "geocentric"
    assert np.linalg.norm(project.photos[0].position) == pytest.approx(6.372e6, rel=1e-3)
    camera = project.cameras[0]
    assert camera.parameters["k4"] == -0.0761413904
    assert camera.parameters["cx"] == pytest.approx(2640.0 + 11.6738523909)
    assert camera.sensor_mm == pytest.approx((5280 * 0.0033582, 3956 * 0.0033582))


def test_a_drone_of_metashape_is_exact_with_corrected_measurements() -> None:
    camera = read_well(read_metashape, sample("metashape", "geograypher", "camera.xml")).cameras[0]
    converted = convert_camera(camera, "K1", accepts_any_fit=True)
    # its b2 of 0.3 px is what orip's polynomial does not hold; b1 and k4 are exact
    assert converted.worst_px < 0.025
    assert converted.rms_px < 0.005
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.7, 0.7, 29), np.linspace(-0.53, 0.53, 29)))
    pixels = lens_pixels(camera, camera.sensor_mm or (1.0, 1.0), np.column_stack([x, y]))
    off = pixels_of_directions(converted.camera, np.column_stack([x, y])) - converted.corrected_pixels(pixels)
    assert np.abs(off).max() < 1e-6


def test_a_fisheye_has_decentring(tmp_path: Path) -> None:
    text = document(block(READING)).replace("<f>3000</f>", "<f>3000</f><p1>1e-4</p1><p2>2e-4</p2><k4>1e-3</k4>")
    text = text.replace('type="frame"', 'type="fisheye"')
    camera = read_well(read_metashape, written(tmp_path / "a.xml", text)).cameras[0]
    converted = convert_camera(camera, "K1")
    assert converted.is_exact
    assert converted.camera.projection == "equidistant"
    # user manual of Metashape, appendix on camera models: angle over tangent takes the place of the tangent
    x, y = 0.6, -0.4
    angle = np.arctan(np.hypot(x, y)) / np.hypot(x, y)
    x, y = x * angle, y * angle
    s = x * x + y * y
    bent = 1.0 + 1e-3 * s**4
    u = 2010.0 + 3000.0 * (x * bent + 1e-4 * (s + 2 * x * x) + 2 * 2e-4 * x * y)
    v = 1490.0 + 3000.0 * (y * bent + 2e-4 * (s + 2 * y * y) + 2 * 1e-4 * x * y)
    seen = pixels_of_directions(converted.camera, np.array([[0.6, 0.4]]))[0]
    assert seen == pytest.approx([u, v], abs=1e-9)


def test_photoscan_of_old_has_other_parameters(tmp_path: Path) -> None:
    old = (
        "<calibration><fx>3010</fx><fy>3000</fy><cx>2010</cx><cy>1490</cy><skew>0.5</skew><k1>-0.1</k1><p1>1e-4</p1>"
        "<p2>2e-4</p2></calibration>"
    )
    text = document(block(READING)).replace(SENSOR[SENSOR.index("<calibration") : SENSOR.index("<covariance")], old)
    camera = read_well(read_metashape, written(tmp_path / "a.xml", text)).cameras[0]
    expected = {"f": 3000.0, "b1": 10.0, "b2": 0.5, "cx": 2010.0, "cy": 1490.0, "p1": 2e-4, "p2": 1e-4}
    assert {name: camera.parameters[name] for name in expected} == expected


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<f>3000</f>", "<f>0</f>", "<f> has to be above 0"),
        ("<f>3000</f>", "<f>x</f>", "'x' is not a number"),
        ('id="3"', 'id="-3"', "not a whole number"),
        ("<scale>2.5</scale>", "<scale>0</scale>", "scale of a transform"),
        ("<document ", '<!DOCTYPE d [<!ENTITY a "b">]><document ', "document type is declared"),
        ("</chunk>", "", "this is not XML"),
    ],
)
def test_faults_name_their_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = document(block(READING))
    assert old in text
    parsed = read_metashape(written(tmp_path / "a.xml", text.replace(old, new, 1)), "a.xml")
    assert parsed.value is None
    assert any(said in complaint.message for complaint in parsed.complaints)
    assert all(complaint.line for complaint in parsed.complaints)


def test_an_imported_drone_of_metashape_is_exact_without_being_asked() -> None:
    lens = read_well(read_metashape, sample("metashape", "geograypher", "camera.xml")).cameras[0]
    given = block(READING)
    camera = convert_camera(lens, "K1", accepts_any_fit=True)
    rows = np.flatnonzero(np.isfinite(given.rays.image).all(axis=1))
    directions = (given.rays.image[rows] - [2010.0, 1490.0]) / 3000.0
    pixels = image_of_directions(lens, directions)
    inside = ((pixels > 0.0) & (pixels < [lens.columns, lens.rows])).all(axis=1)
    rays = replace(
        given.rays,
        photo=given.rays.photo[rows[inside]],
        point=given.rays.point[rows[inside]],
        image=pixels[inside],
        deviation=given.rays.deviation[rows[inside]],
        is_active=given.rays.is_active[rows[inside]],
    )
    imported = imported_block(replace(given, cameras=(lens,), rays=rays), "drone", ExchangeSettings())
    seen = pixels_of_directions(camera.camera, directions[inside] * [1.0, -1.0])
    assert np.abs(seen - imported.pixels).max() < 1e-6  # asked are 0.01 px
    assert np.abs(pixels[inside] - imported.pixels).max() > 0.005
    assert any("measurements are corrected by that" in note for note in imported.notes)


def test_an_adjusted_camera_returns_with_the_shear_that_orip_does_not_hold() -> None:
    """What the import fits and the export fits back cancel, seen in the measurements before their correction."""
    lens = read_well(read_metashape, sample("metashape", "geograypher", "camera.xml")).cameras[0]
    imported = convert_camera(lens, "K1", accepts_any_fit=True)
    values = np.array(imported.camera.parameters)
    values[0] *= 1.01
    values[1:3] += 0.02, -0.03
    values[3:] *= 1.05
    adjusted = replace(imported.camera, parameters=tuple(values.tolist()))
    returned = export_camera(adjusted, lens.name, lens.lens, lens.lens_axes, lens.ray_axes, accepts_any_fit=True).camera
    assert returned.parameters["b2"] == pytest.approx(1.01 * 1.05 * lens.parameters["b2"], rel=0.01)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.65, 0.65, 15), np.linspace(-0.5, 0.5, 15)))
    raw = imported.pixels(image_of_directions(returned, np.column_stack([x, -y])))
    off = imported.corrected_pixels(raw) - pixels_of_directions(adjusted, np.column_stack([x, y]))
    # the correction is that of the imported camera: 0.02 px, of which a change of five per cent leaves a thousandth
    assert np.abs(off).max() < 0.002
