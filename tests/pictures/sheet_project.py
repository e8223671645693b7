"""The PhotoModeler calibration sheet and its 21 photographs as a project of pictures alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from reference.olympus_camera import PRECISION, camera_text, constant_control
from reference.published_data import data_set, records

RINGS = "1001,1002,1003,1004"


def sheet_coordinates() -> dict[str, tuple[float, float, float]]:
    """Return the places of the dots: 10 x 10 on a grid of 1/7 m, named as PhotoModeler has named them."""
    folder = data_set("dbat-camcal-selfcal")
    points = {name: point[:3] for name, point in constant_control(folder / "reference" / "camcal-fixed.txt").items()}
    for name, x, y, *_ in records(folder / "recomputed_points.txt"):
        points[name] = (round(float(x) * 7) / 7, round(float(y) * 7) / 7, 0.0)
    return points  # type: ignore[return-value]


def published_marks() -> dict[str, dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]]:
    """Return PhotoModeler's own marks by picture and dot."""
    folder = data_set("dbat-camcal-selfcal")
    pictures = {number: Path(path).stem for number, path in records(folder / "images" / "images.txt")}
    marks: dict[str, dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]] = {}
    for number, name, column, row, _ in records(folder / "measurements" / "markpts.txt"):
        marks.setdefault(pictures[number], {})[name] = np.array([float(column), float(row)])
    return marks


def write_project(folder: Path) -> Path:
    """Write a project with photos that have no stations, the four constant points and the sheet."""
    photos = "\n".join(f'[[photo]]\nname = "{name}"\ncamera = "CAM"\n' for name in published_marks())
    bundle = f'[[bundle]]\nname = "BLOCK"\nstart_down_weight = 20\nenp_stop = 7.0\n{PRECISION}\n'
    text = f'project = {{ name = "BLOCK" }}\n\n{camera_text(7.5)}\n\n{photos}\n{bundle}'
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    control = constant_control(data_set("dbat-camcal-selfcal") / "reference" / "camcal-fixed.txt")
    lines = [f"{name} {' '.join(map(repr, numbers))}\n" for name, numbers in control.items()]
    (folder / "BLOCK.PNT").write_text("".join(lines), encoding="utf-8")
    dots = [f"{name} {x!r} {y!r} {z!r} 0.01 0.01 0.01\n" for name, (x, y, z) in sheet_coordinates().items()]
    (folder / "SHEET.PNT").write_text("".join(dots), encoding="utf-8")
    return folder
