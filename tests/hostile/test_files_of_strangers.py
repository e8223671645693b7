"""What files of strangers have done: took the memory, never ended, or ended in an internal error."""

from __future__ import annotations

import io
import json
import os
import resource
import shutil
import sqlite3
import subprocess
import sys
import time
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from cli.command_line import orip
from workflow.small_projects import film_project, first_project

from orip.cli.terminal import Terminal
from orip.errors import ProjectWarning
from orip.files.project.toml_lines import NestingError, toml_document
from orip.files.text.shown import visible, visible_json

_CAMERA = {"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.8, "k1": 0.0, "k2": 0.0}
_SHOT = {"rotation": [3.14, 0, 0], "translation": [0, 0, 10], "camera": "c"}
_DEEP = ".".join("a" for _ in range(40_000))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = film_project(tmp_path / "p")
    assert orip(folder, "run").code == 0
    return folder


@pytest.mark.parametrize(
    "text",
    [
        f"{_DEEP} = 1",
        f"[{_DEEP}]",
        f"[[{_DEEP}]]",
        f"x = {'[' * 40_000}",
        f"x = {'{a=' * 40_000}",
        f"x = {{{_DEEP} = 1}}",
    ],
)
def test_a_deeply_nested_orip_toml_takes_no_gigabytes(text: str, tmp_path: Path) -> None:
    (tmp_path / "orip.toml").write_text(f'[project]\nname = "A"\n{text}\n')
    began = time.monotonic()
    said = orip(tmp_path, "init")
    assert time.monotonic() - began < 5.0
    assert said.code == 3
    assert "orip.toml:3: " in said.err
    assert "a project file needs three at most; correct the line" in said.err


def test_a_deeply_nested_exchange_toml_is_no_source(project: Path) -> None:
    (project / "exchange.toml").write_text(f"{_DEEP} = 1\n")
    assert orip(project, "export", "csv", "out").code == 0


@pytest.mark.parametrize(
    "text", ['a = "1.2.3.4.5.6.7.8.9.0.1.2.3.4"', "a = [1.5, 2.5]\n" * 1, "[[a.b]]\nc = [{d = [1.5]}]", "# " + "[" * 40]
)
def test_what_is_flat_is_read(text: str) -> None:
    toml_document(text)


@pytest.mark.parametrize("text", ['"\\' * 200_000, "'" * 200_001, 'a = """\\"' * 100_000, "a = '''\n" * 100_001])
def test_texts_without_an_end_are_looked_at_once(text: str) -> None:
    began = time.monotonic()
    with pytest.raises(ValueError):  # noqa: PT011  # tomllib's own
        toml_document(text)
    assert time.monotonic() - began < 5.0


def test_quoted_parts_of_a_key_count_too() -> None:
    with pytest.raises(NestingError):
        toml_document(" . ".join(['"a"'] * 50) + " = 1")


def opensfm(folder: Path, **changes: Any) -> Path:
    part = {"cameras": {"c": _CAMERA}, "shots": {"a.jpg": _SHOT, "b.jpg": _SHOT}, "points": {}, **changes}
    folder.mkdir()
    (folder / "reconstruction.json").write_text(json.dumps([part]))
    return folder


@pytest.mark.parametrize("points", ["x", [], [1], 5, True, [[{}]]])
def test_points_of_opensfm_that_are_no_object_are_refused_with_their_place(points: object, tmp_path: Path) -> None:
    said = orip(tmp_path, "import", "opensfm", str(opensfm(tmp_path / "s", points=points)), "new")
    assert said.code == 3
    assert "0/points: an object {...} should be here" in said.err


def test_half_a_surrogate_pair_in_a_name_is_refused_with_its_line(tmp_path: Path) -> None:
    said = orip(tmp_path, "import", "opensfm", str(opensfm(tmp_path / "s", shots={"\ud800.jpg": _SHOT})), "new")
    assert said.code == 3
    assert "reconstruction.json:1: a text has half a character" in said.err


@pytest.mark.parametrize("name", ["a\x1b[2Jb", "a\x9bb", "\u202egpj.a", "a\x00b", "a\x7fb", "a\u2028b"])
def test_control_characters_in_names_are_refused_and_never_reach_the_terminal(name: str, tmp_path: Path) -> None:
    for words in (("import", "opensfm"), ("import", "opensfm", "--json")):
        source = tmp_path / "s"
        shutil.rmtree(source, ignore_errors=True)
        opensfm(source, shots={name: _SHOT, "b.jpg": _SHOT})
        said = orip(tmp_path, *words[:2], str(source), "new", *words[2:])
        assert said.code == 3
        assert not set(name.replace("\n", "")) - set("ab[2Jgpj.") & set(said.err + said.out)
        assert "has a character that cannot be shown" in said.err


def test_what_is_shown_is_escaped_but_for_letters_of_all_scripts() -> None:
    assert visible("a\x1b[31m\u202e\x9b\ud800\u2066é漢\u200d\u00a0\u202f", kept="\n") == (
        "a\\x1b[31m\\u202e\\x9b\\ud800\\u2066é漢\u200d\u00a0\u202f"
    )
    text = json.dumps({"a": "\x7f\x9b\u202e\U000e0001\ud800é"}, ensure_ascii=False)
    assert json.loads(visible_json(text)) == json.loads(text)
    assert visible_json(text) == '{"a": "\\u007f\\u009b\\u202e\\udb40\\udc01\\ud800é"}'


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes there")
def test_images_whose_names_are_not_utf8_are_refused_in_words(tmp_path: Path) -> None:
    pictures = pytest.importorskip("PIL.Image")

    folder = tmp_path / "s"
    folder.mkdir()
    pictures.linear_gradient("L").save(folder / "a.jpg")
    (folder / "a.jpg").rename(folder / os.fsdecode(b"\xff\xfe.jpg"))
    said = orip(tmp_path, "photos", str(folder), "out")
    assert said.code == 3
    assert "\\udcff\\udcfe.jpg" in said.err


@pytest.mark.parametrize("key", ["row", "column"])
@pytest.mark.parametrize("value", [2**63, 10**40, 10**300], ids=["64 bits", "40 digits", "300 digits"])
def test_a_row_of_a_model_beyond_64_bits_is_refused_with_its_line(key: str, value: int, tmp_path: Path) -> None:
    folder = film_project(tmp_path / "p")
    places = {"row": 1, "column": 1, key: value}
    with (folder / "orip.toml").open("a") as text:
        text.write('\n[[bundle.model]]\nname = "M"\nleft = "left"\nright = "right"\n')
        text.write("".join(f"{name} = {number}\n" for name, number in places.items()))
    said = orip(folder, "init")
    assert said.code == 3
    assert f"{key}" in said.err
    assert "a whole number of at most 15 digits" in said.err


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "..", "a\x00b", "NUL", "x" * 300, "a b", "a\x1b[2J", ""])
def test_a_dump_with_a_bundle_that_cannot_name_files_is_not_loaded(name: str, project: Path) -> None:
    text = orip(project, "dump", "FIRST.EXT").out
    (project / "bad.dump").write_text(text.replace('"MAIN"', json.dumps(name)))
    before = (project / "FIRST.EXT").read_bytes()
    said = orip(project, "load", "FIRST.EXT", "bad.dump")
    assert said.code == 3, said.err
    assert "internal error" not in said.err
    assert (project / "FIRST.EXT").read_bytes() == before


