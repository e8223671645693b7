"""A calibration of Agisoft (``Save camera calibration``, XML) as a project that has a camera alone."""

from __future__ import annotations

from pathlib import Path

from orip.exchange.metashape.sensors import read_lens_file
from orip.exchange.sources.collected import CollectedPoints, CollectedRays
from orip.exchange.sources.faults import Faults
from orip.files.text.regular_file import beginning
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedProject

_BEGINNING = 1000


def is_lens(source: Path) -> bool:
    """Return whether a file begins as a calibration does."""
    text = beginning(source, _BEGINNING) if source.suffix.lower() == ".xml" else ""
    return "<calibration>" in text and "<document" not in text and "<projection>" in text


def read_lens(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read the file of a calibration."""
    faults = Faults(shown)
    camera = read_lens_file(source, faults)
    if camera is None or faults.complaints:
        return Parsed(None, tuple(faults.complaints))
    points, rays = CollectedPoints().points(), CollectedRays().rays()
    notes = ("The file has a camera alone: add photos of it to orip.toml, and their measurements.",)
    return Parsed(
        ExchangedProject(camera.name, (camera,), (), points, rays, is_calibration=True, ground_unit="m", notes=notes)
    )
