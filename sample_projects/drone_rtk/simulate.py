"""Makes the measurements, the flight's files, the control and the truth of this sample project.

    python simulate.py [FOLDER]

Collinearity is computed in a Cartesian system east, north, up in the middle of the block with SciPy's rotations, and
taken to the map grid by pyproj; nothing of orip is used. The same files come out every time.
"""

from __future__ import annotations

import json
import sys
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from scipy.spatial.transform import Rotation

SEED = 60
HERE = Path(__file__).parent
Array = NDArray[np.float64]

ORIGIN = (9.9372, 53.5527, 62.0)
"""Longitude, latitude (degrees) and height above the ellipsoid (m) of the middle of the block."""

CAMERA = {"C": 8.8214, "DX": 0.0312, "DY": -0.0187, "A3": -2.1e-5, "A5": 4.0e-8}
COLUMNS, ROWS, PIXEL = 5472, 3648, 13.2 / 5472
POINTING_PX = 0.3

HEIGHT, SPEED, INTERVAL = 80.0, 10.0, 2.4
"""Of the flight above the ground (m), m/s, seconds between two exposures."""
LINES = (
    ((-132.0, -54.0), (132.0, -54.0)), ((132.0, -18.0), (-132.0, -18.0)), ((-132.0, 18.0), (132.0, 18.0)),
    ((132.0, 54.0), (-132.0, 54.0)), ((-66.0, -60.0), (-66.0, 60.0)), ((66.0, 60.0), (66.0, -60.0)),
)  # fmt: skip
"""East and north of the first and the last exposure of each strip: four strips, two across."""
TURN_SECONDS = 9.0

WEEK, START = 2315, 384_120.0
"""GPS week, and second of it at the first epoch."""
EPOCH = 0.2
GNSS = (0.010, 0.010, 0.018)
"""Standard deviations of a position east, north, up (m)."""
ANTENNA = (0.02, 0.01, 0.12)
"""From the camera to the antenna, m, to the right, forward and up of the drone."""

SHIFTED_STRIP, SHIFT = 3, (0.14, -0.09, 0.21)
"""In this strip the ambiguities were fixed to wrong numbers: east, north, up, m."""
BAD_PHOTO, BAD_FIX = 44, (0.55, 0.30, -0.85)
"""The position of this photo alone is wrong by so much."""

TARGETS = {"K1": (-118.0, -40.0), "K2": (121.0, 46.0), "C1": (2.0, 5.0), "C2": (-96.0, 49.0), "C3": (104.0, -46.0)}
"""East and north: K are control points, C check points."""
SURVEY = (0.008, 0.008, 0.012)
TIES = 170

POS_HEADING = (
    "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)"
    "  sdeu(m)  sdun(m) age(s)  ratio\n"
)

GEODETIC = CRS.from_epsg(4258).to_3d()
_TO_GEOCENTRIC = Transformer.from_crs(GEODETIC, CRS.from_epsg(4936), always_xy=True)
_TO_GRID = Transformer.from_crs(CRS.from_epsg(4258), CRS.from_epsg(25832), always_xy=True)


def axes_at(longitude: float, latitude: float) -> Array:
    """Return east, north and up as rows, geocentric."""
    lon, lat = np.radians([longitude, latitude])
    return np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )


def geographic(local: Array) -> Array:
    """Return longitude, latitude (degrees) and height (m) of places (n, 3) in the local system."""
    origin = np.array(_TO_GEOCENTRIC.transform(*ORIGIN))
    return np.column_stack(_TO_GEOCENTRIC.transform(*(origin + local @ axes_at(*ORIGIN[:2])).T, direction="INVERSE"))


def grid(local: Array) -> Array:
    """Return easting, northing and height above the ellipsoid."""
    places = geographic(local)
    return np.column_stack([*_TO_GRID.transform(places[:, 0], places[:, 1]), places[:, 2]])


