"""The photos that a doubted group of observations is about: its strip of stations, or its camera."""

from __future__ import annotations

from collections.abc import Mapping

from orip.bundle.groups.words import group_name
from orip.records.names import record_key
from orip.records.results.group_test import GroupTest
from orip.report.report_input import ReportInput


def doubted_photos(given: ReportInput) -> Mapping[str, tuple[str, ...]]:
    """Return the names of the doubted groups by photo, for groups that have some of the photos and not all."""
    found: dict[str, list[str]] = {}
    for group in given.solution.groups:
        photos = _photos_of(given, group) if group.doubted else ()
        if len(photos) < len(given.solution.photos.names):
            for name in photos:
                found.setdefault(name, []).append(group_name(group))
    return {name: tuple(dict.fromkeys(groups)) for name, groups in found.items()}


def _photos_of(given: ReportInput, group: GroupTest) -> tuple[str, ...]:
    if group.kind in {"station", "attitude"}:
        strips = ((exposure.photo, exposure.strip) for exposure in given.solution.exposures)
        return tuple(photo for photo, strip in strips if group.of in {"", strip})
    if group.kind != "photo":
        return ()
    camera = record_key(group.of)
    return tuple(
        name
        for name in given.solution.photos.names
        if (photo := given.photos.get(record_key(name))) is not None and record_key(photo.camera) == camera
    )
