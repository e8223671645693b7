"""Whatever is in the files of a COLMAP model, it is read or complained of; nothing else happens."""

from __future__ import annotations

import random
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import OBLIQUE, block
from exchange.colmap_samples import written
from exchange.mutated_files import project_or_complaints, use_mutated_files
from exchange.test_colmap import blob, database
from support.long_cases import every

from orip.exchange.colmap.reader import READING, Form, read_model
from orip.exchange.colmap.writer import new_model
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.exchange.project.texts import ImportSource, imported_texts
from orip.records.exchanged import ExchangedExposure, ExchangedMounting, ExchangedRig
from orip.structs import replace

_SETTINGS = ExchangeSettings(corrects_distortion=True)
_SOURCE = ImportSource("colmap", "x", "x")
_ALLOCATED = 50
"""Bytes for each byte of the files, and half a megabyte: numbers of a text take some times the room of their digits."""


def sound_model(folder: Path, form: Form) -> Path:
    """Write a small model with rigs, and a database with priors of its photos."""
    project = block(READING, OBLIQUE[:3])
    strong = replace(project.cameras[0], parameters={**project.cameras[0].parameters, "k1": -0.01, "p1": 1e-4})
    photos = tuple(replace(photo, camera=n % 2) for n, photo in enumerate(project.photos))
    rig = ExchangedRig("R", (ExchangedMounting(0), ExchangedMounting(1, tuple(np.eye(3).ravel()), (1.0, 0.0, 0.0))))
    written(
        folder,
        new_model(
            replace(
                project,
                cameras=(strong, replace(strong, name="2")),
                photos=photos,
                rigs=(rig,),
                exposures=(ExchangedExposure("E", (0, 1)),),
            )
        ),
        form,
    )
    cartesian = (1, blob(1.0, 2.0, 3.0), blob(*np.eye(3).ravel()), 1)
    database(folder / "database.db", [cartesian, (2, *cartesian[1:])], is_new=True)
    return folder


def fuzz(folder: Path, form: Form, count: int, seed: int) -> None:
    """Read a model that often, with one of its files changed, and convert what has been read."""
    source = sound_model(folder, form)
    assert not read_model(source, "model").complaints

    def use(_: Path) -> None:
        project = project_or_complaints(read_model(source, "model"))
        if project is not None:
            imported_texts(imported_block(project, "model", _SETTINGS), _SOURCE, None)

    use_mutated_files([(path, path.read_bytes()) for path in sorted(source.iterdir())], count, seed, use)


@pytest.mark.parametrize("form", ["bin", "txt"])
@pytest.mark.parametrize(("count", "seed"), every(2, [(60, 7), (50_000, 8)]))
def test_mutated_files(tmp_path: Path, form: Form, count: int, seed: int) -> None:
    fuzz(tmp_path, form, count, seed)


def test_a_wrong_count_takes_no_memory(tmp_path: Path) -> None:
    source = sound_model(tmp_path, "bin")
    size = sum(path.stat().st_size for path in source.iterdir())
    chance = random.Random(3)
    for name in ("cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin"):
        path = source / name
        sound = path.read_bytes()
        for _ in range(5):
            place = 0 if name == "cameras.bin" else chance.randrange(len(sound) - 8)
            path.write_bytes(sound[:place] + b"\xff\xff\xff\xff\xff\xff\xff\x0f" + sound[place + 8 :])
            tracemalloc.start()
            read_model(source, "model")
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < _ALLOCATED * size + 500_000
        path.write_bytes(sound)
