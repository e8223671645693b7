"""The published calibrations of the Olympus camera as projects: the complete one, and those with a defect."""

from __future__ import annotations

import math
from pathlib import Path

from reference.olympus_camera import PRECISION, camera_text, constant_control
from reference.published_data import ORIENTATION, Export, Published, data_set, records
from reference.published_projects import Project, perturbed


def stations(folder: Path) -> dict[str, dict[str, Published]]:
    """Return the published orientations, printed with 18 digits.

    Angles are in radians, whatever the file's heading says; all deviations have been multiplied by 180/pi.
    """
    found = {}
    for fields in records(folder / "result" / "camera_stations.txt"):
        numbers = [float(field) for field in fields[2:14]]
        values = numbers[:3] + [math.degrees(angle) for angle in numbers[3:6]]
        deviations = [math.radians(number) for number in numbers[6:9]] + numbers[9:]
        found[fields[1]] = {
            kind: Published(value, deviation)
            for kind, value, deviation in zip(ORIENTATION, values, deviations, strict=True)
        }
    return found


def calibration_project(camera: str) -> Project:
    """Return the project: stations some centimetres and a degree wrong, points by intersection."""
    folder = data_set("dbat-camcal-selfcal")
    starts = {name: [station[kind].value for kind in ORIENTATION] for name, station in stations(folder).items()}
    return Project(
        camera,
        perturbed(starts, length=0.03, angle=1.5, seed=1),
        [(photo, point, x, y) for photo, point, x, y, _ in records(folder / "measurements" / "markpts.txt")],
        constant_control(folder / "reference" / "camcal-fixed.txt"),
        bundle=PRECISION,
    )


def defects() -> Path:
    return data_set("dbat-camcal-defects")


def defective_project(export: Export, *, enp_stop: float = 4.0) -> Project:
    """Return the project of an export with constant control; it begins where the published adjustment begins."""
    control = constant_control(defects() / "camcal-fixed.txt")
    return Project(camera_text(7.3), export.stations, export.marks, control, bundle=PRECISION, enp_stop=enp_stop)
