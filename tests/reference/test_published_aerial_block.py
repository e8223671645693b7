"""Five aerial photos in large coordinates: weighted control, two check points, 365 tie points."""

from __future__ import annotations

import re
from typing import Any

import pytest
from reference.aerial_project import (
    CHECK_POINTS,
    camera_text,
    control,
    marks,
)
from reference.comparison import assert_key_figures, assert_orientations
from reference.published_data import ORIENTATION, data_set, half_digit, read_report, records
from reference.published_projects import Project, perturbed, result_of


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the result from stations that are tens of metres and some degrees wrong."""
    folder = data_set("dbat-sxb-aerial")
    photos = read_report(folder / "result" / "report.txt").photos
    starts = {name: [photo[kind].value for kind in ORIENTATION] for name, photo in photos.items()}
    project = Project(
        camera_text(), perturbed(starts, length=50.0, angle=2.0, seed=3), marks(folder / "measurements"),
        control(folder / "reference" / "sxb-control.txt"), bundle='measurement_precision = "1px"',
    )  # fmt: skip
    return result_of(project, tmp_path_factory.mktemp("aerial"))


def tables(section: str, part: str) -> dict[str, list[float]]:
    """Return the numbers of a table of the report's control or check measurements by point."""
    text = read_report(data_set("dbat-sxb-aerial") / "result" / "report.txt").text
    lines = text.partition(f"{section} measurements")[2].partition(f"  {part}")[2].splitlines()[2:]
    found: dict[str, list[float]] = {}
    for line in lines:
        if not re.match(r" +\d+,", line):
            break
        name, *numbers = [field.strip() for field in line.split(",")[:7]]
        found[name] = [float(number.rstrip("%")) for number in numbers]
    return found


def test_sigma0_and_redundancy(result: Any) -> None:
    assert_key_figures(result, read_report(data_set("dbat-sxb-aerial") / "result" / "report.txt"), digits=5)


def test_orientations(result: Any) -> None:
    assert_orientations(result, read_report(data_set("dbat-sxb-aerial") / "result" / "report.txt").photos)


@pytest.mark.parametrize(("section", "kind", "count"), [("Ctrl", "control", 14), ("Check", "check", 2)])
def test_adjusted_control_and_check_points(result: Any, section: str, kind: str, count: int) -> None:
    posterior = tables(section, "Posterior")
    assert len(posterior) == count
    for name, numbers in posterior.items():
        point = result["points"][name]
        assert point["kind"] == kind
        for axis, value, deviation in zip("XYZ", numbers[:3], numbers[3:], strict=True):
            # coordinates are printed in millimetres, deviations with three digits
            assert point[axis]["value"] == pytest.approx(value, abs=half_digit(1.0, 4)), (name, axis)
            assert point[axis]["sd"] == pytest.approx(deviation, abs=half_digit(deviation, 3)), (name, axis)


def test_check_point_differences(result: Any) -> None:
    published = tables("Check", "Diff")
    assert published.keys() == CHECK_POINTS
    found = {point["name"]: [point["dX"], point["dY"], point["dZ"]] for point in result["check_points"]}
    assert found.keys() == CHECK_POINTS
    for name, numbers in published.items():
        assert found[name] == pytest.approx(numbers[:3], abs=half_digit(1.0, 4))


def test_all_points(result: Any) -> None:
    recomputed = list(records(data_set("dbat-sxb-aerial") / "recomputed_points.txt"))
    assert len(recomputed) == len(result["points"]) == 381
    for name, *numbers in recomputed:
        point = result["points"][name]
        found = [point[axis]["value"] for axis in "XYZ"] + [point[axis]["sd"] for axis in "XYZ"]
        # printed with five decimals
        assert found == pytest.approx([float(number) for number in numbers], abs=half_digit(1.0, 6)), name


def test_a_control_point_seen_once_is_placed_by_its_own_coordinates(result: Any) -> None:
    assert result["points"]["403"]["rays"] == 1
    assert result["singular"] == []
