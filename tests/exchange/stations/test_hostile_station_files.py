"""Whatever is in a file of positions, it is read or complained of; nothing else happens."""

from __future__ import annotations

from pathlib import Path

import pytest
from exchange.mutated_files import use_mutated_files
from exchange.stations.test_station_formats import MRK, POS, sbet
from support.long_cases import every

from orip.stations.exposures import Matching, Sources, find_exposures
from orip.stations.imported import read_epochs
from orip.stations.in_project import stations_in_project

# a JPEG with an EXIF segment of one GPS latitude, little-endian
_EXIF = (
    b"\xff\xd8\xff\xe1\x00\x5eExif\0\0II*\0\x08\0\0\0\x01\0\x25\x88\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0"
    b"\x02\0\x01\0\x02\0\x02\0\0\0N\0\0\0\x02\0\x05\0\x03\0\0\0\x38\0\0\0\0\0\0\0"
    b"\x35\0\0\0\x01\0\0\0\x21\0\0\0\x01\0\0\0\x09\0\0\0\x01\0\0\0\xff\xd9"
)
_XMP = b'<x:xmpmeta drone-dji:GpsLatitude="53.5" drone-dji:GimbalYawDegree="-1" drone-dji:RtkFlag="50"></x:xmpmeta>'
_RINEX = """\
     2.10           OBSERVATION DATA    G (GPS)             RINEX VERSION / TYPE
                                                            END OF HEADER
 05  4  2  0  0 31.2500000  5  0
"""
SEEDS = {
    "a.pos": [POS.encode(), POS.replace("2020/12/24 21:28:42", "2137 422922").encode()],
    "a.MRK": [MRK.encode()],
    "a.sbet": [sbet(5).astype("<f8").tobytes()],
    "a.csv": [
        b"photo,X,Y,Z,sX,sY,sZ,omega,phi,kappa,q,strip\nP1,1,2,3,0.1,0.2,0.3,10,20,30,1,S\nP2,1,2,3,1,1,1,1,1,1,2,S\n",
        b"photo lon lat h roll pitch yaw time\nP1 9.9 53.5 100 1 2 3 422922.5\nP2 9.8 53.5 100 1 2 3 422923.5\n",
        b"photo;time\nP1;2020-12-24T21:28:42.5\n",
    ],
    "a.jpg": [_EXIF + _XMP, _EXIF],
    "a.obs": [
        _RINEX.encode(),
        bytes.fromhex("b5620d031c0000cc070024052405e803000000000000fc03000000000000320000006de5"),
    ],
}


def fuzz(folder: Path, count: int, seed: int) -> None:
    def use(path: Path) -> None:
        parsed = read_epochs(path, path.name)
        if not parsed.complaints and len(parsed.value):
            found, _ = find_exposures(Sources(parsed.value), Matching(names="P{}"))
            stations_in_project(found, "EPSG:25832", "m", (0.1, 0.1, 0.1), 0.01)

    sound = [(folder / name, data) for name, seeds in SEEDS.items() for data in seeds]
    use_mutated_files(sound, count, seed, use)


@pytest.mark.parametrize(("count", "seed"), every(2, [(400, 7), (10_000, 8)]))
def test_mutated_files(tmp_path: Path, count: int, seed: int) -> None:
    pytest.importorskip("exifread")
    fuzz(tmp_path, count, seed)
