"""A block of a rig of three cameras as another program would have it, in a reading of its poses."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.records.exchanged import (
    ExchangedCamera,
    ExchangedExposure,
    ExchangedMounting,
    ExchangedPhoto,
    ExchangedPoints,
    ExchangedProject,
    ExchangedRays,
    ExchangedRig,
    PoseReading,
)
from orip.structs import replace

FOCAL, SIZE = 3000.0, (4000, 3000)
OFFSETS = np.array([[0.0, 0.0, 0.0], [0.5, 0.1, -0.05], [-0.4, 0.2, 0.1]])
TURNS = np.array([[0.0, 0.0, 0.0], [0.02, 0.15, 1.5], [-0.1, -0.12, -0.7]])
"""Mountings in the axes of orip: photo to rig, radians."""

TILTS = np.array([[0.1, -0.1, 0.2], [-0.15, 0.05, 1.9], [0.05, 0.2, -2.5], [0.2, 0.1, 2.8], [-0.1, -0.2, 0.9]])


def rig_project(reading: PoseReading, noise_px: float = 0.4) -> ExchangedProject:
    """Return five exposures, the last of which lacks the first camera, and a photo of that camera alone.

    The images are computed with scipy's rotations from X0 = E + R o and rotation = R M.
    """
    rng = np.random.default_rng(49)
    points = np.column_stack([rng.uniform(-40.0, 40.0, (80, 2)), rng.uniform(-8.0, 8.0, 80)])
    bodies = Rotation.from_euler("XYZ", TILTS).as_matrix()
    mountings = Rotation.from_euler("XYZ", TURNS).as_matrix()
    places = 100.0 * bodies[:, :, 2] + rng.uniform(-8.0, 8.0, (5, 3))
    taken = [(n, k) for n in range(5) for k in range(3) if (n, k) != (4, 0)]
    rotations = np.array([bodies[n] @ mountings[k] for n, k in taken] + [bodies[2]])
    centres = np.array([places[n] + bodies[n] @ OFFSETS[k] for n, k in taken] + [places[2] + [3.0, -4.0, 2.0]])
    cameras = np.array([k for _, k in taken] + [0])
    numbers, positions = exchanged_poses(rotations, centres, reading)
    names = [f"{'abc'[k]}/{n}.jpg" for n, k in taken] + ["a/9.jpg"]
    photos = tuple(
        ExchangedPhoto(name, int(cameras[n]), tuple(numbers[n].tolist()), tuple(positions[n].tolist()), key=n + 1)
        for n, name in enumerate(names)
    )
    photo, point = (a.ravel() for a in np.meshgrid(np.arange(len(photos)), np.arange(len(points)), indexing="ij"))
    u = np.einsum("nji,nj->ni", rotations[photo], points[point] - centres[photo])
    image = FOCAL * np.column_stack([-u[:, 0] / u[:, 2], u[:, 1] / u[:, 2]]) + np.array(SIZE) / 2.0
    seen = (u[:, 2] < 0.0) & (image > 0.0).all(axis=1) & (image < SIZE).all(axis=1)
    photo, point, image = photo[seen], point[seen], image[seen] + rng.normal(0.0, noise_px, (int(seen.sum()), 2))
    plane = {"fx": FOCAL, "fy": FOCAL, "cx": SIZE[0] / 2.0, "cy": SIZE[1] / 2.0}
    return ExchangedProject(
        "",
        tuple(ExchangedCamera(str(k + 1), *SIZE, "opencv", plane, "PINHOLE") for k in range(3)),
        photos,
        ExchangedPoints(tuple(str(n + 1) for n in range(len(points))), points, np.ones(len(points), dtype=np.bool_)),
        ExchangedRays(photo, point, image, np.full(len(photo), np.nan), np.ones(len(photo), dtype=np.bool_)),
        (reading,),
        rigs=(ExchangedRig("HEAD", tuple(map(ExchangedMounting, range(3)))),),
        exposures=tuple(
            ExchangedExposure(f"E{n}", tuple(row for row, one in enumerate(taken) if one[0] == n)) for n in range(5)
        ),
    )


def with_mountings(project: ExchangedProject) -> ExchangedProject:
    """Return a project whose rig has its mountings in the axes of a y that points down."""
    down = np.diag([1.0, -1.0, -1.0])
    mountings = Rotation.from_euler("XYZ", TURNS).as_matrix()
    rig = ExchangedRig(
        "HEAD",
        tuple(
            ExchangedMounting(
                k, tuple((down @ mountings[k] @ down).ravel().tolist()), tuple((down @ OFFSETS[k]).tolist())
            )
            for k in range(3)
        ),
    )
    return replace(project, rigs=(rig,))


def relative_poses(project: ExchangedProject) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return by exposures of the first camera and another one the latter's pose against the former, in orip's axes."""
    rotations, centres = orip_poses(project.photos, project.readings[0])
    found = {}
    for exposure in project.exposures:
        of = {project.photos[n].camera: n for n in exposure.photos}
        for camera, n in of.items():
            if camera and 0 in of:
                to_rig = rotations[of[0]].T
                found[f"{exposure.name} {camera}"] = (to_rig @ rotations[n], to_rig @ (centres[n] - centres[of[0]]))
    return found
