"""`orip control`: lines of control texts edited in place, and each kind of bad input."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import typer
from cli.command_line import Said, orip
from workflow.small_projects import contents, first_project, two_bundles

KINDS = ("points", "elements", "distances", "directions", "preliminary")

POINTS = """\
! control of 1987
1   1012.40  2008.15  101.20   0.02 0.02 0.03   ! a bolt

2   1178.95  2012.70   98.65   0.02 0.02 0.03
# the church
3   1015.30  2141.05  104.90   0.02 0.02 0.03
4   1181.60  2138.35  110.25   0.02 0.02 0.03"""


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("prepared") / "first")
    (folder / "FIRST.PNT").write_text(POINTS)
    assert orip(folder, "init").code == 0
    assert orip(folder, "measure").code == 0
    return folder


@pytest.fixture
def project(prepared: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(prepared, tmp_path / "first"))


def done(folder: Path, text: str, *more: str) -> Said:
    said = orip(folder, "control", *text.split(), *more)
    assert said.code == 0, said.err
    return said


def refused(folder: Path, sentence: str, text: str, *more: str, code: int = 3) -> None:
    before = contents(folder)
    said = orip(folder, "control", *text.split(), *more)
    assert said.code == code
    assert sentence in said.err
    assert said.out == ""
    assert contents(folder) == before


def unchanged(folder: Path, text: str) -> None:
    before = contents(folder)
    said = done(folder, text, "--json")
    assert said.document["unchanged"] is True
    assert said.document["changes"] == []
    assert contents(folder) == before


def points(folder: Path) -> str:
    return (folder / "FIRST.PNT").read_bytes().decode()


def test_list(project: Path) -> None:
    said = done(project, "points list")
    assert said.err == ""
    assert said.out.splitlines()[2] == "  1     1012.40  2008.15  101.20  0.02  0.02  0.03"
    document = done(project, "points list", "--json").document
    assert document["file"] == "FIRST.PNT"
    assert document["records"][1] == {
        "name": "2", "X": 1178.95, "Y": 2012.7, "Z": 98.65, "aX": 0.02, "aY": 0.02, "aZ": 0.03,
        "rXY": None, "rXZ": None, "rYZ": None, "rejected": False, "line": 4,
    }  # fmt: skip


@pytest.mark.parametrize("kind", KINDS[1:])
def test_a_file_that_is_absent_is_empty(project: Path, kind: str) -> None:
    assert done(project, f"{kind} list").out == "  none\n"
    assert done(project, f"{kind} list", "--json").document["records"] == []


def test_edit_keeps_comments_order_and_columns(project: Path) -> None:
    said = done(project, "points edit 1 X=1012.5 aZ=0")
    assert points(project) == POINTS.replace(
        "1   1012.40  2008.15  101.20   0.02 0.02 0.03", "1    1012.5  2008.15  101.20   0.02 0.02    0"
    )
    assert "changed   FIRST.PNT:2\n          - 1   1012.40" in said.err
    unchanged(project, "points edit 1 X=1012.50 aZ=0.0")
    unchanged(project, "points edit 1")


def test_a_dry_run_writes_nothing(project: Path) -> None:
    before = contents(project)
    said = done(project, "points edit 1 X=1012.5 --dry-run", "--json")
    assert contents(project) == before
    (change,) = said.document["changes"]
    assert (change["action"], change["line"]) == ("changed", 2)
    assert change["old"].startswith("1   1012.40")
    assert said.document["dry_run"] is True


def test_add_at_the_end_and_insert(project: Path) -> None:
    done(project, "points add P1 X=1101.3 aX=0.05")
    last = "P1   1101.3        -       -   0.05    -    -\n"
    assert points(project) == POINTS + "\n" + last
    unchanged(project, "points add P1 X=1101.30 aX=0.05")
    done(project, "points insert 9 --before 3 Z=104.5 aZ=-1")
    lines = points(project).splitlines()
    assert lines[4:6] == ["# the church", "9         -        -   104.5      -    -   -1"]
    refused(project, "FIRST.PNT:2: control point 1 already exists with other values", "points add 1 X=5 aX=1")
    refused(project, "FIRST.PNT has no control point '77'", "points insert 10 --before 77 X=1 aX=1", code=2)


def test_line_ends_and_byte_order_mark_stay(project: Path) -> None:
    path = project / "FIRST.PNT"
    path.write_bytes(b"\xef\xbb\xbf" + POINTS.replace("\n", "\r\n").encode())
    done(project, "points kill 2 --yes")
    done(project, "points edit 1 name=P1 X=-1012.41234")
    done(project, "points add 2 X=1 aX=1")
    text = path.read_bytes()
    assert text.startswith(b"\xef\xbb\xbf! control of 1987\r\nP1 -1012.41234  2008.15  101.20")
    assert text.endswith(b"\r\n2         1        -       -      1    -    -\r\n")
    assert text.count(b"\n") == text.count(b"\r\n") == 7


def test_kill(project: Path) -> None:
    said = done(project, "points kill 2 4 --yes")
    assert [line for line in said.err.splitlines() if line.startswith("killed")] == [
        "killed    FIRST.PNT:4",
        "killed    FIRST.PNT:7",
    ]
    assert "the church" in points(project)
    refused(project, "FIRST.PNT has no control point '2'; known are: 1, 3", "points kill 2", code=2)


def test_kill_all_needs_to_be_confirmed(project: Path) -> None:
    refused(project, "Kill all points? Say so with --yes", "points kill --all", code=2)
    refused(project, "name what to kill, or write --all and no name", "points kill", code=2)
    refused(project, "name what to kill, or write --all and no name", "points kill 1 --all --yes", code=2)
    assert len(done(project, "points kill --all --dry-run", "--json").document["changes"]) == 4
    assert len(done(project, "points kill --all --yes", "--json").document["changes"]) == 4
    assert points(project) == "! control of 1987\n\n# the church\n"
    unchanged(project, "points kill --all --yes")


@pytest.mark.parametrize(("answer", "left"), [(True, 0), (False, 4)])
def test_kill_all_asks_on_a_terminal(project: Path, monkeypatch: pytest.MonkeyPatch, answer: bool, left: int) -> None:
    def confirm(question: str, abort: bool, err: bool) -> None:
        assert (question, abort, err) == ("Kill all points?", True, True)
        if not answer:
            raise typer.Abort

    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("orip.cli.conversion.typer.confirm", confirm)
    assert orip(project, "control", "points", "kill", "--all").code == (0 if answer else 130)
    assert len(done(project, "points list", "--json").document["records"]) == left


def test_disregard_include_and_reject(project: Path) -> None:
    done(project, "points disregard 1 2")
    assert "1   1012.40  2008.15  101.20  -0.02 -0.02 -0.03   ! a bolt" in points(project)
    unchanged(project, "points disregard 1 2")
    done(project, "points include 1 2")
    assert "1   1012.40  2008.15  101.20   0.02  0.02  0.03   ! a bolt" in points(project)
    done(project, "points reject 1")
    assert "0.03 x   ! a bolt" in points(project)
    unchanged(project, "points reject 1")
    assert done(project, "points list", "--json").document["records"][0]["rejected"] is True
    refused(project, "already exists", "points add 1 X=1012.40 Y=2008.15 Z=101.20 aX=0.02 aY=0.02 aZ=0.03")
    done(project, "points include 1")
    assert "0.03   ! a bolt" in points(project)
    done(project, "points edit 1 aX=0")
    refused(project, "control point 1: aX is 0 (constant), which has no sign", "points disregard 1")


def test_elements(project: Path) -> None:
    done(project, "elements add c35 group=camera kind=C value=35.0 a=0.01")
    done(project, "elements add c35 group=CAMERA kind=DX value=0 a=0.01")
    unchanged(project, "elements add C35 group=CAMERA kind=c value=35 a=0.01")
    refused(project, "has 2 of the name 'c35'; write one of 'c35 camera C', 'c35 CAMERA DX', in quotes",
            "elements edit c35 value=1", code=2)  # fmt: skip
    said = orip(project, "control", "elements", "edit", "C35 CAMERA C", "value=35.1")
    assert "+ c35  camera  C  35.1  0.01" in said.err
    said = orip(project, "control", "elements", "disregard", "c35 camera")
    assert said.code == 2
    said = orip(project, "control", "elements", "disregard", "c35 camera dx")
    assert "-0.01" in said.err
    assert "there is no camera 'O'" in done(project, "elements add O group=CAMERA kind=C value=3 a=1").err
    assert "there is no photo 'O'" in done(project, "elements add O group=PHOTO kind=X0 value=3 a=1").err
    assert "point 'O' is not measured" in done(project, "elements add O group=POINT kind=X value=3 a=1").err
    assert "there is no set 'O'" in done(project, "elements add O group=THEODOLITE kind=R value=3 a=1").err


def test_distances_and_directions(project: Path) -> None:
    said = done(project, "distances add D from=1 to=P1 code=XYZ distance=120.5 a=0.01", "--json")
    assert said.document["warnings"] == []
    said = done(project, "distances add D from=1 to=Q code=xy distance=120.5 a=0.01", "--json")
    assert [warning["text"] for warning in said.document["warnings"]] == ["point 'Q' is not measured in any photo"]
    said = orip(project, "control", "distances", "kill", "D 1 Q")
    assert said.code == 2
    assert "Kill D 1 Q of distances? Say so with --yes" in said.err
    assert orip(project, "control", "distances", "kill", "D 1 Q", "--yes").code == 0
    done(project, "distances disregard D")
    done(project, "directions add S station=1 target=2 direction=12.5 a=0.001 zenith=90 azenith=0.002")
    done(project, "directions disregard S")
    text = (project / "FIRST.DIR").read_text()
    assert text == "S  1  2  12.5 -0.001  90 -0.002\n"
    done(project, "directions edit S zenith= azenith=")
    assert (project / "FIRST.DIR").read_text() == "S  1  2  12.5 -0.001\n"
    record = done(project, "directions list", "--json").document["records"][0]
    assert (record["direction"], record["zenith"]) == (12.5, None)


def test_figures(project: Path) -> None:
    said = done(project, "figures add WALL kind=plane point=Q a=0.01", "--json")
    assert [warning["text"] for warning in said.document["warnings"]] == ["point 'Q' is not measured in any photo"]
    done(project, "figures add WALL kind=PLANE point=1 a=0.01")
    refused = orip(project, "control", "figures", "add", "WALL", "kind=LINE", "point=2", "a=0.01")
    assert refused.code == 3
    assert "figure 'WALL' is a PLANE on line 1 and a LINE here" in refused.err
    done(project, "figures add D kind=DIRECTION point=1 a=0.01 to=2 dX=0 dY=1 dZ=0")
    last = (project / "FIRST.CON").read_text().splitlines()[-1]
    assert " ".join(last.split()) == "D DIRECTION 1 0.01 2 0 1 0"
    done(project, "figures kill D --yes")
    weigh = orip(project, "control", "figures", "disregard", "WALL PLANE 1")
    assert weigh.code == 0
    assert (project / "FIRST.CON").read_text() == "WALL  plane  Q  0.01\nWALL  PLANE  1 -0.01\n"


def test_preliminary_coordinates(project: Path) -> None:
    done(project, "preliminary add P1 X=1 Y=2 Z=3")
    done(project, "preliminary edit P1 sX=0.1 sY=0.2 sZ=0.3")
    assert (project / "MAIN.PRE").read_text() == "P1  1  2  3 0.1 0.2 0.3\n"
    done(project, "preliminary edit P1 sX= sY= sZ=")
    assert (project / "MAIN.PRE").read_text() == "P1  1  2  3\n"
    assert "point 'P2' is not measured" in done(project, "preliminary insert P2 --before P1 X=1 Y=2 Z=3").err
    done(project, "preliminary kill --all --yes")
    assert (project / "MAIN.PRE").read_text() == ""


def test_preliminary_coordinates_of_several_bundles(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "two")
    refused(folder, "the project has 2 bundles; name one of them", "preliminary add P1 X=1 Y=2 Z=3", code=2)
    done(folder, "preliminary add P1 X=1 Y=2 Z=3 --bundle again")
    assert (folder / "AGAIN.PRE").exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("points add 5 X=1", "the error of X is '-' but its coordinate is a number"),
        ("points add 5", "point '5' has no coordinate at all"),
        ("points add 5 X=1,5 aX=1", "'1,5' has a decimal comma"),
        ("points add 5 X=nan aX=1", "'nan' is not allowed"),
        ("points add 5 W=1", "W=1: this is not KEY=VALUE of a control point; its keys are: name, X, Y, Z, aX, aY, aZ"),
        ("points add 5 X", "X: this is not KEY=VALUE of a control point"),
        ("points add 5 X=!1 aX=1", "a value is one word without blanks, and no comment"),
        ("points add - X=1 aX=1", "'-' is not allowed as a name"),
        ("points edit 1 name=2", "FIRST.PNT:4: point '2' is already on line 2"),
        ("elements add O group=CAM kind=C value=1 a=1", "'CAM' is not an element group; did you mean CAMERA?"),
        ("elements add O group=CAMERA kind=X0 value=1 a=1", "'X0' is not a kind of CAMERA"),
        ("elements add O group=CAMERA", "element: missing kind, value, a; give kind=... value=... a=..."),
        ("distances add D from=1 to=1 code=X distance=1 a=1", "goes from '1' to itself"),
        ("distances add D from=1 to=2 code=XYZ distance=-1 a=1", "write a length above 0"),
        (
            "directions add S station=1 target=2 direction=1 a=1 zenith=1",
            "azenith missing; give zenith, azenith together",
        ),
        ("preliminary add P X=1 Y=1", "preliminary point: missing Z; give Z=..."),
        ("preliminary add P X=1 Y=1 Z=1 sX=1 sY=1 sZ=-1", "standard deviation -1 is negative"),
    ],
)
def test_what_may_not_be_written(prepared: Path, text: str, sentence: str) -> None:
    refused(prepared, sentence, text)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", ["edit", "kill"])
def test_a_line_that_is_not_there(prepared: Path, kind: str, command: str) -> None:
    refused(prepared, " '77'; known are: ", f"{kind} {command} 77", code=2)


def test_a_text_with_faults_can_be_put_right_and_nothing_else(project: Path) -> None:
    (project / "FIRST.PNT").write_text(POINTS.replace("101.20", "101,20"))
    refused(project, "FIRST.PNT:2:23: '101,20' has a decimal comma", "points list")
    refused(project, "FIRST.PNT:2:23: '101,20' has a decimal comma", "points edit 2 X=1")
    done(project, "points edit 1 Z=101.20")
    assert points(project) == POINTS


def test_a_text_that_is_not_utf_8(project: Path) -> None:
    (project / "FIRST.PNT").write_bytes(b"1 1 1 1 1 1 1 ! Gr\xfc\xdfe\n")
    refused(project, "FIRST.PNT:1:19: byte 0xFC is not UTF-8", "points edit 1 X=2")


def test_a_file_of_the_same_name_in_other_letters(project: Path) -> None:
    (project / "first.len").write_text("")
    if (project / "FIRST.LEN").exists():
        pytest.skip("this disk does not tell letters apart")
    refused(project, "this file is not read: the project's file is called FIRST.LEN",
            "distances add D from=1 to=2 code=X distance=1 a=1")  # fmt: skip


def test_names_that_look_alike_are_told_once(project: Path) -> None:
    said = done(project, "points add 01 X=1 aX=1", "--json")
    assert "similar-names" in [warning["code"] for warning in said.document["warnings"]]
    said = done(project, "points edit 2 X=1", "--json")
    assert said.document["warnings"] == []


def test_without_stores_nothing_is_made_but_the_text(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    before = set(contents(folder))
    assert done(folder, "distances add D from=1 to=2 code=X distance=1 a=1", "--json").document["warnings"] == []
    assert set(contents(folder)) - before == {"FIRST.LEN"}


def test_what_was_edited_is_solved(project: Path) -> None:
    done(project, "points disregard 4")
    assert orip(project, "run").code == 0
    assert "check" in (project / "BUNDLE_RESULT.OUT").read_text()


@pytest.mark.parametrize("kind", KINDS)
def test_help_of_each_command(project: Path, kind: str) -> None:
    assert "Example: orip " in orip(project, "control", kind, "--help").out
    for command in ("list", "add", "insert", "edit", "kill"):
        assert orip(project, "control", kind, command, "--help").code == 0
    assert orip(project, "control", kind).code == 2


def test_errors_in_json(project: Path) -> None:
    said = orip(project, "control", "points", "edit", "1", "X=east", "--json")
    assert said.code == 3
    assert said.document["errors"][0]["file"] == "FIRST.PNT"
    assert said.document["errors"][0]["line"] == 2


def test_stations_are_edited_like_control_points(project: Path) -> None:
    text = project / "FIRST.STA"
    done(project, "stations add left X=1070 Y=2075 Z=330 aX=0.02 aY=0.02 aZ=0.03")
    done(project, "stations add right X=1130 Y=2075 Z=330 aX=0.02 aY=0.02 aZ=0.03 strip=S1")
    assert text.read_text().splitlines()[1].split()[7:] == ["-"] * 7 + ["S1"]
    unchanged(project, "stations add LEFT X=1070.0 Y=2075 Z=330 aX=0.02 aY=0.02 aZ=0.03")
    done(project, "stations edit left time=12.5")
    done(project, "stations edit RIGHT strip=")
    done(project, "stations disregard left")
    assert [line.split() for line in text.read_text().splitlines()] == [
        ["left", "1070", "2075", "330", "-0.02", "-0.02", "-0.03", *["-"] * 6, "12.5"],
        ["right", "1130", "2075", "330", "0.02", "0.02", "0.03"],
    ]
    done(project, "stations include left")
    document = done(project, "stations list", "--json").document
    assert document["file"] == "FIRST.STA"
    left, right = document["records"]
    assert (left["photo"], left["aX"], left["OMEGA"], left["time"], left["strip"]) == ("left", 0.02, None, 12.5, None)
    assert (right["X"], right["line"]) == (1130.0, 2)
    said = done(project, "stations insert other", "--before", "right", "OMEGA=0", "PHI=0", "KAPPA=0", "aOMEGA=1",
                "aPHI=1", "aKAPPA=1")  # fmt: skip
    assert "there is no photo 'other'" in said.err
    refused(project, "'-' for a part of the position", "stations edit left X=")
    done(project, "stations kill other left --yes")
    assert [line.split()[0] for line in text.read_text().splitlines()] == ["right"]
