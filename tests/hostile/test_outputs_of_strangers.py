"""Names from files of strangers, and names that the user gives to outputs: nothing is written where it harms."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from support.long_cases import in_turn

from orip.files.text.atomic import exported_file_names, is_one_file_name

FILES = {
    "geojson": "orip.geojson",
    "dxf": "orip.dxf",
    "bal": "problem.txt",
    "nvm": "orip.nvm",
    "openmvg": "sfm_data.json",
    "alicevision": "orip.sfm",
    "geopackage": "orip.gpkg",
}
FOLDERS = ("colmap", "opensfm", "metashape", "micmac", "bundler", "bingo", "csv")
NAMES = (
    "../../../stolen", "/tmp/stolen", "..", ".", "a/../../b", "..\\..\\stolen", "C:\\stolen", "NUL", "con.txt", "x. . ",
    "y" * 400, "a:b", "x\u202egpj", "X", "x",
)  # fmt: skip


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("adjusted") / "p"
    assert orip(folder.parent, "init", "--sample", "zurich_city_hall", str(folder)).code == 0
    assert orip(folder, "run").code == 0
    return folder


@pytest.fixture
def project(adjusted: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(adjusted, tmp_path / "deep" / "er" / "p"))


@pytest.mark.parametrize("format_name", [*FOLDERS, *FILES])
def test_export_writes_nothing_outside_of_its_destination(format_name: str, project: Path, tmp_path: Path) -> None:
    photos = [f'photo,st{n},"{name}"' for n, name in enumerate(NAMES, start=1) if name.isprintable()]
    (project / "names.csv").write_text("\n".join(["kind,orip,original", "camera,OLYMPUS,../../../stolen", *photos, ""]))
    (tmp_path / "stolen.xml").write_text("precious")
    before = _state(tmp_path)
    target = project.parent / "out"
    said = orip(project, "export", format_name, str(target))
    assert said.code in (0, 1, 3), said.err
    assert "internal error" not in said.err
    after = {path: text for path, text in _state(tmp_path).items() if not path.is_relative_to(target)}
    assert after == before


def test_every_photo_has_a_file_though_two_folders_have_one_of_its_name(project: Path) -> None:
    rows = "photo,st1,100MEDIA/DJI_0001.JPG\nphoto,st2,101MEDIA/DJI_0001.JPG\nphoto,st3,DJI_0003.JPG\n"
    (project / "names.csv").write_text(f"kind,orip,original\n{rows}")
    assert orip(project, "export", "micmac", "out").code == 0
    found = {path.name for path in (project / "out").glob("Orientation-*")}
    assert len(found) == 15
    assert {f"Orientation-{n}MEDIA_DJI_0001.JPG.xml" for n in (100, 101)} | {"Orientation-DJI_0003.JPG.xml"} <= found


def test_names_with_folders_stay_as_they_are_inside_the_files(project: Path) -> None:
    (project / "names.csv").write_text("kind,orip,original\nphoto,st1,100MEDIA/DJI_0001.JPG\n")
    assert orip(project, "export", "nvm").code == 0
    assert "\n100MEDIA/DJI_0001.JPG " in (project / "orip.nvm").read_text()


@pytest.mark.parametrize("pattern", ["{}.xml", "Orientation-{}.xml"])
def test_names_of_files_are_safe_and_different(pattern: str) -> None:
    found = exported_file_names(pattern, [*NAMES, "", "\0", "\ud800", "é" * 200], taken=["X.xml"])
    assert len({name.casefold() for name in found} | {"x.xml"}) == len(found) + 1
    for name in found:
        assert is_one_file_name(name)
        assert len(name.encode()) <= 220
        assert not set(name) & set('/\\:*?"<>|\0')
        assert name.split(".")[0].upper() not in {"NUL", "CON"}


def test_a_name_with_a_zero_character_in_names_csv_is_refused_in_words(project: Path) -> None:
    (project / "names.csv").write_bytes(b'kind,orip,original\nphoto,st1,"a\0b"\n')
    said = orip(project, "export", "micmac", "out")
    assert said.code == 3
    assert "names.csv:2: 'a\\x00b' has a character that cannot be printed" in said.err


@pytest.mark.parametrize(
    ("name", "format_name"),
    in_turn(
        ["orip.toml", "ZURICH.PNT", "ZURICH.MEA", "MAIN.EXO", "CAMERAS.CAM", "result.json", "names.csv", "NEW.MEA"],
        list(FILES),
    ),
)
def test_export_does_not_replace_a_text_of_the_project(name: str, format_name: str, project: Path) -> None:
    before = _state(project)
    for words in ((name,), (str(project.parent / "er" / ".." / "p" / name), "--force"), (name.upper(), "--force")):
        said = orip(project, "export", format_name, *words)
        assert said.code == 2, said.err
        assert "which no output replaces; name another file" in said.err
    assert _state(project) == before


@pytest.mark.parametrize(
    "words", ["report --output", "results residuals --output", "results covariance st1 --output", "export dxf"]
)
def test_an_output_replaces_another_file_only_when_forced(words: str, project: Path) -> None:
    name = "other.html" if "report" in words else "other.csv"
    (project / name).write_text("my own\n")
    said = orip(project, *words.split(), name)
    assert said.code == 2
    assert "already exists; name another file, or replace it with --force" in said.err
    assert (project / name).read_text() == "my own\n"
    assert orip(project, *words.split(), name, "--force").code == 0
    assert orip(project, *words.split(), name).code == 0  # its own earlier output
    assert orip(project, *words.split(), "names.csv" if "results" in words else "result.json", "--force").code == 2


@pytest.mark.parametrize("format_name", FILES)
def test_an_export_without_a_name_can_be_repeated(format_name: str, project: Path) -> None:
    for _ in range(2):
        assert orip(project, "export", format_name).code == 0
    assert (project / FILES[format_name]).is_file()


def test_todo_does_not_replace_measurements_even_when_forced(project: Path) -> None:
    before = (project / "ZURICH.MEA").read_bytes()
    assert orip(project, "observations", "todo", "--output", "ZURICH.MEA", "--force").code == 2
    assert (project / "ZURICH.MEA").read_bytes() == before


@pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")
def test_a_link_in_the_place_of_an_export_is_not_followed(project: Path, tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("precious")
    (project / "out.dxf").symlink_to(tmp_path / "precious")
    assert orip(project, "export", "dxf", "out.dxf").code == 2
    assert orip(project, "export", "dxf", "out.dxf", "--force").code == 0
    assert (tmp_path / "precious").read_text() == "precious"


def _state(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
