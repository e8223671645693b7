"""A pytest plugin that runs modules, and the tests of each module, in an order that ORIP_TEST_ORDER chooses.

Modules stay whole, so that what a module prepares for its tests is prepared once. All workers of a run have the same
order.
"""

from __future__ import annotations

import os
import random

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Shuffle the tests in place."""
    generator = random.Random(int(os.environ.get("ORIP_TEST_ORDER", "1")))
    modules: dict[str, list[pytest.Item]] = {}
    for item in items:
        modules.setdefault(item.nodeid.split("::")[0], []).append(item)
    names = sorted(modules)
    generator.shuffle(names)
    for name in names:
        generator.shuffle(modules[name])
    items[:] = [item for name in names for item in modules[name]]
