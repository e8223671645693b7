"""Tie points of a project of Metashape: points, and their projections in each camera, as PLY files.

A vertex has the number of its track. Coordinates are those of the chunk, projections are pixels from the outer corner.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.exchange.metashape.chunk import ChunkReader
from orip.exchange.metashape.project_files import TieCloud
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.ply import Vertices, read_vertices
from orip.exchange.sources.xml_tree import XmlElement
from orip.wording import counted

_POINT, _PROJECTION = ("x", "y", "z", "id"), ("x", "y", "id")


def add_ties(
    cloud: TieCloud, chunk: ChunkReader, photos: Mapping[int, int], points: CollectedPoints, rays: CollectedRays
) -> list[str]:
    """Add the tie points that have coordinates, with their projections; return notes on what is left out.

    Parameters
    ----------
    cloud : TieCloud
    chunk : ChunkReader
        Takes coordinates to the ground.
    photos : mapping of int to int
        Places of the photos by the ids of their cameras.
    points, rays : CollectedPoints, CollectedRays
    """
    tracks, places = _added_points(cloud, chunk, points)
    lost = 0
    for element in cloud.element.all("projections"):
        key = cloud.fields.attribute_whole(element, "camera_id")
        vertices = _vertices(cloud, element, _PROJECTION)
        if vertices is None or key is None or key not in photos:
            continue
        track = vertices["id"].astype(np.int64)
        row = np.minimum(np.searchsorted(tracks, track), max(0, len(tracks) - 1))
        is_known = tracks[row] == track if len(tracks) else np.zeros(len(track), dtype=np.bool_)
        lost += int((~is_known).sum())
        image = _coordinates(vertices, ("x", "y"))[is_known]
        rays.extend(np.full(len(image), photos[key], dtype=np.int64), places[row[is_known]], image)
    return [f"{counted(lost, 'projection')} of tracks without a point, left out."] if lost else []


def _added_points(cloud: TieCloud, chunk: ChunkReader, points: CollectedPoints) -> tuple[IntArray, IntArray]:
    """Add points; return their tracks in ascending order, and their places."""
    tracks, places = [], []
    for element in cloud.element.all("points"):
        vertices = _vertices(cloud, element, _POINT)
        if vertices is None:
            continue
        transform = chunk.transform(element.attributes.get("component_id"))
        with np.errstate(all="ignore"):  # coordinates of a damaged file may be of any size; those not finite are lost
            ground = transform.points(_coordinates(vertices, _POINT[:3]))
        for track, place in zip(vertices["id"].tolist(), _valid(ground), strict=True):
            tracks.append(int(track))
            places.append(points.add(str(int(track)), place, is_track=True))
    found, first = np.unique(np.array(tracks, dtype=np.int64), return_index=True)
    return found, np.array(places, dtype=np.int64)[first]


def _valid(ground: FloatArray) -> Iterator[tuple[float, ...] | None]:
    for place in ground.tolist():
        yield tuple(place) if all(value - value == 0.0 for value in place) else None  # neither infinite nor NaN


def _coordinates(vertices: Vertices, names: tuple[str, ...]) -> FloatArray:
    return np.stack([vertices[name].astype(np.float64) for name in names], axis=1)


def _vertices(cloud: TieCloud, element: XmlElement, needed: tuple[str, ...]) -> Vertices | None:
    name = cloud.fields.attribute(element, "path")
    data = None if name is None else cloud.members.read(name)
    return None if data is None or name is None else read_vertices(data, needed, cloud.members.of_member(name))
