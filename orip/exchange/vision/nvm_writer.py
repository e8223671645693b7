"""A project as VisualSFM's ``.nvm``: f and one coefficient at measured coordinates for each photo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from orip.errors import InputError
from orip.exchange.sources.tracks import places_in_photos, tracks
from orip.records.exchanged import ExchangedProject

NVM_TERMS = ("f", "cx", "cy", "k1")


def write_nvm(project: ExchangedProject, original: Path | None) -> Mapping[str, bytes]:  # noqa: ARG001  # new
    """Return one file.

    Raises
    ------
    InputError
        If the name of a photo has a quotation mark, which the format uses itself.
    """
    quoted = [photo.name for photo in project.photos if '"' in photo.name]
    if quoted:
        message = f"photo {quoted[0]}: NVM has quotation marks round names, so that none can be in them; rename it"
        raise InputError.single(message)
    return {"orip.nvm": "".join(_lines(project)).encode()}


def _lines(project: ExchangedProject) -> Iterator[str]:
    photos = [n for n, photo in enumerate(project.photos) if photo.rotation and photo.position]
    number = np.full(len(project.photos), -1)
    number[photos] = np.arange(len(photos))
    yield f"NVM_V3\n\n{len(photos)}\n"
    for photo in (project.photos[n] for n in photos):
        parameters = project.cameras[photo.camera].parameters
        focal = float(parameters["f"])
        name = f'"{photo.name}"' if photo.name.split() != [photo.name] else photo.name
        yield f"{name} {_row([focal, *photo.rotation, *photo.position, parameters.get('k1', 0.0) * focal**2])} 0\n"
    found = list(tracks(project))
    keys = places_in_photos(project)
    yield f"\n{len(found)}\n"
    for place, rows in found:
        seen = rows[number[project.rays.photo[rows]] >= 0].tolist()
        rays = "".join(
            f" {number[project.rays.photo[row]]} {keys[row]} {_row(project.rays.image[row].tolist())}" for row in seen
        )
        yield f"{_row(project.points.coordinates[place].tolist())} 255 255 255 {len(seen)}{rays}\n"
    yield "\n0\n"


def _row(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
