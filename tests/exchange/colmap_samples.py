"""Models of COLMAP for the tests: a small one that is made here, and genuine ones where they are."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path

import numpy as np
from conversion.exchanged_blocks import block
from reference.published_data import data_set

from orip.exchange.colmap.model import ColmapModel
from orip.exchange.colmap.reader import READING, Form
from orip.exchange.colmap.writer import model_files, new_model
from orip.structs import replace


def small_model() -> ColmapModel:
    """Return 6 photos of 60 points with noise, a keypoint without a point, and a name with blanks and a folder."""
    model = new_model(block(READING, noise_px=0.5))
    first = model.images[0]
    images = (
        replace(
            first,
            name="left side/Bild ä.jpg",
            keypoints=np.vstack([first.keypoints, [[17.5, 2900.25]]]),
            points=np.append(first.points, -1),
        ),
        *model.images[1:],
    )
    colours = np.arange(3 * 60, dtype=np.uint8).reshape(60, 3)
    return replace(model, images=images, points=replace(model.points, colours=colours, errors=np.full(60, 0.5)))


def written(folder: Path, model: ColmapModel, form: Form) -> Path:
    """Write a model into a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in model_files(model, form).items():
        (folder / name).write_bytes(data)
    return folder


def genuine(name: str, to: Path) -> Path:
    """Return a copy, unpacked, of one of the models of the Sceaux castle; the test is skipped where there is none."""
    source = data_set("exchange") / "colmap"
    to.mkdir(parents=True, exist_ok=True)
    for path in (source / name).iterdir():
        data = path.read_bytes()
        (to / path.name.removesuffix(".gz")).write_bytes(gzip.decompress(data) if path.suffix == ".gz" else data)
    if not (to / "points3D.txt").exists() and name.endswith("text"):
        shutil.copy(source / "sceaux-9-text" / "points3D.txt", to)
        (to / "points3D.txt").chmod(0o644)
    return to
