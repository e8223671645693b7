"""Self-calibration of a camera over 100 points, four of them constant control, in 21 photos."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from reference.comparison import assert_camera, assert_key_figures, assert_orientations, orientation
from reference.olympus_camera import PIXEL, UNKNOWN, as_reported, camera_text
from reference.olympus_projects import calibration_project, stations
from reference.published_data import data_set, half_digit, read_report, records
from reference.published_projects import result_of

ITERATED = 1e-4
"""Part of a standard deviation: the published iterations of this run ended 5e-5 away, those of the models nearer."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("calibration")


@pytest.fixture(scope="module")
def result(folder: Path) -> Any:
    return result_of(calibration_project(camera_text(7.5)), folder)


def test_sigma0_redundancy_and_camera(result: Any) -> None:
    report = read_report(data_set("dbat-camcal-selfcal") / "result" / "report.txt")
    assert_key_figures(result, report, digits=5)
    assert_camera(result, report, iterated=ITERATED)


def test_camera_to_more_digits_than_the_report_prints(result: Any) -> None:
    camera = ET.parse(data_set("dbat-camcal-selfcal") / "result" / "c4040z.xml").getroot().find(".//camera")
    assert camera is not None
    published = {
        "C": camera.findtext("cc"),
        **dict(zip(("px", "py"), str(camera.findtext("pp")).split(","), strict=True)),
        **dict(zip(("K1", "K2", "K3"), str(camera.findtext("K")).split(","), strict=True)),
        **dict(zip(("P1", "P2"), str(camera.findtext("P")).split(","), strict=True)),
        "as": 1.0 - float(str(camera.findtext("aspect"))),
    }
    for name, found in as_reported(result).items():
        assert found.value == pytest.approx(float(published[name]), abs=ITERATED * found.deviation), name


def test_orientations_as_printed(result: Any) -> None:
    report = read_report(data_set("dbat-camcal-selfcal") / "result" / "report.txt")
    assert_orientations(result, report.photos, iterated=ITERATED)


def test_orientations_to_18_digits(result: Any) -> None:
    published = stations(data_set("dbat-camcal-selfcal"))
    assert len(published) == 21
    for photo, expected in published.items():
        for kind, found in orientation(result, photo).items():
            off = found.value - expected[kind].value
            off = math.remainder(off, 360.0) if kind == "KAPPA" else off
            assert abs(off) < ITERATED * found.deviation, (photo, kind)
            # deviations hardly depend on where the iterations end
            assert found.deviation == pytest.approx(expected[kind].deviation, rel=1e-7), (photo, kind)


def test_points(result: Any) -> None:
    recomputed = list(records(data_set("dbat-camcal-selfcal") / "recomputed_points.txt"))
    assert len(recomputed) == 96
    for name, *numbers in recomputed:
        point = result["points"][name]
        assert point["kind"] == "tie"
        found = [point[kind]["value"] for kind in "XYZ"] + [point[kind]["sd"] for kind in "XYZ"]
        assert found == pytest.approx([float(number) for number in numbers], abs=half_digit(1.0, 8)), name


def test_residuals(result: Any, folder: Path) -> None:
    with (folder / "residuals.csv").open(encoding="utf-8", newline="") as lines:
        rows = {(row["photo"], row["point"], row["component"]): row for row in csv.DictReader(lines)}
    for point, photo, _, _, *published in records(data_set("dbat-camcal-selfcal") / "result" / "top_residuals.txt"):
        found = [float(rows[photo, point, component]["residual"]) / PIXEL for component in "xy"]
        # six digits; the published iterations end a few millionths of a pixel away
        assert found == pytest.approx([float(value) for value in published[:2]], abs=2e-6), (point, photo)


@pytest.mark.parametrize(
    ("model", "distortion_at", "affinity"),
    [(-1, "ideal", False), (1, "measured", False), (3, "measured", True)],
    ids=["forward", "backward", "backward with affinity"],
)
def test_models_of_distortion(model: int, distortion_at: str, affinity: bool, tmp_path: Path) -> None:
    unknown = UNKNOWN if affinity else tuple(name for name in UNKNOWN if name != "B1")
    report = read_report(data_set("dbat-camcal-selfcal") / "models" / f"camcal-dbatreport-model{model}.txt")
    result = result_of(
        calibration_project(camera_text(7.5, distortion_at=distortion_at, unknown=unknown)), tmp_path / "model"
    )
    assert_key_figures(result, report, digits=6)
    assert_camera(result, report)
    assert_orientations(result, report.photos)
