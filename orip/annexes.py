"""What annexes add to the kernel, by the names of their modules: the kernel imports none of them.

An annex holds all of a subject in one folder (`archive`, `exchange`, `multimodel`, `online`, `pictures`, `planning`,
`restitution`, `screen`, `stations`) and stands above the kernel, beside the others. What it adds is registered here and
nowhere else: its commands, its steps of `orip run` and `orip status`, and what commands of others offer with it. A
module is loaded when it is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

COMMANDS: Mapping[str, str] = {
    "online": "orip.online.commands",
    "import": "orip.exchange.commands",
    "export": "orip.exchange.commands",
    "adjust": "orip.exchange.commands",
    "drive": "orip.multimodel.commands.drive",
    "digitise": "orip.multimodel.commands.digitise",
    "photos": "orip.pictures.commands",
    "stations": "orip.stations.commands",
    "gnss": "orip.stations.receiver_commands",
    "imu": "orip.stations.imu_command",
    "plan": "orip.planning.commands.plan",
    "archive": "orip.archive.commands",
    "detect": "orip.pictures.detect_commands",
    "match": "orip.pictures.match_command",
    "restitute": "orip.restitution.commands",
    "screen": "orip.screen.command",
}
"""Modules whose `register` adds a command; the order and the texts of all commands are in `orip.cli.main`."""

DRIVE_STEPS = "orip.multimodel.table_step"
"""Steps of `run` and `status` for bundles with models: `DRIVEN_FROM`, `table_of_run`, `drive_step`."""

DRIVE_WORDS = "orip.multimodel.commands.drive"
"""What `run` says of these steps: `tell_made`."""

DOWNLOAD_STEP = "orip.multimodel.project_link"
"""Step of `status` where there is a plate processor: `download_step`."""

DIVIDED_BLOCK = "orip.archive.cluster.divided_block"
"""`solve --dask`: `ClusterRequest`, `divided_blocks`, `columns_of_project`."""

IMPORTED_PROJECTS = "orip.exchange.project.imported"
"""`orip.import_project`: `import_folder`."""

STATION_STEPS = "orip.stations.project_steps"
"""Steps of `run` and `status` for projects with `[gnss]` or `[imu]`: `station_steps`, `process_stations`."""

MEASURING_ONLINE = "orip.online.commands"
"""`observations todo --next`: `tell_next`; `digitise points --online`: `answered_online`; `screen`:
`session_to_measure`."""

STEREO_MODELS = "orip.multimodel.stereo_project"
"""`screen --stereo`: `open_stereo`."""

PHOTOGRAPHS = "orip.pictures.commands"
"""`orip new --photos`: `make_project`."""

PICTURES_OF_REPORT = "orip.pictures.report_pictures"
"""Pictures of photos in reports: `picture_source`."""


def annex(module: str) -> Any:
    """Return a module of an annex, by one of the names above."""
    return import_module(module)
