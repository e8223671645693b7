"""Films for replays: a template with two photos, photos off templates, a digital frame, and logs that measure them."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from orip.files.log.text import read_measurements
from orip.geometry.plane import PlaneTransformation
from orip.interior.orientation import orient_photo, transformation_without_marks
from orip.interior.replay import Definitions, Measured, replay
from orip.records.camera import Camera, Mark, Sensor
from orip.records.names import record_key
from orip.records.photo import Photo, Scan, Template, Temtick
from orip.structs import replace

NO_PARAMETERS = (50.0,) + (0.0,) * 12
FIDUCIALS = {"1": (-12.0, -18.0), "2": (12.0, -18.0), "3": (12.0, 18.0), "4": (-12.0, 18.0)}
TICKS = {"1": (0.0, 0.0), "2": (200.0, 0.0), "3": (200.0, 200.0), "4": (0.0, 200.0)}
POINTS = {"1001": (3.25, -7.5), "1002": (-11.0, 16.0)}


def by_name(*records):
    return {record_key(record.name): record for record in records}


def marks_of(positions):
    return tuple(Mark(name, x, y) for name, (x, y) in positions.items())


DEFINITIONS = Definitions(
    cameras=by_name(
        Camera("Film", NO_PARAMETERS, fiducials=marks_of(FIDUCIALS)),
        Camera("Digital", NO_PARAMETERS, sensor=Sensor(1000, 500, 10.0, 5.0)),
        Camera("Bare", NO_PARAMETERS),
    ),
    temticks=by_name(Temtick("TT", marks_of(TICKS))),
    templates=by_name(Template("T1", "TT", "LOWER", ("P1", "P2")), Template("T2", "TT", None, ("P5",))),
    photos=by_name(
        Photo("P1", "Film", "T1"),
        Photo("P2", "film", "t1"),
        Photo("P3", "Film"),
        Photo("P4", "Film", scan=Scan((0.01, 0.02))),
        Photo("P5", "Film", "T2"),
        Photo("D1", "Digital"),
        Photo("B1", "Bare"),
    ),
    bundles={"MAIN": "Main", "SIDE": "Side"},
)

ON_TEMPLATE = {"P1": (40.0, 60.0), "P2": (120.0, 60.0)}


def placed(degrees=0.0, x=0.0, y=0.0):
    """Return the transformation of a film that lies turned and shifted."""
    turn = np.radians(degrees)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return PlaneTransformation(matrix, np.array([x, y]))


def lines(positions, place=None, ends=()):
    """Return measurement lines, to the last digit; `ends` is what follows the coordinates of some names."""
    ends = dict(ends)
    place = place or placed()
    text = ""
    for name, xy in positions.items():
        x, y = place.apply(np.array(xy)).tolist()
        text += f"  {name} {x!r} {y!r} {ends.get(name, '')}\n"
    return text


def template(mounting, kind="A", name="T1", ticks=TICKS, ends=()):
    return f"TEMPLATE {name} {kind}\n" + lines(ticks, mounting, ends)


def photo(name, place, kind="A", marks=FIDUCIALS, ends=()):
    return f"PHOTO {name} {kind}\n" + lines(marks, place, ends)


def points(name, place, positions=POINTS, bundle="MAIN", ends=()):
    return f"POINTS {bundle} {name}\n" + lines(positions, place, ends)


def on_plate(name, mounting):
    """Return the place of a photo of template T1 that is mounted so."""
    return mounting.after(placed(0.0, *ON_TEMPLATE[name]))


def replayed(text, start=None, definitions=DEFINITIONS, files=None):
    """Replay a log (or several files of one)."""
    records = ()
    with TemporaryDirectory() as folder:
        for name, content in (files or {"a.MEA": text}).items():
            path = Path(folder, name)
            path.write_text(content, encoding="utf-8")
            parsed = read_measurements(path, name)
            assert parsed.complaints == ()
            records += parsed.value
    return replay(records, definitions, start or Measured())


def measured(text, start=None, definitions=DEFINITIONS):
    """Replay a log in which nothing is wrong."""
    outcome = replayed(text, start, definitions)
    assert outcome.complaints == ()
    return outcome.measured


def complaints(text, **keywords):
    return [str(complaint) for complaint in replayed(text, **keywords).complaints]


def photo_coordinates(found, name, bundle="MAIN", definitions=DEFINITIONS):
    """Return the photo coordinates (mm) of all points of a photo."""
    key = record_key(name)
    definition = definitions.photos[key]
    camera = definitions.cameras[record_key(definition.camera)]
    if key in found.photos:
        to_photo = orient_photo(found.photos[key], camera, definition.template is not None).transformation
    else:
        to_photo = transformation_without_marks(camera)
    observations = found.observations[bundle]
    rows = [row for row, owner in enumerate(observations.photos) if owner == definition.name]
    names = [observations.points[row] for row in rows]
    return dict(zip(names, to_photo.apply(observations.measured[rows]).tolist(), strict=True))


def without(definitions, group, key):
    """Return definitions in which one record is missing."""
    kept = {name: record for name, record in getattr(definitions, group).items() if name != key}
    return replace(definitions, **{group: kept})
