"""What rigs and rolling shutters cost, against the same photos without them; CPU seconds on one thread.

    PYTHONPATH=tests OMP_NUM_THREADS=1 python benchmarks/rigs_and_shutters.py --exposures 500 --photos 500

A rig of five cameras is adjusted with its mountings unknown, and its photos one by one: to the minimum, and all
statistics. Of an aerial block with a rolling shutter an iteration and the cofactors are compared with those of a global
one: with motions that neighbours say, which cost the same whatever they are, and with unknown ones. What counts is the
least of the repetitions.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

from aerial_blocks import FRAME_MM, aerial_block, measured
from support.rig_blocks import rig_block, single

from orip.records.block import Block
from orip.records.camera import Sensor
from orip.structs import replace
from orip.threads import limited_threads

_STRIPS = 20
_POINTS_AN_EXPOSURE = 16
_READOUT = 0.03
_PIXELS_A_MM = 100


def of_rigs(exposures: int) -> dict[str, Block]:
    """Return a block of a rig of five cameras, and the same photos without it."""
    made = rig_block(
        "penta", "cost", strips=_STRIPS, exposures=exposures // _STRIPS, points=_POINTS_AN_EXPOSURE * exposures,
        control=40, start_error=0.002,
    ).block  # fmt: skip
    return {"photos one by one": single(made), "rig": made}


def of_shutters(photos: int) -> dict[str, Block]:
    """Return an aerial block, with a global shutter and with rolling ones."""
    block = aerial_block(photos)
    camera = block.cameras[0]
    width, height = FRAME_MM
    sensor = Sensor(round(_PIXELS_A_MM * width), round(_PIXELS_A_MM * height), width, height)
    rolling = replace(camera, parameters=(*camera.parameters[:-1], _READOUT), sensor=sensor)
    held = replace(block, cameras=(rolling,))

    def unknown(**errors: float) -> Block:
        return replace(held, definition=replace(block.definition, **errors))

    return {
        "global": block,
        "rolling": held,
        "unknown velocities": unknown(velocity_error=0.3),
        "unknown motions": unknown(velocity_error=0.3, rate_error=2.0),
    }


def _cost(block: Block) -> dict[str, float]:
    start = time.process_time()
    _, iterations, precision = measured(block)
    return {
        "all": time.process_time() - start,
        "iterations": float(len(iterations)),
        "iteration": min(iterations),
        "precision": precision,
    }


def least(blocks: dict[str, Block], repetitions: int) -> dict[str, dict[str, float]]:
    """Return the least figures of each block, adjusted in turn."""
    runs = [{name: _cost(block) for name, block in blocks.items()} for _ in range(repetitions)]
    return {name: {key: min(run[name][key] for run in runs) for key in runs[0][name]} for name in blocks}


def main() -> None:
    """Adjust and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--exposures", type=int, default=0, help="of rigs; 0: none")
    parser.add_argument("--photos", type=int, default=0, help="of rolling shutters; 0: none")
    parser.add_argument("--repetitions", type=int, default=3)
    given = parser.parse_args()
    asked: tuple[tuple[Callable[[int], dict[str, Block]], int], ...]
    asked = (of_rigs, given.exposures), (of_shutters, given.photos)
    with limited_threads(1):
        for make, size in asked:
            blocks = make(size) if size else {}
            for name, block in blocks.items():
                print(f"{name}: {len(block.photos)} photos, {len(block.photo_points.photo)} photo points")
            found = least(blocks, given.repetitions)
            plain = next(iter(found.values()), {})
            for name, figures in found.items():
                ratios = {key: round(value / plain[key], 2) for key, value in figures.items()}
                rounded = {key: round(value, 3) for key, value in figures.items()}
                print(json.dumps({"what": name, "found": rounded, "times": ratios}), flush=True)


if __name__ == "__main__":
    main()
