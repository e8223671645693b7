"""What `import orip` gives to scripts and notebooks: blocks from arrays, projects, and their solutions.

A facade over the functions of the commands; nothing is computed here.
"""

from orip.api.estimates import (
    AdjustedCamera,
    AdjustedCameras,
    AdjustedPhoto,
    AdjustedPhotos,
    AdjustedPoint,
    AdjustedPoints,
)
from orip.api.given import (
    Camera,
    ControlPoints,
    Directions,
    Distances,
    Elements,
    Figures,
    GivenDirections,
    PhotoPoints,
    Photos,
    PreliminaryPoints,
    Stations,
)
from orip.api.method import Block
from orip.api.plots import Plots
from orip.api.project import Project, import_project, open_project
from orip.api.solution import Solution
from orip.api.tables import ObservationResiduals
from orip.errors import (
    Complaint,
    InputError,
    LockedError,
    NotSolvableError,
    OripError,
    ProjectWarning,
    UnknownNameError,
    UsageError,
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
    "Figures",
    "GivenDirections",
    "InputError",
    "LockedError",
    "NotSolvableError",
    "ObservationResiduals",
    "OripError",
    "PhotoPoints",
    "Photos",
    "Plots",
    "PreliminaryPoints",
    "Project",
    "ProjectWarning",
    "Solution",
    "Stations",
    "UnknownNameError",
    "UsageError",
    "import_project",
    "open_project",
]
