"""The commented texts of a new project, for the three kinds of block that most users begin with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

from msgspec import Struct

from orip.files.project.toml_text import toml_value

BlockKind = Literal["drone", "object", "film"]
"""A drone block with RTK, photos of an object with scale bars, scanned aerial film."""
BLOCK_KINDS: tuple[BlockKind, ...] = get_args(BlockKind)


class Start(Struct, frozen=True):
    """What is known of a new project.

    Parameters
    ----------
    name, user : str
        Of the project and its operator.
    focal_length : float
        Principal distance, mm.
    columns, rows : int
        Pixels of the sensor; not of film.
    pixel : float
        Size of a pixel of the sensor or the scan, micrometres.
    crs : str
        Coordinate reference system; empty: plane coordinates.
    photo_error : float
        A-priori error of a photo coordinate, pixels.
    control_error : float
        That of control points, or of scale bars, ground units.
    station_error : float
        That of exposure stations, ground units.
    """

    name: str
    user: str = ""
    kind: BlockKind = "drone"
    camera: str = "CAMERA"
    focal_length: float = 8.8
    columns: int = 5472
    rows: int = 3648
    pixel: float = 2.4
    crs: str = ""
    photo_error: float = 0.5
    control_error: float = 0.02
    station_error: float = 0.03


def starting_texts(start: Start) -> Mapping[str, str]:
    """Return the texts of a new project by file name; they are complete except for what has to be measured."""
    parts = [_PROJECT, _CAMERA[start.kind], _PHOTOS[start.kind], _BUNDLE + _DATUM.get(start.kind, "")]
    texts = {"orip.toml": "\n".join(_filled(part, start) for part in parts if _filled(part, start))}
    texts[f"{start.name}.PNT"] = _filled(_POINTS, start)
    for extension, text in _FURTHER[start.kind].items():
        texts[f"{start.name}.{extension}"] = _filled(text, start)
    return texts


def _filled(text: str, start: Start) -> str:
    pixel = start.pixel / 1000.0
    crs = f"crs = {toml_value(start.crs)}" if start.crs else '# crs = "EPSG:25832"'
    return text.format(
        name=start.name,
        quoted_name=toml_value(start.name),
        user=f"user = {toml_value(start.user)}" if start.user else '# user = "your name"',
        crs=crs,
        camera=toml_value(start.camera),
        c=f"{start.focal_length:g}",
        columns=start.columns,
        rows=start.rows,
        width=f"{start.columns * pixel:.6g}",
        height=f"{start.rows * pixel:.6g}",
        scan=f"{pixel:g}",
        photo_error=f"{start.photo_error:g}",
        a=f"{start.control_error:g}",
        s=f"{start.station_error:g}",
        up=f"{2.0 * start.station_error:g}",
    )


_PROJECT = """\
# {name}: what 'orip run' adjusts. Lines with # are comments; the reference has all keys.

[project]
name = {quoted_name}
{user}
# The coordinate reference system of all coordinates; without one they are plane coordinates with heights.
# It gives heights too, such as EPSG:25832+7837, where heights are above sea level and stations come from GNSS.
{crs}

# On the first page of the report: client, order, contractor, date ...
[report]
# title = "Quarry Hohenfels, flight 3"
# client = "Kalkwerk Hohenfels GmbH"
"""

_SENSOR = """\
# The camera. c is the principal distance in mm; the sensor has its pixels and its size in mm.
# 'unknown' are adjusted: remove what the block cannot determine, and the line if the camera is calibrated.
[[camera]]
name = {camera}
c = {c}
sensor = {{ columns = {columns}, rows = {rows}, width = {width}, height = {height} }}
unknown = ["C", "DX", "DY", "A3", "A5", "P1", "P2"]
"""

_CAMERA: Mapping[BlockKind, str] = {
    "drone": _SENSOR.replace(', "P1", "P2"]', "]"),
    "object": _SENSOR,
    "film": """\
