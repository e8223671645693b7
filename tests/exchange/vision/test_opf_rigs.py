"""Rigs of Pix4D's Open Photogrammetry Format."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from cli.command_line import orip
from exchange.vision.test_opf import SENSOR, documents, project_folder, turned
from scipy.spatial.transform import Rotation

RELATIVE = {
    "translation": {"values_m": [-0.015, 0.02, 0.003], "sigmas_m": [0.001, 0.002, 0.003]},
    "rotation": {"angles_deg": [3.0, -20.0, 40.0], "sigmas_deg": [0.05, 0.06, 0.07]},
}


def test_captures_are_exposures_and_sensors_have_observed_mountings(tmp_path: Path) -> None:
    found = documents()
    for key in ("input-cameras", "calibrated-cameras"):
        (sensor,) = found[key]["sensors"]
        found[key]["sensors"].append(sensor | {"id": SENSOR + 1})
    found["input-cameras"]["sensors"][1] |= {"name": "second", "rig_relatives": RELATIVE}
    captures = found["input-cameras"]["captures"]
    for first, second in ((0, 1), (2, 3)):
        captures[first]["cameras"] += captures[second]["cameras"]
        captures[second]["cameras"][0] |= {"sensor_id": SENSOR + 1}
        captures[first]["cameras"][1]["sensor_id"] = SENSOR + 1
        found["calibrated-cameras"]["cameras"][second]["sensor_id"] = SENSOR + 1
    found["input-cameras"]["captures"] = [captures[0], captures[2], captures[4]]
    path = project_folder(tmp_path / "opf", found)
    said = orip(tmp_path, "import", str(path), "made")
    assert said.code == 0, said.told
    document = tomllib.loads((tmp_path / "made" / "orip.toml").read_text(encoding="utf-8"))
    (rig,) = document["rig"]
    assert [one["photos"] for one in document["exposure"]] == [["DJI_0", "DJI_1"], ["DJI_2", "DJI_3"], ["DJI_4"]]
    reference, second = rig["camera"]
    assert set(reference) == {"name"}
    assert second["offset_error"] == [0.001, 0.002, 0.003]
    assert second["rotation_error"] == [0.05, 0.06, 0.07]
    # T_s = T_r + R_r T_rel and R_s = R_r R_rel in axes right, down, front; orip's are right, up, back
    axes = np.diag([1.0, -1.0, -1.0])
    body = turned(10.0, -20.0, 30.0)
    wanted = body @ axes @ turned(*RELATIVE["rotation"]["angles_deg"]) @ axes
    mounted = Rotation.from_euler("XYZ", second["rotation"], degrees=True).as_matrix()
    assert np.abs(body @ mounted - wanted).max() < 1e-12
    assert np.abs(np.array(second["offset"]) - axes @ RELATIVE["translation"]["values_m"]).max() < 1e-15
