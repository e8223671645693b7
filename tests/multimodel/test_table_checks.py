"""The cross checks of a drive table: each fault has its code and names what it is about."""

from __future__ import annotations

import numpy as np
import pytest
from cli.command_line import orip
from hypothesis import given, settings
from hypothesis import strategies as st
from support.drive_tables import LEVEL, LIMITS, cameras, parameter_set, vertical_block

from orip.multimodel.processor import Loaded, load, table_faults
from orip.records.drive_table import DriveCode, DriveModel, DriveTemplate
from orip.structs import replace

TABLE = vertical_block()
(CAMERA,) = TABLE.cameras
LARGE = 1e300


def changed(kind, index, **fields):
    records = list(getattr(TABLE, kind))
    records[index] = replace(records[index], **fields)
    return replace(TABLE, **{kind: tuple(records)})


def lens(**coefficients):
    names = ("C", "DX", "DY", "A1", "A3", "A5", "A7", "A9", "P1", "P2", "B1", "B2")
    values = dict(zip(names, CAMERA.parameters, strict=True)) | coefficients
    return changed("cameras", 0, parameters=tuple(values[name] for name in names))


def tilted_by(angle):
    """Return a matrix that is off by an angle in one column."""
    return (1.0, angle, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def with_set(**fields):
    return changed("cameras", 0, additional=replace(parameter_set("EBNER"), **fields))


FAULTS = {
    "photo P1-1 refers to camera NONE": changed("photos", 0, camera="NONE"),
    "photo P1-1 refers to template NONE": changed("photos", 0, template="NONE"),
    "is on the UPPER stage, its template T2 on the other one": changed("photos", 0, template="T2"),
    "model M1-1 refers to photo NONE": changed("models", 0, left="NONE"),
    "model M1-2 refers to photo ELSE": changed("models", 1, right="ELSE"),
    "models M1-1 and M1-2 are both at row 1, column 1": changed("models", 1, column=1),
    "model M1-1 is at row 0, column 1": changed("models", 0, row=0),
    "NORMAL optics": changed("models", 1, optics="NORMAL"),
    "SWAPPED optics": changed("models", 0, optics="SWAPPED"),
    "camera CAM has C = 0": lens(C=0.0),
    "camera CAM has C = -1": lens(C=-1.0),
    "negative frame": changed("cameras", 0, frame=(-1.0, 24.0)),
    "affine transformation without an inverse": changed("photos", 0, affine=(1.0, 2.0, 4.0, 1.0, 1.0, 2.0)),
    "photo P1-2 has an affine": changed("photos", 1, affine=(0.0,) * 6),
    "not orthonormal, by 2.0e-09": changed("photos", 0, rotation=tilted_by(2e-9)),
    "photo P1-1 has a rotation matrix that is a mirror": changed("photos", 0, rotation=(*LEVEL[:8], -1.0)),
    "not orthonormal": changed("photos", 0, rotation=(LARGE,) * 9),
    "not monotone over the frame": lens(A3=-1.0 / (3.0 * 15.0**2)),
    "a distortion that is not monotone": lens(A1=-1.0),
    "that is not monotone": lens(A7=LARGE),
    "camera CAM has a distortion": lens(B1=-1.5),
    "with the base 0": with_set(base=0.0),
    "has 11 parameters of 12": with_set(values=(0.0,) * 11),
    "has a distortion": with_set(values=(1.0,) * 12),
    "UPPER stage has no area": replace(TABLE, upper=replace(LIMITS, x_min=240.0)),
    "LOWER stage has no area": replace(TABLE, lower=replace(LIMITS, y_max=-1.0)),
    "least count 0": replace(TABLE, lower=replace(LIMITS, least_count=0.0)),
    "too far for its least count": replace(TABLE, lower=replace(LIMITS, x_max=1e308)),
    "no base across": changed("photos", 1, centre=TABLE.photos[0].centre),
    "model M1-1 has no base": changed("photos", 1, centre=(0.0, 0.0, 150.0)),
    "there is no model": replace(TABLE, models=()),
    "model M1-1 is there twice": changed("models", 1, name="M1-1"),
    "photo P1-1 is there twice": changed("photos", 1, name="P1-1"),
    "camera CAM is there twice": replace(TABLE, cameras=TABLE.cameras * 2),
    "template T1 is there twice": replace(TABLE, templates=(*TABLE.templates, DriveTemplate("T1", "UPPER"))),
    "'m1-1' is not in upper case": changed("models", 0, name="m1-1"),
    "'M 1' has a blank": changed("models", 0, name="M 1"),
    "'MÄ' has a letter that is not ASCII": changed("models", 0, name="MÄ"),
    "block: 'main' is not in upper case": replace(TABLE, block="main"),
    "block: an empty name": replace(TABLE, block=""),
}


@pytest.mark.parametrize("text", FAULTS)
def test_each_fault_is_found(text):
    faults = table_faults(FAULTS[text])
    assert {fault.code for fault in faults} == {DriveCode.TABLE_INCONSISTENT}
    assert any(text in fault.text for fault in faults), faults
    assert load(FAULTS[text]) == faults


def test_both_photos_on_one_stage():
    model = DriveModel("M1-1", 1, 1, "P1-1", "P1-3", "NORMAL")
    (fault,) = table_faults(replace(TABLE, models=(model,)))
    assert fault.code == DriveCode.ONE_STAGE
    assert fault.text == "model M1-1: photos P1-1 and P1-3 are both on the UPPER stage"


@pytest.mark.parametrize(
    "table",
    [
        TABLE,
        vertical_block(tilted=True),
        changed("photos", 0, rotation=tilted_by(9e-10)),
        # the curve turns at 15.7 mm, the corner of the frame is at 15.6 mm
        lens(A3=-1.0 / (3.0 * 15.7**2)),
        changed("cameras", 0, frame=(0.0, 0.0)),
        changed("photos", 0, affine=(0.0, 1280.0, 0.0, 0.0, 0.0, -1024.0)),
        *(vertical_block(camera=camera) for camera in cameras().values()),
    ],
)
def test_nothing_is_wrong(table):
    assert table_faults(table) == ()
    assert isinstance(load(table), Loaded)


def test_all_faults_are_told_at_once():
    table = replace(lens(C=0.0), block="", models=TABLE.models * 2)
    texts = " ".join(fault.text for fault in table_faults(table))
    assert "C = 0" in texts
    assert "block" in texts
    assert texts.count("is there twice") == len(TABLE.models)


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1e160, 1e300])
def test_numbers_of_any_size_can_be_loaded(size):
    for table in (lens(C=size), changed("cameras", 0, frame=(size, size)), lens(A3=size), lens(P1=size), lens(DX=size)):
        assert load(table)
    for kind, field, count in (("photos", "affine", 6), ("photos", "centre", 3)):
        assert load(changed(kind, 0, **{field: tuple(size * np.arange(1.0, count + 1.0))}))


