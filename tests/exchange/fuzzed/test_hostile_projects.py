"""Whatever is in a file of another program's project, it is read or complained of; nothing else happens."""

from __future__ import annotations

import json
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import OBLIQUE, block
from exchange import (
    metashape_projects,
    test_aerial,
    test_blocks_exchange,
    test_gubaio,
    test_metashape,
    test_metric,
    test_micmac,
    test_opensfm,
    test_scenes,
    test_tables,
    test_vision,
)
from exchange.imported import written
from exchange.metashape import test_metashape_references
from exchange.mutated_files import project_or_complaints, use_mutated_files
from exchange.vision import test_opf
from support.long_cases import every

from orip.exchange import aicon, bingo, ign, patb, photomodeler, pix4d, tables
from orip.exchange.format import Format
from orip.exchange.formats import format_named
from orip.exchange.metashape import source as metashape
from orip.exchange.opensfm import reconstruction
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.exchange.project.imported import require_names
from orip.exchange.project.texts import ImportSource, imported_texts
from orip.exchange.vision import bundler, nvm, openmvg
from orip.files.project.reader import parse_project
from orip.records.exchanged import ExchangedProject, PoseReading

SETTINGS = ExchangeSettings(frame=(4000, 3000), corrects_distortion=True)


def small(reading: PoseReading) -> ExchangedProject:
    return block(reading, OBLIQUE[:2])


def _opensfm(folder: Path) -> Path:
    project = small(reconstruction.READING)
    written(folder / "reconstruction.json", json.dumps(test_opensfm.reconstruction_of(project)))
    written(folder / "tracks.csv", test_opensfm.tracks_of(project, 2))
    written(folder / "gcp_list.txt", "EPSG:4326\n10 20 30 5 6 0.jpg A\n10 20 NaN 5 6 1.jpg B\n")
    written(folder / "geo.txt", "EPSG:25833\n0.jpg 1 2 3 nan nan nan 0.02 0.05\n")
    return folder


def _marked(folder: Path) -> Path:
    points = [
        {
            "id": "A",
            "position": {"latitude": 20.0, "longitude": 10.0, "altitude": 30.0},
            "observations": [
                {"shot_id": "0.jpg", "projection": [0.01, 0.02]},
                {"shot_id": "1.jpg", "projection": [0, 0]},
            ],
        },
        {"id": 2, "observations": [{"shot_id": "0.jpg", "projection": [0.1, -0.2]}]},
    ]
    written(folder / "ground_control_points.json", json.dumps({"points": points}))
    written(folder / "config.yaml", "feature_process_size: 2048\n")
    project = small(reconstruction.READING)
    written(folder / "reconstruction.json", json.dumps(test_opensfm.reconstruction_of(project)))
    written(folder / "tracks.csv", test_opensfm.tracks_of(project, 2))
    return folder


def _shots(folder: Path) -> Path:
    centres = np.array([[33.0, 52.0, 100.0], [33.0001, 52.0001, 101.0]])
    shots = test_opensfm.shots_of(small(reconstruction.READING), centres)
    return written(folder / "shots.geojson", json.dumps(shots))


def _file(name: str, text: Callable[[ExchangedProject], str], reading: PoseReading) -> Callable[[Path], Path]:
    return lambda folder: written(folder / name, text(small(reading)))


def _tables(folder: Path, project: ExchangedProject) -> Path:
    written(
        folder / "control.csv",
        "point;X;Y;Z;sX;sY;sZ;kind\n1;1,5;2;3;0,01;0,01;0,02;\n2;1;2;3;0,1;0,1;0,1;check\n",
    )
    written(folder / "stations.csv", "photo,X,Y,Z,sX,sY,sZ\n0.jpg,1,2,3,0.1,0.1,0.2\n")
    return test_tables.tables_of(folder, project)


LENS = (
    '<?xml version="1.0"?>\n<calibration>\n<projection>frame</projection><width>4000</width><height>3000</height>\n'
    "<f>3000</f><cx>10</cx><cy>-10</cy><k1>-0.01</k1><b2>0.3</b2>\n</calibration>\n"
)


def _references(folder: Path) -> Path:
    written(folder / "cameras.xml", test_metashape.document(small(metashape.READING)))
    written(folder / "table.csv", test_metashape_references.TABLE)
    return folder


def _folder(files: Callable[[Path, ExchangedProject], Path], reading: PoseReading) -> Callable[[Path], Path]:
    return lambda folder: files(folder, small(reading))


