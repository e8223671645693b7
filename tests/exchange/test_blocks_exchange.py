"""Blocks Exchange XML: all forms of rotations and cameras, read as a stream."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, written

from orip.exchange.blocks_exchange import is_blocks_exchange, read_blocks_exchange
from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.records.exchanged import ExchangedProject, PoseReading
from orip.structs import replace

MATRIX_DOWN = PoseReading("y_down", "to_camera", "matrix", "radian", "centre")
MATRIX_UP = PoseReading("y_up", "to_camera", "matrix", "radian", "centre")
ANGLES_DOWN = PoseReading("y_down", "to_ground", "omega_phi_kappa", "degree", "centre")

CAMERA = """<ImageDimensions><Width>4000</Width><Height>3000</Height></ImageDimensions>
<CameraModelType>Perspective</CameraModelType><SensorSize>24</SensorSize><FocalLength>18</FocalLength>
<PrincipalPoint><x>2009.5</x><y>1489.5</y></PrincipalPoint><Distortion><K1>0</K1><K2>0</K2><K3>0</K3></Distortion>
"""


def rotation(numbers: tuple[float, ...]) -> str:
    tags = [f"M_{n // 3}{n % 3}" for n in range(9)] if len(numbers) == 9 else ["Omega", "Phi", "Kappa"]
    return "".join(f"<{tag}>{float(value)!r}</{tag}>" for tag, value in zip(tags, numbers, strict=True))


def place(xyz: tuple[float, ...]) -> str:
    return "".join(f"<{tag}>{float(value)!r}</{tag}>" for tag, value in zip("xyz", xyz, strict=True))


def text(project: ExchangedProject, orientation: str = "", definition: str = "EPSG:32633") -> str:
    photos = "".join(
        f"<Photo><Id>{n + 10}</Id><ImagePath>a b/{photo.name}</ImagePath><Pose><Rotation>{rotation(photo.rotation)}"
        f"</Rotation><Center>{place(photo.position)}</Center></Pose></Photo>\n"
        for n, photo in enumerate(project.photos)
    )
    ties = []
    for point, xyz in enumerate(project.points.coordinates.tolist()):
        rows = np.flatnonzero(project.rays.point == point)
        marks = "".join(
            f"<Measurement><PhotoId>{project.rays.photo[row] + 10}</PhotoId><x>{project.rays.image[row, 0] - 0.5}</x>"
            f"<y>{project.rays.image[row, 1] - 0.5}</y></Measurement>"
            for row in rows
        )
        ties.append(f"<TiePoint><Position>{place(tuple(xyz))}</Position>{marks}</TiePoint>\n")
    control = (
        "<ControlPoint><SRSId>0</SRSId><Name>G1</Name><Position><x>1</x><y>2</y><z>3</z></Position><CheckPoint>true"
        "</CheckPoint><HorizontalAccuracy>0.01</HorizontalAccuracy><VerticalAccuracy>0.02</VerticalAccuracy>"
        "<Measurement><PhotoId>10</PhotoId><x>7</x><y>8</y></Measurement></ControlPoint>\n"
        "<ControlPoint><Name>G2</Name><Position><x>1</x><y>2</y><z>3</z></Position><Category>Vertical</Category>"
        "<Measurement><PhotoId>99</PhotoId><x>7</x><y>8</y></Measurement></ControlPoint>\n"
    )
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<BlocksExchange version="2.1"><SpatialReferenceSystems><SRS><Id>0</Id>'
        f"<Definition>{definition}</Definition></SRS></SpatialReferenceSystems><Block><Name>B</Name><SRSId>0</SRSId>\n"
        f"<Photogroups><Photogroup>{CAMERA}{orientation}{photos}</Photogroup></Photogroups>\n<ControlPoints>{control}"
        f"</ControlPoints>\n<TiePoints>{''.join(ties)}</TiePoints><PositioningConstraints><Scale><A>G1</A><B>G2</B>"
        "<DistanceAB>5</DistanceAB></Scale></PositioningConstraints></Block></BlocksExchange>\n"
    )


@pytest.mark.parametrize(
    ("reading", "orientation"),
    [
        (MATRIX_DOWN, ""),
        (MATRIX_UP, "<CameraOrientation>XRightYUp</CameraOrientation>"),
        (ANGLES_DOWN, "<CameraOrientation>XRightYDown</CameraOrientation>"),
    ],
)
def test_a_block_is_read_as_it_was_written(tmp_path: Path, reading: PoseReading, orientation: str) -> None:
    given = block(reading)
    source = written(tmp_path / "a.xml", text(given, orientation))
    assert is_blocks_exchange(source)
    project = read_well(read_blocks_exchange, source)
    assert project.readings == (reading,)
    found, is_declared = reprojected(_without_control(project))
    assert is_declared
    assert found.rms < 1e-6
    assert project.crs == "EPSG:32633"
    assert project.cameras[0].sensor_mm == pytest.approx((24.0, 18.0))
    assert project.photos[0].name == "a b/0.jpg"


def _without_control(project: ExchangedProject) -> ExchangedProject:
    active = project.points.is_track[project.rays.point]
    return replace(project, rays=replace(project.rays, is_active=active))


def test_control_has_kinds_and_accuracies(tmp_path: Path) -> None:
    project = read_well(read_blocks_exchange, written(tmp_path / "a.xml", text(block(MATRIX_DOWN))))
    first, second = project.control
    assert (first.errors, first.kind) == ((-0.01, -0.01, -0.02), "check")
    assert second.coordinates == (None, None, 3.0)
    assert [(bar.start, bar.end, bar.distance) for bar in project.distances] == [("G1", "G2", 5.0)]
    assert any("1 measurement in photos" in note for note in project.notes)


def test_the_published_angles_are_those_of_a_vertical_photo() -> None:
    # example in the format's description: a photo of a drone looking down
    reading = ANGLES_DOWN
    photo = replace(block(reading).photos[0], rotation=(179.6523, 0.04986, 179.9065), position=(0.0, 0.0, 0.0))
    rotations, _ = orip_poses([photo], reading)
    angles, _ = exchanged_poses(rotations, np.zeros((1, 3)), replace(reading, camera_axes="y_up"))
    # omega - 180, -phi, -kappa
    assert angles[0] == pytest.approx([-0.3477, -0.04986, -179.9065], abs=1e-9)


def test_a_local_plane_on_the_earth_is_known_by_its_definition(tmp_path: Path) -> None:
    source = written(tmp_path / "a.xml", text(block(MATRIX_DOWN), definition="ENU:52.5,13.4"))
    project = read_well(read_blocks_exchange, source)
    assert (project.frame.kind, project.frame.origin, project.crs) == ("topocentric", (13.4, 52.5, 0.0), None)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<FocalLength>18</FocalLength>", "", "no focal length"),
        ("EPSG:32633", "EPSG:4326", "longitude and latitude"),
        ("<Photogroup>", "<Photogroup><CameraOrientation>XUpYRight</CameraOrientation>", "XUpYRight"),
        ("<x>7</x>", "<x>seven</x>", "'seven' is not a number"),
        ("<M_00>", "<N_00>", "this is not XML"),
        ("<PhotoId>10</PhotoId>", "", "has no <PhotoId>"),
    ],
)
def test_faults_name_their_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    whole = text(block(MATRIX_DOWN))
    assert old in whole
    parsed = read_blocks_exchange(written(tmp_path / "a.xml", whole.replace(old, new, 1)), "a.xml")
    assert parsed.value is None
    assert said in parsed.complaints[0].message
    assert (parsed.complaints[0].line or 0) > 1
