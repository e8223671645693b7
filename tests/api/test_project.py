"""Projects opened from Python: the same figures as the commands, and nothing written before a solution is saved."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip as orip_command
from support.sample_projects import sample_project

import orip

SAMPLES = ("dcs260_calibration", "small_frame_block", "zurich_city_hall")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
