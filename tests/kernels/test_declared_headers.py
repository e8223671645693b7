"""The headers of the extension modules are declared, so that a build after a change of one of them compiles anew."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.declared_extensions import REPOSITORY, Extension, declared_extensions

pytestmark = pytest.mark.skipif(not (REPOSITORY / "orip").is_dir(), reason="not in a clone of the repository")


def included_by(source: Path, found: set[Path]) -> set[Path]:
    """Return `found` with all files of the repository that a source includes, directly or by others."""
    for name in re.findall(r'^\s*#\s*include\s+"([^"]+)"', source.read_text(encoding="utf-8"), flags=re.MULTILINE):
        header = (source.parent / name).resolve()
        if header not in found:
            found.add(header)
            included_by(header, found)
    return found


def names_of(paths: set[Path]) -> set[str]:
    return {path.relative_to(REPOSITORY).as_posix() for path in paths}


def all_included(extension: Extension) -> set[str]:
    found: set[Path] = set()
    for source in extension.sources:
        included_by(REPOSITORY / source, found)
    return names_of(found)


@pytest.mark.parametrize("extension", declared_extensions(), ids=lambda extension: extension.name)
def test_an_extension_depends_on_the_headers_that_it_includes_and_no_others(extension: Extension):
    # some extensions include other sources
    assert set(extension.depends) == all_included(extension) - set(extension.sources)


def test_every_header_belongs_to_an_extension():
    included = set[str]().union(*map(all_included, declared_extensions()))
    assert names_of(set((REPOSITORY / "orip").rglob("*.h"))) <= included
