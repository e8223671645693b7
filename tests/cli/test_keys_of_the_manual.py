"""Every key of ORIPROGRAM's menus (Dueholm 1989) is carried out by a command: docs/oriprogram.md says by which.

The keys that define a project and its control are carried out here, one by one, and what a command shows afterwards
tells whether they did what the manual says. All others have tests of their own, which `ELSEWHERE` names.
"""

from __future__ import annotations

import ast
import shlex
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import Said, orip
from cli.keys_of_the_manual import EDITS, ELEMENT, HERE, PRELIMINARY, Edit, Key
from support.menus_of_the_manual import MENUS
from workflow.small_projects import first_project, replace_in

from orip.workflow.project.state import read_project

TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("prepared") / "cliff"
    assert orip(folder.parent, "init", "--sample", "small_frame_block", str(folder)).code == 0
    assert orip(folder, "init").code == 0
    for name in ("101", "102", "103"):
        assert orip(folder, "control", "elements", "add", name, *ELEMENT.split()).code == 0
    for name in ("E1", "E2"):
        assert orip(folder, "control", "preliminary", "add", name, *PRELIMINARY.split()).code == 0
    assert orip(folder, "measure").code == 0
    return folder


@pytest.fixture
def cliff(prepared: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(prepared, tmp_path / "cliff"))


def done(folder: Path, words: str, *more: str) -> Said:
    said = orip(folder, *shlex.split(words), *more)
    assert said.code == 0, said.err
    return said


@pytest.mark.parametrize("key", HERE, ids=lambda key: f"{key.menu} {key.key}")
def test_a_key_does_what_the_manual_says(cliff: Path, key: Key) -> None:
    for words in key.words.split("; "):
        done(cliff, words)
    document = done(cliff, key.look, "--json").document
    if isinstance(key.shown, tuple):
        assert tuple(record["name"] for record in document["records"]) == key.shown
        return
    if "values" in document:
        found = {value["key"]: value["value"] for value in document["values"]}
    else:
        (found,) = (record for record in document["records"] if record["name"] == key.shown["name"])
    assert {name: found.get(name) for name in key.shown} == key.shown


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: f"{edit.menu} {edit.key}")
def test_a_key_that_edits_measurements(cliff: Path, edit: Edit) -> None:
    for words in edit.words.split("; "):
        done(cliff, f"observations {words}")
    what = shlex.split(edit.words)[1]
    measured = read_project(cliff, "marks", "observations").measured
    if what == "point":
        found = measured.observations["MAIN"]
        rows = [row for row, photo in enumerate(found.photos) if photo == "101"]
        names, disregarded = [found.points[row] for row in rows], found.disregarded[rows]
    else:
        oriented = measured.templates.get("LEFT") if what == "tick" else measured.photos.get("101")
        names = list(oriented.marks.names) if oriented else []
        disregarded = oriented.marks.disregarded if oriented else np.zeros(0, dtype=np.bool_)
    pairs = sorted(pair for pair in zip(names, disregarded.tolist(), strict=True) if pair[0] in edit.names)
    assert tuple(tuple(name for name, out in pairs if out is wanted) for wanted in (False, True)) == edit.left


def test_files_and_names_of_a_project_are_those_of_the_first_menu(tmp_path: Path) -> None:
    """Keys of menu 1.1: the files have the names that were chosen, the listings those of project and user."""
    folder = first_project(tmp_path / "first")
    (tmp_path / "shared").mkdir()
    replace_in(
        folder / "orip.toml", 'project = { name = "FIRST" }',
        'project = { name = "CLIFF", user = "K. Dueholm", camera_file = "../shared/LENS.CAM", '
        'temtick_file = "../shared/SHEET.TIK", project_files = "P", control_files = "FIRST" }',
    )  # fmt: skip
    done(folder, "run")
    assert sorted(path.name for path in (tmp_path / "shared").iterdir()) == ["LENS.CAM", "SHEET.TIK"]
    assert {"P.PHO", "P.TEM", "P.EXT", "MAIN.EXO"} <= {path.name for path in folder.iterdir()}
    heads = [(folder / name).read_text().split("\n", 6) for name in ("BUNDLE_RESULT.OUT", "BUNDLE_ERROR.OUT")]
    for head in heads:
        assert [line.split(maxsplit=1)[1] for line in head[2:4]] == ["CLIFF", "K. Dueholm"]


