"""Rigs of OPF: the sensors of captures with several cameras, and what is known beforehand of their mountings.

With the rotation R and the place T of the reference camera a secondary one has R · R_rel and T + R · T_rel, where R_rel
is Rx(alpha) Ry(beta) Rz(gamma), in axes to the right, down and to the front (opf-spec, auxiliary_objects.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orip.exchange.sources.collected import together
from orip.exchange.sources.json_tree import JsonValue
from orip.exchange.vision.opf_documents import Vector, identity, vector
from orip.geometry.rotation import rotation_from_angles
from orip.records.exchanged import ExchangedExposure, ExchangedMounting, ExchangedPhoto, ExchangedRig
from orip.units import METRES_PER_GROUND_UNIT, RADIANS_PER_DEGREE

_FRONT = np.diag([1.0, -1.0, -1.0])
"""From axes to the right, down and to the front to those of the poses: right, up and back."""


def read_rigs(
    captures: Sequence[JsonValue],
    sensors: Mapping[int, JsonValue],
    place_of_id: Mapping[int, int],
    photos: Sequence[ExchangedPhoto],
    unit: str,
) -> tuple[tuple[ExchangedRig, ...], tuple[ExchangedExposure, ...]]:
    """Return rigs and exposures; mountings are observed where the sensors say with which precision.

    Parameters
    ----------
    sensors : mapping of int to JsonValue
        Input sensors by the places of their cameras.
    place_of_id : mapping of int to int
        Places of photos by the identifiers of OPF's cameras.
    unit : str
        Of the ground.
    """
    taken: list[list[int]] = []
    references: set[int] = set()
    for capture in captures:
        cameras = capture.required("cameras")
        keys = [identity(one, "id") for one in cameras.items()] if cameras is not None else []
        taken.append([place_of_id[key] for key in keys if key is not None and key in place_of_id])
        first = place_of_id.get(identity(capture, "reference_camera_id") or -1)
        if first is not None and len(taken[-1]) > 1:
            references.add(photos[first].camera)
    bodies = together([[photos[n].camera for n in one] for one in taken])
    on_rigs = {camera for body in bodies for camera in body}
    rigs = tuple(
        ExchangedRig(
            f"RIG{number}",
            tuple(
                _mounting(camera, None if n == 0 else sensors.get(camera), unit)
                for n, camera in enumerate(sorted(body, key=lambda one: one not in references))
            ),
        )
        for number, body in enumerate(bodies, start=1)
    )
    exposures = tuple(
        ExchangedExposure(f"E{number}", tuple(n for n in members if photos[n].camera in on_rigs))
        for number, members in enumerate(taken, start=1)
        if any(photos[n].camera in on_rigs for n in members)
    )
    return rigs, exposures


def _mounting(camera: int, sensor: JsonValue | None, unit: str) -> ExchangedMounting:
    relatives = None if sensor is None else sensor.get("rig_relatives")
    metres = METRES_PER_GROUND_UNIT.get(unit)
    if relatives is None or metres is None:
        return ExchangedMounting(camera)
    translation, rotation = relatives.required("translation"), relatives.required("rotation")
    if translation is None or rotation is None:
        return ExchangedMounting(camera)
    values, deviations = vector(translation, "values_m"), vector(translation, "sigmas_m")
    angles, turns = vector(rotation, "angles_deg"), vector(rotation, "sigmas_deg")
    if values is None or deviations is None or angles is None or turns is None:
        return ExchangedMounting(camera)
    turned = _FRONT @ rotation_from_angles(np.array([angles]) * RADIANS_PER_DEGREE)[0] @ _FRONT
    return ExchangedMounting(
        camera,
        tuple(turned.ravel().tolist()),
        tuple((_FRONT @ np.array(values) / metres).tolist()),
        rotation_error=_errors(turns, 1.0),
        offset_error=_errors(deviations, 1.0 / metres),
    )


def _errors(deviations: Vector, factor: float) -> Vector | None:
    x, y, z = (value * factor for value in deviations)
    return (x, y, z) if min(x, y, z) > 0.0 else None
