"""Rigs of a block from arrays."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.rig_blocks import ERROR, C, rig_block

import orip

MADE = rig_block("three", "api", points=120)


def given(**changes):
    block, points = MADE.block, MADE.block.photo_points
    names = np.array(block.point_names)
    found = {
        "cameras": [orip.Camera(name, c=C, frame=(36.0, 24.0)) for name in "ABC"],
        "photos": orip.Photos(
            [photo.name for photo in block.photos],
            [photo.camera for photo in block.photos],
            np.array([photo.orientation for photo in block.photos]),
        ),
        "photo_points": orip.PhotoPoints(
            [block.photos[n].name for n in points.photo], names[points.point].tolist(), points.xy
        ),
        "control_points": orip.ControlPoints(
            [one.name for one in block.control_points], [one.coordinates for one in block.control_points], 0.02
        ),
        "rigs": [{"name": "HEAD", "camera": [{"name": name} for name in "ABC"]}],
        "exposures": [{"name": one.name, "photos": list(one.photos)} for one in block.rigs.exposures],
        "measurement_precision": ERROR,
    }
    return found | changes


def test_a_rig_is_adjusted():
    alone, solution = (orip.Block(**given(**changes)).adjust() for changes in ({"rigs": [], "exposures": []}, {}))
    # 30 photos of 6 unknowns become 10 exposures and 2 mountings
    assert alone.unknowns - solution.unknowns == 6 * (30 - 12)
    assert solution.points.deviations.mean() < alone.points.deviations.mean()
    found = {(one.camera, one.name): one for one in solution.mountings}
    for row, camera in enumerate("ABC"):
        for axis, name in enumerate(("OX", "OY", "OZ")):
            one = found[camera, name]
            assert abs(one.value - MADE.offsets[row, axis]) <= 4.0 * (one.sd if camera != "A" else 0.0)
    assert len(solution.exposures) == 60


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rigs": {}}, "rigs: is {}; a list of dicts is needed"),
        ({"exposures": [3]}, r"exposures\[0\]: is 3; a dict is needed"),
        ({"rigs": [{"name": "R", "camera": [{"name": "A"}]}]}, r"rigs\[0\]: rig 'R' has one camera"),
        ({"exposures": [{"name": "E", "photos": ["1A", "9Z"]}]}, r"exposures\[0\]: .*photo '9Z'"),
    ],
)
def test_what_is_wrong_is_said(changes, message):
    with pytest.raises(orip.errors.InputError) as raised:
        orip.Block(**given(**changes))
    assert re.search(message, str(raised.value)), str(raised.value)
