"""The process in which RTKLIB computes: `python -m orip.stations.gnss.rtklib_process`, with a request as its input."""

from __future__ import annotations

import sys

from msgspec import json

from orip.stations.gnss.rtklib import RtklibRequest, compute

if __name__ == "__main__":
    sys.exit(compute(json.decode(sys.stdin.buffer.read(), type=RtklibRequest)))
