"""`orip results normals`, and rotations of photos by other angles and in other units."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation
from workflow.small_projects import first_project


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("forms") / "first")
    assert orip(folder, "run", "--no-report").code == 0
    return folder


def test_the_inverse_of_the_normal_equations_has_the_cofactors(project: Path, tmp_path: Path) -> None:
    normals, covariance = tmp_path / "normals.npz", tmp_path / "covariance.npz"
    assert orip(project, "results", "normals", "-o", str(normals)).code == 0
    assert orip(project, "results", "covariance", "-o", str(covariance)).code == 0
    with np.load(normals) as found:
        names = found["names"].tolist()
        matrix = csr_array((found["data"], found["indices"], found["indptr"])).toarray()
        right, removed, sigma0 = found["right"], found["removed"], float(found["sigma0"])
    kept = np.flatnonzero(~removed)
    scale = np.sqrt(np.diag(matrix)[kept])
    inverse = np.linalg.inv(matrix[np.ix_(kept, kept)] / np.outer(scale, scale)) / np.outer(scale, scale)
    # the last correction would be a small part of the standard deviations
    assert np.abs(inverse @ right[kept] / np.sqrt(np.diag(inverse))).max() < 1e-3
    with np.load(covariance) as given:
        of_name = dict(zip(given["names"].tolist(), np.diag(given["covariance"]).tolist(), strict=True))
    compared = 0
    for row, variance in zip(kept.tolist(), np.diag(inverse).tolist(), strict=True):
        # angles are rotations about the axes there
        if names[row].split(".")[-1] in ("OMEGA", "PHI", "KAPPA") or not np.isfinite(of_name.get(names[row], np.nan)):
            continue
        assert sigma0**2 * variance == pytest.approx(of_name[names[row]], rel=1e-5)
        compared += 1
    assert compared > 20


def test_normal_equations_need_an_npz_and_no_names(project: Path) -> None:
    assert "--output normals.npz" in orip(project, "results", "normals").err
    assert "leave the names away" in orip(project, "results", "normals", "1", "-o", "n.npz").err


def test_rotations_by_other_angles_are_the_same_rotations(project: Path) -> None:
    usual = orip(project, "results", "photos", "--json").document["photos"]
    said = orip(project, "results", "photos", "--angles", "alpha-zeta-kappa", "--unit", "gon", "--json").document
    assert said["angle_unit"] == "gon"
    for name, photo in said["photo_angles"].items():
        given = [photo[angle]["value"] * 0.9 for angle in ("ALPHA", "ZETA", "KAPPA")]
        expected = [usual[name][angle]["value"] for angle in ("OMEGA", "PHI", "KAPPA")]
        one = Rotation.from_euler("ZXZ", np.add(given, [0.0, 90.0, 0.0]), degrees=True)
        other = Rotation.from_euler("XYZ", expected, degrees=True)
        assert (one * other.inv()).magnitude() < 1e-9
        assert photo["X0"] == usual[name]["X0"]
        assert all(photo[angle]["sd"] > 0.0 for angle in ("ALPHA", "ZETA", "KAPPA"))


def test_units_change_values_and_deviations_alike(project: Path) -> None:
    usual = orip(project, "results", "photos", "--json").document["photos"]
    said = orip(project, "results", "photos", "--unit", "radian", "--json").document["photo_angles"]
    for name, photo in said.items():
        for angle in ("OMEGA", "PHI", "KAPPA"):
            for part in ("value", "sd"):
                assert photo[angle][part] == pytest.approx(np.radians(usual[name][angle][part]), rel=1e-12)
    text = orip(project, "results", "photos", "--unit", "radian").out
    assert "radians" in text
    assert "are for" in orip(project, "results", "points", "--unit", "gon").err


def test_deviations_of_terrestrial_angles_are_those_of_sampling(project: Path, tmp_path: Path) -> None:
    """Angles drawn with the covariances of omega, phi and kappa scatter as alpha, zeta and kappa are said to."""
    file = tmp_path / "covariance.npz"
    name, *_ = json.loads((project / "result.json").read_text())["photos"]
    assert orip(project, "results", "covariance", name, "-o", str(file)).code == 0
    with np.load(file) as found:
        rows = [found["names"].tolist().index(f"photo {name}.{angle}") for angle in ("OMEGA", "PHI", "KAPPA")]
        covariance, values = found["covariance"][np.ix_(rows, rows)], found["values"][rows]
    drawn = np.random.default_rng(1).multivariate_normal(values, covariance, 20_000)
    matrices = Rotation.from_euler("XYZ", drawn, degrees=True)
    angles = np.unwrap(matrices.as_euler("ZXZ"), axis=0)
    said = orip(project, "results", "photos", name, "--angles", "alpha-zeta-kappa", "--json").document
    for column, angle in enumerate(("ALPHA", "ZETA", "KAPPA")):
        sd = said["photo_angles"][name][angle]["sd"]
        assert np.degrees(np.std(angles[:, column])) == pytest.approx(sd, rel=0.03)
