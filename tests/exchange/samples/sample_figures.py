"""Figures of genuine projects of other programs, by names: counts, residuals, orientations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from exchange.imported import reprojected
from exchange.test_micmac import beside_pairs, verified
from exchange.test_vision import ideal_residuals

from orip.exchange.conversion.lens_table import image_of_directions
from orip.exchange.conversion.poses import orip_poses
from orip.geometry.rotation import angles_from_rotation
from orip.records.control import Station
from orip.records.epochs import Epochs
from orip.records.exchanged import ExchangedCamera, ExchangedProject
from orip.stations.imported import read_epochs

Figures = Mapping[str, float]
FiguresOf = Callable[[ExchangedProject, Path], Figures]


def counts(project: ExchangedProject) -> dict[str, float]:
    return {
        "photos": len(project.photos), "points": len(project.points.names), "rays": len(project.rays.photo),
        "control": len(project.control),
    }  # fmt: skip


def orientation(project: ExchangedProject, name: str) -> dict[str, float]:
    """Return projection centre and angles (degrees) of a photo."""
    rotations, centres = orip_poses(project.photos, project.readings[0])
    place = next(n for n, photo in enumerate(project.photos) if photo.name == name)
    values = (*centres[place].tolist(), *np.degrees(angles_from_rotation(rotations[place])).tolist())
    return dict(zip(("X0", "Y0", "Z0", "omega", "phi", "kappa"), values, strict=True))


def of_colmap(project: ExchangedProject, _source: Path) -> Figures:
    found, _ = reprojected(project)
    parameters = project.cameras[0].parameters
    assert project.stated is not None
    # the mean of the file is that of six digits of each point, after the last global adjustment
    difference = abs(found.mean_of_points(project.rays.point) - project.stated.value)
    return counts(project) | {
        "f": parameters["fx"], "k": parameters["k1"], "rms": found.rms, "mean": found.mean,
        "stated": project.stated.value, "off the stated by less than 0.0055": float(difference < 0.0055),
    }  # fmt: skip


def of_nvm(project: ExchangedProject, _source: Path) -> Figures:
    lengths = ideal_residuals(project)
    return counts(project) | {"rms": float(np.sqrt(np.mean(lengths**2))), "median": float(np.median(lengths))}


def of_opensfm(project: ExchangedProject, _source: Path) -> Figures:
    found, _ = reprojected(project)
    of_tracks = project.points.is_track[project.rays.point]
    lengths = np.hypot(*found.residuals[of_tracks].T)
    rays = np.bincount(project.rays.point[of_tracks])
    parameters = project.cameras[0].parameters
    return orientation(project, "01.jpg") | {
        "photos": len(project.photos), "points": int(project.points.is_track.sum()), "rays": len(lengths),
        "with 2 rays": int((rays == 2).sum()), "with 3 rays": int((rays == 3).sum()),
        "focal": parameters["fx"] / 3264.0, "k1": parameters["k1"], "k2": parameters["k2"],
        "rms": float(np.sqrt(np.mean(lengths**2))), "mean": float(lengths.mean()), "largest": float(lengths.max()),
        "control": len(project.control), "rays of control and of a point by hand": int((~of_tracks).sum()),
        **{f"rays of {name}": _rays_of(project, name) for name in ("0", "1", "3")},
    }  # fmt: skip


def _rays_of(project: ExchangedProject, name: str) -> int:
    own = [n for n, point in enumerate(project.points.names) if point == name and not project.points.is_track[n]]
    return int(np.isin(project.rays.point, own).sum())


def of_micmac(project: ExchangedProject, source: Path) -> Figures:
    known = np.isfinite(project.points.coordinates).all(axis=1)
    found, _ = reprojected(project)
    lengths = np.hypot(*found.residuals.T)[known[project.rays.point]]
    return (
        counts(project)
        | orientation(project, "IMGP4167.JPG")
        | {
            "rays with ground": len(lengths),
            "rms": float(np.sqrt(np.mean(lengths**2))),
            "off its own pairs by less than 1e-12": float(verified(project, source) < 1e-12),
        }
    )


def of_micmac_cameras(project: ExchangedProject, source: Path) -> Figures:
    return {"photos": len(project.photos), "off by less than 2e-11": float(verified(project, source) < 2e-11)}


def of_mmvii(project: ExchangedProject, source: Path) -> Figures:
    """Return by how much a coordinate of photos differs from MicMac's own pairs at most, pixels."""
    given = source.parent / "Ori-Ground_mm3d"
    return counts(project) | {
        photo.name: float(np.abs(beside_pairs(project, given, n)).max()) for n, photo in enumerate(project.photos)
    }


