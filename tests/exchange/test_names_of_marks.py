"""Marks and tracks of the same name are two points in every format: control stays with the mark."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, with_frame
from exchange.metashape_projects import packed, psx, psz
from exchange.test_micmac import project_folder
from exchange.test_written_back import BOTH_WAYS, DIGITS, LENS, in_conventions

from orip.exchange.formats import format_named
from orip.exchange.metashape.source import READING
from orip.exchange.sources.names import read_names
from orip.files.control.text import parse_points
from orip.files.log.text import read_measurements
from orip.files.project.reader import read_project
from orip.files.text.shown import Parsed
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedPoints, ExchangedProject
from orip.records.measurement import PointsRecord
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.project.bundle_state import read_bundle

MARKS = (*map(str, range(12)), "T3", "north gate", "Höhe 1", "höhe 1", "gcp", "GCP")
TRACKS = tuple(map(str, range(40)))


def colliding(project: ExchangedProject) -> ExchangedProject:
    """Return a block whose first points are marks with control at their places, and whose others are tracks.

    Marks 0 to 11 and tracks 0 to 39 have the same names. Mark 4 is a check point.
    """
    names = (*MARKS, *TRACKS)
    points = ExchangedPoints(names, project.points.coordinates[: len(names)], np.arange(len(names)) >= len(MARKS))
    control = tuple(
        ControlPoint(name, tuple(points.coordinates[n].tolist()), (-0.03,) * 3 if name == "4" else (0.02, 0.02, 0.05))
        for n, name in enumerate(MARKS)
    )
    rows = project.rays.point < len(names)
    rays = replace(
        project.rays,
        **{key: getattr(project.rays, key)[rows] for key in ("photo", "point", "image", "deviation", "is_active")},
    )
    photos = tuple(replace(photo, name=f"Straße {n} öst.jpg") for n, photo in enumerate(project.photos))
    return replace(project, photos=photos, points=points, rays=rays, control=control, ground_unit="m")


class Held:
    """What a project folder has of marks and measurements, by the names that they have in the other program."""

    def __init__(self, folder: Path) -> None:
        names = read_names(folder)
        texts = {path.suffix: path for path in folder.iterdir()}
        self.control = {}
        if ".PNT" in texts:
            points = parse_points(Parsed(texts[".PNT"].read_text(encoding="utf-8").splitlines()), "a.PNT").value
            self.control = {names.original_mark(point.name): (point.coordinates, point.errors) for point in points}
        self.rays = {}
        for record in read_measurements(texts[".MEA"], "a.MEA").value:
            assert isinstance(record, PointsRecord)
            photo = names.photos.get(record_key(record.photo), record.photo)
            for name, image in zip(record.names, record.measured.tolist(), strict=True):
                mark = names.original_mark(name)
                point = (mark, False) if mark in self.control else names.original_point(name)
                self.rays[photo, *point] = image


WITH_CONTROL = ("metashape", "blocks", "bingo", "patb")
"""Formats that have control points, and marks apart from tracks."""

ONLY_MARKS, NO_RAYS = ("metashape",), ("micmac",)


def expected_control(name: str, given: ExchangedProject) -> dict[str, object]:
    """Return the control of a block as a format has it: PAT-B has neither check points nor errors."""
    if name == "patb":
        return {
            point.name: (point.coordinates, (0.02, 0.02, 0.02)) for point in given.control if point.kind == "control"
        }
    return {point.name: (point.coordinates, point.errors) for point in given.control}


def rays_of_marks(project: ExchangedProject, names: set[str]) -> set[tuple[str, str]]:
    rays, points = project.rays, project.points
    return {
        (project.photos[photo].name, points.names[point])
        for photo, point in zip(rays.photo.tolist(), rays.point.tolist(), strict=True)
        if not points.is_track[point] and points.names[point] in names
    }


@pytest.mark.parametrize("name", [name for name in BOTH_WAYS if name not in NO_RAYS])
def test_a_round_trip_by_way_of_a_project_loses_nothing_that_the_format_has(tmp_path: Path, name: str) -> None:
    """Import, run, export, import: control at its marks, every ray, and a reprojection as before."""
    found = format_named(name)
    assert found.write is not None
    assert found.read is not None
    assert found.conventions is not None
    given = colliding(in_conventions(found.conventions))
    files = found.write(given, None)
    (tmp_path / "given").mkdir()
    for file, data in files.items():
        (tmp_path / "given" / file).write_bytes(data)
    one_file = next(iter(files)) if found.is_file or name == "bundler" else ""
    frame = () if given.cameras[0].lens == "isp" else ("--frame", f"{LENS.columns}x{LENS.rows}")
    assert orip(tmp_path, "import", name, f"given/{one_file}", "first", *frame).code == 0
    run = orip(tmp_path / "first", "run", "--no-report")
    assert run.code == 0, run.err
    target = tmp_path / "again" / (one_file if found.is_file else "")
    target.parent.mkdir(exist_ok=True)
    written_back = orip(tmp_path / "first", "export", name, str(target))
    assert written_back.code == 0, written_back.err
    for file in files:  # a copy of a reconstruction is put back beside what belongs to it
        if name == "opensfm" and not (target / file).exists():
            (target / file).write_bytes((tmp_path / "given" / file).read_bytes())
    assert orip(tmp_path, "import", name, f"again/{one_file}", "second", *frame).code == 0

    first, second = Held(tmp_path / "first"), Held(tmp_path / "second")
    control = expected_control(name, given) if name in WITH_CONTROL else {}
    assert first.control == control
    assert second.control.keys() == control.keys()
    for point, (coordinates, errors) in control.items():
        assert second.control[point] == (pytest.approx(coordinates, abs=1e-9), errors)
    marks = {(photo, point) for photo, point, is_track in second.rays if not is_track and point in control}
    assert marks == rays_of_marks(given, set(control))
    assert len(first.rays) == len(second.rays)
    if name not in ONLY_MARKS:
        assert len(first.rays) >= len(given.rays.photo) - 1  # a track that one photo shows is no point
    again = read_well(found.read, tmp_path / "again" / one_file)
    if not again.cameras[0].columns:
        again = with_frame(again, LENS.columns, LENS.rows)
    reprojection, _ = reprojected(again)
    assert reprojection.rms < (0.005 if name in DIGITS else 1e-6)


MARKS_OF_MICMAC = {"G0": "0", "G1": "Höhe 1", "G2": "north gate"}
"""Names in place of those of the project folder; tracks are numbered from 0."""


def definition_of_camera(folder: Path) -> tuple[float, ...]:
    """Return C, DX, DY and the distortion of the only camera of a project's text."""
    parsed = read_project(folder / "orip.toml", "orip.toml")
    assert parsed.value is not None
    (camera,) = parsed.value.definition.cameras
    return camera.parameters


