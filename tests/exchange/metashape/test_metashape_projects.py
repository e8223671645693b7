"""Metashape: projects with their tie points, `.psx` and `.psz`."""

from __future__ import annotations

import random
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import OBLIQUE, block
from exchange.imported import read_well, reprojected
from exchange.metashape_projects import packed, ply, psx, psz
from hostile.fuzzing import mutated, require_words

from orip.exchange.metashape.source import READING, is_metashape, read_metashape
from orip.records.exchanged import ExchangedProject

Write = Callable[[Path, ExchangedProject], Path]
LAYOUTS = pytest.mark.parametrize(("write", "name"), [(psz, "castle.psz"), (psx, "castle.psx")])


@LAYOUTS
def test_tie_points_come_with_cameras_and_markers(tmp_path: Path, write: Write, name: str) -> None:
    given = block(READING)
    source = write(tmp_path / name, given)
    assert is_metashape(source)
    project = read_well(read_metashape, source)
    assert project.name == "Chunk 1"
    assert len(project.photos) == len(given.photos)
    tracks = project.points.is_track
    assert [project.points.names[n] for n in np.flatnonzero(tracks)[:2]] == ["100", "101"]
    assert project.points.coordinates[tracks] == pytest.approx(given.points.coordinates, abs=1e-9)
    of_tracks = tracks[project.rays.point]
    order = np.lexsort((project.rays.point[of_tracks], project.rays.photo[of_tracks]))
    expected = np.lexsort((given.rays.point, given.rays.photo))
    assert project.rays.image[of_tracks][order] == pytest.approx(given.rays.image[expected], abs=1e-9)
    assert f"{len(given.photos)} projections of tracks without a point, left out." in project.notes
    # markers are those of the frame's own document
    assert "M0" in project.points.names
    assert {control.name for control in project.control} >= {"M0", "M1"}
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6


def test_a_path_that_leads_out_of_the_project_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    source = psx(tmp_path / "inner" / "castle.psx", block(READING))
    for named in ("../outside.zip", "/etc/outside.zip", "C:/outside.zip", "0/../../outside.zip"):
        chunks = f'<document version="1.2.0"><chunks><chunk id="0" path="{named}"/></chunks></document>'
        packed(tmp_path / "inner" / "castle.files" / "project.zip", {"doc.xml": chunks})
        parsed = read_metashape(source, "castle.psx")
        assert parsed.value is None
        assert "leads out of the project" in parsed.complaints[0].message
        assert parsed.complaints[0].path == "castle.files/project.zip/doc.xml"


def test_members_outside_of_the_zip_file_are_refused(tmp_path: Path) -> None:
    source = psz(tmp_path / "castle.psz", block(READING))
    with zipfile.ZipFile(source, "a") as archive:
        archive.writestr("../evil.xml", "<a/>")
    parsed = read_metashape(source, "castle.psz")
    assert parsed.value is None
    assert "'../evil.xml' leads out of the zip file" in parsed.complaints[0].message


def test_a_link_that_leads_out_of_the_project_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    source = psx(tmp_path / "inner" / "castle.psx", block(READING))
    chunk = tmp_path / "inner" / "castle.files" / "0" / "chunk.zip"
    chunk.rename(tmp_path / "chunk.zip")
    chunk.symlink_to(tmp_path / "chunk.zip")
    assert "leads out of the project" in read_metashape(source, "castle.psx").complaints[0].message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"element vertex ", b"element vertex 99999999", "vertices are announced, and there is room for"),
        (b"element vertex ", b"element vertex -", "not a whole number"),
        (b"element vertex ", b"element face ", "has to be 'element vertex'"),
        (b"binary_little_endian", b"ascii", "only binary PLY"),
        (b"property uint id\n", b"property uint no\n", "no property id"),
        (b"property uint id\n", b"property list uint id\n", "of no known type"),
        (b"end_header\n", b"", "this is not a PLY file"),
    ],
)
def test_faults_of_tie_points_are_told(tmp_path: Path, old: bytes, new: bytes, said: str) -> None:
    source = psz(tmp_path / "castle.psz", block(READING))
    with zipfile.ZipFile(source) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    assert old in members["points0.ply"]
    packed(source, {**members, "points0.ply": members["points0.ply"].replace(old, new, 1)})
    parsed = read_metashape(source, "castle.psz")
    assert parsed.value is None
    assert said in parsed.complaints[0].message
    assert parsed.complaints[0].path == "castle.psz/points0.ply"


def test_a_member_that_would_fill_the_memory_is_not_read(tmp_path: Path) -> None:
    source = psz(tmp_path / "castle.psz", block(READING))
    with zipfile.ZipFile(source) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    packed(source, {**members, "points0.ply": bytes(10_000_000)})
    assert "more than can be" in read_metashape(source, "castle.psz").complaints[0].message


def test_a_version_that_is_not_known_is_refused(tmp_path: Path) -> None:
    source = psx(tmp_path / "castle.psx", block(READING))
    text = '<document version="3.0.0"><chunks><chunk id="0" path="0/chunk.zip"/></chunks></document>'
    packed(tmp_path / "castle.files" / "project.zip", {"doc.xml": text})
    complaint = read_metashape(source, "castle.psx").complaints[0]
    assert "version '3.0.0' are not known" in complaint.message


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    source = psx(tmp_path / "castle.psx", block(READING))
    (tmp_path / "castle.files" / "0" / "0" / "frame.zip").unlink()
    complaint = read_metashape(source, "projects/castle.psx").complaints[0]
    assert complaint.path == "projects/castle.files/0/0/frame.zip"
    assert "there is no such file" in complaint.message


def test_a_track_without_coordinates_has_no_rays(tmp_path: Path) -> None:
    source = psz(tmp_path / "castle.psz", block(READING))
    with zipfile.ZipFile(source) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    none = np.zeros(0)
    empty = ply({"x": none, "y": none, "z": none, "id": none}, {"x": "float", "y": "float", "z": "float", "id": "uint"})
    packed(source, {**members, "points0.ply": empty})
    project = read_well(read_metashape, source)
    assert not project.points.is_track.any()


def test_some_mutated_projects(tmp_path: Path) -> None:
    chance = random.Random(9)
    source = psz(tmp_path / "castle.psz", block(READING, OBLIQUE[:2]))
    with zipfile.ZipFile(source) as archive:
        sound = {name: archive.read(name) for name in archive.namelist()}
    whole = source.read_bytes()
    for number in range(60):
        if number % 3:
            name = chance.choice(sorted(sound))
            packed(source, {**sound, name: mutated(sound[name], chance)})
        else:
            source.write_bytes(mutated(whole, chance))
        with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
            warnings.simplefilter("error")
            parsed = read_metashape(source, "castle.psz")
        assert (parsed.value is None) == bool(parsed.complaints)
        for complaint in parsed.complaints:
            require_words(str(complaint))
