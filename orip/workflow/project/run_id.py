"""Run ids, which link stores and outputs to each other. Equal inputs give equal ids; no clock is involved."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from itertools import islice

from orip.arrays import parts
from orip.files.stores.digest import record_digest
from orip.records.observations.measurement import PhotoObservations
from orip.version import __version__

_LENGTH = 12
_NAMES_AT_A_TIME = 1 << 14


def run_id(*parts: object) -> str:
    """Return the id of a run from what it depends on."""
    text = "\n".join([__version__, *(str(part) for part in parts)])
    return hashlib.sha256(text.encode()).hexdigest()[:_LENGTH]


def digest_of_records(records: Iterable[object]) -> str:
    """Return the SHA-256 (hex) of records in their order."""
    return hashlib.sha256("\n".join(map(record_digest, records)).encode()).hexdigest()


def digest_of_observations(observations: PhotoObservations) -> str:
    """Return the SHA-256 (hex) of photo observations; fast for millions."""
    digest = hashlib.sha256()
    names: Sequence[Sequence[str]] = (observations.photos, observations.points)
    for column in names:
        left, between = iter(column), ""
        while some := "\n".join(islice(left, _NAMES_AT_A_TIME)):
            digest.update((between + some).encode())
            between = "\n"
    for array in (observations.measured, observations.errors, observations.disregarded):
        for part in parts(len(array)):
            digest.update(array[part].tobytes())
    return digest.hexdigest()
