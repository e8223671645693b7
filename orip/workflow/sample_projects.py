"""The sample projects that come with orip, and a copy of one to work with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct

from orip.errors import UsageError
from orip.files.project.ignored import IGNORE_FILE, IGNORED
from orip.files.text.leftovers import remove_leftovers
from orip.files.text.new_folder import was_left, write_new_folder
from orip.workflow.project.folder import PROJECT_FILE

SAMPLES: Mapping[str, str] = {
    "zurich_city_hall": "15 terrestrial photos of a building, control and check points: data that do not fit",
    "dcs260_calibration": "5 photos of a grid plate: calibration of a camera",
    "drone_rtk": "60 photos of a drone with RTK, simulated: one bad fix, one shifted strip",
    "small_frame_block": "12 hand-held photos of a cliff, simulated: from film to drive table, with two blunders",
}
"""Name and description."""

_SUFFIXES = {".toml", ".md", ".MEA", ".PNT", ".PRE", ".LEN", ".STA", ".MRK", ".pos", ".py"}
_TRUTH = "truth.json"


class SampleWritten(Struct, frozen=True):
    """A sample project that was written: its name, its folder, and the names of its files."""

    name: str
    folder: Path
    files: tuple[str, ...]


def write_sample(name: str, folder: Path) -> SampleWritten:
    """Write a sample project into a folder that is new or empty; stores and results are left to `orip run`.

    If it is killed while it writes, there is no half project: a new folder appears as a whole, and in an existing one
    orip.toml is written last. When repeated, it goes on from there.

    Raises
    ------
    UsageError
        If there is no such sample, or the folder has something in it; nothing is written then.
    OSError
        If the folder or the disk refuses.
    """
    texts = {IGNORE_FILE: IGNORED, **sample_texts(name)}
    _require_room(folder, texts)
    write_new_folder(folder, texts)
    return SampleWritten(name, folder, tuple(texts))


def sample_texts(name: str) -> dict[str, str]:
    """Return the files of a sample project, orip.toml last.

    Raises
    ------
    UsageError
        If there is no such sample.
    """
    if name not in SAMPLES:
        width = max(map(len, SAMPLES))
        known = "".join(f"\n  {sample:{width}}  {text}" for sample, text in SAMPLES.items())
        message = f"no sample project is called {name!r}; write one of these:{known}"
        raise UsageError(message)
    given = [path for path in (_samples() / name).iterdir() if _is_given(path.name)]
    given.sort(key=lambda path: (path.name == PROJECT_FILE, path.name))
    return {path.name: path.read_bytes().decode("utf-8") for path in given}


def _samples() -> Path:
    """Return the folder of the sample projects: inside an installed package, beside it in a clone."""
    package = Path(__file__).parents[1]
    installed = package / "sample_projects"
    return installed if installed.is_dir() else package.parent / "sample_projects"


def _is_given(name: str) -> bool:
    """Tell whether a file belongs to the sample; orip may have written others there, if it was run in that folder."""
    return Path(name).suffix in _SUFFIXES or name == _TRUTH


def _require_room(folder: Path, texts: Mapping[str, str]) -> None:
    if folder.is_dir():
        remove_leftovers(folder)
        found = sorted(path.name for path in folder.iterdir() if not was_left(path, texts))
        if not found:
            return
        what = f"has something in it already ({found[0]}{', …' if len(found) > 1 else ''})"
    elif folder.exists() or folder.is_symlink():
        what = "is not a folder"
    else:
        return
    message = f"{folder} {what}; a sample is written into a new or empty folder: name another one"
    raise UsageError(message)
