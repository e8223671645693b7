"""The facade of the Zurich City Hall alone, with an unknown camera: given orientations lead the adjustment astray."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from cli.command_line import orip

SAMPLE = Path(__file__).parents[2] / "sample_projects" / "zurich_city_hall"
PHOTOS = {"st1", "st2", "st3", "st15", "st16"}
WRONG_OR_DISTANT = {"201", "202", "211", "212", "301", "302", "303", "311", "312", "321", "322", "323"}


def facade_project(folder: Path, *, given: bool) -> Path:
    """Write five photos of the facade, C, DX, DY and A3 unknown, with or without the preliminary values."""
    folder.mkdir()
    head, *photos = re.split(r"(?m)^(?=\[\[photo\]\])", (SAMPLE / "orip.toml").read_text(encoding="utf-8"))
    unknown = 'unknown = ["C", "DX", "DY", "A3"]\ndistortion_at = "measured"\nc = 8.595 '
    kept = "".join(photo for photo in photos if re.findall(r'name = "(\w+)"', photo)[0] in PHOTOS)
    if given:
        shutil.copy(SAMPLE / "MAIN.PRE", folder)
    else:
        kept = re.sub(r"(?m)^(X0|Y0|Z0|OMEGA|PHI|KAPPA) =.*\n", "", kept)
    (folder / "orip.toml").write_text(head.replace("c = 8.595 ", unknown) + kept, encoding="utf-8")
    lines = (SAMPLE / "ZURICH.PNT").read_text(encoding="utf-8").splitlines()
    control = [line for line in lines if not line.split() or line.split()[0] not in WRONG_OR_DISTANT]
    (folder / "ZURICH.PNT").write_text("\n".join(control) + "\n", encoding="utf-8")
    head, *logs = re.split(r"(?m)^(?=POINTS )", (SAMPLE / "ZURICH.MEA").read_text(encoding="utf-8"))
    log = head + "".join(part for part in logs if part.split()[2] in PHOTOS)
    (folder / "ZURICH.MEA").write_text(log, encoding="utf-8")
    return folder


def test_the_facade_ends_at_the_same_minimum_from_its_given_values_as_from_nothing(tmp_path: Path) -> None:
    given = orip(facade_project(tmp_path / "given", given=True), "run", "--json", "--no-report")
    nothing = orip(facade_project(tmp_path / "nothing", given=False), "run", "--json", "--no-report")
    assert given.code == nothing.code == 0
    assert "this result was computed from preliminary values found by orip" in given.err
    # 7.757 micrometres, and an a-priori error of 6.4
    assert 6.4 * given.document["sigma0"] == pytest.approx(7.757, abs=5e-4)
    assert given.document["sigma0"] == pytest.approx(nothing.document["sigma0"], rel=1e-6)
