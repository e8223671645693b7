"""Networks of baselines with one mark held: closed forms, a wrong baseline, and control points with covariances."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from reference.published_data import REFERENCE_DATA
from support.json_schemas import schema_faults

from orip.files.control.covariances_text import parse_covariances
from orip.files.control.editing import FORMS
from orip.files.text.shown import Parsed
from orip.stations.gnss.network_processing import Baseline, adjust_network, unreached

GNSS = REFERENCE_DATA / "gnss"
ROVER, BASE, ORBITS = "07590920.05o", "30400920.05o", "30400920.05n"
PLACES = np.array([[4e6, 1e6, 4.8e6], [4.001e6, 1.002e6, 4.799e6], [3.999e6, 1.003e6, 4.801e6], [4e6, 1.004e6, 4.8e6]])


def lines(covariance: np.ndarray, count: int, random: np.random.Generator, receivers: int) -> list[Baseline]:
    """Return all baselines of marks, each with errors of its own."""
    root = np.linalg.cholesky(covariance)
    return [
        Baseline(one, two, PLACES[two] - PLACES[one] + root @ random.standard_normal(3), covariance, receivers)
        for one in range(count) for two in range(one + 1, count)
    ]  # fmt: skip


def test_all_baselines_of_a_session_say_what_the_session_says():
    """With n receivers all n(n-1)/2 baselines, each 2/n, have the covariances of n - 1: a mark C, two marks C/2."""
    own = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 9.0]]) * 1e-4
    for count in (2, 3, 4):
        exact = [
            Baseline(one, two, PLACES[two] - PLACES[one], own, count)
            for one in range(count) for two in range(one + 1, count)
        ]  # fmt: skip
        found = adjust_network(count, 0, PLACES[0], exact)
        np.testing.assert_allclose(found.place, PLACES[:count], atol=1e-8)
        assert not found.covariance[:3].any()
        np.testing.assert_allclose(found.covariance[3:6, 3:6], own, rtol=1e-4, atol=1e-9)
        if count > 2:
            np.testing.assert_allclose(found.covariance[3:6, 6:9], own / 2.0, rtol=1e-4, atol=1e-9)


def test_what_is_held_does_not_matter_to_differences():
    random = np.random.default_rng(4)
    given = lines(np.diag([1e-4, 2e-4, 3e-4]), 4, random, 2)
    one, other = (adjust_network(4, held, PLACES[held], given) for held in (0, 2))
    np.testing.assert_allclose(one.place[3] - one.place[1], other.place[3] - other.place[1], atol=1e-8)
    np.testing.assert_allclose(one.residual, other.residual, atol=1e-8)
    assert one.sigma0 == pytest.approx(other.sigma0, rel=1e-6)


def test_errors_of_independent_baselines_are_as_large_as_is_said():
    """Marks of 400 networks: 9 coordinates each, of which 12 of 18 are redundant."""
    random = np.random.default_rng(7)
    covariance = np.diag([1e-4, 2e-4, 4e-4])
    squares, sigma0 = [], []
    for _ in range(400):
        found = adjust_network(4, 0, PLACES[0], lines(covariance, 4, random, 2))
        scale = max(found.sigma0, 1.0) ** 2
        error = (found.place - PLACES)[1:].ravel()
        squares.append(error @ np.linalg.solve(found.covariance[3:, 3:] / scale, error))
        sigma0.append(found.sigma0**2)
    assert np.mean(squares) == pytest.approx(9.0, abs=4.0 * np.sqrt(18.0 / 400.0))
    assert np.mean(sigma0) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (9.0 * 400.0)))


def test_a_wrong_baseline_is_named():
    given = lines(np.eye(3) * 1e-6, 4, np.random.default_rng(1), 2)
    assert not adjust_network(4, 0, PLACES[0], given).is_wrong.any()
    given[4] = Baseline(
        given[4].first, given[4].second, given[4].vector + np.array([0.0, 0.02, 0.0]), given[4].covariance
    )
    assert np.flatnonzero(adjust_network(4, 0, PLACES[0], given).is_wrong).tolist() == [4]


def test_marks_that_are_not_joined():
    assert unreached(5, 0, [(0, 1), (2, 1), (3, 4)]) == [3, 4]


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    if not GNSS.exists():
        pytest.skip("the folder gnss is not in ../shared/reference-data beside the repository")
    pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    folder = tmp_path_factory.mktemp("network")
    for name in (ROVER, BASE, ORBITS):
        shutil.copy(GNSS / name, folder)
    # a third mark a metre and a half below the antenna of the second one, from every second epoch of it
    header, end, body = (GNSS / ROVER).read_text().partition("END OF HEADER\n")
    header = header.replace("0759  ", "LOW   ").replace(f"{0:14.4f}" * 3, f"{1.5:14.4f}" + f"{0:14.4f}" * 2)
    (folder / "low.obs").write_text(header + end + body)
    (folder / "orip.toml").write_text('project = { name = "N", crs = "EPSG:32654" }\n')
    (folder / "N.PNT").write_text("! control\nOLD 1 2 3 0.1 0.1 0.1\n")
    return folder


def test_the_network_becomes_control_points(project):
    words = ("gnss", "network", BASE, ROVER, "low.obs", "--orbits", ORBITS)
    dry = orip(project, *words, "--dry-run", "--json")
    assert dry.code == 0, dry.err
    assert (project / "N.PNT").read_text().count("\n") == 2
    said = orip(project, *words, "--json")
    assert said.code == 0, said.err
    assert schema_faults(said.document) == []
    marks = {mark["name"]: np.array(mark["place"]) for mark in said.document["marks"]}
    vector = marks["0759"] - marks["3040"]
    # the baseline of the two stations, published
    np.testing.assert_allclose(vector, [2022.770, -468.628, 2610.290], atol=0.003)
    assert np.linalg.norm(marks["0759"] - marks["LOW"]) == pytest.approx(1.5, abs=0.003)
    points = FORMS["points"].parse(Parsed((project / "N.PNT").read_text().splitlines()), "N.PNT")
    assert points.complaints == ()
    found = {point.name: point for point in points.value}
    assert found["3040"].errors == (0.0, 0.0, 0.0)
    assert all(0.0 < error < 0.01 for error in found["0759"].errors)
    pairs = parse_covariances(Parsed((project / "N.COV").read_text().splitlines()), "N.COV", points.value)
    assert pairs.complaints == ()
    assert [(pair.first, pair.second) for pair in pairs.value] == [("0759", "LOW")]
    # the same again is refused, and nothing changes
    before = (project / "N.PNT").read_bytes()
    again = orip(project, *words)
    assert again.code != 0
    assert "point '3040' is there already" in again.err
    assert (project / "N.PNT").read_bytes() == before


def test_the_network_is_a_step_of_a_run(project, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(project, folder)
    for name in (BASE, ROVER, "low.obs"):  # a third of the epochs is enough
        header, *epochs = re.split(r"(?m)^(?= 05  4  2 )", (folder / name).read_text())
        (folder / name).write_text(header + "".join(epochs[:40]))
    (folder / "N.COV").unlink(missing_ok=True)
    (folder / "N.PNT").write_text("! control\nOLD 1 2 3 0.1 0.1 0.1\n")
    text = (
        'project = { name = "N", crs = "EPSG:32654" }\n'
        f'gnss_network = {{ marks = ["{BASE}", "{ROVER}", "low.obs"], orbits = ["{ORBITS}"] }}\n'
    )

    def state() -> str:
        steps = orip(folder, "status", "--json").document["steps"]
        (found,) = [step["state"] for step in steps if step["command"] == "orip gnss network"]
        return str(found)

    def names() -> list[str]:
        lines = (folder / "N.PNT").read_text().splitlines()
        return [line.split()[0] for line in lines if not line.startswith("!")]

    (folder / "orip.toml").write_text(text)
    assert state() == "missing"
    said = orip(folder, "run")
    assert "network  3 marks by 3 baselines in N.PNT, N.COV" in said.err, said.err
    assert names() == ["OLD", "3040", "0759", "LOW"]
    assert state() == "up to date"
    assert "baselines" not in orip(folder, "run").err
    (folder / "orip.toml").write_text(text.replace("orbits =", "elevation = 20.0, orbits ="))
    assert state() == "out of date"
    assert "3 marks by 3 baselines" in orip(folder, "run").err
    assert names() == ["OLD", "3040", "0759", "LOW"]
    assert len((folder / "N.COV").read_text().splitlines()) == 1
    assert state() == "up to date"
    # a mark that somebody wrote is not replaced
    (folder / "N.PNT").write_text("3040 1 2 3 0.1 0.1 0.1\n")
    before = (folder / "N.PNT").read_bytes()
    assert "point '3040' is there already" in orip(folder, "run").err
    assert (folder / "N.PNT").read_bytes() == before
    (folder / "orip.toml").write_text(text.replace("orbits =", 'hold = "3040", orbits ='))
    assert re.search(r"orip\.toml:\d+: hold of \[gnss_network\] stands without hold_place", orip(folder, "run").err)


def test_what_is_wrong_with_a_network_is_said(project):
    before = (project / "N.PNT").read_bytes()
    for words, text in [
        ((BASE, ROVER, "--orbits", ORBITS, "--hold", "NIX=-3978242,3382841,3649902"), "there are 3040, 0759"),
        ((BASE, ROVER, "--orbits", ORBITS, "--hold", "3040"), "write NAME=X,Y,Z"),
        ((BASE, "--orbits", ORBITS), "two marks at least"),
        ((BASE, BASE, "--orbits", ORBITS), "marks have the same name: 3040"),
        ((BASE, ORBITS, "--orbits", ORBITS), "these are no observations"),
    ]:
        said = orip(project, "gnss", "network", *words)
        assert said.code != 0
        assert text in said.err
    assert (project / "N.PNT").read_bytes() == before