any_number = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.tuples(*[any_number] * 12), st.tuples(any_number, any_number), st.tuples(*[any_number] * 9),
    st.tuples(*[any_number] * 6), st.tuples(any_number, any_number, any_number), st.sampled_from(["ideal", "measured"]),
    st.sampled_from(["perspective", "equidistant"]),
)  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_any_numbers_are_either_refused_or_can_be_driven_with(
    parameters, frame, rotation, affine, centre, form, projection
):
    camera = replace(CAMERA, parameters=parameters, frame=frame, distortion_at=form, projection=projection)
    first = replace(TABLE.photos[0], rotation=rotation, affine=affine, centre=centre)
    second = replace(TABLE.photos[1], affine=affine, centre=centre)
    for table in (
        replace(TABLE, cameras=(camera,)),
        replace(TABLE, photos=(first, *TABLE.photos[1:])),
        replace(TABLE, photos=(TABLE.photos[0], second, *TABLE.photos[2:])),
        replace(TABLE, start=centre),
    ):
        found = load(table)
        if not isinstance(found, Loaded):
            assert all(np.isfinite(fault.code) and fault.text for fault in found)


@pytest.mark.long
def test_a_camera_with_a_readout_is_driven_to_its_middle_row_as_a_warning_says(tmp_path):
    assert orip(tmp_path, "init", "--sample", "drone_rtk", "drone").code == 0
    folder = tmp_path / "drone"
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    (folder / "orip.toml").write_text(text.replace("\nc = ", "\nreadout = 0.02\nc = ", 1), encoding="utf-8")
    assert orip(folder, "run").code == 0
    said = " ".join(orip(folder, "drive", "table").told.split())
    assert "camera ZENMUSE: has a readout of 0.02 s, which a drive table does not hold" in said
    assert "px at most" in said
