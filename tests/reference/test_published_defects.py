"""Camera calibrations with something missing: no datum, points without rays, a point with one ray, few points.

Where the published program stops at a defect, orip leaves out what nothing determines, names it, and adjusts the rest.
"""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip
from reference.comparison import assert_camera, assert_key_figures, assert_orientations
from reference.olympus_camera import PRECISION
from reference.olympus_projects import defective_project, defects
from reference.published_data import Export, data_set, half_digit, read_export, read_report
from reference.published_projects import Project, perturbed, result_of
from support.long_cases import every

from orip.structs import replace


def complete() -> Export:
    """Return the calibration that the others were made from."""
    return read_export(data_set("dbat-camcal-selfcal") / "models" / "camcal-pmexport.txt")


def without_datum(seed: int | None) -> Project:
    """Return the calibration without control, from the exported stations or from some that are wrong."""
    found = replace(defective_project(complete()), control={})
    return found if seed is None else replace(found, stations=perturbed(found.stations, 0.03, 1.5, seed))


def structural_rank(report: str) -> int:
    """Return the rank of the normal equations that a report of a failed adjustment gives."""
    found = re.search(r"(?:Structural|Numerical) rank: +(\d+) \(deficiency", read_report(defects() / report).text)
    assert found is not None
    return int(found[1])


def named_parameters(report: str) -> set[str]:
    """Return the points whose coordinates a report names as undetermined: 'OZ-87/88' is Z of point 88."""
    return set(re.findall(r"^ +O[XYZ]-\d+/(\S+)$", read_report(defects() / report).text, re.MULTILINE))


def adjusted_unknowns(result: Any) -> int:
    """Return how many unknowns took part."""
    return int(result["observations"] - result["redundancy"])


def assert_same_camera(result: Any, other: Any) -> None:
    """Compare two adjustments of the same observations, apart from where their iterations ended."""
    assert result["sigma0"] == pytest.approx(other["sigma0"], rel=1e-8)
    for kind, parameter in result["cameras"]["CAM"].items():
        same = other["cameras"]["CAM"][kind]
        if parameter["sd"] is None:
            assert parameter == same
            continue
        # enp_stop 4: corrections are 1e-4 of the deviations
        assert parameter["value"] == pytest.approx(same["value"], abs=1e-4 * parameter["sd"]), kind
        assert parameter["sd"] == pytest.approx(same["sd"], rel=1e-6), kind


