"""Rigs and moving photos in drawings of the report: bodies of rigs, and the motion of each photo in pixels."""

from __future__ import annotations

import numpy as np
from rolling.rolling_flights import flown
from support.rig_blocks import rig_block

from orip.bundle.methods import Method, adjust_block
from orip.records.block import Block
from orip.records.names import record_key
from orip.report.drawings.block_view import block_view, rig_bodies
from orip.report.drawings.residual_vectors import vector_sheets
from orip.report.report_input import ReportInput


def report(block: Block) -> ReportInput:
    solution, _ = adjust_block(block, Method(), lambda _: None, lambda: False)
    cameras = {record_key(camera.name): camera for camera in block.cameras}
    photos = {record_key(photo.name): photo for photo in block.photos}
    return ReportInput(solution, (), block.definition, cameras, photos)


def test_a_body_joins_the_photos_of_an_exposure() -> None:
    found = report(rig_block("three", "report", points=120).block)
    solution, bodies = found.solution, rig_bodies(found.solution)
    centres = dict(zip(solution.photos.names, solution.photos.values[:, :3], strict=True))
    assert list(bodies) == [f"E{number} of rig HEAD" for number in range(1, 11)]
    for number, places in enumerate(bodies.values(), start=1):
        np.testing.assert_allclose(places[1:], [centres[f"{number}{camera}"] for camera in "ABC"], atol=1e-9)
        np.testing.assert_allclose(places[0], places[1], atol=1e-12)  # the first camera is in the origin
    view = block_view(found)
    assert [body["name"] for body in view["bodies"]] == list(bodies)
    assert set(view["photos"]["motions"]) == {""}


def test_photos_of_a_rolling_shutter_tell_their_motion() -> None:
    made = flown(5, 0.03, 10.0, given=0.03)
    found = report(made.block)
    (sheet,) = vector_sheets(found)
    motions = {one.photo: one.pixels for one in found.solution.motions}
    assert len(motions) == 18
    for name, drawing in sheet.photos:
        assert f"motion {motions[name]:.1f} px" in drawing
    said = block_view(found)["photos"]["motions"]
    assert said == [f"<br>motion {motions[name]:.1f} px" for name in found.solution.photos.names]
