"""Edits of observations: the log and the stores say the same, whatever happens; predictions are right."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from files.hand_built_solutions import empty
from interior.template_project import film_with_blunder, plate_coordinates
from support.aerial_block_in_crs import CRS, PRINCIPAL_DISTANCE, aerial_block
from workflow.commands import edit_observations, list_observations, measure, measure_again, remeasure
from workflow.killed_here import Killed, killed_at
from workflow.small_projects import film_project, replace_in

from orip.bundle.local_frame import ground_system
from orip.bundle.results.covariance import predict_photo_coordinates
from orip.errors import InputError, LockedError
from orip.files.stores.contents import observations, solutions
from orip.files.stores.dump import dump
from orip.files.stores.transaction import reading, writing
from orip.interior.distortion import corrected_with_partials
from orip.records.camera import CAMERA_PARAMETERS, READOUT, Camera
from orip.records.ground import PLAIN
from orip.records.results.solution import Estimates, Solution
from orip.structs import replace
from orip.workflow.observations.edits import EDITED_FROM
from orip.workflow.observations.edits import edit_observations as edited
from orip.workflow.observations.listed import LISTED_FROM
from orip.workflow.project.bundle_state import read_bundle
from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project

STORES = ("CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO")
KILLED_ORIP = Path(__file__).with_name("killed_orip.py")


def dumps(folder: Path) -> list[list[str]]:
    return [list(dump(folder / name)) for name in STORES]


def edits(folder: Path) -> str | None:
    path = folder / "EDITS.MEA"
    return path.read_text(encoding="utf-8") if path.exists() else None


def assert_replay_gives_the_same(folder: Path) -> None:
    """Replay everything from the beginning into new stores, and compare."""
    held = dumps(folder)
    copy = folder.with_name(f"{folder.name}-replayed")
    shutil.copytree(folder, copy)
    (copy / "MAIN.EXO").unlink()
    assert measure(copy).changed
    assert dumps(copy) == held
    shutil.rmtree(copy)


def state(folder: Path) -> dict[tuple[str, str], bool]:
    """Return by photo and point whether it is disregarded."""
    with reading([folder / "MAIN.EXO"]) as stores:
        found = observations.read(stores[folder / "MAIN.EXO"])
    assert found is not None
    return dict(zip(zip(found.photos, found.points, strict=True), found.disregarded.tolist(), strict=True))


def marks(folder: Path) -> list[str]:
    found = [*dump(folder / "FIRST.PHO"), *dump(folder / "FIRST.TEM")]
    return [line for line in found if not line.startswith(('["measure"', '{"format"'))]


@pytest.fixture
def film(tmp_path: Path, adjusted_film: Path) -> Path:
    """A project on a template, with a blunder in point P1, adjusted."""
    return Path(shutil.copytree(adjusted_film, tmp_path / "film"))


@pytest.fixture(scope="module")
def adjusted_film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = film_with_blunder(tmp_path_factory.mktemp("adjusted") / "film")
    assert orip(folder, "run").code == 0
    return folder


@pytest.mark.parametrize(
    "edit",
    [
        ("DISREGARD", "POINT", "left", ["P1", "1"]),
        ("DISREGARD", "POINT", "*", ["P1"]),
        ("KILL", "POINT", "LEFT", ["*"]),
        ("KILL", "POINT", "right", ["2"]),
        ("DISREGARD", "MARK", "*", ["2"]),
        ("KILL", "MARK", "right", ["4"]),
        ("DISREGARD", "TICK", "t1", ["3"]),
        ("KILL", "TICK", "*", ["5"]),
    ],
)
def test_edit_is_in_the_stores_at_once_and_a_replay_gives_the_same(film: Path, edit) -> None:
    before = dumps(film)
    trial = edit_observations(film, *edit, is_trial=True)
    assert (edits(film), dumps(film)) == (None, before)
    done = edit_observations(film, *edit)
    assert done.lines == trial.lines
    assert dumps(film) != before
    text = edits(film)
    assert text is not None
    assert text.splitlines()[1:] == list(done.lines)
    assert_replay_gives_the_same(film)
    # again: nothing to do, and not one byte changes
    held = dumps(film)
    assert edit_observations(film, *edit).lines == ()
    assert (edits(film), dumps(film)) == (text, held)


def test_include_takes_disregard_back(film: Path) -> None:
    first = state(film)
    measured_marks = marks(film)
    for what, owner, name in [("POINT", "*", "P1"), ("MARK", "left", "1"), ("TICK", "T1", "5")]:
        edit_observations(film, "DISREGARD", what, owner, [name])
    assert {key for key, flag in state(film).items() if flag} == {("left", "P1"), ("right", "P1")}
    assert marks(film) != measured_marks
    for what, owner, name in [("POINT", "*", "P1"), ("MARK", "left", "1"), ("TICK", "T1", "5")]:
        edit_observations(film, "INCLUDE", what, owner, [name])
    assert state(film) == first
    assert marks(film) == measured_marks


def test_only_what_changes_anything_is_written(film: Path) -> None:
    edit_observations(film, "DISREGARD", "POINT", "left", ["1"])
    done = edit_observations(film, "DISREGARD", "POINT", "left", ["1", "2", "2"])
    assert done.lines == ("DISREGARD POINT MAIN left 2",)
    assert edit_observations(film, "INCLUDE", "POINT", "left", ["3", "2"]).lines == ("INCLUDE POINT MAIN left 2",)


def test_comments_and_line_ends_of_the_text_stay(film: Path) -> None:
    (film / "EDITS.MEA").write_bytes(b"! mine\r\nDISREGARD POINT MAIN left 1 ! why\r\n! last")
    edit_observations(film, "KILL", "POINT", "left", ["2"])
    assert (film / "EDITS.MEA").read_bytes() == (
        b"! mine\r\nDISREGARD POINT MAIN left 1 ! why\r\n! last\r\nKILL POINT MAIN left 2\r\n"
    )


def test_measurements_that_changed_meanwhile_are_replayed_too_and_that_is_said(film: Path) -> None:
    replace_in(film / "FIRST.MEA", "PHOTO left A", "PHOTO left C")
    done = edit_observations(film, "DISREGARD", "POINT", "left", ["1"])
    assert [(warning.code, warning.where) for warning in done.warnings] == [("all-replayed", "FIRST.MEA")]
    assert_replay_gives_the_same(film)


def test_point_left_with_a_single_ray_or_none_is_named(film: Path) -> None:
    (alone,) = edit_observations(film, "KILL", "POINT", "left", ["P1"]).left_alone
    assert (alone.bundle, alone.point, alone.photos) == ("MAIN", "P1", ("right",))
    # it has one already: nothing new to say
    assert edit_observations(film, "KILL", "POINT", "right", ["P1"]).left_alone == ()
    gone = edit_observations(film, "DISREGARD", "POINT", "*", ["1", "2"]).left_alone
    assert [(point.point, point.photos) for point in gone] == [("1", ()), ("2", ())]


# measured again


def again(folder: Path, xy: str, name: str = "again.txt") -> Path:
    (folder / name).write_text(f"POINTS MAIN left\n  P1 {xy}\n")
    return Path(name)


@pytest.mark.parametrize("action", ["DISREGARD", "KILL"])
def test_point_measured_again_after_its_edit_is_new_and_included(film: Path, action) -> None:
    edit_observations(film, action, "POINT", "left", ["P1"])
    remeasure(film, again(film, "55.6 69.5"))
    assert state(film)["left", "P1"] is False
    assert_replay_gives_the_same(film)
    # the same again changes nothing
    held = edits(film)
    assert remeasure(film, Path("again.txt")).lines == ()
    assert edits(film) == held
    # an edit after it concerns it
    edit_observations(film, "DISREGARD", "POINT", "left", ["P1"])
    assert state(film)["left", "P1"] is True


@pytest.mark.parametrize(("action", "expected"), [("DISREGARD", True), ("KILL", None)])
def test_measurement_in_another_file_comes_before_the_edits_and_is_edited_by_them(film: Path, action, expected) -> None:
    edit_observations(film, action, "POINT", "left", ["P1"])
    again(film, "55.6 69.5", "SECOND.MEA")
    measure(film)
    assert state(film).get(("left", "P1")) is expected


def test_todo_filled_in_is_a_measurement_file(film: Path) -> None:
    edit_observations(film, "KILL", "POINT", "left", ["1"])
    edit_observations(film, "DISREGARD", "POINT", "right", ["2"])
    todo = measure_again(film, output=Path("again.txt"))
    assert next((point.point, point.why) for point in todo.points if point.photo == "left") == ("1", "killed")
    assert next((point.point, point.why) for point in todo.points if point.photo == "right") == ("2", "disregarded")
    assert [point.why for point in todo.points if point.point == "P1"] == ["down-weighted"]
    with pytest.raises(InputError, match=r"again.txt:6:.* a coordinate is missing"):
        remeasure(film, Path("again.txt"))
    text = (film / "again.txt").read_text()
    before = {f"{point.point}  !": f"{point.point} {point.before[0]!r} {point.before[1]!r} !" for point in todo.points}
    for name, line in before.items():
        text = text.replace(name, line).replace(name.replace("  ", "   "), line)
    (film / "again.txt").write_text(text)
    remeasure(film, Path("again.txt"))
    assert not any(state(film).values())
    assert ("left", "1") in state(film)


def test_todo_names_the_old_coordinates_as_they_were_read_on_the_plate(film: Path) -> None:
    todo = measure_again(film)
    (point,) = todo.points
    assert point.point == "P1"
    assert point.before == pytest.approx(plate_coordinates(film, point.photo, "P1"), abs=1e-9)
    # predicted and measured differ by the residual, turned as the film lies
    assert np.hypot(*np.subtract(point.predicted, point.before)) == pytest.approx(np.hypot(*point.residual), rel=1e-3)


def test_point_of_a_single_ray_is_asked_for_in_the_photos_of_its_models_and_those_that_show_it(film: Path) -> None:
    # a control point: the adjustment knows where the other photo shows it
    edit_observations(film, "KILL", "POINT", "left", ["3"])
    (film / "EDITS.MEA").unlink()
    log = (film / "FIRST.MEA").read_text()
    left, right = log.split("POINTS MAIN right")
    (film / "FIRST.MEA").write_text(
        left
        + "POINTS MAIN right"
        + "\n".join(line for line in right.splitlines() if not line.lstrip().startswith("3 "))
        + "\n"
    )
    assert orip(film, "run", "--no-report").code == 0
    points = {(point.photo, point.point): point for point in measure_again(film).points}
    missing = points["right", "3"]
    assert missing.why == "single ray"
    measured = next(line for line in right.splitlines() if line.lstrip().startswith("3 ")).split()
    assert missing.predicted == pytest.approx((float(measured[1]), float(measured[2])), abs=0.1)
    # a tie point of one ray: nobody knows where it is; without models it is asked for where it is
    (film / "FIRST.MEA").write_text((film / "FIRST.MEA").read_text() + "  lone 120.0 70.0\n")
    measure(film)
    lone = [point for point in measure_again(film).points if point.point == "lone"]
    assert [(point.photo, point.why) for point in lone] == [("right", "single ray")]
    replace_in(
        film / "orip.toml",
        'name = "MAIN"',
        'name = "MAIN"\nmodel = [{ name = "M1", left = "left", right = "right", row = 1, column = 1 }]',
    )
    assert orip(film, "init").code == 0
    lone = [point for point in measure_again(film).points if point.point == "lone"]
    assert [(point.photo, point.why) for point in lone] == [("left", "single ray")]
    assert np.isnan(lone[0].predicted).all()


# refused


def refused(film: Path, words: str, *edit, bundle: str | None = None) -> None:
    before, text = dumps(film), edits(film)
    with pytest.raises(InputError) as fault:
        edit_observations(film, *edit, bundle=bundle)
    assert words in str(fault.value)
    assert (dumps(film), edits(film)) == (before, text)


def test_names_that_are_not_known_are_refused_with_those_like_them(film: Path) -> None:
    refused(film, "photo lef is not defined; did you mean left?", "KILL", "POINT", "lef", ["1"])
    refused(film, "template T9 is not defined; known are: T1", "KILL", "TICK", "T9", ["1"])
    refused(film, "point P11 of bundle MAIN is not measured in photo left; did you mean P1",
            "DISREGARD", "POINT", "left", ["1", "P11"])  # fmt: skip
    refused(film, "mark 9 is not measured in any photo; known are: 1, 2, 3, 4", "DISREGARD", "MARK", "*", ["9"])
    refused(film, "tick 9 is not measured in template T1; known are:", "DISREGARD", "TICK", "T1", ["9"])


def test_killed_point_cannot_be_included_and_the_line_that_killed_it_is_named(film: Path) -> None:
    edit_observations(film, "KILL", "POINT", "left", ["P1"])
    refused(film, "is killed in photo left by EDITS.MEA:2; take that line out", "INCLUDE", "POINT", "left", ["P1"])
    assert edit_observations(film, "KILL", "POINT", "left", ["P1"]).lines == ()


def test_edit_that_leaves_too_few_marks_is_refused(film: Path) -> None:
    edit_observations(film, "DISREGARD", "MARK", "left", ["1"])
    refused(film, "photo left has 2 usable marks; transformation A needs 3", "KILL", "MARK", "left", ["2"])


def test_edit_of_a_log_that_is_at_fault_already_is_refused(film: Path) -> None:
    (film / "SECOND.MEA").write_text("POINTS MAIN left\n 1 x 2\n")
    refused(film, "SECOND.MEA:2:4: 'x' is not a number", "KILL", "POINT", "left", ["1"])


def test_stores_with_measurements_that_no_file_of_the_project_has_are_not_replayed_away(film: Path) -> None:
    (film / "extra.txt").write_text("POINTS MAIN left\n  extra 50.0 60.0\n")
    measure(film, [Path("extra.txt")])
    refused(film, "the stores hold measurements from extra.txt", "KILL", "POINT", "left", ["1"])
    measure(film)
    assert edit_observations(film, "KILL", "POINT", "left", ["1"]).lines


def test_locked_stores_leave_the_text_alone(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = dumps(film)
    monkeypatch.setattr("orip.workflow.project.commit.writing", lambda paths: writing(paths, timeout=0.0))
    with writing([film / "MAIN.EXO"]), pytest.raises(LockedError):
        edit_observations(film, "KILL", "POINT", "left", ["1"])
    assert (edits(film), dumps(film)) == (None, before)


def test_text_that_another_run_has_changed_is_not_overwritten(film: Path) -> None:
    change = edited(read_project(film, *EDITED_FROM), "DISREGARD", "TICK", "T1", ["2"])
    (film / "EDITS.MEA").write_text("! somebody else's\n")
    before = dumps(film)
    with pytest.raises(LockedError, match=r"another run has changed EDITS.MEA in the meantime"):
        commit(change)
    assert edits(film) == "! somebody else's\n"
    assert dumps(film) == before


# killed


def _kill(tmp_path: Path, film: Path, run: Callable[[int, Path], int], chosen: int | None) -> int:
    """Kill an edit before each step, or before some of them; `run` returns the number of steps where it is let live."""
    after = tmp_path / "after"
    shutil.copytree(film, after)
    edit_observations(after, *TICK_OUT)
    old, new = dumps(film), dumps(after)
    steps = list(range(1, run(0, Path(shutil.copytree(film, tmp_path / "counted"))) + 1))
    if chosen is not None:
        steps = sorted(random.Random(1).sample(steps, chosen - 2)) + steps[-8:-6]
    for step in steps:
        folder = Path(shutil.copytree(film, tmp_path / f"killed-{step}"))
        run(step, folder)
        held, text = dumps(folder), edits(folder)
        assert (text, held) in ((None, old), (edits(after), old), (edits(after), new))
        # either way the same command, or a replay, ends as if nothing had happened
        if text is not None and step % 2:
            measure(folder)
        else:
            edit_observations(folder, *TICK_OUT)
        assert (edits(folder), dumps(folder)) == (edits(after), new)
        assert (folder / "INTERIOR_RESULT.OUT").read_text() == (after / "INTERIOR_RESULT.OUT").read_text()
        shutil.rmtree(folder)
    return len(steps)


TICK_OUT = ("DISREGARD", "TICK", "T1", ["2"])


def test_killed_at_some_steps(tmp_path: Path, film: Path) -> None:
    def run(step: int, folder: Path) -> int:
        with killed_at(step or None) as steps, pytest.raises(Killed) if step else nullcontext():
            edit_observations(folder, *TICK_OUT)
        return steps()

    assert _kill(tmp_path, film, run, chosen=3) == 3


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_a_process_killed_at_every_step(tmp_path: Path, film: Path) -> None:
    def run(step: int, folder: Path) -> int:
        words = ["-q", "-C", str(folder), "observations", "disregard", "tick", "T1", "2"]
        program = [sys.executable, str(KILLED_ORIP), str(step), *words]
        done = subprocess.run(program, capture_output=True, check=False, timeout=60)
        assert done.returncode == (-signal.SIGKILL if step else 0)
        return 0 if step else int(done.stdout.split()[-1])

    assert _kill(tmp_path, film, run, chosen=None) > 20


# what is predicted


def predicted_against_residuals(folder: Path) -> float:
    """Return the largest difference (mm) of predicted and observed plus residual, at corrected coordinates if so."""
    bundle = read_bundle(folder, None, *LISTED_FROM)
    solution = bundle.solution
    assert solution is not None
    worst = 0.0
    place = {name: row for row, name in enumerate(solution.points.names)}
    found = solution.residuals
    for photo in solution.photos.names:
        camera = bundle.records.camera_of(bundle.records.photos[photo.upper()])
        xy = predict_photo_coordinates(solution, photo, camera, solution.points.values, PLAIN)
        rows = [row for row, kind in enumerate(found.kind) if kind == "photo" and found.photo[row] == photo]
        observed = found.observed[rows].reshape(-1, 2)
        residual = found.residual[rows].reshape(-1, 2)
        predicted = xy[[place[found.point[row]] for row in rows[::2]]]
        if camera.distortion_at == "measured":
            parameters = solution.cameras.values[0]
            difference = _corrected(predicted, parameters) - _corrected(observed, parameters) - residual
        else:
            difference = predicted - observed - residual
        worst = max(worst, float(np.abs(difference).max()))
    return worst


def _corrected(xy, parameters):
    """Return ideal coordinates (n, 2) of measured ones by the 11 parameters of a camera."""
    return np.stack(corrected_with_partials(parameters[3:READOUT], *(xy - parameters[1:3]).T)[:2], axis=1)


@pytest.mark.parametrize("argument", ["ideal", "measured"])
def test_prediction_is_the_observation_with_its_residual(tmp_path: Path, argument: str) -> None:
    folder = film_project(tmp_path / "film")
    distortion = "{ A3 = -2.0e-5, A5 = 3.0e-8, P1 = 1.0e-5, B1 = 2.0e-4 }"
    more = f'distortion = {distortion}\ndistortion_at = "{argument}"\nprincipal_point = [0.05, -0.03]\n'
    replace_in(folder / "orip.toml", "c = 35.0", f"{more}c = 35.0")
    assert orip(folder, "run").code == 0
    # Newton's steps end below 1e-9 mm
    assert predicted_against_residuals(folder) < 2e-9


def test_prediction_with_a_parameter_set(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    replace_in(folder / "orip.toml", "c = 35.0", 'set = "EBNER"\nframe = [36.0, 24.0]\nc = 35.0')
    assert orip(folder, "run").code == 0
    with reading([folder / "FIRST.EXT"]) as stores:
        solution = solutions.read(stores[folder / "FIRST.EXT"], "MAIN")
    assert solution is not None
    assert max(abs(parameter.value) for parameter in solution.additional) > 0.0
    assert predicted_against_residuals(folder) < 1e-12


def in_crs() -> tuple[Solution, np.ndarray, np.ndarray, np.ndarray]:
    block = aerial_block()
    count = len(block.orientations)
    values = np.array([[PRINCIPAL_DISTANCE, *(0.0,) * 12]])
    solution = replace(
        empty(),
        cameras=Estimates(("CAM",), values, values),
        projections=("perspective",),
        photos=Estimates(tuple(f"P{row}" for row in range(count)), block.orientations, block.orientations),
        additional=(),
    )
    return solution, block.points[block.point], block.photo, block.xy


def test_prediction_on_the_curved_earth_is_that_of_proj() -> None:
    solution, points, photo, xy = in_crs()
    ground = ground_system(CRS, "m", (), solution.photos.values[:, :3])
    camera = Camera("CAM", (PRINCIPAL_DISTANCE, *(0.0,) * (len(CAMERA_PARAMETERS) - 1)))
    for row in (0, len(solution.photos.names) // 2, len(solution.photos.names) - 1):
        mine = photo == row
        found = predict_photo_coordinates(solution, f"P{row}", camera, points[mine], ground)
        # the block's own accuracy: PROJ's conversions to and fro, 1e-9 of the flying height
        assert np.allclose(found, xy[mine], rtol=0.0, atol=1e-6)


def test_point_behind_the_camera_is_not_shown() -> None:
    solution, _, _, _ = in_crs()
    above = solution.photos.values[:1, :3] + [0.0, 0.0, 100.0]
    camera = Camera("CAM", (PRINCIPAL_DISTANCE, *(0.0,) * (len(CAMERA_PARAMETERS) - 1)))
    assert np.isnan(predict_photo_coordinates(solution, "P0", camera, above, PLAIN)).all()


# stereo partners


def test_partner_is_found_where_the_point_is_not_measured(film: Path) -> None:
    replace_in(
        film / "orip.toml",
        'name = "MAIN"',
        'name = "MAIN"\nmodel = [{ name = "M1", left = "left", right = "right", row = 1, column = 1 }]',
    )
    assert orip(film, "init").code == 0
    (measured,) = list_observations(film, photo="left", point="2", every=True, with_partners=True).partners
    assert (measured.partner, measured.model, measured.place) == ("right", "M1", "measured")
    edit_observations(film, "KILL", "POINT", "right", ["2"])
    (predicted,) = list_observations(film, photo="left", point="2", every=True, with_partners=True).partners
    assert (predicted.partner, predicted.model, predicted.place) == ("right", "M1", "predicted")
    # residuals are some µm
    assert predicted.photo_xy == pytest.approx(measured.photo_xy, abs=0.02)
    assert predicted.log_xy == pytest.approx(measured.log_xy, abs=0.02)


def test_point_outside_the_frame_has_no_partner(film: Path) -> None:
    replace_in(film / "orip.toml", "c = 35.0", "frame = [20.0, 20.0]\nc = 35.0")
    assert orip(film, "init").code == 0
    edit_observations(film, "KILL", "POINT", "right", ["1"])  # at x = -17.5 mm there
    assert list_observations(film, point="1", every=True, with_partners=True).partners == ()
