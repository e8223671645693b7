"""Rigs and exposures in orip.toml: read, written, and what is wrong with them in one sentence each."""

import tomllib

import pytest

from orip.files.project.reader import checked_tables
from orip.files.project.records import project_definition, project_document, project_text
from orip.records.rig import places_on_rigs

RECORDS = """
[project]
name = "A"
""" + "".join(
    f'[[camera]]\nname = "{name}"\nc = 50.0\nsensor = {{ columns = 100, rows = 100, width = 10.0, height = 10.0 }}\n'
    for name in ("LEFT", "RIGHT", "DOWN", "OTHER")
)
PHOTOS = "".join(
    f'[[photo]]\nname = "{number}{camera[0]}"\ncamera = "{camera}"\n'
    for number in (1, 2)
    for camera in ("LEFT", "RIGHT", "DOWN")
)
RIG = """
[[rig]]
name = "BAR"
[[rig.camera]]
name = "LEFT"
[[rig.camera]]
name = "RIGHT"
offset = [0.5, 0.0, 0.0]
offset_error = [0.01, 0.01, 0.01]
"""
EXPOSURES = '[[exposure]]\nname = "E1"\nphotos = ["1L", "1R"]\n[[exposure]]\nname = "E2"\nphotos = ["2R"]\n'
DOWN = '[[rig]]\nname = "TWO"\n[[rig.camera]]\nname = "DOWN"\n[[rig.camera]]\nname = "OTHER"\n'


def read(text):
    source, faults = checked_tables(tomllib.loads(RECORDS + PHOTOS + text), lambda _: 1)
    return source, [message for _, message in faults]


def test_rigs_are_read_and_written():
    source, faults = read(RIG + EXPOSURES)
    assert not faults
    definition = project_definition(source, source.project)
    (rig,) = definition.rigs.rigs
    assert [one.name for one in rig.cameras] == ["LEFT", "RIGHT"]
    assert rig.mountings[0].offset == rig.mountings[0].rotation == (0.0, 0.0, 0.0)
    assert rig.cameras[1].offset == (0.5, 0.0, 0.0)
    assert rig.cameras[1].rotation is None
    again, _ = checked_tables(tomllib.loads(project_text(project_document(definition))), lambda _: 1)
    assert project_definition(again, again.project).rigs == definition.rigs


def test_photos_have_places_on_rigs_by_the_names_of_their_cameras():
    source, _ = read(RIG + EXPOSURES)
    rigs = project_definition(source, source.project).rigs
    photos = [("1l", "left"), ("1R", "RIGHT_K1"), ("2R", "RIGHT"), ("2D", "DOWN")]
    found = places_on_rigs(rigs, photos, [("RIGHT", "RIGHT_K1")])
    assert found.exposures == ("E1", "E2")
    assert [camera.name for camera in found.mounted] == ["LEFT on BAR", "RIGHT on BAR"]
    assert [tuple(photo) for photo in found.photos] == [(0, 0, 0), (1, 0, 1), (2, 1, 1)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[rig]]\nname = "ONE"\n[[rig.camera]]\nname = "DOWN"\n', "rig 'ONE' has one camera; a rig has two at least"),
        ('[[rig]]\nname = "NONE"\n', "rig 'NONE' has no camera; it is required"),
        (RIG.replace("BAR", "TWICE"), "camera 'LEFT' of rig 'TWICE' is on rig 'BAR' too"),
        (DOWN.replace("OTHER", "down"), "camera 'down' of rig 'TWO' is twice"),
        (DOWN.replace("OTHER", "UP"), "rig 'TWO' names camera 'UP', which is not defined"),
        (
            DOWN + "rotation_error = [1.0, 1.0, 1.0]\n",
            "camera 'OTHER' of rig 'TWO' has rotation_error without rotation",
        ),
        (DOWN + "offset = [1.0, 2.0]\n", "offset of"),
        ('[[exposure]]\nname = "E3"\nphotos = ["2L", "9L"]\n', "exposure 'E3' names photo '9L', which is not defined"),
        ('[[exposure]]\nname = "E3"\nphotos = ["2D"]\n', "camera 'DOWN', which is on no rig"),
        ('[[exposure]]\nname = "E3"\nphotos = ["1L"]\n', "photo '1L' of exposure 'E3' is of exposure 'E1' too"),
        ('[[exposure]]\nname = "E3"\nphotos = ["2L", "2l"]\n', "photo '2l' of exposure 'E3' comes twice"),
        ('[[exposure]]\nname = "E3"\nphotos = []\n', "exposure 'E3' has no photo"),
        ('[[exposure]]\nname = "e2"\nphotos = ["2L"]\n', "only in case"),
        (DOWN + '[[exposure]]\nname = "E3"\nphotos = ["2L", "2D"]\n', "is of rig 'TWO', '2L' of rig 'BAR'"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(text, message):
    _, faults = read(RIG + EXPOSURES + text)
    assert any(message in fault for fault in faults), faults
    assert len(faults) == (2 if "TWICE" in text else 1), faults


def test_a_camera_on_no_rig_is_said_once():
    _, (fault,) = read(RIG + EXPOSURES.replace('"1R"]', '"1D"]').replace('"2R"]', '"2D"]'))
    assert "photo '1D' of exposure 'E1' is of camera 'DOWN', which is on no rig, as 1 other photo;" in fault


def test_two_photos_of_a_camera_are_not_of_one_exposure():
    _, (fault,) = read(RIG + EXPOSURES.replace('"1R"]', '"2L"]'))
    assert "is of camera 'LEFT' as '1L' is; a camera has one photo in an exposure" in fault


def test_an_exposure_of_all_photos_of_a_camera_is_said_once():
    more = "".join(f'[[photo]]\nname = "{number}L"\ncamera = "LEFT"\n' for number in range(3, 9))
    names = ", ".join(f'"{number}L"' for number in range(2, 9))
    _, (fault,) = read(more + RIG + EXPOSURES.replace('"2R"', names))
    assert "photo '3L' of exposure 'E2' is of camera 'LEFT' as '2L' is; a camera has one photo in an exposure" in fault
