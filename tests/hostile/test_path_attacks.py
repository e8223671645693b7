"""Whatever stands in the place of a project's files, commands end in words and reach nothing beside the project."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hostile.confinement import NotAllowedError, as_plain_user, confined, in_private_mounts
from hostile.path_attacks import confined_attacks, prepare
from support.long_cases import every

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and links are those of POSIX")

WAYS = (in_private_mounts, as_plain_user)
Confine = Callable[[Path], None]


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """Return a folder that every user can get to, unlike pytest's, with the projects that are attacked."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        prepare(Path(name))
        yield Path(name)


@pytest.mark.parametrize("confine", WAYS)
def test_a_confined_process_can_write_in_its_folder_alone(confine: Confine, folder: Path, tmp_path: Path) -> None:
    if confine is as_plain_user and os.geteuid() != 0:
        pytest.skip("this is a plain user already, who may write in folders of his own")

    def work() -> list[str]:
        (folder / confine.__name__).write_text("")
        try:
            (tmp_path / "outside").write_text("")
        except OSError as error:
            return [str(error.errno)]
        return []

    try:
        assert confined(confine, folder, work)
    except NotAllowedError as reason:
        pytest.skip(str(reason))
    assert (folder / confine.__name__).exists()
    assert not (tmp_path / "outside").exists()


@pytest.mark.parametrize("confine", WAYS)
@pytest.mark.parametrize(("count", "seed"), every(2, [(12, 1), (5_000, 2)]))
def test_attacks(confine: Confine, folder: Path, count: int, seed: int) -> None:
    try:
        codes = confined_attacks(confine, count, seed, folder)
    except NotAllowedError as reason:
        pytest.skip(str(reason))
    assert sum(codes.values()) == count
    assert set(codes) & {1, 3}, "some of them have to be refused"
