"""A small flight to forecast, and flights of it simulated without orip's geometry."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from orip.bundle.additions.placing import planned_control
from orip.planning.designed import level
from orip.planning.forecast import Design, design_block, tie_points
from orip.planning.geometry import Terrain
from orip.planning.plan import plan_flight
from orip.records.block import Block
from orip.records.camera import Camera, Sensor
from orip.records.control import Control
from orip.records.definition import BundleDefinition, Precision
from orip.records.plan import PlanSettings
from orip.structs import replace

CAMERA = Camera(
    "P4",
    (8.8, 0.02, -0.01, 0.0, -2e-5, 4e-8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    sensor=Sensor(5472, 3648, 13.2, 8.8),
    unknown=("C", "DX", "DY", "A3", "A5"),
)
PIXEL = 13.2 / 5472
CONTROL_ERROR = 0.01
CORNERS = np.array([[0.0, 0.0], [240.0, 0.0], [240.0, 150.0], [0.0, 150.0]])


def settings(**changed: object) -> PlanSettings:
    usual = {
        "height": 80.0,
        "forward": 65.0,
        "side": 50.0,
        "direction": 90.0,
        "position_error": (0.015, 0.015, 0.03),
        "tie_points": 40,
        "control_error": 0.01,
    }
    return PlanSettings(**{**usual, **changed})


def rolling(places: np.ndarray) -> np.ndarray:
    return 5.0 * np.sin(places[:, 0] / 40.0) * np.cos(places[:, 1] / 30.0)


def design(
    wanted: PlanSettings, terrain: Terrain | None = None, camera: Camera = CAMERA, control: np.ndarray | None = None
) -> Design:
    terrain = terrain or level(0.0)
    stations = plan_flight(wanted, camera, CORNERS, terrain).stations
    points = tie_points(np.array([13.2, 8.8]), 8.8, stations, terrain, wanted.tie_points)
    given = () if control is None else planned_control([f"K{n}" for n in range(len(control))], control, 0.01)
    definition = BundleDefinition("B", Precision(0.3, "px"), start_down_weight=20)
    return Design(definition, camera, stations, points, Control(points=given))


def flown(block: Block, random: np.random.Generator) -> Block:
    """Return a block as it would be measured: all observations with their errors, starting values off."""
    camera = block.cameras[0].parameters
    points, photos = block.point_start, block.photo_orientation
    rotations = Rotation.from_euler("XYZ", photos[:, 3:]).as_matrix()
    seen = block.photo_points
    u = np.einsum("ni,nij->nj", points[seen.point] - photos[seen.photo, :3], rotations[seen.photo])
    ideal = -camera[0] * u[:, :2] / u[:, 2:]
    r2 = (ideal**2).sum(axis=1, keepdims=True)
    xy = np.array(camera[1:3]) + ideal * (1.0 + camera[4] * r2 + camera[5] * r2**2)
    xy = xy + seen.error * random.normal(size=xy.shape)
    stations = tuple(
        replace(one, position=tuple(np.array(one.position) + np.array(one.position_error) * random.normal(size=3)))
        for one in block.stations
    )
    control = tuple(
        replace(one, coordinates=tuple(np.array(one.coordinates) + np.array(one.errors) * random.normal(size=3)))
        for one in block.control_points
    )
    start = photos + random.normal(size=photos.shape) * [0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3]
    return replace(
        block,
        photo_orientation=start,
        point_start=points + 0.1 * random.normal(size=points.shape),
        photo_points=replace(seen, xy=xy),
        stations=stations,
        control_points=control,
    )


def planned(wanted: PlanSettings, **given: object) -> Block:
    return design_block(design(wanted, **given))


def azimuth(direction: np.ndarray) -> float:
    return math.degrees(math.atan2(direction[0], direction[1]))
