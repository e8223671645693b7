"""Rigs and frames of COLMAP 4 as their files have them, text or binary, and what is impossible in them."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeVar

from orip.errors import MOST_COMPLAINTS, Complaint
from orip.exchange.colmap.binary import Bytes, guarded
from orip.exchange.colmap.model import CAMERA_SENSOR, IDENTITY, ColmapFrame, ColmapModel, ColmapRig, Pose, is_pose
from orip.exchange.colmap.text import decimal_number, records, whole_number
from orip.files.text.lines import decode_lines
from orip.files.text.shown import Parsed

RecordT = TypeVar("RecordT")

_KINDS = ("CAMERA", "IMU")
_SENSOR, _POSE = 2, 7

_RIGS_HEAD = """\
# Rig calib list with one line of data per calib:
#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])
# Number of rigs: {}
"""  # noqa: E501  as COLMAP writes it
_FRAMES_HEAD = """\
# Frame list with one line of data per frame:
#   FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)
# Number of frames: {}
"""  # noqa: E501


def rigs_from_bytes(data: bytes, shown: str) -> Parsed[tuple[ColmapRig, ...]]:
    """Read rigs.bin."""
    return guarded(_binary_rigs, data, shown, ())


def frames_from_bytes(data: bytes, shown: str) -> Parsed[tuple[ColmapFrame, ...]]:
    """Read frames.bin."""
    return guarded(_binary_frames, data, shown, ())


def rigs_from_text(data: bytes, shown: str) -> Parsed[tuple[ColmapRig, ...]]:
    """Read rigs.txt."""
    form = "RIG COUNT TYPE SENSOR, then TYPE SENSOR 0, or TYPE SENSOR 1 and a pose, repeated"
    return _from_text(data, shown, _rig_of_line, form)


def frames_from_text(data: bytes, shown: str) -> Parsed[tuple[ColmapFrame, ...]]:
    """Read frames.txt."""
    form = "FRAME RIG QW QX QY QZ TX TY TZ COUNT, then TYPE SENSOR IMAGE repeated"
    return _from_text(data, shown, _frame_of_line, form)


def _from_text(
    data: bytes, shown: str, of_line: Callable[[list[str]], RecordT | None], form: str
) -> Parsed[tuple[RecordT, ...]]:
    """Read a record a line, with a complaint about each line that has another form."""
    lines = decode_lines(data, shown)
    found, complaints = [], list(lines.complaints)
    for number, line in records(lines.value):
        record = of_line(line.split())
        if record is None:
            complaints.append(Complaint(f"write {form}", shown, number))
        else:
            found.append(record)
    return Parsed(tuple(found), tuple(complaints[:MOST_COMPLAINTS]))


def _binary_rigs(source: Bytes) -> tuple[ColmapRig, ...]:
    found = []
    for _ in range(source.count(8, "rigs")):
        identity, number = map(int, source.fields("II", "a rig"))
        sensors: list[tuple[int, int]] = []
        poses: list[Pose | None] = []
        for place in range(number):
            kind, sensor = map(int, source.fields("iI", "a sensor of a rig"))
            has_pose = bool(place) and bool(source.whole("B", "a sensor of a rig"))
            pose = tuple(map(float, source.fields("7d", "the pose of a sensor"))) if has_pose else None
            sensors.append((kind, sensor))
            poses.append(pose if place else IDENTITY)
        found.append(ColmapRig(identity, tuple(sensors), tuple(poses)))
    return tuple(found)


def _binary_frames(source: Bytes) -> tuple[ColmapFrame, ...]:
    found = []
    for _ in range(source.count(68, "frames")):
        identity, rig = map(int, source.fields("II", "a frame"))
        pose = tuple(map(float, source.fields("7d", "the pose of a frame")))
        number = source.whole("I", "a frame")
        data = []
        for _ in range(number):
            kind, sensor, image = map(int, source.fields("iIQ", "a datum of a frame"))
            data.append((kind, sensor, image))
        found.append(ColmapFrame(identity, rig, pose, tuple(data)))
    return tuple(found)


def _rig_of_line(fields: Sequence[str]) -> ColmapRig | None:
    identity, count = (whole_number(field) for field in fields[:2]) if len(fields) > 1 else (None, None)
    sensors: list[tuple[int, int]] = []
    poses: list[Pose | None] = []
    at = 2
    while identity is not None and at < len(fields):
        sensor = _sensor(fields[at : at + _SENSOR])
        at += _SENSOR
        pose: Pose | None = IDENTITY
        if sensors:
            has_pose = fields[at : at + 1]
            pose = _pose(fields[at + 1 : at + 1 + _POSE]) if has_pose == ["1"] else None
            at += 1 + _POSE * (has_pose == ["1"])
            if has_pose not in (["0"], ["1"]) or (has_pose == ["1"] and pose is None):
                return None
        if sensor is None:
            return None
        sensors.append(sensor)
        poses.append(pose)
    return None if identity is None or count != len(sensors) else ColmapRig(identity, tuple(sensors), tuple(poses))


def _frame_of_line(fields: Sequence[str]) -> ColmapFrame | None:
    if len(fields) < 3 + _POSE or (len(fields) - 3 - _POSE) % 3:
        return None
    identity, rig, count = (whole_number(fields[n]) for n in (0, 1, 2 + _POSE))
    pose = _pose(fields[2 : 2 + _POSE])
    data = []
    for at in range(3 + _POSE, len(fields), 3):
        sensor, image = _sensor(fields[at : at + _SENSOR]), whole_number(fields[at + _SENSOR])
        if sensor is None or image is None:
            return None
        data.append((*sensor, image))
    if identity is None or rig is None or pose is None or count != len(data):
        return None
    return ColmapFrame(identity, rig, pose, tuple(data))


def _sensor(fields: Sequence[str]) -> tuple[int, int] | None:
    number = whole_number(fields[1]) if len(fields) == _SENSOR else None
    return (_KINDS.index(fields[0]), number) if number is not None and fields[0] in _KINDS else None


def _pose(fields: Sequence[str]) -> Pose | None:
    values = tuple(value for field in fields if (value := decimal_number(field)) is not None)
    return values if len(values) == _POSE else None


def rig_files(model: ColmapModel, *, is_binary: bool) -> dict[str, bytes]:
    """Return rigs and frames by the names of their files; nothing where a model has none."""
    if not model.rigs:
        return {}
    if is_binary:
        return {"rigs.bin": b"".join(_rig_bytes(model)), "frames.bin": b"".join(_frame_bytes(model))}
    rigs = _RIGS_HEAD.format(len(model.rigs)) + "".join(map(_rig_line, model.rigs))
    frames = _FRAMES_HEAD.format(len(model.frames)) + "".join(map(_frame_line, model.frames))
    return {"rigs.txt": rigs.encode(), "frames.txt": frames.encode()}


def _rig_bytes(model: ColmapModel) -> Iterator[bytes]:
    yield struct.pack("<Q", len(model.rigs))
    for rig in model.rigs:
        yield struct.pack("<II", rig.id, len(rig.sensors))
        for place, (sensor, pose) in enumerate(zip(rig.sensors, rig.poses, strict=True)):
            yield struct.pack("<iI", *sensor)
            if place:
                yield struct.pack("<B", pose is not None) + (b"" if pose is None else struct.pack("<7d", *pose))


def _frame_bytes(model: ColmapModel) -> Iterator[bytes]:
    yield struct.pack("<Q", len(model.frames))
    for frame in model.frames:
        yield struct.pack("<II7dI", frame.id, frame.rig, *frame.pose, len(frame.data))
        yield b"".join(struct.pack("<iIQ", *datum) for datum in frame.data)


def _rig_line(rig: ColmapRig) -> str:
    words = [str(rig.id), str(len(rig.sensors))]
    for place, ((kind, sensor), pose) in enumerate(zip(rig.sensors, rig.poses, strict=True)):
        words += [_KINDS[kind], str(sensor)]
        if place:
            words += ["0"] if pose is None else ["1", *map(repr, pose)]
    return " ".join(words) + "\n"


def _frame_line(frame: ColmapFrame) -> str:
    data = (f"{_KINDS[kind]} {sensor} {image}" for kind, sensor, image in frame.data)
    return " ".join([str(frame.id), str(frame.rig), *map(repr, frame.pose), str(len(frame.data)), *data]) + "\n"


def rig_contradictions(model: ColmapModel, path: str, form: str) -> Iterator[Complaint]:
    """Yield what is impossible in rigs and frames whose files are readable."""
    for message in _of_rigs(model.rigs):
        yield Complaint(message, f"{path}/rigs.{form}")
    for message in _of_frames(model.frames, {rig.id: set(rig.sensors) for rig in model.rigs}):
        yield Complaint(message, f"{path}/frames.{form}")


def _of_rigs(rigs: Sequence[ColmapRig]) -> Iterator[str]:
    sensors = Counter(sensor for rig in rigs for sensor in rig.sensors)
    yield from (f"sensor {number} is on a rig twice, or on two" for (_, number), count in sensors.items() if count > 1)
    for rig in rigs:
        if not all(is_pose(pose) for pose in rig.poses if pose is not None):
            yield f"rig {rig.id} has a sensor without a rotation, or a pose with impossible numbers"
        if any(kind not in range(len(_KINDS)) for kind, _ in rig.sensors):
            yield f"rig {rig.id} has a sensor of an unknown kind; known are 0 (camera) and 1 (IMU)"


def _of_frames(frames: Sequence[ColmapFrame], of_rig: Mapping[int, set[tuple[int, int]]]) -> Iterator[str]:
    images = Counter(image for frame in frames for kind, _, image in frame.data if kind == CAMERA_SENSOR)
    yield from (f"image {image} is of {count} frames" for image, count in images.items() if count > 1)
    for frame in frames:
        if frame.rig not in of_rig:
            yield f"frame {frame.id} is of rig {frame.rig}, which is not among the rigs"
        elif any((kind, sensor) not in of_rig[frame.rig] for kind, sensor, _ in frame.data):
            yield f"frame {frame.id} has a datum of a sensor that is not on its rig {frame.rig}"
        if not is_pose(frame.pose):
            yield f"frame {frame.id} has no rotation, or a pose with impossible numbers"
