"""Results for Metashape: into a copy of exported XML, geocentric as it is, or as a new document."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange import test_metashape
from exchange.imported import read_well, reprojected, written
from exchange.metashape_projects import psz
from exchange.test_metashape import document

from orip.exchange.conversion.ground import LocalGround, from_local_ground
from orip.exchange.metashape.source import READING, read_metashape
from orip.records.exchanged import ExchangedProject
from orip.structs import replace

BERLIN = LocalGround(np.array([np.radians(13.4), np.radians(52.5), 80.0]))


def on_the_earth(noise_px: float) -> ExchangedProject:
    return from_local_ground(block(READING, noise_px=noise_px), BERLIN)


def test_a_chunk_on_the_earth_comes_back_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # a chunk whose own origin is near the block
    monkeypatch.setattr(test_metashape, "SHIFT", BERLIN.origin)
    text = document(on_the_earth(0.3)).replace('<reference>LOCAL_CS["x"]</reference>', "")
    # positions of photos of the block are not on the earth
    text = re.sub(r'<reference x="\d" y="2" z="3" sxyz="0.5"[^>]*/>', "", text)
    # every camera has b2, which orip's polynomial does not hold
    text = text.replace("<cy>-10</cy>", "<cy>-10</cy><b2>0.5</b2><k1>-0.01</k1>")
    source = written(tmp_path / "cameras.xml", text)
    assert orip(tmp_path, "import", "metashape", "cameras.xml", "project", "--hold-cameras").code == 0
    assert orip(tmp_path / "project", "run", "--no-report").code == 0
    said = orip(tmp_path / "project", "export", "metashape", "--json")
    assert said.code == 0, said.err
    assert said.document["original"] == str(source)
    copy = tmp_path / "project" / "metashape_adjusted" / "cameras.xml"
    before, after = (read_well(read_metashape, path) for path in (source, copy))
    assert after.frame.kind == "geocentric"
    moved = [
        np.linalg.norm(np.subtract(old.position, new.position))
        for old, new in zip(before.photos, after.photos, strict=True)
    ]
    # 0.3 px at 3000 px and 100 m are 1 cm; the camera that is not perspective makes it some more
    assert 0.0 < max(moved) < 1.0
    # the camera was held, and is not the nearest one of orip
    assert after.cameras == before.cameras
    assert reprojected(after)[0].rms <= reprojected(before)[0].rms
    # markers, references and settings are those of before
    old, new = text.split("\n"), copy.read_text().split("\n")
    assert all(
        line.startswith(("<camera ", "<cameras>")) for line, other in zip(old, new, strict=True) if line != other
    )


def test_a_project_is_read_and_not_written(tmp_path: Path) -> None:
    given = block(READING, noise_px=0.3)
    psz(tmp_path / "castle.psz", replace(given, name="castle"))
    assert orip(tmp_path, "adjust", "castle.psz", "new").code == 0
    said = orip(tmp_path / "new", "export", "metashape", "again")
    assert "is not copied" in said.err
    again = read_well(read_metashape, tmp_path / "new" / "again")
    assert len(again.photos) == len(given.photos)
    assert "M0" in again.points.names
