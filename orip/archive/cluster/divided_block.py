"""A block that is adjusted by the workers of Dask: where it is divided, and what it keeps in files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from msgspec import Struct, field

from orip.adjustment.factorisation.dissection import DissectionTree
from orip.archive.blocking.divided_problem import LARGEST_PART, Spread, pose_divided
from orip.archive.blocking.sub_block import SubBlock
from orip.archive.cluster.connection import connected, require_fit_workers, require_installed
from orip.archive.cluster.dask_passes import Sent, dask_passes
from orip.archive.cluster.sub_block_files import FOLDER, marker_of, store_sub_blocks
from orip.bundle.compiled.photo_loop import is_compiled
from orip.bundle.problem import BlockProblem
from orip.errors import OripError
from orip.files.text.atomic import reporting_failure
from orip.files.text.own_files import make_folder
from orip.records.block import Block
from orip.set_aside import columns_in_files

if TYPE_CHECKING:
    from distributed import Client, Worker


@contextmanager
def columns_of_project(project: Path) -> Iterator[None]:
    """Keep what is set aside within the block in files of a project's folder.

    Raises
    ------
    OripError
        If the folder for them cannot be made, or a link stands in its place.
    """
    folder = project / FOLDER
    with reporting_failure(folder, "remove the cause, then repeat the command"):
        make_folder(folder)
    with columns_in_files(folder):
        yield


class ClusterRequest(NamedTuple):
    """Where a block is to be adjusted.

    Attributes
    ----------
    scheduler : str or None
        Its address; None: a cluster on this machine.
    workers : int or None
        Worker processes on this machine; None: one for each core.
    memory : int
        Bytes that each of these may use; 0: no limit.
    """

    scheduler: str | None = None
    workers: int | None = None
    memory: int = 0


class Moved(NamedTuple):
    """Bytes moved since the last time: to the workers, from them, and between them; and those of the separators.

    `separators` is what one iteration has to move at least if no two nodes of the tree were with the same worker: the
    normal equations that nodes are reduced to.
    """

    there: int
    back: int
    between: int
    separators: int

    @property
    def total(self) -> int:
        """Return all that was moved."""
        return self.there + self.back + self.between


class DividedBlocks(Struct):
    """Divides blocks of a project among the workers of a client.

    Parameters
    ----------
    project : Path
        Folder in whose store of sub-blocks the workers read.
    largest : int
        Photos up to which a part is not divided.
    trees : list of DissectionTree
        Of the blocks so far.
    """

    client: Client
    project: Path
    largest: int = LARGEST_PART
    trees: list[DissectionTree] = field(default_factory=list)
    sent: Sent = field(default_factory=Sent)
    told: Moved = field(default_factory=lambda: Moved(0, 0, 0, 0))

    def pose(self, block: Block) -> BlockProblem:
        """Return the problem of a block, divided among the workers."""
        return pose_divided(block, self._spread, self.largest)

    def moved(self) -> Moved:
        """Return the bytes that were moved since this was last asked for."""
        outgoing = sum(self.client.run(_outgoing_bytes, on_error="ignore").values())
        now = Moved(self.sent.there, self.sent.back, max(outgoing - self.sent.back, 0), 0)
        # the counters of a worker that died are gone
        there, back, between = (max(one - before, 0) for one, before in zip(now[:3], self.told[:3], strict=True))
        self.told = now
        return Moved(there, back, between, self.trees[-1].border_bytes if self.trees else 0)

    def _spread(self, tree: DissectionTree, sub_blocks: Iterable[SubBlock]) -> Spread:
        sources = store_sub_blocks(self.project, sub_blocks)
        require_fit_workers(self.client, marker_of(Path(sources[0].folder)), forking=False)
        self.trees.append(tree)
        return Spread(dask_passes(self.client, tree, self.sent, Path(sources[0].folder).parent), sources)


@contextmanager
def divided_blocks(request: ClusterRequest, project: Path) -> Iterator[DividedBlocks]:
    """Connect to a cluster that adjusts the blocks of a project.

    Raises
    ------
    UsageError
        If Dask is not installed, or the address is malformed.
    LostClusterError
        If nothing answers at the address, or no worker is there.
    OripError
        If this installation lacks the compiled loop.
    """
    require_installed("--dask needs", ("distributed",))
    if not is_compiled():
        message = "--dask needs orip's compiled loop, which this installation lacks; install orip's wheel"
        raise OripError(message)
    with connected(request.scheduler, request.workers, request.memory) as client:
        yield DividedBlocks(client, project)


def _outgoing_bytes(dask_worker: Worker) -> int:
    return int(dask_worker.transfer_outgoing_bytes_total)
