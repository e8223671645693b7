"""The 21 photographs of PhotoModeler's calibration sheet: dots against PhotoModeler's marks, and the calibration."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from pictures.sheet_project import RINGS, published_marks, sheet_coordinates, write_project
from reference.olympus_camera import as_reported
from reference.published_data import REFERENCE_DATA, data_set, read_report
from support.long_cases import every
from workflow.quiet import run_quietly

from orip.images.image_files import read_colours
from orip.pictures.targets.sheets import find_sheet, sheet_of

PICTURES = REFERENCE_DATA / "pictures" / "camcal-sheet"


def differences(picture: Path) -> tuple[dict[str, np.ndarray], set[str]]:
    """Return own less PhotoModeler's marks, and the dots that PhotoModeler has and orip has not."""
    dots = sheet_coordinates()
    codes = {name: parts for parts, name in enumerate(RINGS.split(","), start=1)}
    found = find_sheet(read_colours(picture)[:, :, 1], sheet_of(list(dots), np.array(list(dots.values())), codes))
    theirs = published_marks()[picture.stem]
    own = {mark.name: np.array([mark.column, mark.row]) for mark in found.marks}
    return {name: own[name] - theirs[name] for name in own if name in theirs}, set(theirs) - set(own)


@pytest.mark.parametrize("number", every(3, [22, 30, 32]))
def test_dots_of_single_pictures(number: int) -> None:
    """A frontal one, one that cuts the sheet, and one with reflections on it."""
    data_set("pictures")
    off, missing = differences(PICTURES / f"P82500{number}.JPG")
    assert not missing
    all_of_them = np.array(list(off.values()))
    assert np.abs(all_of_them).max() < 1.0  # a wrong name would be some 100 pixels off
    assert (all_of_them.std(axis=0) < 0.13).all()


@pytest.mark.long
def test_calibration_from_pictures_alone(tmp_path: Path) -> None:
    data_set("pictures")
    write_project(tmp_path)
    said = orip(tmp_path, "detect", "sheet", "SHEET.PNT", str(PICTURES), "--rings", RINGS, "--least-error", "0.1")
    assert said.code == 0, said.err
    off = []
    theirs = published_marks()
    photo, found = "", 0
    for line in (tmp_path / "DETECTED.MEA").read_text(encoding="utf-8").splitlines():
        fields = line.split()
        if fields[:1] == ["POINTS"]:
            photo = fields[2]
        elif len(fields) == 5 and fields[0] in theirs[photo]:
            found += 1
            off.append(np.array([float(fields[1]), float(fields[2])]) - theirs[photo][fields[0]])
    assert found >= 0.99 * sum(map(len, theirs.values()))
    assert np.abs(off).max() < 2.0
    assert (np.std(off, axis=0) < 0.1).all()
    run_quietly(tmp_path)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    published = read_report(data_set("dbat-camcal-selfcal") / "result" / "report.txt").camera
    assert result["status"] == "converged"
    assert 0.1 * result["sigma0"] < 0.16
    for name, own in as_reported(result).items():
        assert abs(own.value - published[name].value) < 2.0 * published[name].deviation, name
