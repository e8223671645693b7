"""A project of a rig from its texts to its results, from nothing, and again when its rig changes."""

import json

import numpy as np
import pytest
from cli.command_line import orip
from scipy.spatial.transform import Rotation
from support.rig_blocks import C, rig_block

from orip.online.session import OnlineSession


def written(folder, block, rig_text):
    parts = ['[project]\nname = "HEAD"']
    parts += [f'[[camera]]\nname = "{camera.name}"\nc = {C}' for camera in block.cameras]
    parts += [f'[[photo]]\nname = "{photo.name}"\ncamera = "{photo.camera}"' for photo in block.photos]
    parts += ['[[bundle]]\nname = "MAIN"\nmeasurement_precision = 0.004', rig_text]
    parts += [
        f'[[exposure]]\nname = "{one.name}"\nphotos = {json.dumps(list(one.photos))}' for one in block.rigs.exposures
    ]
    (folder / "orip.toml").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    points, log = block.photo_points, []
    for row, photo in enumerate(block.photos):
        log.append(f"POINTS MAIN {photo.name}")
        mine = np.flatnonzero(points.photo == row)
        log += [f"{block.point_names[points.point[k]]} {points.xy[k, 0]:.6f} {points.xy[k, 1]:.6f}" for k in mine]
    (folder / "HEAD.MEA").write_text("\n".join(log) + "\n", encoding="utf-8")
    control = [" ".join([one.name, *map(str, one.coordinates), *["0.02"] * 3]) for one in block.control_points]
    (folder / "HEAD.PNT").write_text("\n".join(control) + "\n", encoding="utf-8")


FREE = '[[rig]]\nname = "BODY"\n[[rig.camera]]\nname = "A"\n[[rig.camera]]\nname = "B"\n[[rig.camera]]\nname = "C"\n'


@pytest.fixture
def project(tmp_path):
    made = rig_block("three", "project", points=150)
    written(tmp_path, made.block, FREE)
    return tmp_path, made


def result(folder):
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))


def test_a_rig_is_adjusted_from_its_texts(project):
    folder, made = project
    said = orip(folder, "run")
    assert said.code == 0, said.told
    found = result(folder)
    mounting = found["mountings"]["BODY"]["C"]
    for axis, name in enumerate(("OX", "OY", "OZ")):
        assert abs(mounting[name]["value"] - made.offsets[2, axis]) < 5.0 * mounting[name]["sd"]
    angles = Rotation.from_matrix(made.mountings[2]).as_euler("XYZ", degrees=True)
    for value, name in zip(angles, ("OMEGA", "PHI", "KAPPA"), strict=True):
        assert abs(mounting[name]["value"] - value) < 5.0 * mounting[name]["sd"]
    assert found["mountings"]["BODY"]["A"]["OX"] == {"value": 0.0, "sd": None}
    exposure, photo = found["exposures"]["E1"], found["photos"]["1A"]
    assert exposure.pop("rig") == "BODY"
    for name, figures in exposure.items():
        assert figures["value"] == pytest.approx(photo[name]["value"], abs=1e-9)
        assert figures["sd"] == pytest.approx(photo[name]["sd"], rel=1e-6)
    listing = (folder / "BUNDLE_RESULT.OUT").read_text(encoding="utf-8")
    assert "RIGS: MOUNTINGS OF CAMERAS" in listing
    assert "RIGS: EXPOSURES" in listing
    assert "Rigs: mountings of cameras" in (folder / "report.html").read_text(encoding="utf-8")
    assert orip(folder, "status").code == 0


def test_a_rig_without_exposures_is_said(project):
    folder, made = project
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    alone = "\n".join(f'[[exposure]]\nname = "{photo.name}"\nphotos = ["{photo.name}"]' for photo in made.block.photos)
    for exposures in ("", alone):
        (folder / "orip.toml").write_text(text[: text.index("[[exposure]]")] + exposures, encoding="utf-8")
        said = orip(folder, "run")
        assert said.code == 0, said.told
        assert "rig BODY: no exposure has photos of two of its cameras" in " ".join(said.told.split())


def test_a_session_says_that_it_tests_the_photos_one_by_one(project):
    folder, _ = project
    assert orip(folder, "init").code == 0
    session = OnlineSession(folder, None)
    (warning,) = [one for one in session.warnings if one.code == "rigs-while-measuring"]
    assert warning.where == "rig BODY"


def test_another_mounting_makes_the_results_stale(project):
    folder, made = project
    said = orip(folder, "run")
    assert said.code == 0, said.told
    before = result(folder)
    said = f"offset = {made.offsets[1].tolist()}\noffset_error = [0.002, 0.002, 0.002]\n"
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    changed = text.replace('[[rig.camera]]\nname = "B"\n', f'[[rig.camera]]\nname = "B"\n{said}')
    (folder / "orip.toml").write_text(changed, encoding="utf-8")
    assert "rig BODY of orip.toml" in orip(folder, "status").told
    said = orip(folder, "run")
    assert said.code == 0, said.told
    after = result(folder)
    assert after["run"] != before["run"]
    assert after["mountings"]["BODY"]["B"]["OX"]["sd"] < before["mountings"]["BODY"]["B"]["OX"]["sd"]
    assert after["observations"] == before["observations"] + 3
    rows = (folder / "residuals.csv").read_text(encoding="utf-8").splitlines()
    assert sum(row.startswith("mounting") for row in rows) == 3
