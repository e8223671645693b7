"""Whatever is in a file of positions, it is read or complained of; nothing else happens."""

from __future__ import annotations

import random
import warnings
from pathlib import Path

import numpy as np
import pytest
from exchange.test_station_formats import MRK, POS, sbet
from hostile.fuzzing import mutated, require_words

from orip.errors import OripError
from orip.exchange.stations.source import read_epochs
from orip.trajectory.exposures import Matching, Sources, find_exposures
from orip.trajectory.stations import stations_in_project

# a JPEG with an EXIF segment of one GPS latitude, little-endian
_EXIF = (
    b"\xff\xd8\xff\xe1\x00\x5eExif\0\0II*\0\x08\0\0\0\x01\0\x25\x88\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0"
    b"\x02\0\x01\0\x02\0\x02\0\0\0N\0\0\0\x02\0\x05\0\x03\0\0\0\x38\0\0\0\0\0\0\0"
    b"\x35\0\0\0\x01\0\0\0\x21\0\0\0\x01\0\0\0\x09\0\0\0\x01\0\0\0\xff\xd9"
)
_XMP = b'<x:xmpmeta drone-dji:GpsLatitude="53.5" drone-dji:GimbalYawDegree="-1" drone-dji:RtkFlag="50"></x:xmpmeta>'
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
}


def fuzz(folder: Path, count: int, seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(count):
        name = chance.choice(sorted(SEEDS))
        data = mutated(chance.choice(SEEDS[name]), chance)
        (folder / name).write_bytes(data)
        try:
            with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
                warnings.simplefilter("error")
                parsed = read_epochs(folder / name, name)
                if not parsed.complaints and len(parsed.value):
                    found, _ = find_exposures(Sources(parsed.value), Matching(names="P{}"))
                    stations_in_project(found, "EPSG:25832", "m", (0.1, 0.1, 0.1), 0.01)
        except OripError as error:
            require_words(str(error))
        except Exception as error:
            message = f"{name} of {data!r} ended in {type(error).__name__}: {error}"
            raise AssertionError(message) from error


def test_some_hundred_mutated_files(tmp_path: Path) -> None:
    pytest.importorskip("exifread")
    fuzz(tmp_path, 400, 7)


@pytest.mark.long
def test_ten_thousand_mutated_files(tmp_path: Path) -> None:
    pytest.importorskip("exifread")
    fuzz(tmp_path, 10_000, 8)