def distances(result: Any) -> Any:
    """Return the distances of all points, over their mean."""
    places = np.array([[point[axis]["value"] for axis in "XYZ"] for point in result["points"].values()])
    found = np.array([np.linalg.norm(a - b) for a, b in itertools.combinations(places, 2)])
    return found / found.mean()


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the free network of the calibration without control."""
    block = without_datum(None)
    return result_of(replace(block, bundle=f'{PRECISION}\ndatum = "free"'), tmp_path_factory.mktemp("free"))


def test_free_network_has_seven_movements_and_nothing_undetermined(free: Any) -> None:
    report = read_report(defects() / "camcal-dbatreport-no-datum.txt")
    assert free["status"] == "converged"
    assert free["singular"] == []
    assert free["observations"] == report.observations
    assert free["unknowns"] == report.unknowns
    assert adjusted_unknowns(free) == structural_rank("camcal-dbatreport-no-datum.txt") == report.unknowns - 7
    estimates = [
        *free["photos"].values(),
        *({axis: point[axis] for axis in "XYZ"} for point in free["points"].values()),
    ]
    assert all(figure["sd"] > 0.0 for estimate in estimates for figure in estimate.values())


def test_without_a_datum_only_photo_elements_are_named(tmp_path: Path) -> None:
    said = orip(without_datum(None).write(tmp_path / "block"), "run")
    assert said.code == 4
    assert (
        "not determined: the ground system is not fixed (no control points); free: 3 shifts, 3 rotations" in said.told
    )
    result = json.loads((tmp_path / "block" / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "not_determined"
    assert len(result["singular"]) == 7
    assert {unknown["group"] for unknown in result["singular"]} == {"PHOTO"}


@pytest.mark.parametrize("seed", every(5, [2, None, 1, 3, 4]))
def test_without_a_datum_seven_unknowns_are_named_and_the_shape_is_that_of_the_free_network(
    seed: int | None, free: Any, tmp_path: Path
) -> None:
    result = result_of(without_datum(seed), tmp_path / "block")
    assert len(result["singular"]) == 7
    assert adjusted_unknowns(result) == structural_rank("camcal-dbatreport-no-datum.txt")
    assert_same_camera(result, free)
    # 1e-4 of the points' standard deviations, which are 1e-4 of their distances
    assert distances(result) == pytest.approx(distances(free), abs=1e-7)


@pytest.mark.parametrize("given", every(2, ["check", "preliminary"]))
def test_points_without_rays_are_named_and_change_nothing(given: str, tmp_path: Path) -> None:
    export = read_export(defects() / "camcal-pmexport-missing-obs.txt")
    unseen = named_parameters("camcal-dbatreport-missing-obs.txt")
    assert unseen == set(export.points) - {point for _, point, _, _ in export.marks}
    block = defective_project(export)
    if given == "preliminary":
        block = replace(block, preliminary=export.points)
        where = "preliminary point"
    else:
        check = {name: (*export.points[name], -1.0, -1.0, -1.0) for name in unseen}
        block = replace(block, control={**block.control, **check})
        where = "control point"
    said = orip(block.write(tmp_path / "block"), "run")
    assert said.code == 0
    result = json.loads((tmp_path / "block" / "result.json").read_text(encoding="utf-8"))
    # control point 1003 lies 2.6 mm from where the photos see it, which is reported too
    named = {
        warning["where"]: warning["text"]
        for warning in result["warnings"]
        if warning["code"] != "contradicting-control"
    }
    assert named == {f"{where} {name}": "is not measured in any photo" for name in unseen}
    # those of a kind are one line, with the first names
    (line,) = [line for line in said.told.splitlines() if line.endswith("are not measured in any photo")]
    assert line.startswith(f"warning: {where}s ")
    assert sum(name in line.replace(",", "").replace(":", "").split() for name in unseen) == min(len(unseen), 3)
    assert result["status"] == "converged"
    assert result["singular"] == []
    assert unseen.isdisjoint(result["points"])
    # the published program counts their coordinates as unknowns, and says that they are none
    report = read_report(defects() / "camcal-dbatreport-missing-obs.txt")
    assert result["observations"] == report.observations
    assert result["unknowns"] == report.unknowns - 6 == structural_rank("camcal-dbatreport-missing-obs.txt")
    assert adjusted_unknowns(result) == result["unknowns"]
    assert_same_camera(result, result_of(defective_project(export), tmp_path / "without"))


@pytest.mark.parametrize("preliminary", [False, True], ids=["by its ray", "preliminary"])
def test_one_coordinate_of_a_point_with_one_ray_is_named(preliminary: bool, tmp_path: Path) -> None:
    export = read_export(defects() / "camcal-pmexport-1ray.txt")
    (point,) = named_parameters("camcal-dbatreport-1ray.txt")
    block = defective_project(export)
    if preliminary:
        block = replace(block, preliminary=export.points)
    said = orip(block.write(tmp_path / "block"), "run")
    assert said.code == 0
    assert f"of point {point} cannot be determined" in said.told
    assert (f"point {point} is seen by one ray" in said.told) is not preliminary
    result = json.loads((tmp_path / "block" / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "converged"
    (singular,) = result["singular"]
    # which of the three it is depends on the ray's direction; the published program names Z
    assert (singular["group"], singular["name"]) == ("POINT", point)
    coordinates = result["points"][point]
    assert coordinates["rays"] == 1
    assert coordinates[singular["kind"]]["sd"] == "singular"
    # the others follow from the removed one along the ray, which is parallel to no axis
    assert [axis for axis in "XYZ" if coordinates[axis]["sd"] == "singular"] == ["X", "Y", "Z"]
    report = read_report(defects() / "camcal-dbatreport-1ray.txt")
    assert result["observations"] == report.observations
    assert result["unknowns"] == report.unknowns
    assert adjusted_unknowns(result) == structural_rank("camcal-dbatreport-1ray.txt")
    alone = replace(export, marks=tuple(mark for mark in export.marks if mark[1] != point))
    assert_same_camera(result, result_of(defective_project(alone), tmp_path / "without"))


def test_few_points(tmp_path: Path) -> None:
    export = read_export(defects() / "camcal-pmexport5.txt")
    report = read_report(defects() / "camcal-dbatreport5.txt")
    result = result_of(defective_project(export, enp_stop=7.0), tmp_path / "block")
    assert_key_figures(result, report, digits=6)
    assert_camera(result, report)
    assert_orientations(result, report.photos)


def test_precision_of_few_points(tmp_path: Path) -> None:
    text = read_report(defects() / "camcal-dbatreport5.txt").text.partition("Point Precision")[2]
    result = result_of(defective_project(read_export(defects() / "camcal-pmexport5.txt")), tmp_path / "block")
    deviations = {
        name: [point[axis]["sd"] for axis in "XYZ"]
        for name, point in result["points"].items()
        if point["kind"] == "tie"
    }
    for axis, label in enumerate("XYZ"):
        largest = max(deviations, key=lambda name: deviations[name][axis])
        published = re.search(rf"Maximum {label} standard deviation: (\S+) \(OP (\S+)\)", text)
        assert published is not None
        assert largest == published[2]
        # printed with two digits
        tolerance = half_digit(float(published[1]), 2)
        assert deviations[largest][axis] == pytest.approx(float(published[1]), abs=tolerance)