def test_a_store_with_such_a_bundle_is_damaged(project: Path) -> None:
    with closing(sqlite3.connect(project / "FIRST.EXT")) as store:
        store.execute("UPDATE bundle SET name = '../../stolen'")
        store.commit()
    for words in ("status", "solve", "run", "report"):
        said = orip(project, words)
        assert said.code == 3, said.err
        assert "the store is damaged" in said.err


def test_a_zip_file_that_unpacks_to_more_than_memory_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.psz", "w", zipfile.ZIP_DEFLATED) as archive, archive.open("doc.xml", "w") as doc:
        for _ in range(300):
            doc.write(bytes(1 << 20))
    began, used = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    said = orip(tmp_path, "import", "metashape", "a.psz", "new")
    assert said.code == 3
    assert "more than can be; not read" in said.err
    assert time.monotonic() - began < 20.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used < 200_000


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE a [<!ENTITY b "bbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;">]><document>&c;</document>',
        '<!DOCTYPE a SYSTEM "/etc/passwd"><document/>',
        "<document>" * 5000,
    ],
)
def test_entities_and_nesting_of_xml_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(text)
    assert orip(tmp_path, "import", "metashape", "a.xml", "new").code == 3


def test_json_in_json_without_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "reconstruction.json").write_text("[" * 1_000_000)
    said = orip(tmp_path, "import", "opensfm", "reconstruction.json", "new")
    assert said.code == 3
    assert "nested too deeply" in said.err


_VIEWS = {
    "an endless view": "CREATE VIEW pose_priors AS WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) "
    "SELECT 1 AS image_id, 1 AS coordinate_system, zeroblob(24) AS position, NULL AS position_covariance FROM r",
    "a view of the images": "CREATE VIEW images2 AS SELECT 1; CREATE VIEW pose_priors AS SELECT 1 AS image_id, "
    "1 AS coordinate_system, zeroblob(24) AS position",
    "a virtual table": "CREATE VIRTUAL TABLE pose_priors USING fts5(image_id, coordinate_system, position)",
    "a computed column": "CREATE TABLE pose_priors (image_id INTEGER, coordinate_system INTEGER, "
    "position BLOB AS (zeroblob(900000000)))",
}


