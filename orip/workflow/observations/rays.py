"""How many photos see each point, and which points an edit leaves with a single ray or none."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from orip.records.observations.measurement import Measured, PhotoObservations


class LeftAlone(Struct, frozen=True):
    """A point that had two rays or more before and has fewer now: its bundle, and its remaining photos."""

    bundle: str
    point: str
    photos: tuple[str, ...]


def photos_of_points(observations: PhotoObservations) -> dict[str, list[str]]:
    """Return the photos that see each point, disregarded measurements left out, by point in the order measured."""
    photos: dict[str, list[str]] = {name: [] for name in observations.points}
    rows = zip(observations.photos, observations.points, observations.disregarded.tolist(), strict=True)
    for photo, point, disregarded in rows:
        if not disregarded and photo not in photos[point]:
            photos[point].append(photo)
    return photos


def left_alone(before: Measured, after: Measured) -> tuple[LeftAlone, ...]:
    """Return the points that have a single ray or none after an edit, and had more before it."""
    found = []
    for key, observations in before.observations.items():
        now: Mapping[str, list[str]] = photos_of_points(after.observations[key]) if key in after.observations else {}
        for point, photos in photos_of_points(observations).items():
            left = now.get(point, [])
            if len(photos) >= 2 > len(left):
                found.append(LeftAlone(observations.bundle, point, tuple(left)))
    return tuple(found)
