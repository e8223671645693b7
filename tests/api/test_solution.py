"""Solutions as Python has them: estimates by name and as arrays, residuals, covariances, tables."""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import pytest
from api.arrays import arrays_of
from bundle.solving import noisy
from support.synthetic_block import synthetic_block

import orip


@cache
def solution() -> orip.Solution:
    made = synthetic_block("convergent", "solution", noise_mm=0.005, unknown=("C", "DX", "DY"))
    return orip.Block(**arrays_of(noisy(made, 4))).adjust()


def test_records_are_found_by_name() -> None:
    found = solution()
    assert list(found.points) == list(found.points.names)
    assert len(found.photos) == 8
    assert found.photos["p3"].name == "P3"
    assert "105" in found.points
    assert "5" not in found.points
    assert found.points.get("5") is None
    point, row = found.points["105"], found.points.row("105")
    assert np.array_equal(point.coordinates, found.points.coordinates[row])
    assert np.diag(point.covariance) == pytest.approx(point.deviations**2, rel=1e-14)
    assert found.cameras["cam"]["c"] == found.cameras["CAM"].parameters[0]
    assert found.cameras["CAM"].parameter_names[:3] == ("C", "DX", "DY")
    assert repr(found.photos) == "<8 photos: P1, P2, P3, P4, P5, ...>"


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda found: found.points["1O5"], "there is no point '1O5'; did you mean '1"),
        (lambda found: found.points[105], "there is no point 105; did you mean '105'?"),
        (lambda found: found.photos["X"], "there is no photo 'X'; there are: P1, P2, P3, P4, P5 and 3 more"),
        (lambda found: found.covariance("photo X"), "there is no photo 'X'"),
        (lambda found: found.covariance("105", ["photo P1", "P2"]), "there is no point 'P2'"),
        (lambda found: found.covariance(105), "there is no record 105; did you mean '105'?"),
        (lambda found: found.covariance("station P1"), "there is no kind of record 'station'"),
        (
            lambda found: found.cameras["CAM"]["Q9"],
            "there is no parameter 'Q9'; there are: C, DX, DY, A1, A3 and 8 more",
        ),
        (lambda found: found.figure("sigma1"), "there is no figure 'sigma1'; did you mean 'sigma0'?"),
        (lambda found: found.to_dataframe("photo"), "there is no table 'photo'; did you mean 'photos'?"),
    ],
)
def test_unknown_names(ask: object, message: str) -> None:
    with pytest.raises(orip.UnknownNameError) as found:
        ask(solution())
    assert str(found.value).startswith(message)
    assert isinstance(found.value, KeyError)


def test_covariances_between_records() -> None:
    found = solution()
    names = ["105", "photo P2", "camera CAM"]
    joint = found.covariance(names)
    assert joint.shape == (3 + 6 + 13,) * 2
    assert np.array_equal(joint[:3, 3:9], found.covariance("point 105", "photo p2"))
    deviations = np.concatenate(
        [found.points["105"].deviations, found.photos["P2"].deviations, found.cameras["CAM"].deviations]
    )
    constant = np.isnan(deviations)
    assert np.sqrt(np.diag(joint))[~constant] == pytest.approx(deviations[~constant], rel=1e-6)
    assert np.array_equal(joint[constant], np.zeros((10, 22)))
    assert found.photos["P2"].covariance == pytest.approx(joint[3:9, 3:9], rel=1e-9)
    assert found.cameras["CAM"].covariance == pytest.approx(joint[9:, 9:], rel=1e-9)
    assert found.covariance("105") == pytest.approx(found.points["105"].covariance, rel=1e-6, abs=1e-15)
    # C of a camera between points around an object: its correlations are those of the record
    r = joint[9, 10] / np.sqrt(joint[9, 9] * joint[10, 10])
    (wanted,) = [
        correlation.r for correlation in found.correlations if (correlation.a, correlation.b) == ("CAM.C", "CAM.DX")
    ]
    assert r == pytest.approx(wanted, abs=1e-6)


def test_residuals_are_shown_by_their_columns() -> None:
    shown = repr(solution().residuals)
    assert shown.startswith(
        f"<{len(solution().residuals)} observation components: kind, photo, point, component, unit, "
    )
    assert len(shown) < 200


def test_residuals_have_names_and_units() -> None:
    residuals = solution().residuals
    assert {(kind, unit) for kind, unit in zip(residuals.kind, residuals.unit, strict=True)} == {
        ("photo", "mm"),
        ("control", "m"),
    }
    assert len(residuals) == len(residuals.residual) == 2 * 8 * 40 + 3 * 10
    active = ~np.isnan(residuals.weight_factor)
    redundancy = residuals.redundancy_number[active].sum()
    assert redundancy == pytest.approx(solution().redundancy, abs=1e-6)


def test_data_frames() -> None:
    found = solution()
    points = found.to_dataframe("points")
    assert points.loc["105", "X"] == found.points["105"].coordinates[0]
    assert points.loc["105", "sZ"] == found.points["105"].deviations[2]
    assert points.attrs["units"]["sZ"] == "m"
    photos = found.to_dataframe("photos")
    assert photos.loc["P2", "KAPPA"] == found.photos["P2"].orientation[5]
    assert photos.attrs["units"]["sKAPPA"] == "degrees"
    cameras = found.to_dataframe("cameras").set_index(["camera", "parameter"])
    assert cameras.loc[("CAM", "C"), "value"] == found.cameras["CAM"]["C"]
    assert cameras.loc[("CAM", "A3"), "unit"] == "mm^-2"
    residuals = found.to_dataframe("residuals")
    assert np.array_equal(residuals.w, found.residuals.w)
    assert list(residuals.columns[:5]) == ["kind", "photo", "point", "component", "unit"]


def test_without_pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(orip.OripError, match="needs pandas, which is not installed; run 'pip install pandas'"):
        solution().to_dataframe("points")


def test_what_is_not_determined_and_what_is_constant() -> None:
    made = synthetic_block("strip", "solution", control="constant")
    given = arrays_of(made.block)
    measured = given["photo_points"]
    once = made.block.point_names[1]
    first = next(row for row, name in enumerate(measured.point) if name == once)
    keep = np.array([name != once or row == first for row, name in enumerate(measured.point)])
    given["photo_points"] = orip.PhotoPoints(measured.photo[keep], measured.point[keep], np.array(measured.xy)[keep])
    found = orip.Block(**given).adjust()
    constant, undetermined = found.points[made.block.point_names[0]], found.points[once]
    assert np.isnan(constant.deviations).all()
    assert np.array_equal(constant.covariance, np.zeros((3, 3)))
    assert np.isinf(undetermined.deviations).any()
    assert np.isnan(undetermined.covariance).any()
    assert np.array_equal(np.isnan(found.covariance(once)), np.isnan(undetermined.covariance))
    assert "105" not in [unknown.name for unknown in found.singular]
    assert once in [unknown.name for unknown in found.singular]


def test_a_block_belongs_to_no_project() -> None:
    with pytest.raises(orip.InputError, match="belongs to no project folder"):
        solution().save()
    assert '"bundle": "MAIN"' in solution().to_json()
    assert (
        repr(solution()) == f"<Solution of bundle MAIN: converged, sigma0 {solution().sigma0:.4f}, 8 photos, 40 points>"
    )