@pytest.mark.parametrize(
    ("deviation", "errors"),
    [("0.01 0.01 0.05", (0.01, 0.01, 0.05)), ("1 1 1", (0.02, 0.02, 0.02))],  # MicMac's default says nothing
)
@pytest.mark.parametrize("is_held", [True, False])
def test_orientations_of_micmac_come_back_beside_the_measurements_that_they_belong_to(
    tmp_path: Path, deviation: str, errors: tuple[float, ...], is_held: bool
) -> None:
    """Import, run, export, import: MicMac has measurements and control in files that an export leaves alone.

    A camera that is held comes back as it was given, one that is free as it was adjusted.
    """
    hold = ["--hold-cameras"] if is_held else []
    source = project_folder(tmp_path / "given")
    for file in ("points-S3D.xml", "points-S2D.xml"):
        text = (source / file).read_text(encoding="utf-8")
        for name, other in MARKS_OF_MICMAC.items():
            text = text.replace(f"<NamePt>{name}<", f"<NamePt>{other}<")
        text = re.sub("<Incertitude>.*?<", f"<Incertitude>{deviation}<", text)
        (source / file).write_text(text, encoding="utf-8")
    calibration = source / "Ori-A" / "Cam.xml"
    text = calibration.read_text(encoding="utf-8")
    longer = re.sub("<F>(.*?)<", lambda found: f"<F>{float(found[1]) * 1.0005}<", text)
    calibration.write_text(text if is_held else longer, encoding="utf-8")
    shutil.copytree(source, tmp_path / "again")
    said = orip(tmp_path, "import", "micmac", "given", "first", *hold)
    assert ("1 camera held" if is_held else "1 camera adjusted") in said.told
    run = orip(tmp_path / "first", "run", "--no-report")
    assert run.code == 0, run.err
    written_back = orip(tmp_path / "first", "export", "micmac", str(tmp_path / "written"))
    assert written_back.code == 0, written_back.err
    shutil.rmtree(tmp_path / "again" / "Ori-A")
    shutil.copytree(tmp_path / "written", tmp_path / "again" / "Ori-A")
    assert orip(tmp_path, "import", "micmac", "again", "second", *hold).code == 0
    adjusted = read_bundle(tmp_path / "first", None, "heads", "solutions").adjusted.cameras.values[0]
    given, back = (definition_of_camera(tmp_path / name) for name in ("first", "second"))
    assert back == pytest.approx(given if is_held else adjusted, rel=1e-9, abs=1e-12)
    assert given[0] / adjusted[0] == pytest.approx(1.0 if is_held else 1.0005, rel=1e-6)

    first, second = Held(tmp_path / "first"), Held(tmp_path / "second")
    assert set(first.control) == set(MARKS_OF_MICMAC.values())
    assert first.control == second.control
    assert [given for _, given in first.control.values()] == [errors] * 3
    assert first.rays == second.rays
    marks = {point for _, point, is_track in first.rays if not is_track}
    assert marks == set(MARKS_OF_MICMAC.values())
    read = format_named("micmac").read
    assert read is not None
    reprojection, _ = reprojected(read_well(read, tmp_path / "again"))
    assert reprojection.rms < 1e-6


