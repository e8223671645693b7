"""Blocks that two control points leave free to turn, and exposure stations hold."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import orip

STATIONS, C, PRECISION = 7, 51.4, 0.004


def strip(seed: int, control_error: float, station_error: float, points: int) -> tuple[orip.Block, np.ndarray]:
    """Return seven photos of a long lens in a row and their centres; two points and all centres are known."""
    random = np.random.default_rng(seed)
    centres = np.column_stack(
        [108.0 * np.arange(STATIONS), random.normal(0.0, 8.0, STATIONS), 385.0 + random.normal(0.0, 8.0, STATIONS)]
    )
    rotations = Rotation.from_euler("xyz", random.normal(0.0, 3.0, (STATIONS, 3)), degrees=True).as_matrix()
    ground = np.column_stack(
        [random.uniform(-190.0, 840.0, points), random.uniform(-80.0, 80.0, points), random.normal(0.0, 40.0, points)]
    )
    seen = np.einsum("npi,nij->npj", ground - centres[:, None], rotations)
    xy = -C * seen[..., :2] / seen[..., 2:] + random.normal(0.0, PRECISION, (STATIONS, points, 2))
    inside = (np.abs(xy) < [18.0, 12.0]).all(axis=2)
    inside &= inside.sum(axis=0) > 1
    photo, point = np.nonzero(inside)
    photos = [f"p{n}" for n in range(STATIONS)]
    first, last = np.flatnonzero(inside.any(axis=0))[[3, -4]]
    control = ground[[first, last]] + random.normal(0.0, control_error, (2, 3))
    block = orip.Block(
        [orip.Camera("C", c=C, frame=[36.0, 24.0], principal_point=[0.0, 0.0])],
        orip.Photos(photos, "C"),
        orip.PhotoPoints([photos[n] for n in photo], [f"t{n}" for n in point], xy[photo, point]),
        orip.ControlPoints([f"t{first}", f"t{last}"], control, control_error),
        stations=orip.Stations(photos, centres + random.normal(0.0, station_error, centres.shape), station_error),
        measurement_precision=PRECISION,
    )
    return block, centres


@pytest.mark.parametrize(
    ("control_error", "station_error", "points"), [(0.05, 0.28, 160), (0.14, 8.5, 200)], ids=["RTK", "navigation"]
)
@pytest.mark.parametrize("seed", range(4))
def test_the_stations_turn_the_block_about_the_line_of_the_control(
    seed: int, control_error: float, station_error: float, points: int
) -> None:
    block, centres = strip(seed, control_error, station_error, points)
    solution = block.adjust()
    assert solution.status == "converged"
    off = np.array([solution.photos[f"p{n}"].orientation[:3] for n in range(STATIONS)]) - centres
    sd = np.array([solution.photos[f"p{n}"].deviations[:3] for n in range(STATIONS)])
    assert (np.abs(off) < 5.0 * sd).all()
