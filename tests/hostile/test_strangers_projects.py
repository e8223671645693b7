"""Generated projects of strangers: whatever is in them, opening them harms nobody."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hostile.confinement import NotAllowedError, as_plain_user, in_private_mounts
from support.long_cases import every

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes, links and limits are those of POSIX")

WAYS = (in_private_mounts, as_plain_user)


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """Return a folder that every user can get to, with sound projects and what is beside them."""
    from hostile.strangers_projects import prepare

    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        prepare(Path(name))
        yield Path(name)


@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize(("count", "seed"), every(2, [(12, 1), (5_000, 2)]))
def test_projects_of_strangers_harm_nobody(how: Callable[[Path], None], folder: Path, count: int, seed: int) -> None:
    from hostile.strangers_projects import COMMANDS_OF_EACH, confined_strangers, told

    try:
        codes, holes = confined_strangers(how, count, seed, folder)
    except NotAllowedError as reason:
        pytest.skip(str(reason))
    assert not holes, told(holes)
    assert sum(codes.values()) == COMMANDS_OF_EACH * count
    assert codes[0]
    assert codes[3], "some of them have to be refused"
