"""orip: bundle adjustment of ORIPROGRAM-style project folders.

What scripts and notebooks may use is named in `__all__`. It is imported when it is first asked for: no command waits
for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orip.version import __version__ as __version__

if TYPE_CHECKING:
    from orip.api import (
        AdjustedCamera,
        AdjustedCameras,
        AdjustedPhoto,
        AdjustedPhotos,
        AdjustedPoint,
        AdjustedPoints,
        Block,
        Camera,
        Complaint,
        ControlPoints,
        Directions,
        Distances,
        Elements,
        InputError,
        LockedError,
        NotSolvableError,
        ObservationResiduals,
        OripError,
        PhotoPoints,
        Photos,
        PreliminaryPoints,
        Project,
        ProjectWarning,
        Solution,
        UnknownNameError,
        UsageError,
        open_project,
    )

__all__ = [
    "AdjustedCamera",
    "AdjustedCameras",
    "AdjustedPhoto",
    "AdjustedPhotos",
    "AdjustedPoint",
    "AdjustedPoints",
    "Block",
    "Camera",
    "Complaint",
    "ControlPoints",
    "Directions",
    "Distances",
    "Elements",
    "InputError",
    "LockedError",
    "NotSolvableError",
    "ObservationResiduals",
    "OripError",
    "PhotoPoints",
    "Photos",
    "PreliminaryPoints",
    "Project",
    "ProjectWarning",
    "Solution",
    "UnknownNameError",
    "UsageError",
    "open_project",
]

if not TYPE_CHECKING:  # a type checker is to know the names, not that any name may be asked for

    def __getattr__(name: str) -> object:
        """Import what is asked for."""
        if name in __all__:
            from orip import api

            return getattr(api, name)
        message = f"module 'orip' has no attribute {name!r}"
        raise AttributeError(message)

    def __dir__() -> list[str]:
        """Return the public names and those of the module itself."""
        return sorted({*__all__, *globals()})
