"""Rules for the antennas of orip.toml: their cameras and their unknown parameters."""

from __future__ import annotations

from collections.abc import Iterator

from orip.files.project.checks import References
from orip.files.project.record_checks import parameter_names
from orip.files.project.source import ProjectSource
from orip.files.project.toml_faults import Fault
from orip.files.text.shown import shown_token
from orip.records.names import record_key
from orip.records.project.definition import ANTENNA_PARAMETERS

_EVERY = ""
"""Key of an antenna for all cameras."""


def check_antennas(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that the cameras of antennas are defined and have one each, and the names of unknown parameters."""
    taken: dict[str, str] = {}
    for antenna in source.antennas:
        record, where = antenna.record, f"antenna '{shown_token(antenna.record.name)}'"
        place = (*antenna.place, "cameras")
        for index, camera in enumerate(record.cameras):
            for message in references.check("camera", camera, where):
                yield (*place, index), message
        for key in map(record_key, record.cameras or (_EVERY,)):
            other = taken.get(key, taken.get(_EVERY) if key != _EVERY else next(iter(taken.values()), None))
            if other is not None:
                cameras = f"camera {key}" if key else "all cameras"
                yield place, f"{where} is for {cameras}, but antenna '{other}' too; give each its own cameras = [...]"
            taken.setdefault(key, shown_token(record.name))
        unknown = (*antenna.place, "unknown")
        yield from parameter_names(unknown, record.unknown, ANTENNA_PARAMETERS, f"unknown of {where}")
