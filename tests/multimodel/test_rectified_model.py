"""Rectified models of cameras of every kind: rows in common, parallaxes of depths, and movements as they are seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.drive_tables import BASE, cameras, loaded, vertical_block

from orip.geometry.plane import PlaneTransformation
from orip.multimodel.rectified_model import ImageOnPlate, rectified_model
from orip.multimodel.stereo_processor import StereoPhoto, StereoProcessor
from orip.records.ground import PLAIN
from orip.structs import replace

CAMERAS = cameras()
TO_PLATE = PlaneTransformation(np.array([[0.01, 0.0], [0.0, -0.01]]), np.array([3.0, 90.0]))


def image_on(photo) -> ImageOnPlate:
    """Return an image that covers the frame of a photo, in pixels of 0.01 mm."""
    corners = np.array([photo.plate_of_photo(x, y) for x in (-10.0, 10.0) for y in (-12.0, 12.0)])
    logs = TO_PLATE.inverse().apply(corners)
    return ImageOnPlate(TO_PLATE, (*logs.min(axis=0).tolist(), *logs.max(axis=0).tolist()))


def points_below(model, random, count=200) -> np.ndarray:
    middle = np.mean([photo.centre for photo in model.photos], axis=0)
    return np.column_stack([middle[:2] + random.uniform(-8.0, 8.0, (count, 2)), random.uniform(-15.0, 15.0, count)])


@pytest.mark.parametrize("name", CAMERAS)
def test_points_of_the_object_are_in_one_row_and_have_the_parallax_of_their_depth(name: str) -> None:
    block, _ = loaded(vertical_block(camera=CAMERAS[name], tilted=True))
    random = np.random.default_rng(4)
    for model in block.models:
        pair = rectified_model(model, tuple(image_on(photo) for photo in model.photos))
        xyz = points_below(model, random)
        left, right = (pair.places(side, xyz) for side in (0, 1))
        assert np.abs(left[:, 1] - right[:, 1]).max() < 1e-7
        depth = -np.array(model.model_of_object(*xyz.T))[2]
        base = np.linalg.norm(np.subtract(model.photos[1].centre, model.photos[0].centre))
        apart = (left[:, 0] - right[:, 0]) * pair.pitch + pair.first[0] - pair.first[1]
        assert np.abs(apart - pair.c * base / depth).max() < 1e-9
        for side, places in enumerate((left, right)):
            # by the loop equations of the photo: through its distortion and its place on the stage
            plates = model.photos[side].plate_places(xyz).plate
            assert np.abs(pair.plates(side, places) - plates).max() < 1e-9
            assert np.abs(pair.logs_of(side, places) - TO_PLATE.inverse().apply(plates)).max() < 1e-7
            assert np.abs(pair.place(side, tuple(plates[0])) - places[0]).max() < 1e-6


def test_rows_apart_are_the_parallax_that_the_plate_processor_reads() -> None:
    block, _ = loaded(vertical_block(camera=CAMERAS["measured"], tilted=True))
    model, random = block.models[2], np.random.default_rng(8)
    pair = rectified_model(model, tuple(image_on(photo) for photo in model.photos))
    for xyz in points_below(model, random, 30).tolist():
        left, right = (photo.plate_place(*xyz).plate for photo in model.photos)
        moved = right[0] + 0.03, right[1] - 0.05
        upper, lower = (moved, left) if model.swapped else (left, moved)
        rows = pair.place(0, left)[1] - pair.place(1, moved)[1]
        # rows run against y
        assert model.object_place(upper, lower).y_parallax == pytest.approx(-rows * pair.pitch, abs=1e-9)


@pytest.mark.parametrize("turn", [0.0, 90.0])
@pytest.mark.parametrize("system", ["MODEL", "OBJECT"])
def test_movements_are_seen_as_asked_for_from_above_and_from_the_side(turn: float, system: str) -> None:
    """Turned by 90 degrees about X the photos look along Y: there MODEL guides, and OBJECT has its Z upwards."""
    table = vertical_block(rows=1)
    rotation = Rotation.from_euler("x", turn, degrees=True).as_matrix()
    photos = tuple(
        replace(
            photo,
            centre=tuple((rotation @ photo.centre).tolist()),
            rotation=tuple((rotation @ np.reshape(photo.rotation, (3, 3))).ravel().tolist()),
        )
        for photo in table.photos
    )
    found = loaded(replace(table, photos=photos, start=tuple((rotation @ table.start).tolist())))
    images = {photo.name: StereoPhoto(photo.name, image_on(photo), False) for photo in found.block.photos}
    processor = StereoProcessor(found, images, PLAIN, {}, ())
    assert processor.read().guide == ("MODEL" if turn else "OBJECT")
    processor.guide(system)
    processor.automatic(False)
    before, up = processor.read(), 0.0 if turn and system == "OBJECT" else 3.0
    processor.move(4.0, up, 0.0)
    after = processor.read()
    moved = np.subtract(after.places, before.places)
    assert moved == pytest.approx(np.array([[4.0, -up]] * 2), abs=1e-6)
    assert np.linalg.norm(np.subtract(after.xyz, before.xyz)) > 0.0
    processor.move(0.0, 0.0, 2.0)
    last = processor.read()
    # what is recorded, mm in the photos of films, is the same place again
    assert processor.place_of(processor.vertex()) == pytest.approx(last.xyz, abs=1e-9)
    assert np.abs(np.subtract(processor.vertex().right_xy, last.photos[1])).max() == 0.0
    apart = [one.places[0][0] - one.places[1][0] for one in (after, last)]
    if system == "OBJECT" and turn:  # Z runs up in the picture
        assert np.subtract(last.places, after.places) == pytest.approx(np.array([[0.0, -2.0]] * 2), abs=1e-6)
    else:
        assert apart[1] - apart[0] == pytest.approx(2.0, abs=1e-6)
        nearer = np.subtract(last.xyz, after.xyz) @ rotation[:, 2]
        assert nearer == pytest.approx(BASE * 50.0 * (1 / 10.0 - 1 / 10.02), rel=0.05)


def test_photos_side_by_side_have_no_rows_in_common() -> None:
    block, _ = loaded(vertical_block(rows=1))
    model = block.models[0]
    images = [image_on(photo) for photo in model.photos]
    x0, y0, x1, y1 = images[0].extent
    tall = y1 - y0
    cut = [ImageOnPlate(TO_PLATE, (x0, y0, x1, y0 + 0.3 * tall)), images[1]]
    other = images[1].extent
    cut[1] = ImageOnPlate(TO_PLATE, (other[0], other[1] + 0.6 * tall, other[2], other[3]))
    assert rectified_model(model, tuple(cut)).rows == 0
    assert rectified_model(model, tuple(images)).rows > 2000
