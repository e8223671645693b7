"""Files of other programs with some bytes changed: whatever is in them, they are read or complained of."""

from __future__ import annotations

import io
import random
import warnings
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from hostile.fuzzing import mutated, require_words
from hostile.structured import mutated_structure

from orip.errors import OripError
from orip.files.text.shown import Parsed
from orip.records.exchanged import ExchangedProject

_ZIP = b"PK"


def use_mutated_files(
    sound: Sequence[tuple[Path, bytes]], count: int, seed: int, use: Callable[[Path], object]
) -> None:
    """Use a file that often, each time with other changes of what it holds; fail on any exception but complaints."""
    chance = random.Random(seed)
    for _ in range(count):
        path, data = chance.choice(sound)
        changed = _mutated(data, chance)
        path.write_bytes(changed)
        try:
            with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
                warnings.simplefilter("error")
                use(path)
        except OripError as error:
            require_words(str(error))
        except Exception as error:
            message = f"{path.name} of {changed[:3000]!r} ended in {type(error).__name__}: {error}"
            raise AssertionError(message) from error
        finally:
            path.write_bytes(data)


def _mutated(data: bytes, chance: random.Random) -> bytes:
    if data.startswith(_ZIP) and chance.random() < 0.7:
        return _mutated_members(data, chance)
    structured = mutated_structure(data, chance) if chance.random() < 0.6 else None
    return mutated(data, chance) if structured is None else structured


def _mutated_members(data: bytes, chance: random.Random) -> bytes:
    """Return a zip file that is sound and has some of its members changed."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as new:
        chosen = set(chance.sample(old.namelist(), k=chance.randint(1, min(2, len(old.namelist())))))
        for name in old.namelist():
            new.writestr(name, _mutated(old.read(name), chance) if name in chosen else old.read(name))
    return stream.getvalue()


def project_or_complaints(parsed: Parsed[ExchangedProject | None]) -> ExchangedProject | None:
    """Return what was read; None where there are complaints, and then there are words."""
    assert (parsed.value is None) == bool(parsed.complaints)
    for complaint in parsed.complaints:
        require_words(str(complaint))
    return parsed.value