def grid_angles(local: Array, rotation: Array) -> Array:
    """Return omega, phi, kappa (degrees) against grid east, grid north and the ellipsoid's normal."""
    angles = []
    for place, turn in zip(geographic(local), rotation, strict=True):
        step = 1e-5
        ahead = np.subtract(
            _TO_GRID.transform(place[0], place[1] + step), _TO_GRID.transform(place[0], place[1] - step)
        )
        convergence = np.arctan2(ahead[0], ahead[1])  # from grid north to true north, clockwise
        to_place = axes_at(place[0], place[1]) @ axes_at(*ORIGIN[:2]).T
        to_grid = Rotation.from_euler("z", -convergence).as_matrix()
        angles.append(Rotation.from_matrix(to_grid @ to_place @ turn).as_euler("XYZ", degrees=True))
    return np.array(angles)


def ground(east: Array, north: Array) -> Array:
    """Return the height of the ground in the local system, m."""
    return 3.0 * np.sin(east / 47.0) + 2.0 * np.cos(north / 31.0 + 0.4) + 0.01 * east


def flight(random: np.random.RandomState) -> tuple[Array, Array, Array]:
    """Return times of the exposures, their strips, and knots (time, east, north) of the planned path."""
    times, strips, knots = [], [], []
    now = 20.0
    for strip, (first, last) in enumerate(LINES, start=1):
        ends = np.array([first, last])
        length = float(np.linalg.norm(ends[1] - ends[0]))
        count = round(length / (SPEED * INTERVAL)) + 1
        moments = now + INTERVAL * np.arange(count) + 0.03 * random.normal(size=count)
        times += moments.tolist()
        strips += [strip] * count
        unit = (ends[1] - ends[0]) / length
        duration = length / SPEED
        for moment, place in ((now - 1.0, ends[0] - unit * SPEED), (now + duration + 1.0, ends[1] + unit * SPEED)):
            knots.append((moment, *place))
        now += duration + TURN_SECONDS
    return np.round(times, 6), np.array(strips), np.array(knots)


def camera_at(time: Array, knots: Array) -> Array:
    """Return the places (n, 3) of the camera: the planned path with the drone's slow swaying about it."""
    t = np.asarray(time)
    east = np.interp(t, knots[:, 0], knots[:, 1]) + 0.25 * np.sin(t / 7.1) + 0.1 * np.sin(t / 2.9 + 1.0)
    north = np.interp(t, knots[:, 0], knots[:, 2]) + 0.25 * np.cos(t / 6.3) + 0.1 * np.sin(t / 3.7 + 2.0)
    up = HEIGHT + 0.3 * np.sin(t / 11.0) + 0.08 * np.sin(t / 2.3)
    return np.column_stack([east, north, up])