SOUND: dict[str, Callable[[Path], Path]] = {
    "opensfm": _opensfm,
    "opensfm marked": _marked,
    "opensfm shots": _shots,
    "micmac": test_micmac.project_folder,
    "metashape": _file("cameras.xml", test_metashape.document, metashape.READING),
    "blocks": _file("a.xml", test_blocks_exchange.text, test_blocks_exchange.MATRIX_DOWN),
    "bundler": _file("bundle.out", test_vision.bundler, bundler.BUNDLER),
    "bal": _file("a.txt", test_vision.bal, bundler.BAL),
    "nvm": _file("a.nvm", test_vision.nvm, nvm.READING),
    "openmvg": _file("sfm_data.json", test_scenes.openmvg_text, openmvg.READING),
    "alicevision": _file("cameras.sfm", test_scenes.alicevision_text, openmvg.READING),
    "opf": test_opf.tracked_folder,
    "photomodeler": _file("a.txt", test_metric.photomodeler_text, photomodeler.READING),
    "aicon": _folder(test_metric.aicon_files, aicon.READING),
    "pix4d": _folder(test_metric.pix4d_files, pix4d.READING),
    "ign": _folder(test_metric.ign_files, ign.READING),
    "gubaio": test_gubaio.folder_of,
    "bingo": _folder(test_aerial.bingo_files, bingo.READING),
    "csv": _folder(_tables, tables.READING),
    "patb": _folder(test_aerial.patb_files, patb.READINGS[0]),
    "metashape psz": lambda folder: metashape_projects.psz(folder / "a.psz", small(metashape.READING)),
    "metashape psx": lambda folder: metashape_projects.psx(folder / "a.psx", small(metashape.READING)),
    "metashape references": _references,
    "lens": lambda folder: written(folder / "lens.xml", LENS),
}
"""Of each format a project that is read without complaints; after a blank, of which kind."""


def format_of(name: str) -> Format:
    return format_named(name.split(maxsplit=1)[0])


def fuzz(folder: Path, name: str, count: int, seed: int) -> None:
    """Read a project that often, with one of its files changed; and convert what has been read."""
    source = SOUND[name](folder)
    files = [source] if source.is_file() else sorted(path for path in source.rglob("*") if path.is_file())
    read = format_of(name).read
    assert read is not None
    assert not read(source, name).complaints

    def use(_: Path) -> None:
        project = project_or_complaints(read(source, name))
        if project is not None:
            require_names(project, name)
            origin = ImportSource(name, "x", project.name or "x")
            content = imported_texts(imported_block(project, name, SETTINGS), origin, None)
            "".join(content.texts.values()).encode("utf-8")
            parsed = parse_project(content.texts["orip.toml"])
            assert not parsed.complaints, [str(complaint) for complaint in parsed.complaints]

    use_mutated_files([(path, path.read_bytes()) for path in files], count, seed, use)


ORIGINALS = ("opensfm", "micmac", "metashape")


def fuzz_original(folder: Path, name: str, count: int, seed: int) -> None:
    """Write a project that often into a copy of its original, which has changed."""
    source = SOUND[name](folder)
    found = format_of(name)
    assert found.read is not None
    assert found.write is not None
    project = found.read(source, name).value
    assert project is not None
    write = found.write
    files = [source] if source.is_file() else sorted(path for path in source.rglob("*") if path.is_file())
    use_mutated_files([(path, path.read_bytes()) for path in files], count, seed, lambda _: write(project, source))


@pytest.mark.parametrize("name", ORIGINALS)
@pytest.mark.parametrize(("count", "seed"), every(2, [(30, 9), (10_000, 10)]))
def test_mutated_originals(tmp_path: Path, name: str, count: int, seed: int) -> None:
    fuzz_original(tmp_path, name, count, seed)


@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize(("count", "seed"), every(2, [(15, 7), (100_000 // len(SOUND), 8)]))
def test_mutated_files(tmp_path: Path, name: str, count: int, seed: int) -> None:
    fuzz(tmp_path, name, count, seed)


@pytest.mark.long
@pytest.mark.parametrize("name", SOUND)
def test_no_mutated_file_takes_much_memory(tmp_path: Path, name: str) -> None:
    """Not more than some times its size: numbers of a text take some times the room of their digits."""
    source = SOUND[name](tmp_path)
    files = [source] if source.is_file() else sorted(path for path in source.rglob("*") if path.is_file())
    size = sum(path.stat().st_size for path in files)
    read = format_of(name).read
    assert read is not None
    read(source, name)  # what is imported on demand is there now

    def use(_: Path) -> None:
        tracemalloc.start()
        try:
            project_or_complaints(read(source, name))
            assert tracemalloc.get_traced_memory()[1] < 60 * size + 2_000_000
        finally:
            tracemalloc.stop()

    use_mutated_files([(path, path.read_bytes()) for path in files], 300, 9, use)


def test_entities_are_refused_before_they_expand(tmp_path: Path) -> None:
    bomb = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;">]><document><chunk>&b;</chunk></document>'
    for name in ("metashape", "blocks"):
        path = written(tmp_path / name / "cameras.xml", bomb)
        read = format_named(name).read
        assert read is not None
        assert "document type" in read(path, name).complaints[0].message
    shutil.rmtree(tmp_path / "blocks")


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    read = format_named("metashape").read
    assert read is not None
    deep = written(tmp_path / "a.xml", "<document>" + "<chunk>" * 100_000)
    assert "more elements in one another" in read(deep, "a.xml").complaints[0].message
    read = format_named("opensfm").read
    assert read is not None
    deep = written(tmp_path / "reconstruction.json", "[" * 100_000)
    assert "not JSON" in read(deep, "a.json").complaints[0].message


def test_every_format_recognises_its_own_files_alone(tmp_path: Path) -> None:
    names = {format_of(name).name for name in SOUND}
    for name, files in SOUND.items():
        source = files(tmp_path / name)
        found = [other for other in names if format_named(other).recognises(source)]
        assert found == [format_of(name).name]
