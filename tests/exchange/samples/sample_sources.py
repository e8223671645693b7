"""Genuine files as the readers want them: unpacked, under their usual names, or gathered into one project."""

from __future__ import annotations

import csv
import gzip
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from exchange.imported import read_well, sample, written

from orip.exchange.metashape.sensors import read_lens
from orip.exchange.metashape.source import READING as METASHAPE
from orip.exchange.opensfm.control_marks import read_control_list
from orip.exchange.opensfm.source import read_opensfm
from orip.exchange.sources.text import Faults
from orip.exchange.tables import read_tables
from orip.records.exchanged import ExchangedPhoto, ExchangedProject
from orip.structs import replace

LEVEL = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)


def in_place(*names: str) -> Callable[[Path], Path]:
    return lambda _: sample(*names)


def unpacked(*names: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for path in sample(*names).iterdir():
            data = path.read_bytes()
            is_packed = path.suffix == ".gz"
            (folder / (path.stem if is_packed else path.name)).write_bytes(gzip.decompress(data) if is_packed else data)
        return folder

    return make


def colmap4_text(folder: Path) -> Path:
    unpacked("colmap", "sceaux-9-colmap4", "text")(folder)
    (folder / "points3D.txt").write_bytes(sample("colmap", "sceaux-9-text", "points3D.txt").read_bytes())
    return folder


def berlin(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    given = sample("opensfm", "berlin")
    shutil.copy(given / "reconstruction_example.json", folder / "reconstruction.json")
    shutil.copy(given / "tracks_example.csv", folder / "tracks.csv")
    return folder


def berlin_with_control(folder: Path) -> Path:
    berlin(folder)
    shutil.copy(sample("opensfm", "berlin", "ground_control_points.json"), folder)
    return folder


def standing_level(project: ExchangedProject) -> ExchangedProject:
    """Return a project whose photos, which are not oriented, stand in a row and look down."""
    photos = tuple(
        replace(photo, rotation=LEVEL, position=(10.0 * n, 0.0, 100.0), key=n) for n, photo in enumerate(project.photos)
    )
    return replace(project, photos=photos, readings=(METASHAPE,))


def photo_of_lens(path: Path) -> ExchangedProject:
    """Return a project with a photo of a lens that is saved by itself."""
    lens = read_well(read_lens, path)
    return standing_level(replace(lens, photos=(ExchangedPhoto("a.jpg", 0),), is_calibration=False, notes=()))


def targets(folder: Path) -> ExchangedProject:
    """Return the targets of icepy4d in 8 photos of 2 cameras, from tables that have been gathered into one."""
    folder.mkdir(parents=True, exist_ok=True)
    given = sample("icepy4d-targets")
    rays, photos = ["image,label,x,y"], ["photo,camera"]
    for path in sorted(given.glob("IMG_*.csv")):
        photos.append(f"{path.stem},cam{1 if path.stem.startswith('IMG_1') else 2}")
        with path.open(newline="") as stream:
            rays += [f"{path.stem},{row['label']},{row['x']},{row['y']}" for row in csv.DictReader(stream)]
    cameras = ["camera,columns,rows,f,cx,cy,k1,k2,p1,p2"]
    for name in ("cam1", "cam2"):
        words = (given / f"{name}.txt").read_text().split()
        values = [*words[:3], str(float(words[4]) + 0.5), str(float(words[7]) + 0.5), *words[11:15]]
        cameras.append(",".join([name, *values]))
    for name, lines in (("observations", rays), ("photos", photos), ("cameras", cameras)):
        written(folder / f"{name}.csv", "\n".join(lines) + "\n")
    shutil.copy(given / "target_world.csv", folder / "control.csv")
    return standing_level(read_well(read_tables, folder))


def copr(folder: Path) -> ExchangedProject:
    """Return the ground control of Coal Oil Point in a reconstruction of its photos, none of which is there."""
    folder.mkdir(parents=True, exist_ok=True)
    control = read_control_list(sample("odm", "copr", "gcp_list.txt"), Faults("gcp_list.txt"))
    shutil.copy(sample("odm", "copr", "gcp_list.txt"), folder)
    camera = {"projection_type": "perspective", "width": 4608, "height": 3456, "focal": 0.85, "k1": 0.01, "k2": 0.0}
    shots = {
        name: {"rotation": [np.pi, 0.0, 0.0], "translation": [-5.0 * n, 0.0, 100.0], "camera": "c"}
        for n, name in enumerate(sorted({mark.photo for mark in control.marks}))
    }
    reference = {"latitude": 34.4084, "longitude": -119.8800, "altitude": 0.0}
    part = {"cameras": {"c": camera}, "shots": shots, "points": {}, "reference_lla": reference}
    written(folder / "reconstruction.json", json.dumps([part]))
    return read_well(read_opensfm, folder)
