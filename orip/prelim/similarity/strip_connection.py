"""Strip connection: strips become a block in the system of the first one."""

from __future__ import annotations

from collections.abc import Sequence

from orip.prelim.similarity.bridging import JoinedSystems
from orip.prelim.similarity.joining import Joined, Names, join
from orip.prelim.similarity.partial_blocks import assembled
from orip.records.results.preliminary import NotOriented, PartialBlock, SimilarityStep


def connect(strip: PartialBlock, block: PartialBlock, names: Names) -> Joined | NotOriented:
    """Connect a strip to another one, or to a block of strips; see `join`."""
    return join(strip, block, names, "connect")


def connect_strips(strips: Sequence[PartialBlock], names: Names) -> JoinedSystems:
    """Connect strips to one block.

    Parameters
    ----------
    strips : sequence of PartialBlock
        In the order of their rows.
    names : Names

    Returns
    -------
    JoinedSystems
        Each strip is connected to all those connected so far. One that cannot be connected is tried again after the
        others, and finally begins a block of its own; the failures say why.
    """
    waiting = list(strips)
    systems: list[PartialBlock] = []
    steps: list[SimilarityStep] = []
    failures: list[NotOriented] = []
    while waiting:
        members = [waiting.pop(0)]
        failed = _connect_all(members, waiting, steps, names)
        systems.append(assembled(members))
        failures.extend(failed[:1])
    return JoinedSystems(tuple(systems), tuple(steps), tuple(failures))


def _connect_all(
    members: list[PartialBlock], waiting: list[PartialBlock], steps: list[SimilarityStep], names: Names
) -> list[NotOriented]:
    """Move strips from the waiting ones to the members of a block; return why the remaining ones do not connect."""
    while True:
        failed: list[NotOriented] = []
        before, block = len(waiting), assembled(members)
        for strip in tuple(waiting):
            found = connect(strip, block, names)
            if isinstance(found, Joined):
                members.append(found.block)
                block = assembled(members)
                steps.append(found.step)
                waiting.remove(strip)
            else:
                failed.append(found)
        if not waiting or len(waiting) == before:
            return failed
