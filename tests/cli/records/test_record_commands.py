"""`orip camera`, `temtick`, `photo`, `template`, `bundle` and `model`: each command, and each kind of bad input."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli.command_line import Said, orip
from workflow.small_projects import contents, film_project, first_project, replace_in, two_bundles

from orip.files.stores.contents import observations
from orip.files.stores.contents.stores import PHOTO_ORIENTATIONS
from orip.files.stores.transaction import reading

KINDS = ("camera", "temtick", "photo", "template", "bundle", "model")


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("prepared")
    for made in (first_project(folder / "first"), film_project(folder / "film")):
        assert orip(made, "init").code == 0
        assert orip(made, "measure").code == 0
    return folder


@pytest.fixture
def project(prepared: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(prepared / "first", tmp_path / "first"))


@pytest.fixture
def film(prepared: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(prepared / "film", tmp_path / "film"))


def typed(text: str) -> list[str]:
    """Return the words of a command line."""
    return text.split()


def done(said: Said) -> Said:
    assert said.code == 0, said.err
    return said


def refused(folder: Path, sentence: str, *words: str, code: int = 3) -> str:
    """Check that a command is refused and changes nothing; return what it said."""
    before = contents(folder)
    said = orip(folder, *words)
    assert said.code == code
    assert sentence in said.err
    assert said.out == ""
    assert contents(folder) == before
    return said.err


def unchanged(folder: Path, *words: str) -> None:
    before = contents(folder)
    said = done(orip(folder, *words, "--json"))
    assert "unchanged" in said.err
    assert said.document["unchanged"] is True
    assert said.document["changes"] == []
    assert contents(folder) == before


def values(folder: Path, kind: str, name: str) -> dict[str, object]:
    document = done(orip(folder, kind, "show", name, "--json")).document
    return {value["key"]: value["value"] for value in document["values"]}


def names(folder: Path, kind: str) -> list[str]:
    return [record["name"] for record in done(orip(folder, kind, "list", "--json")).document["records"]]


# list and show


def test_list_and_show(project: Path) -> None:
    said = done(orip(project, "photo", "list"))
    assert said.err == ""
    assert "left   C35     -         1070.0  2075.0" in said.out
    assert "orip.toml:6" in said.out
    said = done(orip(project, "camera", "show", "c35"))
    shown = dict(line.split()[:2] for line in said.out.splitlines() if len(line.split()) > 1)
    assert (shown["c"], shown["sensor.width"]) == ("35.0", "36.0")
    assert "from      orip.toml:2\n" in said.out
    assert "named by  photo left, photo right" in said.out


@pytest.mark.parametrize("kind", KINDS)
def test_lists_are_data_of_records_or_none(project: Path, kind: str) -> None:
    said = done(orip(project, kind, "list"))
    assert said.err == ""
    assert said.out
    document = done(orip(project, kind, "list", "--json")).document
    assert document["command"] == f"{kind} list"
    assert all({"name", "from"} <= set(record) for record in document["records"])


def test_units_stand_beside_the_values(film: Path) -> None:
    done(orip(film, "camera", "edit", "C35", "distortion.A3=1e-5"))
    document = done(orip(film, "camera", "show", "C35", "--json")).document
    units = {value["key"]: value["unit"] for value in document["values"]}
    assert units["c"] == units["fiducials.1.x"] == "mm"
    assert units["distortion.A3"] == "1/mm^2"
    document = done(orip(film, "photo", "show", "left", "--json")).document
    units = {value["key"]: value["unit"] for value in document["values"]}
    assert (units["X0"], units["KAPPA"]) == ("m", "degrees")


def test_where_a_record_came_from(project: Path) -> None:
    def source(name: str) -> str:
        return str(done(orip(project, "photo", "show", name, "--json")).document["from"])

    assert source("left") == "orip.toml:6"
    done(orip(project, "photo", "edit", "left", "X0=1071"))
    assert source("left") == "orip.toml:6, changed in the store"
    replace_in(project / "orip.toml", "X0 = 1070.0", "X0 = 1072.0")
    assert source("left") == "orip.toml:6, changed in the store and in the text"
    replace_in(project / "orip.toml", "X0 = 1130.0", "X0 = 1131.0")
    assert source("right") == "orip.toml:15, changed in the text"
    done(orip(project, "photo", "add", "own", "camera=C35"))
    assert source("own") == "no text"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", ["show", "edit", "delete"])
def test_a_record_that_is_not_there(project: Path, kind: str, command: str) -> None:
    refused(project, f"there is no {kind} 'nobody'; known are: ", kind, command, "nobody", code=2)


def test_before_the_first_init_there_are_no_records_to_edit(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    refused(folder, "no record stores yet; run 'orip init' first", "camera", "edit", "C35", "c=36")


# add


def test_a_project_from_nothing_but_commands(tmp_path: Path) -> None:
    (tmp_path / "orip.toml").write_text('[project]\nname = "NEW"\n')
    for words in (
        "camera add K c=152.5 frame=230,230 fiducials.1={x=1.0,y=2.0} fiducials.2.x=3 fiducials.2.y=4",
        "temtick add GRID ticks.1={x=10,y=220}",
        "template add T1 temtick=GRID stage=UPPER",
        "photo add P1 camera=K template=T1 constant=X0,Y0",
        "photo add P2 camera=K stage=LOWER KAPPA=90",
        "bundle add MAIN measurement_precision=0.004 datum=free datum_points=1,02",
        "model add M1 left=P1 right=P2 row=1 column=2",
    ):
        said = done(orip(tmp_path, *words.split()))
        assert f"added    {words.split()[0]} " in said.err
        unchanged(tmp_path, *words.split())
    assert values(tmp_path, "photo", "P1")["constant"] == ["X0", "Y0"]
    assert values(tmp_path, "template", "T1")["photos"] == ["P1"]
    assert values(tmp_path, "camera", "K")["fiducials.2.y"] == 4.0
    assert values(tmp_path, "bundle", "MAIN")["datum_points"] == ["1", "02"]
    assert values(tmp_path, "model", "M1")["column"] == 2
    assert done(orip(tmp_path, "init")).err.startswith("init     unchanged")


def test_added_before_another(project: Path) -> None:
    done(orip(project, "photo", "add", "first", "camera=C35", "--before", "LEFT"))
    assert names(project, "photo") == ["first", "left", "right"]
    refused(project, "there is no photo 'x'", "photo", "add", "f", "camera=C35", "--before", "x", code=2)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("camera add O", "camera 'O' has no c; it is required, write for example c = 8.595"),
        ("camera add O c=8,6", "c of camera 'O' is \"8,6\", but a number is required"),
        ("camera add O c=-1", "c of camera 'O' is -1, but a number above 0 is required"),
        ("camera add O c=nan", "but a finite number is required"),
        ("camera add O cc=1", "camera 'O' has the unknown key 'cc'; did you mean 'c'?"),
        ("camera add O c", "c: this is not KEY=VALUE"),
        ("camera add O =1", "this is not KEY=VALUE"),
        ("camera add O c=1 name=P", "give the record another one with 'orip camera rename'"),
        ("camera add O c=1 frame=[1", "this is not TOML"),
        ("camera add O c=1 unknown=C,A2", "'A2' is not a parameter"),
        ("camera add O c=1 fiducials.1=5", "write the values in braces"),
        ("camera add O c=1 fiducials.1.x=5", "has no y; it is required"),
        ("camera add O c=1 distortion_curve.1=5", "has 1 different radii above 0; give at least 4"),
        ("camera add O c=1 distortion_curve.x=5", "are pairs of numbers; write distortion_curve.FIRST=SECOND"),
        ("camera add O c=1 distortion_curve.1=x", "are pairs of numbers; write distortion_curve.FIRST=SECOND"),
        ("camera add O c=1 distortion_curve.1=", "has no pair that begins with 1; known are: none"),
        ("camera add O c=1 distortion.A3=1 distortion_isp.A1=1", "give the radial distortion in one form"),
        (
            "camera add O c=1 distortion_isp.R0=1e200 distortion_isp.A1=1",
            "distortion_isp of camera 'O' has no polynomial",
        ),
        ("camera add O c=1 distortion_curve=[[0,0],[1,0],[2,0],[3,0]]", "curve of camera 'O'"),
        ("camera add O c=1 c.x=1", "c has no parts"),
        ("camera add C35 c=1", "camera C35 already exists with other values; change it with 'orip camera edit'"),
        ("camera add !O c=1", "'!O' is not allowed as a name"),
        ("camera add O c=1 colour=", "the record has the unknown key 'colour'"),
        ("photo add P camera=K", "photo 'P' names camera 'K', which is not defined"),
        ("photo add P camera=C35 template=T", "photo 'P' names template 'T', which is not defined"),
        ("photo add P camera=C35 stage=upper", "'UPPER' or 'LOWER' is required"),
        ("template add T temtick=G", "template 'T' names temtick 'G', which is not defined"),
        ("bundle add B/C", "which file names cannot have"),
        ("bundle add B model=1", "change them with 'orip model'"),
        ("bundle add B start_down_weight=70", "above its max_iterations 60"),
        ("model add M left=left right=left row=1 column=1", "has photo 'left' both left and right"),
        ("model add M left=left right=west row=1 column=1", "names photo 'west', which is not defined"),
        ("model add M left=left right=right row=0 column=1", "a number of at least 1 is required"),
    ],
)
def test_what_may_not_be_added(project: Path, words: str, sentence: str) -> None:
    refused(project, sentence, *words.split())


def test_all_faults_at_once(project: Path) -> None:
    said = refused(project, "3 errors; nothing was written", *typed("photo add P camera=C35 X0=east colour=red x"))
    assert "unknown key 'colour'" in said
    assert "x: this is not KEY=VALUE" in said


def test_two_models_cannot_have_one_place(project: Path) -> None:
    done(orip(project, *typed("model add M1 left=left right=right row=1 column=1")))
    sentence = "model 'M2' is at row 1, column 1 like model 'M1'; give it its own place"
    refused(project, sentence, *typed("model add M2 left=left right=right row=1 column=1"))


def test_models_of_several_bundles(project: Path) -> None:
    done(orip(project, "bundle", "add", "AGAIN"))
    words = typed("left=left right=right row=1 column=1")
    refused(project, "name that of the models with --bundle: MAIN, AGAIN", "model", "add", "M", *words, code=2)
    refused(project, "there is no bundle 'X'", "model", "add", "M", "--bundle", "X", *words, code=2)
    done(orip(project, "model", "add", "M", "--bundle", "again", *words))
    assert done(orip(project, "model", "list", "--json")).document["records"][0]["bundle"] == "AGAIN"
    assert names(project, "model") == ["M"]
    assert done(orip(project, "model", "list", "--bundle", "MAIN", "--json")).document["records"] == []
    done(orip(project, "model", "delete", "M", "--bundle", "AGAIN", "--yes"))


@pytest.mark.parametrize("words", ["camera list", "photo show left", "camera add X c=30", "control points list"])
def test_what_belongs_to_no_bundle_takes_none(project: Path, words: str) -> None:
    refused(project, "No such option: --bundle", *typed(words), "--bundle", "MAIN", code=2)


def test_no_bundle_for_a_model(tmp_path: Path) -> None:
    (tmp_path / "orip.toml").write_text('project = { name = "Z" }\ncamera = [{ name = "C", c = 1 }]\n')
    done(orip(tmp_path, "init"))
    refused(tmp_path, "the stores hold 0 bundles", "model", "add", "M", code=2)


# edit


def test_edit_shows_the_difference_and_init_keeps_it(project: Path) -> None:
    words = (
        "camera",
        "edit",
        "C35",
        "c=35.1",
        'unknown=["C","A3"]',
        "distortion.A3=1e-5",
        "principal_point=[0.1,-0.2]",
    )
    before = contents(project)
    said = done(orip(project, *words, "--dry-run"))
    assert "would do the following; nothing is written" in said.err
    assert contents(project) == before
    said = done(orip(project, *words))
    assert "changed  camera C35\n         c  35.0 -> 35.1 mm\n" in said.err
    assert "distortion.A3  - -> 1e-05 1/mm^2" in said.err
    unchanged(project, *words)
    done(orip(project, "run"))
    assert values(project, "camera", "C35")["c"] == 35.1


def test_the_difference_in_json(project: Path) -> None:
    document = done(orip(project, "photo", "edit", "left", "X0=1071.5", "OMEGA=", "--dry-run", "--json")).document
    assert document["dry_run"] is True
    (change,) = document["changes"]
    assert (change["kind"], change["name"], change["action"]) == ("photo", "left", "changed")
    assert change["values"] == [
        {"key": "X0", "old": 1070.0, "new": 1071.5, "unit": "m"},
        {"key": "OMEGA", "old": 0.0, "new": None, "unit": "degrees"},
    ]


def test_a_value_taken_away_is_the_default_again(film: Path) -> None:
    done(orip(film, "bundle", "edit", "MAIN", "enp_stop=6"))
    done(orip(film, "bundle", "edit", "MAIN", "enp_stop=", "measurement_precision="))
    assert values(film, "bundle", "MAIN")["enp_stop"] == 4.0
    assert values(film, "bundle", "MAIN")["measurement_precision"] == 0.005
    done(orip(film, "camera", "edit", "C35", "fiducials.2=", "fiducials.3.x=18.5"))
    found = values(film, "camera", "C35")
    assert "fiducials.2.x" not in found
    assert found["fiducials.3.x"] == 18.5
    refused(film, "fiducials has no item of that name; known are: 1, 3, 4", "camera", "edit", "C35", "fiducials.2=")
    done(orip(film, "camera", "edit", "C35", "fiducials="))
    assert values(film, "camera", "C35")["fiducials"] is None


def test_the_other_form_of_a_distortion(project: Path) -> None:
    done(orip(project, "camera", "edit", "C35", "distortion_isp={R0=10.0, A1=1e-4}"))
    done(orip(project, "camera", "edit", "C35", "distortion.P1=2e-6", "distortion.B2=3e-5"))
    found = values(project, "camera", "C35")
    assert [found[f"distortion_isp.{name}"] for name in ("R0", "A1")] == [10.0, 1e-4]
    assert [found[f"distortion.{name}"] for name in ("P1", "B2")] == [2e-6, 3e-5]
    done(orip(project, "export-toml", "--output", "orip.toml", "--force"))
    assert done(orip(project, "init")).err.startswith("init     unchanged")
    done(orip(project, "camera", "edit", "C35", "distortion="))
    done(orip(project, "camera", "edit", "C35", "distortion_isp=", "distortion.A3=1e-5"))
    assert done(orip(project, "init")).err.startswith("init     unchanged")


def test_a_camera_with_the_lens_of_another_follows_it(project: Path) -> None:
    done(orip(project, "camera", "add", "CUT", "same_lens_as=C35", "principal_point=[0.2,0.1]"))
    done(orip(project, "camera", "edit", "C35", "c=35.4", "distortion.A3=1e-5"))
    found = values(project, "camera", "CUT")
    assert (found["same_lens_as"], found["c"]) == ("C35", None)
    refused(project, "is referred to by camera CUT, photo left", "camera", "delete", "C35", "--yes")
    done(orip(project, "camera", "rename", "C35", "NEW"))
    assert values(project, "camera", "CUT")["same_lens_as"] == "NEW"
    refused(project, "has c, but its lens is that of camera 'NEW'; give it there", "camera", "edit", "CUT", "c=35")
    done(orip(project, "export-toml", "--output", "orip.toml", "--force"))
    assert (project / "orip.toml").read_text().count("c = 35.4") == 1
    assert done(orip(project, "init")).err.startswith("init     unchanged")


def test_init_shows_the_difference(project: Path) -> None:
    replace_in(project / "orip.toml", "c = 35.0", "c = 35.2")
    replace_in(project / "orip.toml", "X0 = 1070.0", "X0 = 1071.0")
    copy = Path(shutil.copytree(project, project.parent / "copy"))
    said = done(orip(project, "init"))
    assert "         camera C35: c 35.0 -> 35.2\n         photo left: X0 1070.0 -> 1071.0\n" in said.err
    document = done(orip(copy, "init", "--json")).document
    assert [difference["values"][0]["new"] for difference in document["differences"]] == [35.2, 1071.0]


def test_changed_in_text_and_store_is_a_conflict(project: Path) -> None:
    done(orip(project, "camera", "edit", "C35", "c=35.1"))
    replace_in(project / "orip.toml", "c = 35.0", "c = 35.2")
    refused(project, "C is 35.2 in the text and 35.1 in the store", "init")


def test_a_photo_moves_from_template_to_template(film: Path) -> None:
    done(orip(film, *typed("temtick add G ticks.1={x=1,y=1}")))
    done(orip(film, *typed("template add T1 temtick=G photos=left,right")))
    done(orip(film, *typed("template add T2 temtick=G")))
    assert values(film, "photo", "left")["template"] == "T1"
    done(orip(film, "photo", "edit", "left", "template=T2"))
    assert values(film, "template", "T1")["photos"] == ["right"]
    assert values(film, "template", "T2")["photos"] == ["left"]
    said = done(orip(film, "template", "edit", "T2", "photos=[right, left]"))
    assert "template  T1 -> T2" in said.err
    assert values(film, "template", "T1")["photos"] is None
    done(orip(film, "template", "edit", "T2", "photos="))
    assert values(film, "photo", "right")["template"] is None
    done(orip(film, "photo", "edit", "left", "stage=UPPER"))
    refused(film, "has a stage but is on template 'T2'", "template", "edit", "T2", "photos=left")


def test_models_that_share_a_stage_are_a_warning(film: Path) -> None:
    done(orip(film, *typed("model add M1 left=left right=right row=1 column=1")))
    done(orip(film, "photo", "edit", "left", "stage=UPPER"))
    said = done(orip(film, "photo", "edit", "right", "stage=UPPER", "--json"))
    assert [warning["code"] for warning in said.document["warnings"]] == ["shared-stage"]
    said = done(orip(film, "photo", "edit", "right", "X0=5", "--json"))
    assert said.document["warnings"] == [], "it was said before"


# rename


def test_rename_carries_references_and_measurements(film: Path) -> None:
    done(orip(film, *typed("model add M1 left=left right=right row=1 column=1")))
    said = done(orip(film, "photo", "rename", "left", "L"))
    assert "renamed  photo left -> L\n" in said.err
    assert "left  left -> L" in said.err
    assert "warning: orip.toml:6: photo left is called L now, but is still in the text" in said.err
    assert "warning: FIRST.MEA:1: photo left is called L now, but is still measured here" in said.err
    assert values(film, "model", "M1")["left"] == "L"
    with reading([film / "FIRST.PHO", film / "MAIN.EXO"]) as stores:
        assert PHOTO_ORIENTATIONS.read(stores[film / "FIRST.PHO"])["L"].photo == "L"
        observed = observations.read(stores[film / "MAIN.EXO"])
    assert observed is not None
    assert set(observed.photos) == {"L", "right"}
    assert len(observed.points) == 10
    refused(film, "there is no photo 'left'", "photo", "rename", "left", "L", code=2)
    unchanged(film, "photo", "rename", "L", "L")


def test_rename_a_camera_its_photos_follow(project: Path) -> None:
    (project / "FIRST.ELE").write_text("c35 CAMERA C 35 0.1\n")
    said = done(orip(project, "camera", "rename", "C35", "K"))
    assert values(project, "photo", "left")["camera"] == "K"
    assert "FIRST.ELE:1: camera C35 is called K now, but is still observed here" in said.err
    refused(project, "run 'orip init' first", "measure")


def test_rename_in_case_alone(project: Path) -> None:
    done(orip(project, "photo", "rename", "left", "LEFT"))
    assert names(project, "photo") == ["LEFT", "right"]
    assert done(orip(project, "init")).err.startswith("init     unchanged")


def test_rename_to_a_name_that_is_taken(project: Path) -> None:
    refused(project, "photo right already exists", "photo", "rename", "left", "RIGHT")
    refused(project, "has a blank", "photo", "rename", "left", "l eft")


def test_rename_a_bundle_its_files_follow(project: Path) -> None:
    (project / "MAIN.PRE").write_text("! mine\nP1 1 2 3\n")
    said = done(orip(project, "bundle", "rename", "MAIN", "ALL", "--dry-run"))
    assert (project / "MAIN.EXO").exists()
    said = done(orip(project, "bundle", "rename", "MAIN", "ALL"))
    assert "FIRST.MEA:1: bundle MAIN is called ALL now" in said.err
    assert not (project / "MAIN.EXO").exists()
    assert not (project / "MAIN.PRE").exists()
    assert (project / "ALL.PRE").read_text() == "! mine\nP1 1 2 3\n"
    with reading([project / "ALL.EXO"]) as stores:
        observed = observations.read(stores[project / "ALL.EXO"])
    assert observed is not None
    assert (observed.bundle, len(observed.points)) == ("ALL", 10)
    for name in ("orip.toml", "FIRST.MEA"):
        replace_in(project / name, "MAIN", "ALL")
    assert done(orip(project, "init")).err.startswith("init     unchanged")
    assert "status   converged" in done(orip(project, "run")).out


def test_rename_a_bundle_its_solution_follows_and_stays_as_current_as_it_was(project: Path) -> None:
    (project / "MAIN.PRE").write_text("P1 1100 2040 100\n")
    assert orip(project, "run").code == 0
    before = orip(project, "results", "points", "--json").document
    done(orip(project, "bundle", "rename", "MAIN", "ALL"))
    for name in ("orip.toml", "FIRST.MEA"):
        replace_in(project / name, "MAIN", "ALL")
    after = orip(project, "results", "points", "--json").document
    assert after["points"] == before["points"]
    assert after["run"] != before["run"]
    # the listings are those of the old name until they are written again; the log has another text
    assert "Bundle   MAIN" in (project / "BUNDLE_RESULT.OUT").read_text()
    assert orip(project, "measure").code == 0
    assert "Bundle   ALL" in (project / "BUNDLE_RESULT.OUT").read_text()
    assert "Bundle   ALL" in (project / "BUNDLE_ERROR.OUT").read_text()
    assert orip(project, "status", "--json").document["next"] is None
    with (project / "FIRST.PNT").open("a") as file:
        file.write("NEW 1 2 3 0.1 0.1 0.1\n")
    assert orip(project, "status", "--json").document["next"] == "orip solve"


def test_rename_one_of_two_bundles_its_listings_go(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "two")
    assert orip(folder, "run").code == 0
    names = {"MAIN_RESULT.OUT", "MAIN_ERROR.OUT", "MAIN_result.json", "MAIN_residuals.csv", "MAIN_report.html"}
    assert names <= set(contents(folder))
    said = done(orip(folder, "bundle", "rename", "MAIN", "ALL"))
    removed = "MAIN_RESULT.OUT, MAIN_ERROR.OUT, MAIN_result.json, MAIN_residuals.csv, MAIN_report.html"
    assert f"results under the old name were removed: {removed}. Rename the bundle in orip.toml" in said.err
    assert not [name for name in contents(folder) if name.startswith("MAIN")]
    assert "AGAIN_RESULT.OUT" in contents(folder)
    for name in ("orip.toml", "FIRST.MEA"):
        replace_in(folder / name, "MAIN", "ALL")
    assert orip(folder, "init").code == 0
    assert "Bundle   ALL" in (folder / "ALL_RESULT.OUT").read_text()


def test_a_bundle_takes_no_files_of_another(project: Path) -> None:
    (project / "ALL.PRE").write_text("P1 1 2 3\n")
    refused(project, "ALL.PRE already exists; move it away", "bundle", "rename", "MAIN", "ALL")


# copy


def test_copy_with_other_values(project: Path) -> None:
    words = ("camera", "copy", "C35", "C50", "c=50")
    said = done(orip(project, *words))
    assert "added    camera C50" in said.err
    found = values(project, "camera", "C50")
    assert (found["c"], found["sensor.columns"]) == (50.0, 6000)
    unchanged(project, *words)
    refused(project, "camera C50 already exists with other values", "camera", "copy", "C35", "C50", "c=51")
    refused(project, "there is no camera 'X'", "camera", "copy", "X", "Y", code=2)
    refused(project, "camera C35 already exists", "camera", "copy", "C50", "c35")


def test_copies_of_templates_and_models(film: Path) -> None:
    done(orip(film, *typed("temtick add G ticks.1={x=1,y=1}")))
    done(orip(film, *typed("template add T1 temtick=G photos=left")))
    done(orip(film, "template", "copy", "T1", "T2"))
    assert values(film, "template", "T2")["photos"] is None, "a photo is on one template"
    done(orip(film, "photo", "copy", "left", "again"))
    assert values(film, "template", "T1")["photos"] == ["left", "again"]
    done(orip(film, *typed("model add M1 left=left right=right row=1 column=1")))
    refused(film, "like model 'M1'; give it its own place", "model", "copy", "M1", "M2")
    done(orip(film, "model", "copy", "M1", "M2", "column=2"))


# delete


@pytest.mark.parametrize(
    ("kind", "name"),
    [("camera", "C36"), ("temtick", "T"), ("photo", "left"), ("template", "T9"), ("bundle", "MAIN"), ("model", "M")],
)
def test_delete_asks(film: Path, kind: str, name: str) -> None:
    for words in (
        "camera add C36 c=36", "temtick add T ticks.1={x=1,y=2}", "template add T9 temtick=T",
        "model add M left=left right=right row=1 column=1",
    ):  # fmt: skip
        if words.startswith(kind) or (kind, words.split()[0]) == ("template", "temtick"):
            done(orip(film, *words.split()))
    refused(film, f"Delete {kind} {name}", kind, "delete", name, "--with-referents", code=2)
    assert "Say so with --yes" in orip(film, kind, "delete", name, "--with-referents").err
    assert name in names(film, kind)
    done(orip(film, kind, "delete", name, "--with-referents", "--yes"))
    assert name not in names(film, kind)


def test_delete_what_nothing_refers_to(project: Path) -> None:
    done(orip(project, "camera", "add", "O", "c=8.5"))
    said = done(orip(project, "camera", "delete", "o", "--yes", "--json"))
    assert said.document["changes"][0]["action"] == "deleted"
    assert said.document["warnings"] == []
    assert names(project, "camera") == ["C35"]


def test_delete_what_others_refer_to(film: Path) -> None:
    done(orip(film, *typed("model add M1 left=left right=right row=1 column=1")))
    said = refused(film, "camera C35 is referred to by photo left, photo right, ", "camera", "delete", "C35")
    for what in ("model MAIN M1", "4 measured fiducial marks of photo left", "5 measured photo points of MAIN"):
        assert what in said
    before = contents(film)
    said = done(orip(film, "photo", "delete", "left", "--with-referents", "--dry-run"))
    assert contents(film) == before
    said = done(orip(film, "photo", "delete", "left", "--with-referents", "--yes", "--json"))
    assert [(change["kind"], change["name"]) for change in said.document["changes"]] == [
        ("photo", "left"),
        ("model", "MAIN M1"),
    ]
    assert said.document["measurements_deleted"] == [
        "4 measured fiducial marks of photo left",
        "5 measured photo points of MAIN of photo left",
    ]
    assert [warning["code"] for warning in said.document["warnings"]] == ["still-in-text", "still-in-measurements"]
    with reading([film / "FIRST.PHO", film / "MAIN.EXO"]) as stores:
        assert set(PHOTO_ORIENTATIONS.read(stores[film / "FIRST.PHO"])) == {"RIGHT"}
        observed = observations.read(stores[film / "MAIN.EXO"])
    assert observed is not None
    assert observed.photos == ("right",) * 5
    said = done(orip(film, "init"))
    assert "1 photo added" in said.err, "orip.toml still has it"


def test_delete_a_measured_template(film: Path) -> None:
    folder = film
    done(orip(folder, *typed("temtick add G ticks.1={x=0,y=0} ticks.2={x=99,y=0} ticks.3={x=0,y=99}")))
    done(orip(folder, *typed("template add T1 temtick=G")))
    (folder / "T.MEA").write_text("TEMPLATE T1 A\n1 0 0\n2 99 0\n3 0 99\n")
    done(orip(folder, "measure"))
    refused(folder, "template T1 is referred to by 3 measured tick marks of template T1", "template", "delete", "T1")
    refused(folder, "temtick G is referred to by template T1", "temtick", "delete", "G")
    said = done(orip(folder, "template", "rename", "T1", "T9"))
    assert "T.MEA:1: template T1 is called T9 now" in said.err
    refused(folder, "3 measured tick marks of template T9", "template", "delete", "T9")
    done(orip(folder, "template", "delete", "T9", "--with-referents", "--yes"))
    assert names(folder, "template") == []


def test_delete_a_bundle(project: Path) -> None:
    refused(project, "bundle MAIN is referred to by 10 measured photo points of MAIN", "bundle", "delete", "MAIN")
    before = contents(project)
    said = orip(project, "bundle", "delete", "MAIN", "--with-referents")
    assert said.code == 2
    assert "Delete bundle MAIN, 10 measured photo points of MAIN? Say so with --yes" in said.err
    assert contents(project) == before
    done(orip(project, "bundle", "delete", "MAIN", "--with-referents", "--yes"))
    assert names(project, "bundle") == []
    assert not (project / "MAIN.EXO").exists()


def test_a_shared_camera_is_told_of(project: Path) -> None:
    neighbour = first_project(project.parent / "second")
    text = '"FIRST" }', '"SECOND", camera_file = "../first/CAMERAS.CAM", control_files = "FIRST" }'
    replace_in(neighbour / "orip.toml", *text)
    replace_in(neighbour / "orip.toml", '"C35"', '"C36"')
    done(orip(neighbour, "init"))
    assert set(names(project, "camera")) == {"C35", "C36"}
    said = done(orip(project, "camera", "delete", "C36", "--yes"))
    assert "camera C36: comes from project SECOND, which may still use it" in said.err


# the command line


@pytest.mark.parametrize("kind", KINDS)
def test_help_of_each_command(project: Path, kind: str) -> None:
    assert "Example: orip " in orip(project, kind, "--help").out
    for command in ("list", "show", "add", "edit", "rename", "copy", "delete"):
        assert f" {command} " in orip(project, kind, "--help").out
        assert orip(project, kind, command, "--help").code == 0
    assert orip(project, kind).code == 2
    assert orip(project, kind, "kill").code == 2


def test_errors_in_json(project: Path) -> None:
    said = orip(project, "camera", "edit", "C35", "c=0", "--json")
    assert said.code == 3
    assert said.document["schema"] == "orip.error/1"
    assert "number above 0" in said.document["errors"][0]["message"]


def test_listing_a_photo_on_a_template_makes_it(film: Path) -> None:
    done(orip(film, *typed("temtick add G ticks.1={x=1,y=1}")))
    done(orip(film, *typed("template add T1 temtick=G photos=left")))
    done(orip(film, *typed("camera copy C35 OTHER")))
    done(orip(film, *typed("template edit T1 photos=left,north")))
    assert values(film, "photo", "north")["camera"] == "C35", "that of the photo beside it"
    assert values(film, "photo", "north")["template"] == "T1"
    done(orip(film, *typed("template add T2 temtick=G")))
    said = refused(film, "photo 'south'", "template", "edit", "T2", "photos=south")
    assert "camera" in said, "there are two"


def test_a_photo_made_by_a_template_names_its_camera_as_the_camera_does(film: Path) -> None:
    done(orip(film, *typed("temtick add G ticks.1={x=1,y=1}")))
    done(orip(film, *typed("photo edit left camera=c35")))
    done(orip(film, *typed("template add T1 temtick=G photos=left,north")))
    assert values(film, "photo", "left")["camera"] == "c35", "as it was typed"
    assert values(film, "photo", "north")["camera"] == "C35"


def test_all_models_of_a_bundle_are_deleted_at_once(film: Path) -> None:
    for number in (1, 2):
        done(orip(film, "model", "add", f"M{number}", "left=left", "right=right", f"row={number}", "column=1"))
    refused(film, "name the model to delete or --all", "model", "delete", "--yes", code=2)
    done(orip(film, "model", "delete", "--all", "--yes"))
    assert done(orip(film, "model", "list", "--json")).document["records"] == []
    refused(film, "--all", "photo", "delete", "--all", "--yes", code=2)


def test_one_form_of_radial_distortion_takes_the_place_of_another(project: Path) -> None:
    done(orip(project, "camera", "edit", "C35", "distortion.A3=-1e-5", "distortion.P1=2e-6"))
    done(orip(project, "camera", "edit", "C35", "distortion_isp={R0=10,A1=-1e-6,A2=1e-9,A3=0}"))
    found = values(project, "camera", "C35")
    assert (found["distortion_isp.A1"], found["distortion.P1"]) == (-1e-6, 2e-6)
    assert found.get("distortion.A3") is None
    # A1 = -(a1 R0^2 + a2 R0^4), A3 = a1, A5 = a2
    assert "radial    A1 9e-05, A3 -1e-06, A5 1e-09 (from distortion_isp)" in orip(project, "camera", "show", "C35").out
    done(orip(project, "camera", "edit", "C35", "distortion.A3=-1e-5"))
    assert values(project, "camera", "C35")["distortion.A3"] == -1e-5
    assert "distortion_isp.A1" not in values(project, "camera", "C35")
    words = ("camera", "edit", "C35", "distortion.A3=-1e-5", "distortion_isp={R0=10,A1=-1e-6,A2=1e-9,A3=0}")
    refused(project, "give the radial distortion in one form", *words)
