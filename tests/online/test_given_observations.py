"""One control or orientation observation is left out of a session and taken in again by an update."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from support.online_answers import last_answer
from workflow.small_projects import first_project

from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.replies import reply_to
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.session import OnlineSession
from orip.online.simulation import simulated_session

ELEMENT = "left PHOTO Z0 332.55 0.05\n"


class Asked:
    """A session of a project that is asked by its lines."""

    def __init__(self, folder: Path) -> None:
        self.session, self.folder = OnlineSession(folder, None), folder

    def __call__(self, **request: str) -> dict:
        reply = reply_to(self.session, self.folder, json.dumps(request))
        assert reply is not None
        return reply

    def figures(self) -> dict[str, list[float]]:
        points = self(do="show", what="points")["points"]
        return {one["point"]: [one[axis] for axis in "XYZ"] + [one["sd"][axis] for axis in "XYZ"] for one in points}


def project(folder: Path) -> Path:
    made = first_project(folder)
    (made / "FIRST.ELE").write_text(ELEMENT, encoding="utf-8")
    return made


def adjusted(folder: Path) -> dict[str, list[float]]:
    assert orip(folder, "run", "--no-report").code == 0
    points = json.loads((folder / "result.json").read_text(encoding="utf-8"))["points"]
    return {
        name: [found[axis]["value"] for axis in "XYZ"] + [found[axis]["sd"] for axis in "XYZ"]
        for name, found in points.items()
    }


def agree(figures: dict[str, list[float]], expected: dict[str, list[float]]) -> None:
    """Check coordinates to a hundredth of their standard deviations, and these: a session is near its solution."""
    assert figures.keys() == expected.keys()
    for name, (x, y, z, *deviations) in expected.items():
        assert figures[name][3:] == pytest.approx(deviations, rel=1e-3)
        for found, value, sd in zip(figures[name][:3], (x, y, z), deviations, strict=True):
            assert found == pytest.approx(value, abs=0.01 * sd)


@pytest.mark.parametrize("words", ["control point 2", "element left Z0"])
def test_the_state_is_that_of_an_adjustment_without_it_and_with_it(tmp_path: Path, words: str) -> None:
    with_it = adjusted(project(tmp_path / "session"))
    asked = Asked(tmp_path / "session")
    agree(asked.figures(), with_it)
    block = asked.session.measuring.block
    said = asked(do="exclude", observation=words)
    assert (said["state"], said["observation"]) == ("excluded", words)
    other = project(tmp_path / "other")
    if words.startswith("control"):
        assert orip(other, "init").code == 0
        assert orip(other, "control", "points", "disregard", "2").code == 0
    else:
        (other / "FIRST.ELE").write_text(ELEMENT.replace(" 0.05", " -0.05"), encoding="utf-8")
    without = adjusted(other)
    agree(asked.figures(), without)
    said = asked(do="include", observation=words)
    assert said["state"] in ("included", "unchecked")
    agree(asked.figures(), with_it)
    assert asked.session.measuring.block is block, "it has begun again"


def test_covariances_between_points_are_left_to_the_adjustment(tmp_path: Path) -> None:
    """Each point has its own; those with other points count in `solve` alone."""
    own = "1 1 4e-4 1e-4 0 1e-4 4e-4 0 0 0 9e-4\n"
    figures = {}
    for name, text in (("own", own), ("both", f"{own}1 2 1e-4 0 0 0 1e-4 0 0 0 1e-4\n")):
        made = project(tmp_path / name)
        (made / "FIRST.COV").write_text(text, encoding="utf-8")
        figures[name] = adjusted(made)
    asked = Asked(tmp_path / "both")
    agree(asked.figures(), figures["own"])
    assert [one.where for one in asked.session.warnings if one.code == "covariances-while-measuring"] == ["point 1"]
    assert figures["own"] != figures["both"]
    assert asked(do="solve")["status"] == "converged"
    points = json.loads((tmp_path / "both" / "result.json").read_text(encoding="utf-8"))["points"]
    assert points["P1"]["Z"]["sd"] == pytest.approx(figures["both"]["P1"][5], rel=1e-6)


def test_what_is_not_observed_is_said(tmp_path: Path) -> None:
    adjusted(project(tmp_path / "session"))
    asked = Asked(tmp_path / "session")
    assert (
        "there is no observation with an a-priori error called 'control point 99'; did you mean 'control point"
        in asked(do="exclude", observation="control point 99")["error"]
    )
    assert "does not have" in asked(do="exclude", observation="control point 2", photo="left")["error"]


def test_out_and_in_again_leaves_the_triangle_of_all_equations() -> None:
    """To 1e-8 standard deviations: each step loses digits by the redundancy of what it takes out alone."""
    session = simulated_session(2, 4, 0)
    measuring = Measuring(OnlineBlock(session.inputs))
    for one in session.measurements:
        last_answer(measuring, one)
    equations = measuring.block.equations
    built = equations.rebuilt
    given = [key for key in equations.included if key.kind == "control"]
    for key in given:
        measuring.leave_out(key)
        measuring.take_in(key)
    assert set(given) <= equations.included.keys()
    found = equations.triangle.solution()
    if equations.rebuilt == built:
        equations.rebuild()
    sd = np.sqrt(np.diagonal(equations.triangle.cofactors()))
    assert np.abs(found - equations.triangle.solution()).max() <= 1e-8 * sd.min()


def test_what_is_left_out_stays_out_where_the_session_begins_again() -> None:
    session = simulated_session(2, 3, 0)
    measuring = Measuring(OnlineBlock(session.inputs))
    for one in session.measurements:
        last_answer(measuring, one)
    key = next(key for key in measuring.block.equations.included if key.kind == "control")
    measuring.leave_out(key)
    again = Measuring(measuring.block.begun_again(measuring.excluded))
    assert key in again.excluded
    assert key not in again.block.equations.included
    assert isinstance(key, ObservationKey)
    again.take_in(key)
    assert key in again.block.equations.included


def test_what_is_given_is_shown_with_the_figures_of_the_adjustment(tmp_path: Path) -> None:
    folder = project(tmp_path / "session")
    adjusted(folder)
    found = orip(folder, "results", "residuals", "--json").document["residuals"]
    expected: dict[str, list[dict]] = {}
    for row in found:
        if row["kind"] == "control" and row["weight_factor"] is not None:
            expected.setdefault(f"control point {row['point']}", []).append(row)
    asked = Asked(folder)
    given = {one["observation"]: one for one in asked(do="show", what="given")["given"]}
    assert set(expected) | {"element left Z0"} <= set(given)
    for name, components in expected.items():
        for place, row in enumerate(components):
            shown = given[name]
            assert shown["redundancy"][place] == pytest.approx(row["redundancy_number"], abs=1e-3)
            assert abs(shown["v"][place]) == pytest.approx(row["standard_residual"], abs=2e-3)


def test_photo_points_are_shown_in_the_order_of_measuring(tmp_path: Path) -> None:
    folder = project(tmp_path / "session")
    assert orip(folder, "run", "--no-report").code == 0
    asked = Asked(folder)
    shown = asked(do="show", what="measured")["measured"]
    lines = (folder / "FIRST.MEA").read_text(encoding="utf-8").splitlines()
    wanted, photo = [], ""
    for line in lines:
        words = line.split()
        if words[:1] == ["POINTS"]:
            photo = words[2]
        elif words and words[0] in ("PHOTO", "TEMPLATE"):
            photo = ""
        elif words and photo and not line.startswith("!"):
            wanted.append((photo, words[0]))
    assert [(one["photo"], one["point"]) for one in shown] == wanted
    name = shown[0]
    assert asked(do="exclude", photo=name["photo"], point=name["point"])["state"] == "excluded"
    assert asked(do="show", what="measured")["measured"][0]["state"] == "excluded"
