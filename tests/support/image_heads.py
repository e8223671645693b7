"""Heads of image files, without a picture: EXIF and XMP as cameras and drones write them."""

from __future__ import annotations

import struct
from pathlib import Path

DRONE = (
    '<x:xmpmeta drone-dji:GpsLatitude="53.5" drone-dji:GpsLongitude="9.9" drone-dji:AbsoluteAltitude="+120.25" '
    'drone-dji:GimbalYawDegree="-30" drone-dji:GimbalPitchDegree="-80" drone-dji:GimbalRollDegree="+0.00" '
    'drone-dji:RtkFlag="50" drone-dji:RtkStdLon="0.01" drone-dji:RtkStdLat="0.012" drone-dji:RtkStdHgt="0.03" />'
    "</x:xmpmeta>"
)
FOCAL_MM, FOCAL_35, X_RESOLUTION, UNIT, WIDTH = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002
MODEL, ORIENTATION = 0x0110, 0x0112


def _directory(tags: dict[int, object], start: int) -> bytes:
    """Return an IFD, little-endian, at an offset: whole numbers, fractions (two numbers) and texts."""
    rows, data = b"", b""
    after = start + 2 + 12 * len(tags) + 4
    for tag, value in sorted(tags.items()):
        kind, count, content = (
            (5, 1, struct.pack("<2I", *value)) if isinstance(value, tuple)
            else (2, len(value) + 1, value.encode() + b"\0") if isinstance(value, str)
            else (4, 1, struct.pack("<I", value))
        )  # fmt: skip
        if len(content) > 4:
            rows += struct.pack("<2H2I", tag, kind, count, after + len(data))
            data += content
        else:
            rows += struct.pack("<2HI", tag, kind, count) + content.ljust(4, b"\0")
    return struct.pack("<H", len(tags)) + rows + bytes(4) + data


def image(path: Path, size: tuple[int, int], tags: dict[int, object], xmp: str = "") -> Path:
    """Write a JPEG of a size, without a picture, with tags of EXIF and a packet of XMP."""
    main = {tag: value for tag, value in tags.items() if tag in (MODEL, ORIENTATION)}
    own = {tag: value for tag, value in tags.items() if tag not in main}
    length = len(_directory({**main, 0x8769: 0}, 8))
    tiff = b"II*\0\x08\0\0\0" + _directory({**main, 0x8769: 8 + length}, 8) + _directory(own, 8 + length)
    segments = [b"Exif\0\0" + tiff] if tags else []
    segments += [b"http://ns.adobe.com/xap/1.0/\0" + xmp.encode()] if xmp else []
    parts = [b"\xff\xd8", *(b"\xff\xe1" + struct.pack(">H", 2 + len(one)) + one for one in segments)]
    frame = b"\x08" + struct.pack(">2H", size[1], size[0]) + b"\x01\x01\x11\0"
    parts += [b"\xff\xc0" + struct.pack(">H", 2 + len(frame)) + frame, b"\xff\xd9"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(parts))
    return path


FULL = {MODEL: "Phantom", FOCAL_MM: (88, 10), X_RESOLUTION: (4000, 1), UNIT: 3, WIDTH: 5472}