_DIGITISE, _NEW = "workflow/digitise/test_digitise.py", "workflow/digitise/test_new_points.py"
_PRELIM, _PANEL, _LINK = "cli/adjust/test_prelim.py", "cli/drive/test_drive_panel.py", "cli/drive/test_drive_link.py"
_BY_COMMANDS = "cli/records/test_projects_by_commands.py"
_HERE = "cli/test_keys_of_the_manual.py"
_COMMANDS, _UPDATE, _OBSERVATIONS = "cli/test_commands.py", "cli/adjust/test_update.py", "cli/test_observations.py"
_WHOLE = "cli/test_digitise_commands.py::test_a_project_is_measured_through_the_plate_processor_from_nothing"
_FILES = f"{_HERE}::test_files_and_names_of_a_project_are_those_of_the_first_menu"
_DONE = f"{_HERE}::test_a_key_does_what_the_manual_says"
_BETTER = f"{_DIGITISE}::test_tick_marks_are_found_better_and_better"
_PHOTOS_OF_A_TEMPLATE = f"{_DIGITISE}::test_all_photos_of_a_template"
_STEREO = f"{_DIGITISE}::test_new_points_go_model_by_model_with_their_partners"
_MONO = f"{_DIGITISE}::test_with_one_eye_new_points_come_photo_by_photo"
_AGAIN = f"{_DIGITISE}::test_again_goes_point_by_point"
_NAMED = f"{_NEW}::test_a_strip_is_measured_model_by_model_with_names_of_the_operator"
_NAMED_MONO = f"{_NEW}::test_with_one_eye_photo_by_photo"
_SKIPPED = f"{_DIGITISE}::test_with_one_eye_the_left_foot_skips_and_deletes"
_ONE_MARK = f"{_NEW}::test_one_mark_alone_is_measured_again_and_a_new_one_is_added"
_OLD_MARKS = f"{_DIGITISE}::test_again_drives_to_the_old_marks_and_keeps_them"
_DOWN_WEIGHTED = f"{_OBSERVATIONS}::test_todo_on_stdout_and_in_a_file"
_PANEL_KEYS = f"{_LINK}::test_goto_where_profile_next_model_forward"
_ALL_MODELS = f"{_PRELIM}::test_relative_orientation_of_all_models_has_the_columns_of_the_manual"
_CONNECTED = f"{_PRELIM}::test_bridging_and_connection_have_the_columns_of_the_manual"
_CHAIN = f"{_PRELIM}::test_the_chain_keeps_photos_and_points_and_lists_how"
_RESULTS = f"{_COMMANDS}::test_results_as_text"
_MARK_KEYS = {
    "Insert Point": _ONE_MARK, "Add Point": _ONE_MARK, "Re-Measure Point": _ONE_MARK, "Edit Point": _OLD_MARKS,
    "Re-Measure All": _OLD_MARKS, "Transformation": _OLD_MARKS,
}  # fmt: skip
_CURVES = "cli/records/test_camera_plot.py"
_FITTED = f"{_CURVES}::test_numbers_are_those_of_the_polynomial_and_the_residuals_of_a_least_squares_fit"

