"""`orip adjust` of a model of COLMAP, from reading it to writing it, against pycolmap's adjustment of it alone.

    python whole_adjust.py --peer /path/to/environment/bin/python aerial-bal
    python whole_adjust.py --peer ... aerial-bal-2000

The blocks are those of `bal_files.py`, and the models what three iterations of pycolmap made of them. orip imports the
model, adjusts it, computes all statistics, writes listings, report and result, and the model with its result; pycolmap
has the model in memory, and ends at the minimum. Prints one line of JSON: CPU seconds of both, seconds on the clock and
peak memory of orip.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from against_peers import ONE_THREAD, run

HERE = Path(__file__).parent


def whole_command(case: str, peer: str) -> dict[str, float]:
    """Return the figures of a case."""
    environment = os.environ | ONE_THREAD
    with tempfile.TemporaryDirectory() as name:
        folder, problem, model = Path(name), str(Path(name) / "problem.npz"), Path(name) / "model"
        model.mkdir()
        subprocess.run([sys.executable, str(HERE / "peer_problem.py"), case, problem], check=True, env=environment)
        colmap = [peer, str(HERE / "pycolmap_peer.py"), problem]
        run(*colmap, "--write", str(model), "--iterations", "3")
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        command = [sys.executable, "-m", "orip", "-q", "adjust", str(model), str(folder / "adjusted")]
        subprocess.run(command, check=True, env=environment)
        wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
        result = json.loads((folder / "adjusted" / "result.json").read_text(encoding="utf-8"))
        figures = run(*colmap, "--model", str(model))
    return {
        "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "wall": wall,
        "peak": after.ru_maxrss / 1024.0,
        "iterations": len(result["iterations"]),
        "pycolmap": figures["minimum"],
        "cost": figures["cost"],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case")
    parser.add_argument("--peer", default=sys.executable, help="a Python that has pycolmap")
    given = parser.parse_args()
    print(json.dumps(whole_command(given.case, given.peer)))
