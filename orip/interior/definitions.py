"""The records that a measurement log refers to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

from msgspec import Struct, field

from orip.errors import OrientationError
from orip.records.camera import Camera
from orip.records.definition import BundleDefinition
from orip.records.names import near_names, record_key
from orip.records.photo import Photo, Template, Temtick
from orip.structs import replace

Referred = TypeVar("Referred", Camera, Template, Temtick)


class Definitions(Struct, frozen=True):
    """The records that a log refers to, by `record_key` of their names.

    `bundles` are names alone; `settings` are those of bundles whose points may be measured again.
    """

    cameras: Mapping[str, Camera]
    temticks: Mapping[str, Temtick]
    templates: Mapping[str, Template]
    photos: Mapping[str, Photo]
    bundles: Mapping[str, str]
    settings: Mapping[str, BundleDefinition] = field(default_factory=dict)

    @property
    def averaged_bundles(self) -> frozenset[str]:
        """Return the bundles in which points that are measured again are averaged."""
        return frozenset(key for key, bundle in self.settings.items() if bundle.repeated_points == "mean")

    @property
    def bundles_with_repetitions(self) -> frozenset[str]:
        """Return the bundles in which every measurement of a point in a photo is an observation of its own."""
        return frozenset(key for key, bundle in self.settings.items() if bundle.repeated_points == "both")

    @property
    def sources_of_points(self) -> Mapping[str, str]:
        """Return the bundles that have the photo points of another one, with that one."""
        return {key: record_key(bundle.points_of) for key, bundle in self.settings.items() if bundle.points_of}

    def camera_of(self, photo: Photo) -> Camera:
        """Return the camera of a photo.

        Raises
        ------
        OrientationError
            If there is none of that name.
        """
        return _referred_to(self.cameras, "camera", photo.camera, f"photo {photo.name}")

    def template_of(self, photo: Photo) -> Template | None:
        """Return the template that a photo is on, None for a photo off a template.

        Raises
        ------
        OrientationError
            If there is none of that name.
        """
        if photo.template is None:
            return None
        return _referred_to(self.templates, "template", photo.template, f"photo {photo.name}")

    def temtick_of(self, template: Template) -> Temtick:
        """Return the tick marks of a template.

        Raises
        ------
        OrientationError
            If there are none of that name.
        """
        return _referred_to(self.temticks, "temtick", template.temtick, f"template {template.name}")

    def with_cameras_of(self, bundle: BundleDefinition) -> Definitions:
        """Return the definitions with the cameras that photos have in a bundle."""
        if not bundle.cameras:
            return self
        others = {record_key(camera): other for camera, other in bundle.cameras}
        photos = {
            key: replace(photo, camera=others.get(record_key(photo.camera), photo.camera))
            for key, photo in self.photos.items()
        }
        return replace(self, photos=photos)

    def with_camera(self, camera: Camera) -> Definitions:
        """Return the definitions with one camera replaced."""
        return replace(self, cameras={**self.cameras, record_key(camera.name): camera})

    def with_temtick(self, temtick: Temtick) -> Definitions:
        """Return the definitions with the tick marks of one name replaced."""
        return replace(self, temticks={**self.temticks, record_key(temtick.name): temtick})


def unknown_record(what: str, name: str, known: Iterable[str]) -> str:
    """Say that a record is not defined, and which are."""
    correct = "correct the name, or define it in orip.toml and run 'orip init'"
    return f"{what} {name} is not defined; {near_names(name, known)} ({correct})"


def _referred_to(records: Mapping[str, Referred], kind: str, name: str, by: str) -> Referred:
    found = records.get(record_key(name))
    if found is None:
        message = f"{by}: {unknown_record(kind, name, (record.name for record in records.values()))}"
        raise OrientationError(message)
    return found
