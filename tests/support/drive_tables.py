"""Drive tables of blocks that are easy to calculate with, and some of everything that a table can hold."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from orip.multimodel.processor import Loaded, load
from orip.records.drive_table import (
    DriveCamera,
    DriveModel,
    DriveParameterSet,
    DrivePhoto,
    DriveTable,
    DriveTemplate,
    StageLimits,
)
from orip.structs import replace

C, BASE, WIDTH, HEIGHT = 50.0, 20.0, 48.0, 100.0
"""Principal distance (mm); base, distance of strips and flying height (m): 1 mm in the photo is 2 m on the ground."""

PLAIN_CAMERA = DriveCamera("CAM", (C, *(0.0,) * 11), (20.0, 24.0), "ideal")
"""Its frame is two photo bases wide, so that models of flat ground border on each other in the middle of overlaps."""

LENS = (C, 0.12, -0.07, 1e-3, -8e-5, 6e-8, -2e-11, 5e-15, 3e-5, -2e-5, 4e-4, -3e-4)
"""All parameters of a camera at once: 0.1 mm and more at the corners of the frame."""

LIMITS = StageLimits(0.0, 240.0, 0.0, 240.0, 0.001)
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def parameter_set(name):
    """Return a set with every parameter different from zero: some micrometres each at the border of the frame."""
    count, base = {"EBNER": 12, "GRUEN": 44}[name], 8.0
    random = np.random.default_rng(count)
    degrees = {"EBNER": [1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4], "GRUEN": [1, 1, 2, 2, 2, 2] + _gruen_degrees() * 2}[name]
    return DriveParameterSet(name, base, tuple((random.normal(size=count) * 3e-3 / base ** np.array(degrees)).tolist()))


def _gruen_degrees():
    return [total - 2 for total in range(5, 11) for i in range(1, 6) if 1 <= total - i <= 5]


def vertical_block(rows=2, columns=4, camera=PLAIN_CAMERA, tilted=False):
    """Return the table of a block of level photos from equal heights, X to the right; strip 1 has the largest Y.

    Photos alternate between two templates, from left to right. Tilted ones are turned by some degrees, and all their
    centres moved by some metres.
    """
    random = np.random.default_rng(7)
    photos, models = [], []
    for row in range(rows):
        for column in range(columns + 1):
            template, stage = ("T2", "LOWER") if column % 2 else ("T1", "UPPER")
            centre, rotation = np.array([column * BASE, -row * WIDTH, HEIGHT]), LEVEL
            if tilted:
                centre = centre + random.normal(size=3)
                turned = Rotation.from_euler("xyz", random.normal(size=3) * 3.0, degrees=True)
                rotation = tuple(turned.as_matrix().ravel().tolist())
            place = (30.0 + 20.0 * (column // 2), 0.999, 0.02, 60.0 + 40.0 * row, -0.021, 1.001)
            photos.append(
                DrivePhoto(
                    f"P{row + 1}-{column + 1}", camera.name, template, stage, tuple(centre.tolist()), rotation, place
                )
            )
        for column in range(columns):
            pair = (f"P{row + 1}-{column + 1}", f"P{row + 1}-{column + 2}")
            optics = "SWAPPED" if column % 2 else "NORMAL"
            models.append(DriveModel(f"M{row + 1}-{column + 1}", row + 1, column + 1, *pair, optics))
    templates = (DriveTemplate("T1", "UPPER"), DriveTemplate("T2", "LOWER"))
    return DriveTable(
        "MAIN", "Any project", "A. Nyone", "mm", "m", LIMITS, LIMITS, (camera,), templates, tuple(photos),
        tuple(models), (10.0, 0.0, 0.0),
    )  # fmt: skip


def loaded(table):
    """Return the block and the first state of a table in which nothing is wrong."""
    found = load(table)
    assert isinstance(found, Loaded), found
    return found


def cameras():
    """Return cameras of every kind by a name: no, all and additional distortion, in both forms."""
    found = {"plain": PLAIN_CAMERA}
    for form in ("ideal", "measured"):
        lens = DriveCamera("CAM", LENS, (20.0, 24.0), form)
        found[form] = lens
        for name in ("EBNER", "GRUEN"):
            found[f"{form} {name}"] = replace(lens, additional=parameter_set(name))
        found[f"fisheye {form}"] = replace(lens, projection="equidistant")
    return found
