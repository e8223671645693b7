"""Images of a camera that moves while its rows are exposed, against those of a camera that stands where it then is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rolling_shutter import Motion, moving_image_with_partials


def moving(offset, rotation, velocity, rate, fraction, readout):
    count = len(offset)
    return moving_image_with_partials(
        offset, rotation, np.full(count, 8.0), np.zeros(count, dtype=bool), Motion(velocity, rate), fraction,
        np.full(count, readout),
    )  # fmt: skip


@pytest.mark.parametrize("readout", [0.008, 0.06, -0.03])
def test_each_row_is_imaged_from_where_the_camera_is_then(readout):
    random = np.random.default_rng(2)
    offset = random.uniform([-30.0, -20.0, -110.0], [30.0, 20.0, -90.0], (6, 3))
    rotation = Rotation.from_euler("XYZ", random.uniform(-0.1, 0.1, (6, 3)))
    velocity, rate = random.uniform(-15.0, 15.0, (6, 3)), random.uniform(-2.0, 2.0, (6, 3))
    fraction = random.uniform(-0.5, 0.5, 6)
    found = moving(offset, rotation.as_matrix(), velocity, rate, fraction, readout)
    for row, f in enumerate(fraction):
        then = Rotation.from_rotvec(rate[row] * readout * f) * rotation[row]
        u = then.inv().apply(offset[row] - velocity[row] * readout * f)
        np.testing.assert_allclose(found.image.xy[row], -8.0 * u[:2] / u[2], rtol=0.0, atol=1e-12)


def test_a_level_camera_over_level_ground_moves_its_image_by_the_speed_over_the_height():
    """10 m/s in 0.03 s from 100 m with C = 8 mm: 0.024 mm from the first row to the last one."""
    offset, velocity = np.tile([5.0, -3.0, -100.0], (2, 1)), np.tile([10.0, 0.0, 0.0], (2, 1))
    level = np.tile(np.eye(3), (2, 1, 1))
    found = moving(offset, level, velocity, np.zeros((2, 3)), np.array([-0.5, 0.5]), 0.03)
    np.testing.assert_allclose(found.image.xy[1] - found.image.xy[0], [-0.024, 0.0], atol=1e-15)


def test_a_global_shutter_gives_the_plain_perspective():
    random = np.random.default_rng(3)
    offset, fraction = random.uniform([-30.0, -20.0, -110.0], [30.0, 20.0, -90.0], (4, 3)), np.linspace(-0.5, 0.5, 4)
    level = np.tile(np.eye(3), (4, 1, 1))
    found = moving(offset, level, np.full((4, 3), 15.0), np.full((4, 3), 2.0), fraction, 0.0)
    plain = perspective_with_partials(offset, level, np.full(4, 8.0))
    for one, other in zip(found.image, plain, strict=True):
        np.testing.assert_array_equal(one, other)
    assert not found.by_velocity.any()
    assert not found.by_rate.any()
