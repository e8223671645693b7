"""Where the files of an archive's results are, in the folder that holds nothing else."""

from __future__ import annotations

import hashlib
from pathlib import Path

from msgspec import Struct

SHARDS = "0123456789abcdef"
"""Parts of each table: the first digit of the digest of the project's name."""

_DIGITS = 20


class ResultsFolder(Struct, frozen=True):
    """The folder of an archive's results."""

    folder: Path

    @property
    def plan(self) -> Path:
        """Return the file that says what is run."""
        return self.folder / "archive.json"

    @property
    def lock(self) -> Path:
        """Return the file that the running program holds locked."""
        return self.folder / "archive.lock"

    @property
    def finished(self) -> Path:
        """Return the folder of what is kept of each project."""
        return self.folder / "finished"

    @property
    def dataset(self) -> Path:
        """Return the folder of the tables."""
        return self.folder / "tables"

    @property
    def overview(self) -> Path:
        """Return the overview page."""
        return self.folder / "index.html"

    def project(self, name: str) -> Path:
        """Return the file that is kept of a project."""
        return self.shard(name_digest(name)[0]) / f"{name_digest(name)}.json"

    def shard(self, shard: str) -> Path:
        """Return the folder of the projects of a shard."""
        return self.finished / shard

    def table(self, table: str, shard: str) -> Path:
        """Return the file with the rows of a table that are those of a shard."""
        return self.dataset / table / f"shard={shard}" / "rows.parquet"


def name_digest(name: str) -> str:
    """Return the digits by which the files of a project are named: folders have names that files cannot have."""
    return hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGITS]
