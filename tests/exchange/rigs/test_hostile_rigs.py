"""Whatever is in the files of a project with rigs, it is read or complained of, and written into or refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from exchange.mutated_files import project_or_complaints, use_mutated_files
from exchange.rigs.test_exchanged_rigs import FORMATS, source
from exchange.samples.round_trip import local_through_orip
from support.long_cases import every

from orip.errors import OripError
from orip.exchange.formats import format_named
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.exchange.project.texts import ImportSource, imported_texts

_SETTINGS = ExchangeSettings(corrects_distortion=True)


def fuzz(folder: Path, name: str, count: int, seed: int) -> None:
    path, found = source(folder / "given", name), format_named(name)
    assert found.read is not None
    assert found.write is not None
    sound = project_or_complaints(found.read(path, name))
    assert sound is not None
    result = local_through_orip(sound, name)
    files = sorted(path.iterdir()) if path.is_dir() else [path]

    def use(_: Path) -> None:
        assert found.read is not None
        assert found.write is not None
        project = project_or_complaints(found.read(path, name))
        try:
            if project is not None:
                imported_texts(imported_block(project, name, _SETTINGS), ImportSource(name, "x", "x"), None)
            found.write(result, path)
        except OripError:
            pass

    use_mutated_files([(one, one.read_bytes()) for one in files], count, seed, use)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(("count", "seed"), every(2, [(40, 11), (10_000, 12)]))
def test_mutated_rigs(tmp_path: Path, name: str, count: int, seed: int) -> None:
    fuzz(tmp_path, name, count, seed)
