"""Missions for drones hold what their formats ask for, and refuse what a drone cannot do."""

from __future__ import annotations

import io
import json
import math
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from cli.command_line import orip
from planning.planned_projects import project, stations, text_of, written

# "Is it required: Yes" in the tables of https://github.com/dji-sdk/Cloud-API-Doc,
# docs/en/60.api-reference/00.dji-wpml, and what is required by the values of others
COMMON = {
    "missionConfig": {
        "flyToWaylineMode", "finishAction", "exitOnRCLost", "executeRCLostAction", "takeOffSecurityHeight",
        "globalTransitionalSpeed", "globalRTHHeight",
    },
    "waypointHeadingParam": {"waypointHeadingMode", "waypointHeadingAngle", "waypointHeadingPathMode"},
    "actionGroup": {"actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex", "actionGroupMode"},
    "actionTrigger": {"actionTriggerType"},
    "action": {"actionId", "actionActuatorFunc"},
}  # fmt: skip
WAYLINES = COMMON | {
    "Folder": {"templateId", "waylineId", "autoFlightSpeed", "executeHeightMode"},
    "Placemark": {"Point", "index", "executeHeight", "waypointSpeed", "waypointHeadingParam", "waypointTurnParam"},
    "waypointTurnParam": {"waypointTurnMode", "waypointTurnDampingDist"},
}
TEMPLATE = COMMON | {
    "Folder": {
        "templateType", "templateId", "autoFlightSpeed", "globalWaypointTurnMode", "globalUseStraightLine",
        "gimbalPitchMode", "globalHeight",
    },
    "Placemark": {
        "Point", "index", "useGlobalHeight", "ellipsoidHeight", "height", "useGlobalSpeed", "useGlobalHeadingParam",
        "useGlobalTurnParam", "gimbalPitchAngle",
    },
    "waylineCoordinateSysParam": {"coordinateMode", "heightMode"},
}  # fmt: skip
PARAMETERS = {
    "takePhoto": {"payloadPositionIndex", "fileSuffix", "payloadLensIndex", "useGlobalPayloadLensIndex"},
    "gimbalRotate": {
        "payloadPositionIndex", "gimbalHeadingYawBase", "gimbalRotateMode", "gimbalPitchRotateEnable",
        "gimbalPitchRotateAngle", "gimbalRollRotateEnable", "gimbalRollRotateAngle", "gimbalYawRotateEnable",
        "gimbalYawRotateAngle", "gimbalRotateTimeEnable", "gimbalRotateTime",
    },
}  # fmt: skip
WORDS = {
    "flyToWaylineMode": {"safely", "pointToPoint"},
    "finishAction": {"goHome", "noAction", "autoLand", "gotoFirstWaypoint"},
    "exitOnRCLost": {"goContinue", "executeLostAction"},
    "executeRCLostAction": {"goBack", "landing", "hover"},
    "executeHeightMode": {"WGS84", "relativeToStartPoint", "realTimeFollowSurface"},
    "heightMode": {"EGM96", "relativeToStartPoint", "aboveGroundLevel", "realTimeFollowSurface"},
    "waypointHeadingMode": {"followWayline", "manually", "fixed", "smoothTransition", "towardPOI"},
    "waypointHeadingPathMode": {"clockwise", "counterClockwise", "followBadArc"},
    "waypointTurnMode": {
        "coordinateTurn", "toPointAndStopWithDiscontinuityCurvature", "toPointAndStopWithContinuityCurvature",
        "toPointAndPassWithContinuityCurvature",
    },
    "actionGroupMode": {"sequence"},
    "actionTriggerType": {"reachPoint", "betweenAdjacentPoints", "multipleTiming", "multipleDistance"},
    "gimbalPitchMode": {"manual", "usePointSetting"},
}  # fmt: skip
LIMITS = {
    "takeOffSecurityHeight": (2.0, 1500.0),
    "globalTransitionalSpeed": (1e-6, 15.0),
    "autoFlightSpeed": (1e-6, 15.0),
    "gimbalPitchRotateAngle": (-90.0, 30.0),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    # two cross strips look forward by 20 degrees
    made = project(tmp_path_factory.mktemp("drones") / "p", cross_strips="2", cross_tilt="20.0")
    assert orip(made, "plan", "make").code == 0
    return made


def name_of(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def mission_of(folder: Path, name: str) -> ET.Element:
    return ET.fromstring(zipfile.ZipFile(io.BytesIO(written(folder, "dji", "m.kmz"))).read(f"wpmz/{name}"))


@pytest.mark.parametrize(("name", "required"), [("waylines.wpml", WAYLINES), ("template.kml", TEMPLATE)])
def test_wpml_has_all_that_its_tables_require(folder, name, required):
    whole = mission_of(folder, name)
    found = set()
    for element in whole.iter():
        kind, inside = name_of(element), {name_of(one) for one in element}
        found.add(kind)
        assert required.get(kind, set()) <= inside, kind
        if kind == "action":
            function, parameters = (element.find(f"{{*}}actionActuatorFunc{end}") for end in ("", "Param"))
            assert PARAMETERS[function.text] == {name_of(one) for one in parameters}
        if kind in WORDS:
            assert element.text in WORDS[kind]
        if kind in LIMITS:
            assert LIMITS[kind][0] <= float(element.text) <= LIMITS[kind][1]
    assert set(required) <= found
    for index in ("index", "actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex"):
        assert text_of(whole, index) == [str(number) for number in range(len(stations(folder)))]
    assert all(-180 <= int(one) <= 180 for one in text_of(whole, "waypointHeadingAngle"))


def test_wpml_goes_up_to_the_flight_and_home_above_it(folder):
    above = np.array([one.position[2] for one in stations(folder)]) - 30.0
    mission = mission_of(folder, "waylines.wpml")
    assert float(text_of(mission, "takeOffSecurityHeight")[0]) == pytest.approx(above.min(), abs=1e-3)
    assert float(text_of(mission, "globalRTHHeight")[0]) == pytest.approx(above.max(), abs=1e-3)
    template = mission_of(folder, "template.kml")
    assert np.allclose([float(one) for one in text_of(template, "height")], above, atol=1e-3)


def test_the_gimbal_is_turned_where_the_view_changes(folder):
    tilted = [abs(one.angles[0]) + abs(one.angles[1]) > 0.1 for one in stations(folder)]
    assert 0 < sum(tilted) < len(tilted)
    expected = [-70.0 if one else -90.0 for one in tilted]
    assert np.allclose([float(one) for one in text_of(mission_of(folder, "waylines.wpml"), "gimbalPitchRotateAngle")],
                       expected, atol=0.01)  # fmt: skip
    pitch, found = None, []
    for item in json.loads(written(folder, "qgc", "m.plan"))["mission"]["items"]:
        pitch = item["params"][0] if item["command"] == 205 else pitch
        if item["command"] == 203:
            found.append(pitch)
    assert np.allclose(found, expected, atol=0.01)


def rings(folder: Path, **changed: str) -> Path:
    usual = {"kind": '"rings"', "centre": "[562000.0, 5934000.0, 40.0]", "size": "[10.0, 10.0, 8.0]", "pixel": "",
             "corners": "", "position_error": ""}  # fmt: skip
    made = project(folder, **usual, **changed)
    assert orip(made, "plan", "make").code == 0
    return made


def test_level_views_round_an_object_head_for_it(tmp_path):
    made = rings(tmp_path / "p", elevations="[0.0, 40.0]", stations="4", rolls="[0.0]")
    places = np.array([one.position for one in stations(made)])
    to_centre = np.array([562000.0, 5934000.0]) - places[:, :2]
    expected = np.degrees(np.arctan2(to_centre[:, 0], to_centre[:, 1]))
    found = np.array([float(one) for one in text_of(mission_of(made, "waylines.wpml"), "waypointHeadingAngle")])
    # grid north is within a degree of true north there, headings are whole degrees
    assert max(abs(math.remainder(one, 360.0)) for one in found - expected) < 1.6
    pitch = [float(one) for one in text_of(mission_of(made, "template.kml"), "gimbalPitchAngle")]
    assert np.allclose(pitch, [0.0] * 4 + [-40.0] * 4, atol=0.01)


@pytest.mark.parametrize("form", ["qgc", "dji", "litchi"])
def test_photos_that_no_drone_takes_are_refused(tmp_path, form):
    made = rings(tmp_path / "p", elevations="[40.0]", stations="4", rolls="[0.0, 90.0]")
    refused = orip(made, "plan", "export", form, "m.bin")
    assert refused.code != 0
    assert "P0002 and 3 more" in refused.err
    assert not (made / "m.bin").exists()
    assert orip(made, "plan", "export", "csv", "m.csv").code == 0
