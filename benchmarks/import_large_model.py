"""Import of a simulated block of 2000 photos and 1.2 million rays: time and memory.

    python benchmarks/import_large_model.py [bin|txt|opensfm|bal] [PHOTOS]

It is a model of COLMAP, binary or text, a reconstruction of OpenSfM with its tracks, or a problem file of BAL.

Photos look down from 100 m in strips; each shows 600 of the points below it. A quarter of the keypoints has no point.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from orip.exchange.colmap.model import ColmapCamera, ColmapImage, ColmapModel, ColmapPoints
from orip.exchange.colmap.writer import model_files

FOCAL, COLUMNS, ROWS = 3000.0, 4000, 3000
RAYS_OF_PHOTO = 600
_ROW = 50
_STEP = 20.0
_SHOWN = 60.0, 45.0
"""Half the width and height on the ground that a photo shows, less than it could."""


def simulated_model(photos: int, seed: int = 1) -> ColmapModel:
    """Return a model whose keypoints have 0.5 px of noise."""
    rng = np.random.default_rng(seed)
    number = np.arange(photos)
    centres = np.column_stack([_STEP * (number % _ROW), 1.5 * _STEP * (number // _ROW), np.full(photos, 100.0)])
    extent = centres.max(axis=0)[:2]
    density = RAYS_OF_PHOTO / (4.0 * _SHOWN[0] * _SHOWN[1])
    count = int(density * (extent[0] + 2 * _SHOWN[0]) * (extent[1] + 2 * _SHOWN[1]))
    points = np.column_stack([rng.uniform(-s, e + s, count) for s, e in zip(_SHOWN, extent, strict=True)])
    points = np.column_stack([points, rng.uniform(-5.0, 5.0, count)])
    points = points[np.argsort(points[:, 0])]
    images, owners, rows = [], [], []
    for n, centre in enumerate(centres):
        first, last = np.searchsorted(points[:, 0], [centre[0] - _SHOWN[0], centre[0] + _SHOWN[0]])
        near = first + np.flatnonzero(np.abs(points[first:last, 1] - centre[1]) < _SHOWN[1])
        offset = points[near] - centre
        keypoints = FOCAL * offset[:, :2] / -offset[:, 2:] * [1.0, -1.0] + [COLUMNS / 2, ROWS / 2]
        keypoints += rng.normal(0.0, 0.5, keypoints.shape)
        empty = rng.uniform(0.0, ROWS, (len(near) // 3, 2))
        ids = np.concatenate([near + 1, np.full(len(empty), -1)])
        # rotation by half a turn about x: y down, z forward
        pose = (0.0, 1.0, 0.0, 0.0, -centre[0], centre[1], centre[2])
        images.append(ColmapImage(n + 1, pose, 1, f"DJI_{n + 1:04d}.JPG", np.vstack([keypoints, empty]), ids))
        owners.append(near)
        rows.append(np.column_stack([np.full(len(near), n + 1), np.arange(len(near))]))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    lengths = np.bincount(owner, minlength=len(points))
    found = ColmapPoints(
        np.arange(1, len(points) + 1),
        points,
        np.zeros((len(points), 3), dtype=np.uint8),
        np.full(len(points), 0.5),
        lengths,
        np.concatenate(rows)[order],
    )
    camera = ColmapCamera(1, "SIMPLE_RADIAL", COLUMNS, ROWS, (FOCAL, COLUMNS / 2, ROWS / 2, 0.0))
    return ColmapModel((camera,), tuple(images), found)


def main() -> None:
    """Simulate a model, import it, and print time and memory."""
    form = next((word for word in sys.argv[1:] if word in ("txt", "opensfm", "bal")), "bin")
    photos = next((int(word) for word in sys.argv[1:] if word.isdigit()), 2000)
    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "model"
        source.mkdir()
        _in_child(lambda: _write(source, simulated_model(photos), form))
        only = source / "problem.txt" if form == "bal" else source
        _in_child(lambda: _import(only, Path(name) / "project"))


def _write(folder: Path, model: ColmapModel, form: str) -> None:
    if form == "opensfm":
        _write_opensfm(folder, model)
        return
    if form == "bal":
        _write_bal(folder / "problem.txt", model)
        return
    for name, data in model_files(model, "txt" if form == "txt" else "bin").items():
        (folder / name).write_bytes(data)


def _write_opensfm(folder: Path, model: ColmapModel) -> None:
    camera = {"projection_type": "perspective", "width": COLUMNS, "height": ROWS, "focal": FOCAL / COLUMNS}
    shots, lines = {}, ["OPENSFM_TRACKS_VERSION_v2"]
    for image in model.images:
        *_, x, y, z = image.pose
        shots[image.name] = {"rotation": [np.pi, 0.0, 0.0], "translation": [x, y, z], "camera": "c"}
        places = (image.keypoints - [COLUMNS / 2, ROWS / 2]) / COLUMNS
        rows = zip(image.points.tolist(), places.tolist(), strict=True)
        lines += [
            f"{image.name}\t{point if point >= 0 else f'9{image.id:06}{n}'}\t{n}\t{u!r}\t{v!r}\t0.001\t1\t2\t3\t-1\t-1"
            for n, (point, (u, v)) in enumerate(rows)
        ]
    coordinates = zip(model.points.ids.tolist(), model.points.coordinates.tolist(), strict=True)
    points = {str(name): {"coordinates": place, "color": [1.0, 2.0, 3.0]} for name, place in coordinates}
    part = {"cameras": {"c": camera | {"k1": 0.0, "k2": 0.0}}, "shots": shots, "points": points}
    (folder / "reconstruction.json").write_text(json.dumps([part]))
    (folder / "tracks.csv").write_text("\n".join(lines) + "\n")


def _write_bal(path: Path, model: ColmapModel) -> None:
    """Write a camera for each photo; its axes are those of orip, so that photos that look down are not turned."""
    lines = []
    for image in model.images:
        shown = np.flatnonzero(image.points >= 0)
        places = (image.keypoints[shown] - [COLUMNS / 2, ROWS / 2]) * [1.0, -1.0]
        rows = zip((image.points[shown] - 1).tolist(), places.tolist(), strict=True)
        lines += [f"{image.id - 1} {point} {x!r} {y!r}" for point, (x, y) in rows]
    head = f"{len(model.images)} {len(model.points.ids)} {len(lines)}"
    for image in model.images:
        *_, x, y, z = image.pose
        lines += [repr(float(value)) for value in (0.0, 0.0, 0.0, x, -y, -z, FOCAL, 0.0, 0.0)]
    lines += [repr(value) for value in model.points.coordinates.ravel().tolist()]
    path.write_text("\n".join([head, *lines]) + "\n")


def _import(source: Path, target: Path) -> None:
    begun = time.process_time()
    from orip.exchange.project.block import ExchangeSettings
    from orip.exchange.project.imported import read_source, write_project
    from orip.exchange.project.texts import summary_lines

    frame = (COLUMNS, ROWS) if source.is_file() else None
    imported = read_source(None, source, ExchangeSettings(frame))
    read = time.process_time()
    write_project(imported, target)
    done = time.process_time()
    print("; ".join(summary_lines(imported.block)))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"CPU: read and converted {read - begun:.2f} s, written {done - read:.2f} s, memory {memory:.2f} GB")


def _in_child(work: object) -> None:
    """Do work in a process of its own, whose memory is that of the work alone."""
    import os

    child = os.fork()
    if child == 0:
        work()  # type: ignore[operator]
        sys.stdout.flush()
        os._exit(0)
    os.waitpid(child, 0)


if __name__ == "__main__":
    main()
