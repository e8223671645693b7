"""Files of inertial units: logs, or tables with a column for each quantity; and of trajectories: SBET and SMRMSG."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.lines import read_bytes
from orip.files.text.shown import Parsed, shown_token
from orip.records.epochs import SECONDS_PER_WEEK
from orip.stations.gnss.receiver_data import gunzip
from orip.stations.inertial.loggers import logger_of
from orip.stations.inertial.samples import ImuSamples

COLUMNS = ("time", "fx", "fy", "fz", "wx", "wy", "wz")
"""Time, specific forces and angular rates along the axes of the unit."""

FORCE_UNITS = {"m/s2": 1.0, "g": 9.80665}
RATE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0}
TIME_SYSTEMS = {"gps": 0.0, "unix-gps": -315_964_800.0, "unix-utc": -315_964_800.0 + 18.0}
"""Seconds to be added for seconds since 1980-01-06 GPS time; UTC is 18 s behind since 2017."""

_REST = 9.81
_FASTEST_RATE = 35.0
"""rad/s, 2000 degrees a second: the largest range of common units."""

_LARGEST_FORCE = 2000.0
"""m/s², 200 g: beyond the range of every unit on a vehicle."""

_LARGEST = 1e12
"""Beyond any time or measurement; its square is still a number."""

_LEAST_SAMPLES = 100
_LONGEST_GAP = 0.2


class ImuForm(Struct, frozen=True):
    """How a table is to be read.

    Parameters
    ----------
    columns : tuple of str
        Of `COLUMNS`, in the order of the table; ``-``: not used. Empty: as the heading has them, else time, three
        forces, three rates.
    force, rate : str
        Units.
    mount : tuple of 3 float
        Roll, pitch and yaw of the unit on the body, degrees: body = Rz(yaw) Ry(pitch) Rx(roll) unit.
    shift : float
        Added to the times, s.
    """

    columns: tuple[str, ...] = ()
    force: str = "m/s2"
    rate: str = "rad/s"
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: float = 0.0


def read_imu(path: Path, shown: str, form: ImuForm) -> Parsed[ImuSamples]:
    """Read the samples of a unit, along the axes of the body; times are as in the file, shifted."""
    data, faults = read_bytes(path, shown)
    complaints = list(faults)
    if data is not None and data.startswith(b"\x1f\x8b"):
        try:
            data = gunzip(data)
        except (OSError, EOFError, zlib.error) as error:
            complaints.append(Complaint(f"the file cannot be unpacked ({error}); give the whole file", shown))
    table = np.zeros((0, len(COLUMNS)))
    if data is not None and not complaints:
        table, more = _read(data, shown, form)
        complaints += more
    if not complaints:
        complaints += _impossible(table, shown)
    if complaints:
        table = table[:0]
    turn = Rotation.from_euler("ZYX", form.mount[::-1], degrees=True).as_matrix()
    samples = ImuSamples(table[:, 0] + form.shift, table[:, 1:4] @ turn.T, table[:, 4:7] @ turn.T)
    return Parsed(samples, tuple(complaints))


def _read(data: bytes, shown: str, form: ImuForm) -> tuple[FloatArray, list[Complaint]]:
    """Return times, forces and rates (n, 7) of a log that is known by its content, else of a table."""
    logger = logger_of(data)
    if logger is None:
        return _table(data, shown, form)
    name, read = logger
    if form.columns or (form.force, form.rate) != ("m/s2", "rad/s"):
        text = f"this is a log of {name}, which has its own columns and units; leave them out"
        return np.zeros((0, len(COLUMNS))), [Complaint(text, shown)]
    found = read(data, shown)
    return (np.zeros((0, len(COLUMNS))), [found]) if isinstance(found, Complaint) else (found, [])


def _table(data: bytes, shown: str, form: ImuForm) -> tuple[FloatArray, list[Complaint]]:
    lines = data.decode("utf-8", errors="replace").splitlines()
    names = form.columns or _columns_of_heading(lines) or COLUMNS
    rows: list[list[float]] = []
    complaints: list[Complaint] = []
    width = len(names)
    for number, line in enumerate(lines, 1):
        words = _words(line)
        if not words or words[0].startswith(("#", "%", "!")):
            continue
        if len(words) < len(names):
            what = f"{len(words)} columns where {len(names)} are needed: {' '.join(names)}"
            complaints.append(Complaint(f"{what}; say what the columns are with --columns", shown, number))
        elif rows and len(words) != width:
            complaints.append(Complaint(f"{len(words)} columns where the rows before it have {width}", shown, number))
        else:
            try:
                rows.append([float(word) for word in words[: len(names)]])
                width = len(words)
            except ValueError:
                if not rows and not complaints:
                    continue  # a heading
                complaints.append(Complaint(f"'{shown_token(line[:40])}' is no row of numbers", shown, number))
        if len(complaints) > 20:
            break
    found = np.array(rows).reshape(len(rows), len(names))
    picked = np.column_stack([found[:, names.index(name)] for name in COLUMNS])
    with np.errstate(over="ignore"):  # such numbers are named later
        picked[:, 1:4] *= FORCE_UNITS[form.force]
        picked[:, 4:7] *= RATE_UNITS[form.rate]
    return picked, complaints


def _columns_of_heading(lines: list[str]) -> tuple[str, ...]:
    """Return the columns that the first line names, ``-`` those that are not used; none where it does not name all."""
    words = _words(lines[0].removeprefix("\ufeff").lower()) if lines else []
    return tuple(word if word in COLUMNS else "-" for word in words) if set(COLUMNS) <= set(words) else ()


def _words(line: str) -> list[str]:
    """Return the columns of a row: between semicolons, else between commas, else between blanks."""
    for separator in (";", ","):
        if separator in line:
            words = [word.strip() for word in line.strip().split(separator)]
            return words if words[-1] else words[:-1]  # some loggers end rows with a separator
    return line.split()


def _impossible(table: FloatArray, shown: str) -> list[Complaint]:
    """Say what cannot be the samples of a unit: times, and the size of forces and rates in their units."""
    if len(table) < _LEAST_SAMPLES:
        return [Complaint(f"there are {len(table)} samples; at least {_LEAST_SAMPLES} are needed", shown)]
    if not (np.abs(table) < _LARGEST).all():
        return [Complaint("there are numbers that are not finite, or larger than anything that is measured", shown)]
    found = []
    steps = np.diff(table[:, 0])
    if (steps <= 0.0).any():
        row = int(np.flatnonzero(steps <= 0.0)[0]) + 2
        found.append(Complaint(f"sample {row} is not later than the one before it; sort the file by time", shown))
    elif steps.max() > _LONGEST_GAP:
        row = int(np.argmax(steps)) + 2
        text = f"there are {steps.max():.2f} s without samples before sample {row}; use the part before or after it"
        found.append(Complaint(text, shown))
    force = float(np.median(np.linalg.norm(table[:, 1:4], axis=1)))
    if not 0.8 * _REST < force < 1.25 * _REST:
        guess = "; they are probably in g: --force-unit g" if 0.8 < force < 1.25 else ""
        guess = "; they are probably in m/s²: --force-unit m/s2" if 80.0 < force < 120.0 else guess
        found.append(
            Complaint(f"the specific forces are {force:.3g} m/s² in the median; gravity alone is 9.8{guess}", shown)
        )
    rates = np.abs(table[:, 4:7]).max(axis=1)
    rate = float(np.percentile(rates, 99.9, method="lower"))
    if rate > _FASTEST_RATE:
        text = f"the angular rates reach {rate:.3g} rad/s; they are probably in degrees: --rate-unit deg/s"
        found.append(Complaint(text, shown))
    elif rates.max() > _FASTEST_RATE:
        row = int(np.argmax(rates))
        text = f"sample {row + 1} has an angular rate of {rates[row]:.6g} rad/s, which no unit has; mend or remove it"
        found.append(Complaint(text, shown))
    forces = np.abs(table[:, 1:4]).max(axis=1)
    if force < 1.25 * _REST and forces.max() > _LARGEST_FORCE:
        row = int(np.argmax(forces))
        text = f"sample {row + 1} has a specific force of {forces[row]:.6g} m/s², which no unit has; mend or remove it"
        found.append(Complaint(text, shown))
    return found


def sbet_bytes(
    time: FloatArray, geographic: FloatArray, velocity: FloatArray, angles: FloatArray, body: FloatArray
) -> bytes:
    """Return a trajectory as an SBET with wander angle 0.

    Parameters
    ----------
    time : array (n,)
        Seconds since 1980-01-06.
    geographic : array (n, 3)
        Longitude, latitude, height: radians, m.
    velocity : array (n, 3)
        East, north, up.
    angles : array (n, 3)
        Roll, pitch, heading, radians.
    body : array (n, 6)
        Accelerations and rates along the axes of the body.
    """
    table = np.column_stack([
        np.mod(time, SECONDS_PER_WEEK), geographic[:, [1, 0, 2]],
        velocity[:, 1], -velocity[:, 0], velocity[:, 2], angles, np.zeros(len(time)), body,
    ])  # fmt: skip
    return np.ascontiguousarray(table, dtype="<f8").tobytes()


def smrmsg_bytes(time: FloatArray, place: FloatArray, velocity: FloatArray, angles: FloatArray) -> bytes:
    """Return standard deviations (n, 3) as an SMRMSG: of places and velocities east, north, up; of angles, radians."""
    minutes = np.degrees(angles) * 60.0
    order = [1, 0, 2]
    table = np.column_stack([np.mod(time, SECONDS_PER_WEEK), place[:, order], velocity[:, order], minutes])
    return np.ascontiguousarray(table, dtype="<f8").tobytes()
