"""A problem of `against_peers.py` adjusted by the recipe of SciPy's cookbook; run by it in a process of its own.

    python scipy_peer.py problem.npz

`least_squares` with the sparsity pattern of the Jacobian, finite differences of two points, method "trf", x_scale "jac"
and ftol 1e-4, as in "Large-scale bundle adjustment in scipy" (N. Mayorov). Prints one line of JSON: CPU seconds of the
whole, and of an evaluation, which is a step, the residuals there and the Jacobian if the step is taken.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import NamedTuple

import numpy as np
import scipy
from scipy.optimize import least_squares
from scipy.sparse import csr_array, lil_array
from scipy.spatial.transform import Rotation

_CAMERA, _PHOTO = 5, 6


class Unknowns(NamedTuple):
    """Cameras (k, 5), photos (n, 6: rotation vector and translation) and points (p, 3)."""

    cameras: np.ndarray
    photos: np.ndarray
    points: np.ndarray


class Recipe:
    """Residuals of a problem and the pattern of their Jacobian; points that are constant are no unknowns."""

    def __init__(self, problem: dict[str, np.ndarray]) -> None:
        self.problem = problem
        turns = Rotation.from_matrix(problem["rotations"]).as_rotvec()
        self.start = Unknowns(problem["cameras"], np.hstack([turns, problem["translations"]]), problem["points"])
        self.free = np.setdiff1d(np.arange(len(problem["points"])), problem["constant"])
        # k1, k2 at a distance of 1, pixels: x_scale does the rest
        self.x0 = np.concatenate(
            [self.start.cameras.ravel(), self.start.photos.ravel(), self.start.points[self.free].ravel()]
        )

    def unknowns(self, x: np.ndarray) -> Unknowns:
        """Return the unknowns in a vector."""
        of_cameras, of_photos = self.start.cameras.size, self.start.photos.size
        points = self.start.points.copy()
        points[self.free] = x[of_cameras + of_photos :].reshape(-1, 3)
        cameras = x[:of_cameras].reshape(-1, _CAMERA)
        return Unknowns(cameras, x[of_cameras : of_cameras + of_photos].reshape(-1, _PHOTO), points)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return computed minus measured pixels."""
        now, photo = self.unknowns(x), self.problem["photo"]
        camera = now.cameras[self.problem["camera"][photo]]
        turned = rotate(now.points[self.problem["point"]], now.photos[photo, :3]) + now.photos[photo, 3:]
        at_one = turned[:, :2] / turned[:, 2:]
        r2 = np.sum(at_one**2, axis=1)
        distortion = 1.0 + camera[:, 3] * r2 + camera[:, 4] * r2**2
        pixels = camera[:, 1:3] + at_one * (distortion * camera[:, 0])[:, None]
        return np.asarray(pixels - self.problem["pixels"]).ravel()

    def sparsity(self) -> csr_array:
        """Return which residual depends on which unknown."""
        photo, point = self.problem["photo"], self.problem["point"]
        of_cameras, of_photos = self.start.cameras.size, self.start.photos.size
        pattern = lil_array((2 * len(photo), len(self.x0)), dtype=int)
        row = np.arange(len(photo))
        place = np.full(len(self.problem["points"]), -1)
        place[self.free] = np.arange(len(self.free))
        known = place[point] >= 0
        for component in range(2):
            for element in range(_CAMERA):
                pattern[2 * row + component, self.problem["camera"][photo] * _CAMERA + element] = 1
            for element in range(_PHOTO):
                pattern[2 * row + component, of_cameras + photo * _PHOTO + element] = 1
            for element in range(3):
                columns = of_cameras + of_photos + place[point[known]] * 3 + element
                pattern[2 * row[known] + component, columns] = 1
        return pattern.tocsr()


def rotate(points: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return points turned by rotation vectors (Rodrigues)."""
    angle = np.linalg.norm(turns, axis=1, keepdims=True)
    axis = np.divide(turns, angle, out=np.zeros_like(turns), where=angle > 0.0)
    along = np.sum(points * axis, axis=1, keepdims=True)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.asarray(cosine * points + sine * np.cross(axis, points) + along * (1.0 - cosine) * axis)


def main() -> None:
    """Adjust and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem")
    parser.add_argument("--evaluations", type=int, help="end after so many")
    given = parser.parse_args()
    recipe = Recipe(dict(np.load(given.problem)))
    pattern = recipe.sparsity()
    start = time.process_time()
    found = least_squares(
        recipe.residuals, recipe.x0, jac_sparsity=pattern, x_scale="jac", ftol=1e-4, method="trf",
        max_nfev=given.evaluations,
    )  # fmt: skip
    seconds = time.process_time() - start
    residual = recipe.residuals(recipe.x0)
    figures = {
        "seconds": seconds,
        "evaluation": seconds / found.nfev,
        "iterations": int(found.nfev),
        "start_cost": 0.5 * float(residual @ residual),
        "cost": float(found.cost),
        "version": scipy.__version__,
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
