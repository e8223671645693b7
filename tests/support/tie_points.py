"""Which points of a scene are measured in which photos, and whether they hold the block together."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from support.block_scenes import Scene

_MODEL_POINTS = 6
"""A relative orientation or a resection needs five or four; with one more a wrong solution shows."""

_JOINT_POINTS = 4
"""Systems are joined over three points; with one more a blunder shows."""

_MOST = 1.5
"""Of the points wanted in a photo; neighbours' points come on top of its own."""


class TiePoints(Struct, frozen=True):
    """n measured photo points, sorted by photo: photo, place on the surface, ideal photo coordinates (mm)."""

    photo: np.ndarray
    place: np.ndarray
    xy: np.ndarray


def measured_points(
    scene: Scene, random: np.random.Generator, wanted: int, measured: float, *, von_gruber: bool
) -> TiePoints:
    """Choose about `wanted` points a photo, spread over it; of the rays that there are a part is measured.

    Parameters
    ----------
    scene : Scene
    random : Generator
    wanted : int
    measured : float
        Part of the rays that is measured, in full photos less; of each point two at the least.
    von_gruber : bool
        Points lie on a regular grid of the photo as far as may be, else anywhere.
    """
    seen = [scene.ideal(photo) for photo in range(len(scene.centres))]
    shown = np.array([sight[1] for sight in seen])
    rays = shown.sum(axis=0)
    chosen = np.zeros(len(scene.surface), dtype=bool)
    for photo in random.permutation(len(shown)):
        candidates = np.flatnonzero(shown[photo] & (rays >= 2))
        if len(candidates) >= _MODEL_POINTS:
            targets = _grid(random, wanted) if von_gruber else random.uniform(-0.46, 0.46, (wanted, 2))
            xy = seen[photo][0][candidates] / scene.frame
            chosen[candidates[_nearest(random, targets, xy, rays[candidates], chosen[candidates])]] = True
    possible = shown & chosen
    part = measured * np.minimum(1.0, _MOST * wanted / np.maximum(possible.sum(axis=1, keepdims=True), 1))
    kept = possible & (random.uniform(size=shown.shape) < part)
    for place in np.flatnonzero(chosen & (kept.sum(axis=0) < 2)):
        kept[random.permutation(np.flatnonzero(shown[:, place]))[:2], place] = True
    photo, place = np.nonzero(kept)
    xy = np.vstack([sight[0][row] for sight, row in zip(seen, kept, strict=True)])
    return TiePoints(photo, place, xy)


def _grid(random: np.random.Generator, wanted: int) -> np.ndarray:
    """Return about `wanted` places (k, 2) in units of the frame: three rows of three are those of von Gruber."""
    columns = max(3, round(np.sqrt(wanted)))
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, columns), np.linspace(-0.4, 0.4, max(2, round(wanted / columns))))
    return np.column_stack([x.ravel(), y.ravel()]) + 0.02 * random.normal(size=(x.size, 2))


def _nearest(
    random: np.random.Generator, targets: np.ndarray, xy: np.ndarray, rays: np.ndarray, chosen: np.ndarray
) -> np.ndarray:
    """Return candidates near targets that have no chosen point nearby: of the nearest four mostly that of most rays."""
    distance = np.linalg.norm(targets[:, None] - xy, axis=2)
    spacing = 1.0 / np.sqrt(len(targets))
    open_targets = distance[:, chosen].min(axis=1, initial=np.inf) > 0.4 * spacing
    near = np.argsort(distance[open_targets], axis=1)[:, :4]
    if not len(near):
        return np.array([], dtype=int)
    best = near[np.arange(len(near)), rays[near].argmax(axis=1)]
    return np.where(random.uniform(size=len(near)) < 0.7, best, near[:, 0])


def holds_together(scene: Scene, points: TiePoints) -> bool:
    """Whether models, joints and resections of well-spread points lead from any photo to all others.

    Photos are united to systems: two photos by a model of six points; two systems by four points that both determine;
    a photo and a system by six points that it determines, or by a model with one of its photos and two such points.
    """
    photos = len(scene.centres)
    table = np.zeros((photos, len(scene.surface)), dtype=bool)
    table[points.photo, points.place] = True
    used = table.any(axis=0)
    table = table[:, used]
    surface = scene.surface[used]
    xy = np.full((*table.shape, 2), np.nan)
    xy[points.photo, np.searchsorted(np.flatnonzero(used), points.place)] = points.xy / scene.frame.min()
    distance = np.median(np.linalg.norm(scene.surface[points.place] - scene.centres[points.photo], axis=1))
    photo_width = scene.frame.min() * distance / scene.principal_distance
    shared = table.astype(int) @ table.T.astype(int)
    left, right = np.nonzero(np.triu(shared, 1))
    order = np.argsort(-shared[left, right], kind="stable")
    system = np.arange(photos)
    growing = True
    while growing:
        growing = False
        for i, j in zip(left[order], right[order], strict=True):
            if system[i] != system[j] and _united(i, j, system, table, xy, surface / photo_width):
                system[system == system[j]] = system[i]
                growing = True
    return bool((system == system[0]).all())


def _united(i: int, j: int, system: np.ndarray, table: np.ndarray, xy: np.ndarray, surface: np.ndarray) -> bool:
    members = [np.flatnonzero(system == system[point]) for point in (i, j)]
    determined = [table[member].sum(axis=0) >= 2 for member in members]
    joint = determined[0] & determined[1]
    if joint.sum() >= _JOINT_POINTS and _spread(surface[joint]) > 0.03:
        return True
    common = table[i] & table[j]
    scaled = all(
        len(member) == 1 or (common & known).sum() >= 2 for member, known in zip(members, determined, strict=True)
    )
    if scaled and common.sum() >= _MODEL_POINTS and min(_spread(xy[i, common]), _spread(xy[j, common])) > 0.08:
        return True
    for photo, mine, others in ((i, members[0], determined[1]), (j, members[1], determined[0])):
        known = table[photo] & others
        if len(mine) == 1 and known.sum() >= _MODEL_POINTS and _spread(xy[photo, known]) > 0.08:
            return True
    return False


def _spread(coordinates: np.ndarray) -> float:
    """Return the standard deviation across the line that lies best in points."""
    values = np.linalg.svd(coordinates - coordinates.mean(axis=0), compute_uv=False)
    return float(values[1] / np.sqrt(len(coordinates)))
