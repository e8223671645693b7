"""Published blocks in plain arrays, sound as they are, in which blunders are planted.

Olympus: calibration of Börlin and Grussenmeyer (2013) on a sheet, with four control points; Strasbourg: their aerial
block; DCS260 and Zurich: the sample projects; Sceaux and Roma: reconstructions of COLMAP, of which some points are
control. Zurich is without the six control points that contradict it, and Strasbourg can be with observed stations.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from mistakes.edits import CONTRADICTING, SAMPLES
from mistakes.planted.blocks import Planted
from msgspec import Struct
from reference.aerial_project import COLUMNS, PIXEL, PRINCIPAL_POINT, ROWS, control, marks
from reference.olympus_camera import UNKNOWN, constant_control
from reference.olympus_projects import stations
from reference.published_data import REFERENCE_DATA, data_set, read_export, read_report, records
from scipy.spatial.transform import Rotation

import orip

Images = dict[tuple[str, str], np.ndarray]


def published_block(name: str) -> Planted:
    """Return a published block; the test is skipped where its data are not there."""
    return PUBLISHED[name]()


def _with_own_words(images: Iterator[tuple[str, ...]] | list[tuple[str, ...]]) -> Images:
    return {(f"P{photo}", point): np.array([float(x), float(y)]) for photo, point, x, y, *_ in images}


def _placed(found: dict[str, tuple[float, ...]], error: float | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {
        name: (np.array(numbers[:3]), np.array(numbers[3:6]) if error is None else np.full(3, error))
        for name, numbers in found.items()
    }


def _nothing_given(photos: list[str]) -> dict[str, np.ndarray]:
    return {photo: np.full(6, np.nan) for photo in photos}


# -------------------------------------------------------------------------------------------------------------- olympus

_OLYMPUS = {"columns": 2272, "rows": 1704, "width": 2272 * 5.43764 / 1704, "height": 5.43764}
_CALIBRATED = {
    "c": 7.457,
    "principal_point": [3.61546 - 1136 * 5.43764 / 1704, 852 * 5.43764 / 1704 - 2.61329],
    "distortion": {"A3": -4.58861e-3, "A5": 4.51351e-5, "A7": 2.05253e-6, "P1": 6.12803e-5, "P2": 4.41171e-5,
                   "B1": -3.89598e-4},
}  # fmt: skip


def _olympus(export: str, control_error: float, *, calibrated: bool = False, given: bool = False) -> Planted:
    folder = data_set("dbat-camcal-selfcal")
    found = constant_control(folder / "reference" / "camcal-fixed.txt")
    if export:
        read = read_export(REFERENCE_DATA / "dbat-camcal-defects" / export)
        images = _with_own_words(list(read.marks))
        orientation = {f"P{photo}": np.array(values) for photo, values in read.stations.items()}
    else:
        images = _with_own_words([tuple(row) for row in records(folder / "measurements" / "markpts.txt")])
        orientation = {
            f"P{photo}": np.array([station[kind].value for kind in station])
            for photo, station in stations(folder).items()
        }
    photos = list(dict.fromkeys(photo for photo, _ in images))
    camera: dict[str, Any] = {"name": "CAM", "sensor": _OLYMPUS, "distortion_at": "measured"}
    camera |= _CALIBRATED if calibrated else {"c": 7.3, "unknown": UNKNOWN}
    return Planted(
        "olympus",
        [camera],
        dict.fromkeys(photos, "CAM"),
        {photo: orientation[photo] for photo in photos} if given else _nothing_given(photos),
        images,
        _placed(found, control_error),
        settings={"measurement_precision": "0.16px"},
    )


# ----------------------------------------------------------------------------------------------------------- strasbourg


_OFF = "410"
"""A check point that is off by ten standard deviations as it is."""


def _strasbourg(*, every: int = 1, observed: bool = False) -> Planted:
    folder = data_set("dbat-sxb-aerial")
    # the photo points have errors of their own there: half a pixel, and a pixel
    found = list(marks(folder / "measurements"))
    ties = list(dict.fromkeys(mark[1] for mark in found if len(mark) == 4))[::every]
    images = _with_own_words([mark for mark in found if len(mark) > 4 or mark[1] in ties])
    shown = [point for _, point in images]
    images = {key: xy for key, xy in images.items() if shown.count(key[1]) > 1}
    photos = list(dict.fromkeys(photo for photo, _ in images))
    camera = {
        "name": "CAM",
        "c": 123.9392,
        "principal_point": [PRINCIPAL_POINT[0] - COLUMNS / 2 * PIXEL, ROWS / 2 * PIXEL - PRINCIPAL_POINT[1]],
        "sensor": {"columns": COLUMNS, "rows": ROWS, "width": COLUMNS * PIXEL, "height": ROWS * PIXEL},
    }
    settings: dict[str, Any] = {"measurement_precision": "1px"}
    if observed:
        report = read_report(folder / "result" / "report.txt")
        centres = [[report.photos[photo[1:]][kind].value for kind in ("X0", "Y0", "Z0")] for photo in photos]
        settings["stations"] = orip.Stations(photos, np.round(np.array(centres), 2), 0.2)
    given = control(folder / "reference" / "sxb-control.txt")
    seen = {point for _, point in images}
    return Planted(
        "strasbourg",
        [camera],
        dict.fromkeys(photos, "CAM"),
        _nothing_given(photos),
        images,
        _placed({name: numbers for name, numbers in given.items() if name in seen - {_OFF}}, None),
        settings=settings,
    )


# -------------------------------------------------------------------------------------------------------------- samples


def _sample(name: str, control_error: float, precision: float, unknown: tuple[str, ...] = ()) -> Planted:
    folder = SAMPLES / name
    text = tomllib.loads((folder / "orip.toml").read_text(encoding="utf-8"))
    camera, *_ = text["camera"]
    camera |= {"unknown": unknown} if unknown else {}
    images: Images = {}
    photo = ""
    (log,) = folder.glob("*.MEA")
    for line in log.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if words[:1] == ["POINTS"]:
            photo = words[2]
        elif words and words[0] != "!":
            images[photo, words[0]] = np.array([float(words[1]), float(words[2])])
    (points,) = folder.glob("*.PNT")
    found = {}
    for line in points.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if words and words[0] != "!" and words[0] not in CONTRADICTING:
            errors = [-1.0] * 3 if words[4].startswith("-") else [control_error] * 3
            found[words[0]] = (*map(float, words[1:4]), *errors)
    elements = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
    orientation = {photo["name"]: np.array([photo[kind] for kind in elements]) for photo in text["photo"]}
    block = Planted(
        name,
        [camera],
        dict.fromkeys(orientation, camera["name"]),
        orientation,
        images,
        _placed(found, None),
        settings={"measurement_precision": precision},
    )
    preliminary = folder / "MAIN.PRE"
    if preliminary.exists():
        rows = [line.split() for line in preliminary.read_text(encoding="utf-8").splitlines() if "!" not in line]
        rows = [row for row in rows if row]
        values = np.array([[float(value) for value in row[1:4]] for row in rows])
        block.settings["preliminary_points"] = orip.PreliminaryPoints([row[0] for row in rows], values)
    return block


# --------------------------------------------------------------------------------------------------------------- colmap


class _Point(Struct, frozen=True):
    xyz: np.ndarray
    rays: tuple[tuple[str, int], ...]


def _colmap(folder: str, every: int, control_count: int, precision: str, *, free: bool = False) -> Planted:
    kind, _, rest = folder.partition("/")
    path = data_set(kind) / rest
    _, _, columns, rows, *numbers = next(records(path / "cameras.txt"))
    f, cx, cy, k = map(float, numbers[:4])
    lines = [line for line in (path / "images.txt").read_text(encoding="utf-8").splitlines() if line[:1] != "#"]
    names, orientation, features = {}, {}, {}
    for head, points in zip(lines[::2], lines[1::2], strict=True):
        number, *pose = head.split()[:8]
        turn = Rotation.from_quat(np.array(pose[:4], dtype=float)[[1, 2, 3, 0]]).as_matrix()
        centre = -turn.T @ np.array(pose[4:], dtype=float)
        axes = turn.T @ np.diag([1.0, -1.0, -1.0])
        names[number] = f"P{number}"
        orientation[f"P{number}"] = np.array([*centre, *Rotation.from_matrix(axes).as_euler("XYZ", degrees=True)])
        features[number] = np.array(points.split(), dtype=float).reshape(-1, 3)
    found: list[_Point] = []
    for fields in records(path / "points3D.txt"):
        rays = [(fields[place], int(fields[place + 1])) for place in range(8, len(fields), 2)]
        if len(rays) >= 4 and len({photo for photo, _ in rays}) == len(rays) and float(fields[7]) < 1.0:
            found.append(_Point(np.array(fields[1:4], dtype=float), tuple(rays)))
    found.sort(key=lambda point: -len(point.rays))
    found = found[::every]
    spread = np.array([point.xyz for point in found])
    scale = float(np.median(np.linalg.norm(spread - np.median(spread, axis=0), axis=1)))
    images, given = {}, {}
    for row, point in enumerate(found):
        for photo, feature in point.rays:
            images[names[photo], str(1001 + row)] = features[photo][feature, :2]
        if row % max(1, len(found) // control_count) == 0:
            given[str(1001 + row)] = np.round(point.xyz / scale * 20.0, 3), np.full(3, 0.004)
    width = 0.005 * float(columns)
    c, pixel = 0.005 * f, 0.005
    camera: dict[str, Any] = {
        "name": "CAM", "c": c, "principal_point": [(cx - float(columns) / 2) * pixel, (float(rows) / 2 - cy) * pixel],
        "distortion": {"A3": k / c**2}, "sensor": {"columns": int(columns), "rows": int(rows), "width": width,
                                                   "height": 0.005 * float(rows)},
    }  # fmt: skip
    if free:
        camera["unknown"] = ["C", "A3"]
    for values in orientation.values():
        values[:3] *= 20.0 / scale
    return Planted(
        folder,
        [camera],
        dict.fromkeys(orientation, "CAM"),
        orientation,
        images,
        given,
        settings={"measurement_precision": precision},
    )


PUBLISHED: dict[str, Callable[[], Planted]] = {
    "olympus constant": lambda: _olympus("", 0.0),
    "olympus weighted": lambda: _olympus("", 0.001),
    "olympus calibrated": lambda: _olympus("", 0.001, calibrated=True, given=True),
    "olympus one ray": lambda: _olympus("camcal-pmexport-1ray.txt", 0.0, given=True),
    "olympus five": lambda: _olympus("camcal-pmexport5.txt", 0.001, calibrated=True),
    "strasbourg": _strasbourg,
    "strasbourg thinned": lambda: _strasbourg(every=6),
    "strasbourg stations": lambda: _strasbourg(observed=True),
    "dcs constant": lambda: _sample("dcs260_calibration", 0.0, 0.0041),
    "dcs weighted": lambda: _sample("dcs260_calibration", 0.0003, 0.0041),
    "zurich constant": lambda: _sample("zurich_city_hall", 0.0, 0.02, unknown=("C", "DX", "DY", "A3")),
    "zurich weighted": lambda: _sample("zurich_city_hall", 0.1, 0.02, unknown=("C", "DX", "DY", "A3")),
    "sceaux": lambda: _colmap("exchange/colmap/sceaux-9-text", 20, 10, "0.5px", free=True),
    "roma": lambda: _colmap("tracks/colmap", 1, 14, "1px", free=True),
}
"""By name; of these the planted blunders are found or not."""