@pytest.fixture(scope="module")
def model_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("model") / "p")
    assert orip(folder, "run", "--no-report").code == 0
    assert orip(folder, "export", "colmap", "model").code == 0
    return folder / "model"


@pytest.fixture
def model(model_once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(model_once, tmp_path / "model"))


@pytest.mark.parametrize("name", _VIEWS)
def test_a_database_of_colmap_with_more_than_tables_is_refused(name: str, model: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(model / "database.db")) as database:
        try:
            database.executescript(
                "CREATE TABLE images (image_id INTEGER, name TEXT, camera_id INTEGER);"
                f"INSERT INTO images VALUES (1, 'a', 1); {_VIEWS[name]};"
            )
        except sqlite3.OperationalError as error:
            pytest.skip(str(error))
        if "computed" in name:
            database.execute("INSERT INTO pose_priors (image_id, coordinate_system) VALUES (1, 1)")
        database.commit()
    began = time.monotonic()
    said = orip(tmp_path, "import", "colmap", str(model), "new")
    assert time.monotonic() - began < 5.0
    assert said.code == 3, said.err
    assert "move it away, and they are left out" in said.err


def test_a_join_of_a_database_of_colmap_that_never_ends_is_given_up(model: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(model / "database.db")) as database:
        database.execute("CREATE TABLE images (image_id INTEGER, name TEXT, camera_id INTEGER)")
        database.execute("CREATE TABLE pose_priors (image_id INTEGER, coordinate_system INTEGER, position BLOB)")
        same = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r WHERE n < 30000)"
        database.execute(f"INSERT INTO images {same} SELECT 1, 'a', 1 FROM r")
        database.execute(f"INSERT INTO pose_priors {same} SELECT 1, 1, zeroblob(24) FROM r")
        database.commit()
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30));"
        f"sys.argv = ['orip', '-C', {str(tmp_path)!r}, 'import', 'colmap', {str(model)!r}, 'new'];"
        "from orip.cli.main import main; main()"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert said.returncode == 3, said.stderr
    assert "image 1 is there twice" in said.stderr


GUBAIO = {
    "gubaio.cam": "[SENSOR]\nname = dcs\ntype = DIGITAL\nSensorElement = 5.0 7.5\nSensorPixels = 1024 1536\n"
    "CameraConstants = 0.03 0.2 8\nRadialDistortion = 1e-4 0.0 0.0\nEND\n",
    "gubaio.gcp": "FullControl\n1 118.13 235.51 14.61\nFullControlEnd\nTiePoint\n9 114 235 16\nTiePointEnd\n",
    "gubaio.img": "[IMAGE]\nname = st1\nsensor = dcs\nInitialPersCenter = 0 0 .8\nInitialRotation = 0 0 0\nPoints\n"
    " 1  532.04 185.57\n 7  100.5 200.5\nPointsEnd\nImageEnd\n",
}


def test_a_project_whose_points_are_all_at_one_place_ends_in_words(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    folder.mkdir()
    for name, text in GUBAIO.items():
        (folder / name).write_text(text)
    said = orip(tmp_path, "adjust", "--frame", "4000x3000", "--exact-distortion", "gubaio", str(folder), "out")
    assert said.code == 4
    assert "could not be oriented" in said.err


class _OnTerminal(io.StringIO):
    """A stream that is a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


def test_no_command_of_a_terminal_comes_from_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    shown, told = _OnTerminal(), _OnTerminal()
    monkeypatch.setattr("sys.stdout", shown)
    monkeypatch.setattr("sys.stderr", told)
    hostile = "a\x1b]0;x\x07\x9b2J\u202eb\r\b\x7f\n"
    terminal = Terminal(color="never")
    terminal.data(hostile)
    terminal.document("error", {"exit_code": 1, "errors": [hostile]})
    terminal.result(hostile, hostile)
    terminal.say(hostile)
    terminal.error(hostile)
    terminal.point(hostile, hostile)
    terminal.warn([ProjectWarning("x", hostile, hostile)])
    for text in (shown.getvalue(), told.getvalue()):
        assert not set(text) & set("\x1b\x07\x9b\u202e\r\b\x7f")
        assert "a" in text
    assert json.loads(shown.getvalue().partition("\n{")[2].partition("\n}")[0].join(["{", "}"]))["errors"] == [hostile]


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes there")
@pytest.mark.parametrize("words", ["status", "run", "solve", "init", "status --json", "run --json"])
def test_names_of_files_that_are_listed_are_escaped(words: str, project: Path) -> None:
    for name in (b"a\x1b[2J.STA", b"\xff\xfe.MEA", "b\u202e.PNT".encode(), b"c\x1b.mea", b"d\x9b.txt"):
        (project / os.fsdecode(name)).write_bytes(b"")
    said = orip(project, *words.split())
    assert "internal error" not in said.err
    assert not set(said.out + said.err) & set("\x1b\u202e\x9b\udcff\udcfe")
