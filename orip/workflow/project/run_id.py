"""Run ids, which link stores and outputs to each other, and whether each step of the work is up to date."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Literal

from msgspec import Struct

from orip.files.stores.digest import record_digest
from orip.records.measurement import PhotoObservations
from orip.version import __version__

_LENGTH = 12
_NAMES_AT_A_TIME = 1 << 14


def run_id(*parts: object) -> str:
    """Return the id of a run from what it depends on."""
    text = "\n".join([__version__, *(str(part) for part in parts)])
    return hashlib.sha256(text.encode()).hexdigest()[:_LENGTH]


def digest_of_records(records: Iterable[object]) -> str:
    """Return the SHA-256 (hex) of records in their order."""
    return digest_of_digests(map(record_digest, records))


def digest_of_digests(digests: Iterable[str]) -> str:
    """Return the SHA-256 (hex) of records from their own digests."""
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()


def digest_of_observations(observations: PhotoObservations) -> str:
    """Return the SHA-256 (hex) of photo observations; fast for millions."""
    return digest_of_columns((observations.photos, observations.points), _pieces(observations))


def _pieces(observations: PhotoObservations) -> Iterator[bytes]:
    """Yield the numbers of the arrays, some thousand rows at a time."""
    from orip.arrays import parts  # what has been read without arrays needs none

    for array in (observations.measured, observations.errors, observations.disregarded):
        yield from (array[part].tobytes() for part in parts(len(array)))


def digest_of_columns(names: Iterable[Iterable[str]], numbers: Iterable[bytes]) -> str:
    """Return the SHA-256 (hex) of columns of names and of numbers."""
    digest = hashlib.sha256()
    for column in names:
        left, between = iter(column), ""
        while some := "\n".join(islice(left, _NAMES_AT_A_TIME)):
            digest.update((between + some).encode())
            between = "\n"
    for piece in numbers:
        digest.update(piece)
    return digest.hexdigest()


StepState = Literal["missing", "out of date", "failed", "up to date"]
"""Failed: with this input it comes to nothing, and doing it again would not help."""

WRITTEN_BY = "the next init, measure, solve or run writes it"


class Step(Struct, frozen=True):
    """One step of the work: its command, its state, and why; and what comes next where it is not this command."""

    command: str
    state: StepState
    text: str
    instead: str | None = None

    @property
    def following(self) -> str:
        """Return what comes next while the step is not up to date."""
        return self.command if self.instead is None else self.instead


def changed_inputs(old: Sequence[tuple[str, str]], new: Sequence[tuple[str, str]]) -> list[str]:
    """Return the names of inputs that are new, gone or different."""
    before, after = dict(old), dict(new)
    return [name for name in {**before, **after} if before.get(name) != after.get(name)]
