"""Several processes that make the same store at the same moment."""

from __future__ import annotations

from multiprocessing import get_context
from pathlib import Path

from orip.errors import OripError
from orip.files.stores.transaction import writing

PROCESSES, STORES = 3, 60


def made(folder: Path, barrier) -> list[str]:
    """Make stores in step with others; return the complaints."""
    complaints = []
    for number in range(STORES):
        barrier.wait(60)
        try:
            with writing([folder / f"B{number}.EXO"]):
                pass
        except OripError as error:
            complaints.append(str(error))
    return complaints


def test_a_store_that_another_process_is_making_is_no_stranger(tmp_path):
    # of 60 stores some eight were taken for another program's as long as their marks were read one by one
    context = get_context("spawn")
    with context.Manager() as manager, context.Pool(PROCESSES) as pool:
        barrier = manager.Barrier(PROCESSES)
        assert pool.starmap(made, [(tmp_path, barrier)] * PROCESSES) == [[]] * PROCESSES
