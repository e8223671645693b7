"""A pytest plugin that takes tests which can depend on their surroundings, in the order that ORIP_TEST_ORDER chooses.

Mathematics depends on its arguments alone, which the contracts of the imports see to: it imports no files, no terminal,
no clock. What can depend on the surroundings is what runs commands, reads and writes files, talks over sockets, draws
pages, or leaves linear algebra to several threads; the tests of these folders are taken. Whatever a module meets of its
surroundings, it meets in its imports, its fixtures and the way it calls the program, which its tests share: a few of
them are enough, and these are other ones in another order. Slow and long tests are left out.

Modules stay whole, so that what a module prepares for its tests is prepared once. All workers of a run have the same
order.
"""

from __future__ import annotations

import os
import random

import pytest

FOLDERS = (
    "adjustment", "api", "bundle", "cli", "exchange", "files", "hostile", "link", "report", "samples", "trajectory",
    "workflow",
)  # fmt: skip

OF_MODULE = 4
"""Test functions that are taken of a module; of one with parameters a single case."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Choose tests and shuffle them in place."""
    generator = random.Random(int(os.environ.get("ORIP_TEST_ORDER", "1")))
    modules: dict[str, list[pytest.Item]] = {}
    for item in items:
        is_quick = item.get_closest_marker("slow") is None and item.get_closest_marker("long") is None
        if is_quick and item.nodeid.split("/")[1] in FOLDERS:
            modules.setdefault(item.nodeid.split("::")[0], []).append(item)
    names = sorted(modules)
    generator.shuffle(names)
    chosen = [item for name in names for item in _some_of(modules[name], generator)]
    taken = set(chosen)
    config.hook.pytest_deselected(items=[item for item in items if item not in taken])
    items[:] = chosen


def _some_of(tests: list[pytest.Item], generator: random.Random) -> list[pytest.Item]:
    generator.shuffle(tests)
    cases = {test.nodeid.split("[")[0]: test for test in tests}
    return list(cases.values())[:OF_MODULE]
