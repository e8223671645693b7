"""Edits that make mistakes in the texts of a project: lines of measurements, control and orip.toml."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

from workflow.small_projects import REPOSITORY, replace_in

SAMPLES = REPOSITORY / "sample_projects"
TEXTS = (".toml", ".MEA", ".PNT", ".PRE", ".LEN")

CONTRADICTING = {"201", "202", "211", "212", "311", "312"}
"""Control points of Zurich that contradict the photos, see the README of the sample."""

Rule = Callable[[list[str], list[str]], list[str] | None]
"""From the words of a log's header line and those of a line below it to new words; None: the line goes."""


def sample(name: str, folder: Path) -> Path:
    """Return a copy of the texts of a sample project, freed of the mistakes that it has of its own."""
    folder.mkdir()
    for path in (SAMPLES / name).iterdir():
        if path.suffix in TEXTS:
            shutil.copy(path, folder)
    if name == "zurich_city_hall":
        in_control(folder, lambda words: [*words, "x"] if words[0] in CONTRADICTING else words)
    elif name == "small_frame_block":
        in_logs(folder, _without_blunders)
    return folder


def _without_blunders(header: list[str], words: list[str]) -> list[str] | None:
    """Mend the two blunders of the small-frame block, see its README."""
    if header[::2] == ["POINTS", "104"] and words[0] == "1307":
        return None
    return ["1218", *words[1:]] if header[::2] == ["POINTS", "203"] and words[0] == "1213" else words


def in_logs(folder: Path, rule: Rule, headers: Callable[[list[str]], list[str]] = list) -> None:
    """Change the lines of all measurement logs; `headers` changes header lines."""
    for path in folder.glob("*.MEA"):
        lines: list[str] = []
        header: list[str] = []
        for line in path.read_text(encoding="utf-8").splitlines():
            words = line.split()
            if not words or words[0] == "!":
                lines.append(line)
            elif words[0] in {"TEMPLATE", "PHOTO", "POINTS"}:
                header = words
                lines.append(" ".join(headers(words)))
            elif (changed := rule(header, words)) is not None:
                lines.append("  " + "  ".join(changed))
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def only_photos(folder: Path, names: set[str]) -> None:
    """Leave out all other photos, and what is measured in them."""
    path = folder / "orip.toml"
    parts = re.split(r"(?=^\[\[)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    of_photos = {part: re.search(r'name = "(.*)"', part) for part in parts if part.startswith("[[photo]]")}
    others = [part for part, name in of_photos.items() if name and name[1] not in names]
    path.write_text("".join(part for part in parts if part not in others), encoding="utf-8")
    for log in folder.glob("*.MEA"):
        blocks = re.split(r"(?m)^(?=POINTS)", log.read_text(encoding="utf-8"))
        kept = [block for block in blocks if block.split()[:1] != ["POINTS"] or block.split()[2] in names]
        log.write_text("".join(kept), encoding="utf-8")


def in_control(folder: Path, rule: Callable[[list[str]], list[str]], extension: str = "PNT") -> None:
    """Change the lines of a control file, word by word."""
    (path,) = folder.glob(f"*.{extension}")
    lines = path.read_text(encoding="utf-8").splitlines()
    changed = [line if not line.strip() or line.startswith("!") else "  ".join(rule(line.split())) for line in lines]
    path.write_text("\n".join(changed) + "\n", encoding="utf-8")


def in_toml(folder: Path, *pairs: tuple[str, str]) -> None:
    """Replace texts of orip.toml, each of which is there."""
    for old, new in pairs:
        replace_in(folder / "orip.toml", old, new)


def in_photo(folder: Path, photo: str, change: Callable[[str], str]) -> None:
    """Change the record of a photo in orip.toml."""
    path = folder / "orip.toml"
    parts = re.split(r"(?=^\[\[)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    mine = [part for part in parts if part.startswith("[[photo]]") and f'name = "{photo}"' in part]
    assert len(mine) == 1
    path.write_text("".join(change(part) if part is mine[0] else part for part in parts), encoding="utf-8")


def number(text: str, factor: float = 1.0, shift: float = 0.0) -> str:
    """Return a decimal, scaled and shifted."""
    return f"{float(text) * factor + shift:.9g}"
