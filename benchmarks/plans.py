"""A flight of 2000 photos: its plan, its forecast, and the places of 20 control points among 500.

    python plans.py

Prints one line of JSON: CPU seconds and seconds on the clock of each command, from its start to its end.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from orip.files.control.stations_text import read_stations

PROJECT = """project = {{ name = "LARGE", crs = "EPSG:25832" }}

[plan]
pixel = 0.02
forward = 80.0
side = 60.0
cross_strips = 4
cross_height = 1.2
ground = 30.0
tie_points = 30
position_error = [0.015, 0.015, 0.03]
corners = {corners}

[[camera]]
name = "P4"
c = 8.8
sensor = {{ columns = 5472, rows = 3648, width = 13.2, height = 8.8 }}
unknown = ["C", "DX", "DY", "A3"]

[[bundle]]
name = "B"
measurement_precision = "0.3px"
"""
LOW, SIZE = (561000.0, 5934000.0), (1320.0, 820.0)
COMMANDS = {
    "plan": ("plan", "make"),
    "forecast": ("plan", "forecast"),
    "places": ("plan", "place", "20", "--places", "500"),
}


def corners() -> list[list[float]]:
    """Return the corners of the area."""
    (x, y), (along, across) = LOW, SIZE
    return [[x, y], [x + along, y], [x + along, y + across], [x, y + across]]


def timed(folder: Path, *arguments: str) -> tuple[float, float]:
    """Return CPU seconds and seconds on the clock of a command."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-m", "orip", "-q", "-C", str(folder), *arguments], check=True, env=os.environ)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return round(used, 2), round(time.perf_counter() - begun, 2)


def main() -> None:
    """Run the commands and print."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "orip.toml").write_text(PROJECT.format(corners=corners()), encoding="utf-8")
        found = {what: timed(folder, *arguments) for what, arguments in COMMANDS.items()}
        photos = len(read_stations(folder / "LARGE.PLAN", "LARGE.PLAN").value)
    print(json.dumps({"photos": photos, **found}))


if __name__ == "__main__":
    main()