LOST = {
    "colmap": "17 control points, 1 check point, 1 distance",
    "opensfm": "17 control points, 1 check point, 1 distance",
    "metashape": "1 distance, 40 tie points",
    "blocks": "1 distance",
    "micmac": "17 control points, 1 check point, 1 distance, 304 measurements",
    "bundler": "17 control points, 1 check point, 1 distance",
    "bal": "17 control points, 1 check point, 1 distance",
    "nvm": "17 control points, 1 check point, 1 distance",
    "openmvg": "17 control points, 1 check point, 1 distance",
    "alicevision": "17 control points, 1 check point, 1 distance",
    "bingo": "1 distance",
    "patb": "1 check point, 1 distance",
}


def test_an_export_says_what_the_format_has_no_place_for(tmp_path: Path) -> None:
    blocks = format_named("blocks")
    assert blocks.write is not None
    assert blocks.conventions is not None
    (tmp_path / "block.xml").write_bytes(blocks.write(colliding(in_conventions(blocks.conventions)), None)["block.xml"])
    assert orip(tmp_path, "import", "block.xml", "p").code == 0
    (tmp_path / "p" / "orip.LEN").write_text("bar 0 1 XYZ 21.1 1\n", encoding="utf-8")
    run = orip(tmp_path / "p", "run", "--no-report")
    assert run.code == 0, run.err
    assert LOST.keys() == set(BOTH_WAYS)
    for name, lost in LOST.items():
        said = orip(tmp_path / "p", "export", name, f"../{name}", "--exact-distortion")
        assert said.code == 0, said.err
        assert f"has no place for it: {lost}." in " ".join((said.out + said.err).split()), name


