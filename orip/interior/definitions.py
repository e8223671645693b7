"""The records that a measurement log refers to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from orip.interior.known_names import unknown_record
from orip.interior.orientation import OrientationError
from orip.model.camera import Camera
from orip.model.names import record_key
from orip.model.photo import Photo, Template, Temtick


@dataclass(frozen=True, slots=True)
class Definitions:
    """The records that a log refers to, by `record_key` of their names; `bundles` are names alone."""

    cameras: Mapping[str, Camera]
    temticks: Mapping[str, Temtick]
    templates: Mapping[str, Template]
    photos: Mapping[str, Photo]
    bundles: Mapping[str, str]

    def camera_of(self, photo: Photo) -> Camera:
        """Return the camera of a photo.

        Raises
        ------
        OrientationError
            If there is none of that name.
        """
        camera = self.cameras.get(record_key(photo.camera))
        if camera is None:
            known = (each.name for each in self.cameras.values())
            message = f"photo {photo.name}: {unknown_record('camera', photo.camera, known)}"
            raise OrientationError(message)
        return camera

    def template_of(self, photo: Photo) -> Template | None:
        """Return the template that a photo is on, None for a photo off a template.

        Raises
        ------
        OrientationError
            If there is none of that name.
        """
        if photo.template is None:
            return None
        template = self.templates.get(record_key(photo.template))
        if template is None:
            known = (each.name for each in self.templates.values())
            message = f"photo {photo.name}: {unknown_record('template', photo.template, known)}"
            raise OrientationError(message)
        return template

    def temtick_of(self, template: Template) -> Temtick:
        """Return the tick marks of a template.

        Raises
        ------
        OrientationError
            If there are none of that name.
        """
        temtick = self.temticks.get(record_key(template.temtick))
        if temtick is None:
            known = (each.name for each in self.temticks.values())
            message = f"template {template.name}: {unknown_record('temtick', template.temtick, known)}"
            raise OrientationError(message)
        return temtick

    def with_camera(self, camera: Camera) -> Definitions:
        """Return the definitions with one camera replaced."""
        return replace(self, cameras={**self.cameras, record_key(camera.name): camera})

    def with_temtick(self, temtick: Temtick) -> Definitions:
        """Return the definitions with the tick marks of one name replaced."""
        return replace(self, temticks={**self.temticks, record_key(temtick.name): temtick})