ELSEWHERE: dict[str, dict[str, str]] = {
    "1": {
        "Initialize Project": f"{_BY_COMMANDS}::test_a_project_is_made_once_and_with_a_name_that_is_allowed",
        "Define Project": _DONE, "Enter Control": _DONE, "Measure Orientation": _WHOLE,
        "Compute Bundle Adjustment": _WHOLE, "Test Menu": _PANEL_KEYS, "Print Results": _FILES,
    },
    "1.1": {
        **dict.fromkeys(
            ("Camera File", "Temtick File", "Project Files", "Control Files", "Project Name", "Users Name"), _FILES
        ),
        "Plates Forward": _PANEL_KEYS,
    },
    "1.3": dict.fromkeys(("Control Points", "Control Elements", "Control Distances", "Preliminary Values"), _DONE),
    "1.4": dict.fromkeys(MENUS["1.4"], _DONE),
    "1.4.1": {"Fiducial Marks": _DONE},
    "1.4.1.1": {"Transform Coordinates": f"{_NEW}::test_fiducial_marks_of_a_camera"},
    "1.4.1.2": {"Compute Parameters": f"{_CURVES}::test_isp_form_is_shown_beside_its_polynomial"},
    "1.4.1.3": {"Compute Parameters": _FITTED},
    "1.4.5": {"Observation File Name": "cli/records/test_record_commands.py::test_rename_a_bundle_its_files_follow"},
    "1.5": {
        "Template Orientation": _BETTER, "Photo Orientation": _WHOLE, "Template Photos": _PHOTOS_OF_A_TEMPLATE,
        "Bundle Mono": _MONO, "Bundle Stereo": _STEREO,
    },
    "1.5.1": {**_MARK_KEYS, "Measure All": _BETTER},
    "1.5.2": {**_MARK_KEYS, "Measure All": _PHOTOS_OF_A_TEMPLATE},
    "1.5.3": {
        "Re-Measure Point": _SKIPPED, "Re-Measure All": _SKIPPED, "Measure All": _MONO, "Insert Point": _NAMED_MONO,
        "Add Point": _NAMED_MONO, "Re-Measure Down Weighted": _DOWN_WEIGHTED,
    },
    "1.5.4": {
        "Re-Measure Point": f"{_DIGITISE}::test_a_lock_that_is_opened", "Re-Measure All": _AGAIN,
        "Measure Point All": _AGAIN, "Insert Point": _NAMED, "Add Point": _NAMED,
        "Re-Measure Down Weighted": _DOWN_WEIGHTED, "Next Model": _PANEL_KEYS, "Change Model": _PANEL_KEYS,
    },
    "1.6": {
        "Solve Bundle": _WHOLE, "Stop Solve": "cli/test_interrupt.py::test_ctrl_c_keeps_the_iteration_in_hand",
        "Camera Results": _RESULTS, "Photo Results": _RESULTS, "Point Results": _RESULTS,
        "Compute Preliminary Values": _CHAIN, "Down Load Models": f"{_LINK}::test_download",
    },
    "1.6.1": {
        "Camera Name": _RESULTS,
        "Update Preliminary Values": f"{_UPDATE}::test_a_camera_survives_the_next_run_and_the_adjustment_stays",
    },
    "1.6.2": {"Photo Name": _RESULTS, "Update Preliminary Values": f"{_UPDATE}::test_named_ones_alone"},
    "1.6.3": {"Update Preliminary Values": f"{_UPDATE}::test_points_go_into_the_text_with_their_deviations"},
    "1.6.4": {
        "Relative Orientation Model": f"{_PRELIM}::test_relative_orientation_of_one_model_lists_points_and_parameters",
        "Bridge Models": _CONNECTED, "Connect Strips": _CONNECTED, "Relative Orientation All": _ALL_MODELS,
        "Bridge All": _CONNECTED, "Connect All": _CONNECTED,
        "Absolute Orientation": f"{_PRELIM}::test_absolute_orientation_lists_control_in_ground_units",
        "Print Results": _CHAIN, "Update Values": _CHAIN,
        "Model Coordinates": f"{_PRELIM}::test_show_lists_the_systems_that_there_are_after_each_step",
    },
}  # fmt: skip

NOT_NEEDED = {
    ("1", "Stop Program"), ("1.4.1", "Down Load Distortion"), ("1.6.4", "Next Model"), ("1.6.4", "Change Model"),
}  # fmt: skip
"""Keys that docs/oriprogram.md says are not needed."""


def test_every_key_of_every_menu_is_tested() -> None:
    tested = {(key.menu, key.key) for key in (*HERE, *EDITS)}
    tested |= {(menu, key) for menu, keys in ELSEWHERE.items() for key in keys}
    assert {(menu, key) for menu, keys in MENUS.items() for key in keys} - tested == NOT_NEEDED
    named = {test for keys in ELSEWHERE.values() for test in keys.values()}
    assert {test for test in named if test.partition("::")[2] not in names_of_tests(test.partition("::")[0])} == set()


@cache
def names_of_tests(module: str) -> frozenset[str]:
    tree = ast.parse((TESTS / module).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))