def of_pix4d(project: ExchangedProject, source: Path) -> Figures:
    p = project.cameras[0].parameters
    rotations, centres = orip_poses(project.photos, project.readings[0])
    k = np.array([[p["fx"], 0, p["cx"]], [0, p["fy"], p["cy"]], [0, 0, 1.0]])
    to_camera = np.diag([1.0, -1.0, -1.0]) @ rotations[0].T
    words = (source / "example_pmatrix.txt").read_text().splitlines()[0].split()[1:]
    offset = np.array((source / "example_offset.xyz").read_text().split(), dtype=float)
    matrix = k @ np.column_stack([to_camera, -to_camera @ (centres[0] - offset)])
    position = (source / "example_calibrated_images_position.txt").read_text().splitlines()[0].split(",")[1:]
    return orientation(project, project.photos[0].name) | {
        "off pmatrix by less than 1e-6": float(np.abs(matrix.ravel() - np.array(words, dtype=float)).max() < 1e-6),
        "off position by less than 1e-6": float(np.abs(centres[0] - np.array(position, dtype=float)).max() < 1e-6),
    }


def of_ign(project: ExchangedProject, _source: Path) -> Figures:
    """Return sigmas of least squares of the photo coordinates with held photos, from 2 coordinates of each ray."""
    found, _ = reprojected(project)
    of_ties = np.array([project.points.names[point].startswith("MES_") for point in project.rays.point])
    squares = (found.residuals**2).sum(axis=1)
    ties, control = (len(np.unique(project.rays.point[rows])) for rows in (of_ties, ~of_ties))
    return {
        "photos": len(project.photos), "ties": ties, "rays of ties": int(of_ties.sum()),
        "control": control, "rays of control": int((~of_ties).sum()),
        "sigma of ties": float(np.sqrt(squares[of_ties].sum() / (2 * of_ties.sum() - 3 * ties))),
        "sigma of control": float(np.sqrt(squares[~of_ties].sum() / (2 * (~of_ties).sum() - 3 * control))),
    }  # fmt: skip


def of_metashape(project: ExchangedProject, _source: Path) -> Figures:
    return {"photos": len(project.photos), "k4": project.cameras[0].parameters["k4"]}


def of_epochs(found: Epochs) -> Figures:
    """Return the first epoch of a trajectory, and the numbers of epochs and of the lines of its file."""
    longitude, latitude, height = found.place[0].tolist()
    return {
        "records": len(found), "lines": int(found.line[-1]), "time": float(found.time[0]), "height": height,
        "latitude": float(np.degrees(latitude)), "longitude": float(np.degrees(longitude)),
        "latitude in radians": latitude, "longitude in radians": longitude,
        "sd north": float(np.sqrt(found.covariance[0, 1, 1])),
    }  # fmt: skip


def stations_of(found: Epochs) -> list[Station]:
    """Return epochs as exposure stations in longitude and latitude; those without deviations get 1."""
    deviation = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    deviation = np.where(np.isfinite(deviation), deviation, 1.0)
    places = np.column_stack([np.degrees(found.place[:, :2]), found.place[:, 2]])
    return [
        Station(f"P{n}", (x, y, z), (a, b, c))
        for n, ((x, y, z), (a, b, c)) in enumerate(zip(places.tolist(), deviation.tolist(), strict=True))
    ]


def stations_with_deviations(folder: Path, deviations: Path) -> list[Station]:
    """Return stations of a trajectory that stands still, with the genuine deviations of the first seconds."""
    records = np.zeros((3, 17))
    records[:, 0] = 536258.0 + np.arange(3)
    records[:, 1:4] = [0.568021, -2.041654, 107.715]
    (folder / "a.sbet").write_bytes(records.astype("<f8").tobytes())
    parsed = read_epochs(folder / "a.sbet", "a.sbet", deviations=deviations)
    assert parsed.complaints == ()
    return stations_of(parsed.value)


def pixels_beside_opencv(camera: ExchangedCamera, twin: Path) -> np.ndarray:
    """Return by how much a lens images directions beside a calibration of OpenCV, pixels (n, 2)."""
    text = twin.read_text()
    fx, _, cx, _, fy, cy, *_ = opencv_matrix(text, "Camera_Matrix")
    k1, k2, p1, p2, k3 = [*opencv_matrix(text, "Distortion_Coefficients"), 0.0][:5]
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.3, 0.3, 9), np.linspace(-0.2, 0.2, 9)))
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    u = fx * (x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x)) + cx
    v = fy * (y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y) + cy
    return image_of_directions(camera, np.column_stack([x, y])) - np.column_stack([u, v])


def opencv_matrix(text: str, name: str) -> list[float]:
    """Return the numbers of a matrix in a file of OpenCV."""
    matrix = text[text.index(f"<{name}") : text.index(f"</{name}")]
    return [float(word) for word in matrix[matrix.index("<data>") + 6 : matrix.index("</data>")].split()]