def heading_at(time: Array, knots: Array) -> Array:
    """Return the heading (radians, clockwise from north): along the strip, between strips that of the one before."""
    strip = np.clip((np.searchsorted(knots[:, 0], time) - 1) // 2, 0, len(knots) // 2 - 1) * 2
    way = knots[strip + 1, 1:] - knots[strip, 1:]
    return np.arctan2(way[:, 0], way[:, 1])


def antenna_offset(heading: Array) -> Array:
    """Return from the camera to the antenna, east, north, up."""
    sine, cosine = np.sin(heading), np.cos(heading)
    right, forward, up = ANTENNA
    return np.column_stack(
        [right * cosine + forward * sine, -right * sine + forward * cosine, np.full(len(heading), up)]
    )


def image(place: Array, rotation: Array, points: Array) -> Array:
    """Return the pixels (n, 2) of points; NaN outside the picture."""
    U = (points - place) @ rotation
    ideal = -CAMERA["C"] * U[:, :2] / np.where(U[:, 2:] < 0.0, U[:, 2:], np.nan)
    r2 = np.sum(ideal**2, axis=1, keepdims=True)
    xy = [CAMERA["DX"], CAMERA["DY"]] + ideal * (1.0 + CAMERA["A3"] * r2 + CAMERA["A5"] * r2**2)
    pixels = np.column_stack([xy[:, 0] / PIXEL + COLUMNS / 2, ROWS / 2 - xy[:, 1] / PIXEL])
    inside = (np.abs(pixels - [COLUMNS / 2, ROWS / 2]) < [COLUMNS / 2 - 40, ROWS / 2 - 40]).all(axis=1)
    return np.where(inside[:, None], pixels, np.nan)


def wrong(time: Array, exposures: Array, strips: Array) -> Array:
    """Return what is wrong with positions at times, east, north, up."""
    result = np.zeros((len(time), 3))
    of_strip = exposures[strips == SHIFTED_STRIP]
    result[(time > of_strip[0] - 3.0) & (time < of_strip[-1] + 3.0)] += SHIFT
    result[np.abs(time - exposures[BAD_PHOTO - 1]) < 2.5 * EPOCH] += BAD_FIX
    return result


def mrk_lines(times: Array, offsets: Array, positions: Array) -> list[str]:
    """Return the image log of the drone: positions of the camera as they were computed in flight."""
    lines = []
    sE, sN, sU = GNSS
    rows = zip(times, offsets * 1000.0, geographic(positions), strict=True)
    for number, (time, (east, north, up), (longitude, latitude, height)) in enumerate(rows):
        lines.append(
            f"{number}\t{START + time:.6f}\t[{WEEK}]\t{north:6.0f},N\t{east:6.0f},E\t{-up:6.0f},V\t"
            f"{latitude:.9f},Lat\t{longitude:.9f},Lon\t{height:.4f},Ellh\t{sN:.6f}, {sE:.6f}, {sU:.6f}\t50,Q\n"
        )
    return lines


def pos_lines(times: Array, positions: Array) -> list[str]:
    """Return the trajectory of the antenna as RTKLIB writes it."""
    sE, sN, sU = GNSS
    start = datetime(1980, 1, 6) + timedelta(weeks=WEEK, seconds=START)
    lines = [
        "% program   : simulated, as RTKPOST writes it\n",
        "% pos mode  : Kinematic\n",
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n",
        POS_HEADING,
    ]
    for time, (longitude, latitude, height) in zip(times, geographic(positions), strict=True):
        moment = start + timedelta(seconds=round(float(time), 3))
        lines.append(
            f"{moment:%Y/%m/%d %H:%M:%S}.{moment.microsecond // 1000:03d} {latitude:14.9f} {longitude:14.9f} "
            f"{height:10.4f}   1  17 {sN:8.4f} {sE:8.4f} {sU:8.4f}   0.0020  -0.0030   0.0020   0.00  999.9\n"
        )
    return lines


def toml_text(names: list[str], kappas: Array) -> str:
    """Return the project; photos begin with the planned rotation, and are where their stations are."""
    text = """# Simulated: 60 photos of a drone with RTK, see README.md.

project = { name = "DRONE", crs = "EPSG:25832" }

[plan]
corners = [[561958.0, 5934111.0], [562219.0, 5934114.0], [562217.0, 5934219.0], [561956.0, 5934216.0]]
height = 80.0
forward = 68.5
side = 67.5
direction = 89.2
terrain = "control"
position_error = [0.01, 0.01, 0.018]
tie_points = 25

[[camera]]
name = "ZENMUSE"
c = 8.8
sensor = { columns = 5472, rows = 3648, width = 13.2, height = 8.8 }
unknown = ["C", "DX", "DY", "A3", "A5"]

[[bundle]]
name = "FLIGHT"
measurement_precision = "0.3px"
"""
    for name, kappa in zip(names, kappas, strict=True):
        text += f'\n[[photo]]\nname = "{name}"\ncamera = "ZENMUSE"\nOMEGA = 0.0\nPHI = 0.0\nKAPPA = {kappa:.1f}\n'
    return text


def measure(random: np.random.RandomState, points: dict[str, Array], photos: dict[str, tuple[Array, Array]]) -> str:
    """Return the measurement log; points that fewer than three photos show are not measured."""
    located = np.array(list(points.values()))
    pixels = np.array([image(place, turn, located) for place, turn in photos.values()])
    pixels += POINTING_PX * random.normal(size=pixels.shape)
    pixels[:, np.count_nonzero(np.isfinite(pixels[:, :, 0]), axis=0) < 3] = np.nan
    lines = []
    for photo, found in zip(photos, pixels, strict=True):
        lines.append(f"POINTS FLIGHT {photo}\n")
        lines += [
            f"{point:4s} {column:9.2f} {row:9.2f}\n"
            for point, (column, row) in zip(points, found, strict=True)
            if not np.isnan(column)
        ]
    return "".join(lines)


def simulate() -> dict[str, str]:
    """Return the texts of the project by file name, without the stations, which orip imports."""
    random = np.random.RandomState(SEED)
    times, strips, knots = flight(random)
    names = [f"DJI_{number:04d}" for number in range(1, len(times) + 1)]
    places, headings = camera_at(times, knots), heading_at(times, knots)
    tilts = 0.6 * random.normal(size=(len(times), 2))
    turns = np.degrees(-headings) + 0.8 * random.normal(size=len(times))
    rotation = Rotation.from_euler("XYZ", np.column_stack([tilts, turns]), degrees=True).as_matrix()
    points = {name: np.array([east, north, ground(east, north)]) for name, (east, north) in TARGETS.items()}
    for number, (east, north) in enumerate(random.uniform((-170.0, -95.0), (170.0, 95.0), size=(TIES, 2)), start=1):
        points[f"{100 + number}"] = np.array([east, north, ground(east, north) + random.uniform(0.0, 2.0)])
    located = np.array(list(points.values()))
    measurements = measure(random, points, dict(zip(names, zip(places, rotation, strict=True), strict=True)))
    surveyed = grid(located[: len(TARGETS)]) + random.normal(size=(len(TARGETS), 3)) * SURVEY
    control = ["! targets on the ground: K control points, C check points; heights above the ellipsoid\n"]
    for name, (x, y, z) in zip(TARGETS, surveyed, strict=True):
        errors = " ".join(f"{'-' if name[0] == 'C' else ''}{error:.3f}" for error in SURVEY)
        control.append(f"{name}  {x:.3f}  {y:.3f}  {z:.3f}  {errors}\n")
    # the log has one event more, of a photo that was taken to try the camera, and was deleted
    events = np.array([6.5, *times])
    to_camera = -antenna_offset(heading_at(events, knots))
    at_events = camera_at(events, knots)
    live = at_events + wrong(events, times, strips) + 1.5 * random.normal(size=(len(events), 3)) * GNSS
    epochs = np.arange(0.0, times[-1] + 12.0, EPOCH)
    antenna = camera_at(epochs, knots) + antenna_offset(heading_at(epochs, knots))
    # errors of satellites and of the base station change slowly: neighbouring epochs have nearly the same ones
    seconds = np.arange(-1.0, epochs[-1] + 2.0)
    slow = np.column_stack([np.interp(epochs, seconds, random.normal(size=len(seconds))) for _ in range(3)])
    antenna = antenna + wrong(epochs, times, strips) + slow * GNSS
    truth: dict[str, Any] = {
        "camera": CAMERA,
        "photos": {
            name: [round(float(value), 6) for value in (*xyz, *angles)]
            for name, xyz, angles in zip(names, grid(places), grid_angles(places, rotation), strict=True)
        },
        "points": {
            name: [round(float(value), 5) for value in xyz] for name, xyz in zip(points, grid(located), strict=True)
        },
        "strips": {name: f"S{strip}" for name, strip in zip(names, strips.tolist(), strict=True)},
        "shifted strip": {"strip": f"S{SHIFTED_STRIP}", "east north up": SHIFT},
        "bad fix": {"photo": names[BAD_PHOTO - 1], "east north up": BAD_FIX},
    }
    return {
        "orip.toml": toml_text(names, np.round(np.degrees(-headings), 1) + 0.0),
        "DRONE.MEA": measurements,
        "DRONE.PNT": "".join(control),
        "flight_Timestamp.MRK": "".join(mrk_lines(events, to_camera, live)),
        "flight.pos": "".join(pos_lines(epochs, antenna)),
        "truth.json": json.dumps(truth, indent=1) + "\n",
    }


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
    folder.mkdir(parents=True, exist_ok=True)
    for file_name, text in simulate().items():
        (folder / file_name).write_text(text, encoding="utf-8")
