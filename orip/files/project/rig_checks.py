"""Rules of the rigs and exposures of orip.toml: which cameras are on a rig, and which photos are of one exposure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from orip.files.project.checks import References
from orip.files.project.source import ProjectSource
from orip.files.project.tables import Fault
from orip.files.text.shown import shown_token
from orip.records.names import record_key
from orip.wording import counted


def check_rigs(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that a rig has two cameras at least, each defined and on one rig, once, and that errors have values."""
    taken: dict[str, str] = {}
    for rig in source.rigs:
        name = shown_token(rig.record.name)
        place = (*rig.place, "camera")
        if len(rig.record.cameras) < 2:
            message = f"rig '{name}' has one camera; a rig has two at least: give a [[rig.camera]] for each, or none"
            yield (place if rig.record.cameras else rig.place), message
        for index, mounting in enumerate(rig.record.cameras):
            camera, key = shown_token(mounting.name), record_key(mounting.name)
            for message in references.check("camera", mounting.name, f"rig '{name}'"):
                yield (*place, index, "name"), message
            if key in taken:
                where = "twice" if taken[key] == name else f"on rig '{taken[key]}' too"
                yield (*place, index, "name"), f"camera '{camera}' of rig '{name}' is {where}; leave it on one, once"
            taken.setdefault(key, name)
            for what in ("offset", "rotation"):
                is_given = getattr(mounting, what) is not None or index == 0
                if getattr(mounting, f"{what}_error") is not None and not is_given:
                    text = f"camera '{camera}' of rig '{name}' has {what}_error without {what}; give both, or neither"
                    yield (*place, index, f"{what}_error"), text


def check_exposures(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that the photos of an exposure are defined, of different cameras of one rig, and of no other exposure.

    A camera on no rig is one fault, whatever the number of its photos.
    """
    rig_of = _rigs_of_cameras(source)
    taken: dict[str, str] = {}
    alone: dict[str, list[tuple[tuple[str | int, ...], str]]] = {}
    for exposure in source.exposures:
        where = f"exposure '{shown_token(exposure.record.name)}'"
        of_rigs: list[tuple[str, str, str]] = []
        if not exposure.record.photos:
            yield (*exposure.place, "photos"), f"{where} has no photo; name those of its instant, or remove it"
        for index, photo in enumerate(exposure.record.photos):
            place, shown = (*exposure.place, "photos", index), f"photo '{shown_token(photo)}' of {where}"
            yield from ((place, message) for message in references.check("photo", photo, where))
            if record_key(photo) in taken:
                again = "comes twice" if taken[record_key(photo)] == where else f"is of {taken[record_key(photo)]} too"
                yield place, f"{shown} {again}; leave it in one, once"
                continue
            taken[record_key(photo)] = where
            located = references.photos.get(record_key(photo))
            if located is None:
                continue
            camera = located.record.camera
            rig = rig_of.get(record_key(camera))
            if rig is None:
                alone.setdefault(camera, []).append((place, shown))
            else:
                yield from ((place, f"{shown} {fault}") for fault in _misfits(of_rigs, rig, camera))
                of_rigs.append((rig, camera, photo))
    for camera, photos in alone.items():
        (place, shown), others = photos[0], len(photos) - 1
        more = f", as {counted(others, 'other photo')}" if others else ""
        text = f"{shown} is of camera '{shown_token(camera)}', which is on no rig{more}; add the camera to a [[rig]]"
        yield place, f"{text}, or take {'them' if others else 'the photo'} out of the exposure{'s' if others else ''}"


def _misfits(before: Sequence[tuple[str, str, str]], rig: str, camera: str) -> Iterator[str]:
    """Yield what is wrong with a photo after others of its exposure, given as rig, camera and photo."""
    for other, _, photo in before[:1]:
        if record_key(other) != record_key(rig):
            others = f"'{shown_token(photo)}' of rig '{shown_token(other)}'"
            yield f"is of rig '{shown_token(rig)}', {others}; give an exposure the photos of one rig"
    for _, of, photo in before:
        if record_key(of) == record_key(camera):
            text = f"is of camera '{shown_token(camera)}' as '{shown_token(photo)}' is"
            yield f"{text}; a camera has one photo in an exposure"


def _rigs_of_cameras(source: ProjectSource) -> dict[str, str]:
    """Return the rig of each camera on one, also of those that photos have in its place in a bundle."""
    found: dict[str, str] = {}
    for rig in source.rigs:
        for mounting in rig.record.cameras:
            found.setdefault(record_key(mounting.name), rig.record.name)
    for bundle in source.bundles:
        for name, other in bundle.record.cameras:
            if record_key(name) in found:
                found.setdefault(record_key(other), found[record_key(name)])
    return found
