"""The way back: from stored and photo coordinates to those of a measurement log, where an instrument would drive to.

A log has plate millimetres of the mounting in force, or pixels of a scan or digital frame.
"""

from __future__ import annotations

from collections.abc import Mapping

from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.interior.definitions import Definitions
from orip.interior.pixels import scan_transformation
from orip.records.names import record_key
from orip.records.project.photo import Photo


def stored_to_log(
    photo: Photo, definitions: Definitions, to_template: Mapping[str, PlaneTransformation]
) -> PlaneTransformation | None:
    """Return stored coordinates of a photo to those of a log; None where its template is not oriented.

    Parameters
    ----------
    photo : Photo
    definitions : Definitions
    to_template : mapping by `record_key`
        Plate to template millimetres of the templates that are oriented.
    """
    if definitions.camera_of(photo).sensor is not None:
        return IDENTITY
    template = definitions.template_of(photo)
    mounted = IDENTITY if template is None else to_template.get(record_key(template.name))
    if mounted is None:
        return None
    scan = photo.scan or (template.scan if template else None)
    to_plate = mounted.inverse()
    return to_plate if scan is None else scan_transformation(scan).inverse().after(to_plate)