@pytest.mark.parametrize("write", [psz, psx])
def test_markers_called_as_tracks_keep_their_control(tmp_path: Path, write: Callable[..., Path]) -> None:
    """Every project of Metashape whose markers are called 0, 1, 2 has tracks of these numbers, too."""
    project = block(READING)
    path = write(tmp_path / "tiny" / f"tiny.{write.__name__}", project)
    for file in [path, *path.parent.rglob("*.zip")]:
        _rename_in_zip(file)
    assert orip(tmp_path, "import", str(path), "p").code == 0
    held = Held(tmp_path / "p")
    places = dict(zip(project.points.names, project.points.coordinates.tolist(), strict=True))
    assert {name: place for name, (place, _) in held.control.items()} == {
        str(n + 100): pytest.approx(tuple(places[str(n)])) for n in range(60) if n != 2
    }
    photos = {point: set() for point in held.control}
    for photo, point, is_track in held.rays:
        if not is_track and point in photos:
            photos[point].add(photo)
    assert all(len(seen) == 6 for point, seen in photos.items() if point != "105")  # not pinned
    tracks = {point for _, point, is_track in held.rays if is_track}
    assert tracks == {str(n + 100) for n in range(60)}


def _rename_in_zip(path: Path) -> None:
    """Give markers the numbers of tracks as names: M0 becomes 100."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    if "doc.xml" in members:
        text = members["doc.xml"].decode()
        text = text.replace('<marker id="2" label="M0"/>', '<marker id="2" label="unmeasured"/>')
        members["doc.xml"] = re.sub(r'label="M(\d+)"', lambda m: f'label="{int(m[1]) + 100}"', text).encode()
    packed(path, members)


def test_check_points_without_accuracies_stay_check_points(tmp_path: Path) -> None:
    """A reference that is not enabled, or a check point, has no weight even where no file says how good it is."""
    blocks = format_named("blocks")
    assert blocks.write is not None
    assert blocks.conventions is not None
    given = colliding(in_conventions(blocks.conventions))
    text = blocks.write(given, None)["block.xml"].decode()
    (tmp_path / "block.xml").write_text(re.sub(r"<(Horizontal|Vertical)Accuracy>.*?Accuracy>", "", text), "utf-8")
    assert orip(tmp_path, "import", "block.xml", "blocks").code == 0
    metashape = format_named("metashape")
    assert metashape.write is not None
    assert metashape.conventions is not None
    files = metashape.write(colliding(in_conventions(metashape.conventions)), None)
    text = re.sub(r' s[xyz]="[^"]*"', "", files["cameras.xml"].decode())
    (tmp_path / "cameras.xml").write_text(text, "utf-8")
    assert orip(tmp_path, "import", "cameras.xml", "metashape").code == 0
    for folder in ("blocks", "metashape"):
        held = Held(tmp_path / folder).control
        assert held.pop("4")[1] == (-0.02, -0.02, -0.02)
        assert {errors for _, errors in held.values()} == {(0.02, 0.02, 0.02)}


def test_what_a_run_would_refuse_is_refused_at_its_line_of_the_source(tmp_path: Path) -> None:
    blocks = format_named("blocks")
    assert blocks.write is not None
    assert blocks.conventions is not None
    text = blocks.write(colliding(in_conventions(blocks.conventions)), None)["block.xml"].decode()
    text = text.replace("<Name>3</Name>", "<Name>2</Name>").replace(
        "<HorizontalAccuracy>0.02", "<HorizontalAccuracy>1e-12", 1
    )
    (tmp_path / "b.xml").write_text(text, "utf-8")
    lines = [n for n, line in enumerate(text.splitlines(), start=1) if line.startswith("<ControlPoint>")]
    said = orip(tmp_path, "import", "b.xml", "p")
    assert said.code == 3
    message = " ".join(said.err.split())
    assert f"b.xml:{lines[0]}: point 0: an a-priori error of 1e-12 is smaller" in message
    assert f"b.xml:{lines[3]}: point 2: point '2' is already on line {lines[2]};" in message
    assert not (tmp_path / "p").exists()
