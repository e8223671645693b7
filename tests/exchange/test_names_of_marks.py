"""Marks and tracks of the same name are two points in every format: control stays with the mark."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange.imported import written
from exchange.metashape_projects import psx, psz
from exchange.test_metashape import SCALE, SHIFT, TURN
from exchange.test_written_back import BOTH_WAYS, in_conventions

from orip.exchange.formats import format_named
from orip.files.control.text import parse_points
from orip.records.exchanged import ExchangedPoints, ExchangedProject, PoseReading
from orip.records.observations.control import ControlPoint
from orip.structs import replace

MARKS = (*map(str, range(12)), "T3", "north gate", "Höhe 1", "höhe 1", "gcp", "GCP")
TRACKS = tuple(map(str, range(40)))


def colliding(project: ExchangedProject) -> ExchangedProject:
    """Return a block whose first points are marks with control at their places, and whose others are tracks.

    Marks 0 to 11 and tracks 0 to 39 have the same names. Mark 4 is a check point.
    """
    names = (*MARKS, *TRACKS)
    points = ExchangedPoints(
        names, project.points.coordinates[: len(names)], np.arange(len(names)) >= len(MARKS)
    )
    control = tuple(
        ControlPoint(name, tuple(points.coordinates[n].tolist()), (-0.03,) * 3 if name == "4" else (0.02, 0.02, 0.05))
        for n, name in enumerate(MARKS)
    )
    rows = project.rays.point < len(names)
    rays = replace(
        project.rays,
        **{key: getattr(project.rays, key)[rows] for key in ("photo", "point", "image", "deviation", "is_active")},
    )
    return replace(project, points=points, rays=rays, control=control, ground_unit="m")