# The camera, from its calibration certificate: principal distance, principal point, fiducial marks and distortion, mm.
# The marks below are nominal values of a 23 cm frame: replace them.
[[camera]]
name = {camera}
c = {c}
principal_point = [0.0, 0.0]
fiducials = [
    {{ name = "1", x = -106.0, y = -106.0 }},
    {{ name = "2", x = 106.0, y = -106.0 }},
    {{ name = "3", x = 106.0, y = 106.0 }},
    {{ name = "4", x = -106.0, y = 106.0 }},
]
""",
}

_PHOTOS: Mapping[BlockKind, str] = {
    "drone": """\
# How the antenna of the receiver relates to the camera. If the positions are those of the antenna, measure the lever
# arm along the photo's x, y and z axes; a shift of all stations is found by two control points or more.
# [[antenna]]
# name = "RTK"
# lever_arm = [0.0, 0.0, 0.12]
# shift = "session"

# The photos. 'orip stations import' adds those of a flight, with their stations; or write them here:
# [[photo]]
# name = "DJI_0001"
# camera = {camera}
""",
    "object": """\
# The photos, in any order and looking anywhere: orientations are computed.
# [[photo]]
# name = "IMG_0001"
# camera = {camera}
""",
    "film": """\
# The photos; 'scan' says that marks and points are measured in pixels of a scan, 'pixel' is in mm.
# [[photo]]
# name = "101"
# camera = {camera}
# scan = {{ pixel = {scan}, origin = "corner" }}
""",
}

_BUNDLE = """\
# The adjustment. The a-priori error of a photo coordinate weighs photos against control: half a pixel is usual for
# points that were measured by hand, 0.3 pixels for those that a program matched.
[[bundle]]
name = "MAIN"
measurement_precision = "{photo_error}px"
"""

_DATUM: Mapping[BlockKind, str] = {
    "object": """\
# A free network: scale bars alone give the scale. Remove the line where control points are to place the block.
datum = "free"
"""
}

_POINTS = """\
! Control points: name, X Y Z, and their a-priori errors. Negative errors: a check point, compared, without influence.
! name  X          Y          Z        aX   aY   aZ
! K1    1012.412   2008.150   101.204  {a}  {a}  {a}
! C1    1088.070   2051.963   101.871  -{a}  -{a}  -{a}
"""

_MEASUREMENTS = """\
! Photo points: a block for each photo, 'POINTS bundle photo'; pixels to the right and down from the upper left corner.
! The same name in several photos is the same point; those of the .PNT file are control or check points.
! POINTS MAIN {example}
! K1    2160.20   1149.86
! 104    225.24   3023.18
"""

_FURTHER: Mapping[BlockKind, Mapping[str, str]] = {
    "drone": {
        "STA": """\
! Exposure stations: photo, X Y Z, and their a-priori errors. 'orip stations import' writes them from the files of the
! flight. The errors that receivers state are those within one solution: 2 to 3 cm is rarely too pessimistic.
! photo     X           Y           Z        aX   aY   aZ
! DJI_0001  561957.590  5934109.323  142.336  {s}  {s}  {up}
""",
        "MEA": _MEASUREMENTS.replace("{example}", "DJI_0001"),
    },
    "object": {
        "LEN": """\
! Scale bars: name, the two points, XYZ (a distance in space), the distance and its a-priori error, ground units.
! One bar is the least; several, in different directions, check each other. The system is that of the first photo,
! unless control points place the block: then remove datum = "free" from [[bundle]] of orip.toml.
! name  from  to   code  distance  a
! B1    1001  1002 XYZ   1.50032   0.0001
""",
        "MEA": _MEASUREMENTS.replace("{example}", "IMG_0001"),
    },
    "film": {
        "MEA": """\
! Pixels of the scan: first the fiducial marks of a photo (A: affine), then its points.
! PHOTO 101 A
! 1    235.31   190.04
! 2  15891.18   190.22
! 3  15890.77 15843.90
! 4    234.90 15844.31
! POINTS MAIN 101
! K1   2160.20   1149.86
! 104  1225.24   3023.18
"""
    },
}
