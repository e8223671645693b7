"""Sessions of `orip online` in a project: what is answered, what is in the log, and where a session goes on."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.sample_projects import sample
from threadpoolctl import threadpool_limits
from workflow.online_points import typed_points
from workflow.quiet import run_quietly
from workflow.small_projects import Point, first_project, replace_in, without_points

from orip.errors import UsageError
from orip.online import session as session_module
from orip.online.block.first_photos import solution_of_what_is_measured
from orip.online.replies import Reply, reply_to
from orip.online.requests import read_request
from orip.online.session import OnlineSession
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project
from orip.workflow.records.initialise import initialise


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1, user_api="blas"):
        yield


def _measure(session: OnlineSession, folder: Path, point: Point) -> Reply:
    photo, name, x, y = point
    return _reply(session, folder, do="measure", photo=photo, point=name, x=x, y=y)


def _reply(session: OnlineSession, folder: Path, **request: object) -> Reply:
    found = reply_to(session, folder, json.dumps(request))
    assert found is not None
    return found


@pytest.fixture
def project(tmp_path: Path) -> tuple[Path, list[Point]]:
    folder = first_project(tmp_path / "first")
    points = without_points(folder)
    commit(initialise(read_project(folder, "definitions")))
    return folder, points


def _figures(folder: Path) -> list[str]:
    """Return the lines of all listings of an adjustment, sorted: photos and points come in the order of measuring."""
    names = ("BUNDLE_RESULT.OUT", "BUNDLE_ERROR.OUT")
    lines = [line for name in names for line in (folder / name).read_text(encoding="utf-8").splitlines()]
    return sorted(line for line in lines if not line.startswith("Run id"))


def test_exposure_stations_without_an_unknown_shift_are_the_ground_of_a_session(tmp_path: Path) -> None:
    """Two control points and 60 stations: the strip with an unknown shift is left to the adjustment."""
    folder = sample(tmp_path, "drone_rtk")
    with (folder / "orip.toml").open("a", encoding="utf-8") as text:
        text.write('\n[[antenna]]\nname = "RTK"\nshift = "strip"\nstrips = ["S3"]\n')
    commit(initialise(read_project(folder, "definitions")))
    measuring = OnlineSession(folder, None).measuring
    stations = [key.photo for key in measuring.block.equations.included if key.kind == "station"]
    lines = (folder / "DRONE.STA").read_text(encoding="utf-8").splitlines()
    shifted = {line.split()[0] for line in lines if " S3 " in f"{line} "}
    assert len(measuring.block.values.orientations) == 60
    assert shifted
    assert shifted.isdisjoint(stations)
    assert {key.photo for key in measuring.suspects if key.kind == "station"} == {"DJI_0044"}  # planted


def test_points_typed_in_random_order_end_as_orip_run_does(project, tmp_path: Path) -> None:
    folder, points = project
    random.Random(3).shuffle(points)
    session = OnlineSession(folder, None)
    states = [_measure(session, folder, point)["state"] for point in points]
    assert states[0] == "waiting"
    assert states[-1] in ("included", "unchecked")
    _reply(session, folder, do="solve")
    other = first_project(tmp_path / "other")
    run_quietly(other)
    assert _figures(folder) == _figures(other)


WRONG = {
    "small_frame_block": {"1213 in 203", "1307 in 104"},
    "zurich_city_hall": {f"control point {name}" for name in (201, 202, 211, 212, 311, 312)},
}
"""What is wrong in the samples, by their README."""


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", sorted(WRONG))
@pytest.mark.parametrize("seed", [1, 2, 3, 5, 7])
def test_a_sample_typed_in_random_order_ends_with_the_figures_of_solve(tmp_path: Path, seed: int, name: str) -> None:
    folder, other = sample(tmp_path, name), sample(tmp_path / "other", name)
    commit(initialise(read_project(folder, "definitions")))
    points = typed_points(folder)
    random.Random(seed).shuffle(points)
    session = OnlineSession(folder, None)
    for point in points:
        assert "error" not in _measure(session, folder, point)
    assert len(session.measuring.block.measurements) == len(points)
    suspects = {one["observation"] for one in _reply(session, folder, do="show", what="suspects")["suspects"]}
    _reply(session, folder, do="solve")
    run_quietly(other)
    assert _figures(folder) == _figures(other)
    assert suspects == WRONG[name]


def test_a_session_on_a_measured_sample_names_its_two_blunders(tmp_path: Path) -> None:
    """Five parameters of its camera are unknown; its README says which measurements are wrong."""
    folder = sample(tmp_path, "small_frame_block")
    commit(initialise(read_project(folder, "definitions")))
    measuring = OnlineSession(folder, None).measuring
    assert {(key.photo, key.point) for key in measuring.suspects} == {("203", "1213"), ("104", "1307")}
    assert len(measuring.block.values.orientations) == 12
    assert measuring.block.sigma0 == pytest.approx(1.0, abs=0.1)


def test_photos_points_cameras_residuals_and_statistics_are_those_of_the_adjustment(project) -> None:
    folder, points = project
    session = OnlineSession(folder, None)
    for point in points:
        _measure(session, folder, point)
    _reply(session, folder, do="relinearise")
    shown = {
        what: _reply(session, folder, do="show", what=what)[what]
        for what in ("photos", "points", "cameras", "residuals", "statistics")
    }
    _reply(session, folder, do="solve")
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    statistics = shown["statistics"]
    assert statistics["equations"] - statistics["unknowns"] == statistics["redundancy"]
    of_photos = sum(v * v for one in shown["residuals"] for v in one["v"])
    assert of_photos <= statistics["square sum"] * (1.0 + 1e-9) + 1e-12
    assert len(shown["residuals"]) == len(points)
    assert all(one["w"] <= one["limit"] for one in shown["residuals"])
    photo, name = points[0][:2]
    for asked in ({"photo": photo}, {"point": name}, {"photo": photo, "point": name}):
        of_it = _reply(session, folder, do="show", what="residuals", **asked)["residuals"]
        expected = [one for one in shown["residuals"] if one.items() >= asked.items()]
        assert [one["point"] for one in of_it] == [one["point"] for one in expected]
        # by substitution of few, and by the inverse for many
        assert all(
            one["w"] == pytest.approx(other["w"], rel=1e-6, abs=1e-9)
            for one, other in zip(of_it, expected, strict=True)
        )
    assert {one["photo"] for one in shown["photos"]} == {point[0] for point in points}
    assert {one["point"] for one in shown["points"]} == {point[1] for point in points}
    assert shown["cameras"][0]["C"] > 0.0
    for photo in shown["photos"]:
        # control that is held is observed here
        assert photo["X0"] == pytest.approx(result["photos"][photo["photo"]]["X0"]["value"], abs=1e-3)


def test_a_calibration_that_nothing_determines_is_held_by_solve_with_prune(project) -> None:
    folder, points = project
    replace_in(folder / "orip.toml", "c = 35.0", 'set = "EBNER"\nframe = [36.0, 24.0]\nc = 35.0')
    commit(initialise(read_project(folder, "definitions")))
    session = OnlineSession(folder, None)
    for point in points:
        assert "error" not in _measure(session, folder, point)
    assert session.measuring.block.measurements.whole().cameras[0].additional_set is None
    pruned = _reply(session, folder, do="solve", prune=True)
    assert "EBNER" in " ".join(pruned["held"])
    assert not _reply(session, folder, do="solve")["held"]


SHOWN = ("photos", "points", "cameras", "statistics", "residuals", "suspects", "waiting")


def _leaves(shown: object, at: str = "") -> Iterator[tuple[str, object]]:
    """Yield all that is shown with where it stands, the items of lists by what names them."""
    if isinstance(shown, dict):
        for key, value in shown.items():
            yield from _leaves(value, f"{at} {key}")
    elif isinstance(shown, list) and shown and isinstance(shown[0], dict):
        for one in shown:
            yield from _leaves(one, f"{at} {one.get('photo')} {one.get('point')} {one.get('camera')}")
    elif isinstance(shown, list):
        for place, one in enumerate(shown):
            yield from _leaves(one, f"{at} {place}")
    else:
        yield at, shown


@pytest.mark.parametrize(
    "name",
    [
        None,
        pytest.param("small_frame_block", marks=pytest.mark.long),
        pytest.param("drone_rtk", marks=pytest.mark.long),
    ],
)
def test_a_session_from_the_stored_solution_is_that_from_the_measurements_alone(
    project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str | None
) -> None:
    folder, points = project
    if name is None:
        session = OnlineSession(folder, None)
        for point in points:
            _measure(session, folder, point)
        _reply(session, folder, do="solve")
    else:
        folder = sample(tmp_path, name)
        run_quietly(folder)
    from_solution = OnlineSession(folder, None)
    state = BundleState(from_solution._films.state, from_solution.bundle.name)
    assert solution_of_what_is_measured(state) is not None
    monkeypatch.setattr(session_module, "solution_of_what_is_measured", lambda _: None)
    from_measurements = OnlineSession(folder, None)
    for what in SHOWN:
        found = dict(_leaves(_reply(from_solution, folder, do="show", what=what)))
        expected = dict(_leaves(_reply(from_measurements, folder, do="show", what=what)))
        assert found.keys() == expected.keys()
        for at, value in expected.items():
            # both adjustments end within 1e-4 of a standard deviation, which has two or three digits of what is shown
            is_figure = isinstance(value, float)
            assert found[at] == (pytest.approx(value, rel=1e-5, abs=1e-6) if is_figure else value), at


def test_a_solution_of_other_measurements_is_not_what_a_session_starts_from(project) -> None:
    folder, points = project
    session = OnlineSession(folder, None)
    for point in points:
        _measure(session, folder, point)
    _reply(session, folder, do="solve")
    photo, name, x, y = points[-1]
    for moved, is_of_it in ((0.0, True), (0.01, False)):
        _measure(session, folder, (photo, name, x + moved, y))
        state = BundleState(OnlineSession(folder, None)._films.state, "MAIN")
        assert (solution_of_what_is_measured(state) is not None) == is_of_it


def test_what_is_answered_is_on_the_disk(project) -> None:
    """A session that was killed after any answer goes on where it was: nothing but the log is needed."""
    folder, points = project
    session = OnlineSession(folder, None)
    for point in points:
        reply = _measure(session, folder, point)
        again = OnlineSession(folder, None)
        assert again.measuring.block.measurements.at(reply["photo"], reply["point"]) is not None
    again = OnlineSession(folder, None)
    assert len(again.measuring.block.measurements) == len(points)
    assert set(again.measuring.block.values.orientations) == set(session.measuring.block.values.orientations)
    for session_now in (session, again):
        session_now.measuring.relinearise()
    assert again.measuring.block.equations.square_sum == pytest.approx(
        session.measuring.block.equations.square_sum, rel=1e-5, abs=1e-8
    )


def test_undo_remove_exclude_and_include(project) -> None:
    folder, points = project
    session = OnlineSession(folder, None)
    for point in points:
        _measure(session, folder, point)
    photo, name, x, y = points[-1]
    assert _reply(session, folder, do="exclude", photo=photo, point=name)["state"] == "excluded"
    assert OnlineSession(folder, None).measuring.answer(photo, name).state == "excluded"
    assert _reply(session, folder, do="include", photo=photo, point=name)["state"] != "excluded"
    _measure(session, folder, (photo, name, x + 0.5, y))
    assert _reply(session, folder, do="undo")["state"] in ("included", "unchecked")
    assert session._places[photo, name] == pytest.approx((x, y), abs=1e-9)
    assert _reply(session, folder, do="remove", photo=photo, point=name)["state"] == "removed"
    assert "is not measured" in _reply(session, folder, do="remove", photo=photo, point=name)["error"]
    assert len(OnlineSession(folder, None).measuring.block.measurements) == len(points) - 1


def test_lines_that_others_append_are_answered(project) -> None:
    folder, points = project
    session = OnlineSession(folder, None)
    with (folder / "FIRST.MEA").open("a", encoding="utf-8") as log:
        for photo, name, x, y in points:
            log.write(f"POINTS MAIN {photo}\n  {name} {x} {y}\n")
    answers = list(session.appended())
    assert {(answer.photo, answer.point) for answer in answers} == {point[:2] for point in points}
    assert not list(session.appended())


def _first_strip(folder: Path) -> tuple[Path, list[Point]]:
    """Return a sample of which the first strip is measured, with its points in the order of measuring."""
    folder = sample(folder, "small_frame_block")
    (folder / "DAY2.MEA").unlink()
    commit(initialise(read_project(folder, "definitions")))
    return folder, typed_points(folder)


def test_a_strip_typed_in_the_order_of_its_file_is_oriented_by_control_that_comes_late(tmp_path: Path) -> None:
    """Three full control points in 207 photo points, the last of them within a tenth of all from the end."""
    folder, points = _first_strip(tmp_path)
    session = OnlineSession(folder, None)
    for point in points:
        _measure(session, folder, point)
    assert len(session.measuring.block.values.orientations) == 6
    shown = _reply(session, folder, do="show")["summary"]
    assert "6 photos oriented" in shown
    assert _reply(session, folder, do="show", what="waiting") == {"waiting": []}
    again = OnlineSession(folder, None)
    assert _reply(again, folder, do="show")["summary"] == shown


@pytest.mark.long
def test_what_is_shown_after_a_measurement_is_the_solution_of_what_is_measured(tmp_path: Path) -> None:
    """Photos and points were up to two standard deviations from the adjustment of the same measurements."""
    folder = sample(tmp_path, "small_frame_block")
    commit(initialise(read_project(folder, "definitions")))
    points = typed_points(folder)
    random.Random(3).shuffle(points)
    session = OnlineSession(folder, None)
    for point in points:
        _measure(session, folder, point)
    suspects = list(session.measuring.suspects)
    assert {key.kind for key in suspects} <= {"photo"}
    shown = {
        what: {one[what[:-1]]: one for one in _reply(session, folder, do="show", what=what)[what]}
        for what in ("photos", "points")
    }
    for key in suspects:
        _reply(session, folder, do="exclude", photo=key.photo, point=key.point)
    assert _reply(session, folder, do="solve")["status"] == "converged"
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    compared = 0
    for what, of_kind in shown.items():
        for name, found in of_kind.items():
            for element, of_solve in result[what][name].items():
                if isinstance(of_solve, dict) and of_solve.get("sd"):
                    assert abs(found[element] - of_solve["value"]) < 0.05 * of_solve["sd"], (name, element)
                    compared += 1
    assert compared >= 6 * 12 + 3 * 140


def test_control_that_is_written_to_its_file_during_a_session_orients_it(tmp_path: Path) -> None:
    folder, points = _first_strip(tmp_path)
    control = folder / "CLIFF.PNT"
    text = control.read_text(encoding="utf-8")
    control.write_text("! nothing yet\n", encoding="utf-8")
    session = OnlineSession(folder, None)
    for point in points:
        _measure(session, folder, point)
    assert "local system, no control yet" in _reply(session, folder, do="show")["summary"]
    control.write_text(text, encoding="utf-8")
    assert not list(session.appended())
    summary = _reply(session, folder, do="show")["summary"]
    assert "6 photos oriented" in summary
    assert "local system" not in summary


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("", "not a request"),
        ("[1, 2]", "not a request"),
        ('{"do": "fly"}', "it is one of measure"),
        ('{"do": "measure", "photo": "P1", "point": "1", "x": "a", "y": 1}', "a number"),
        ('{"do": "measure", "photo": "P1", "point": "1", "x": NaN, "y": 1}', "a number"),
        ('{"do": "measure", "photo": "P1", "point": 1, "x": 1, "y": 1}', "in quotes"),
        ('{"do": "show", "what": "all"}', "it is one of summary"),
        ('{"do": "show", "what": "points", "photo": "P1"}', 'for "what": "residuals" alone'),
        ('{"do": "solve", "now": true}', "does not have"),
        ('{"do": "solve", "prune": "yes"}', "true or false"),
    ],
)
def test_faulty_requests(line: str, wrong: str) -> None:
    with pytest.raises(UsageError, match=wrong):
        read_request(line)


def test_a_hundred_thousand_garbled_lines_change_nothing(project) -> None:
    folder, points = project
    session = OnlineSession(folder, None)
    _measure(session, folder, points[0])
    before = (folder / "EDITS.MEA").read_bytes()
    noise = random.Random(5).random
    line = json.dumps({"do": "measure", "photo": "NONE", "point": "7", "x": 1.0, "y": 2.0})
    for _ in range(100_000):
        characters = list(line)
        for _ in range(1 + int(5 * noise())):
            characters[int(len(line) * noise())] = chr(1 + int(0x2000 * noise()))
        reply = reply_to(session, folder, "".join(characters))
        assert reply is not None
        assert "error" in reply
    assert (folder / "EDITS.MEA").read_bytes() == before


def test_unknown_photo_is_refused_with_names_like_it(project) -> None:
    folder, _ = project
    reply = _reply(OnlineSession(folder, None), folder, do="measure", photo="NONE", point="1", x=1.0, y=1.0)
    assert "photo NONE is not defined" in reply["error"]
    assert not (folder / "EDITS.MEA").exists()
