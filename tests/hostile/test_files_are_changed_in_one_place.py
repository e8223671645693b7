"""Every place where orip removes, renames or makes a file goes through `own_files`, or is listed here."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import orip

PACKAGE = Path(orip.__file__).parent

_METHODS = {
    "unlink", "rmdir", "rename", "renames", "mkdir", "makedirs", "touch", "symlink_to", "hardlink_to", "link_to",
    "write_text", "write_bytes", "removedirs", "truncate", "mknod", "mkfifo", "chmod", "chown", "tofile", "connect",
    "save", "savez", "savez_compressed", "savetxt", "savefig", "write_table", "to_csv", "to_parquet", "write_html",
}  # fmt: skip
_MODULES = {"shutil", "tempfile"}
_OF_OS = {"replace", "remove", "link", "symlink", "open", "truncate", "rename", "unlink", "rmdir", "mkdir"}
_HARMLESS = {"shutil.which", "shutil.get_terminal_size", "tempfile.gettempdir"}

OWN_FILES = "files/text/own_files.py"

ALLOWED = {
    ("files/text/atomic.py", "chmod"): "the new file has the permissions of the old one, before it takes its name",
    ("files/text/atomic.py", "os.open"): "a folder is opened to be brought to the disk",
    ("files/text/regular_file.py", "os.open"): "for reading",
    ("files/stores/transaction.py", "connect"): "after `require_own_store`",
    ("files/stores/joint_commit.py", "connect"): "in memory, and by what `transaction` hands in",
    ("workflow/adjust/results.py", "savez_compressed"): "in memory",
    ("exchange/colmap/model.py", "connect"): "read only, and immutable",
    ("files/maps/layers.py", "connect"): "in memory",
    ("files/result/residuals.py", "open for writing"): "in memory",
    ("archive/cluster/sub_block_files.py", "savez"): "into a `new_file`",
    ("archive/results.py", "write_table"): "in memory",
    ("files/result/residuals.py", "savez_compressed"): "in memory",
    ("exchange/project/imported.py", "tempfile.TemporaryDirectory"): "in the system's folder for them",
    ("exchange/project/imported.py", "write_text"): "in the system's folder for temporary files",
    ("web/access.py", "mkdir"): "in a folder of the user that nobody else may read",
    ("web/access.py", "os.open"): "in a folder of the user that nobody else may read",
    ("web/access.py", "replace"): "in a folder of the user that nobody else may read",
    ("web/access.py", "unlink"): "in a folder of the user that nobody else may read",
    ("web/serving.py", "unlink"): "in a folder of the user that nobody else may read",
    ("images/image_files.py", "save"): "a picture into memory",
    ("archive/cluster/connection.py", "mkdir"): "in the system's folder for temporary files",
    ("archive/cluster/connection.py", "tempfile.mkdtemp"): "in the system's folder for temporary files",
    ("archive/cluster/worker_tasks.py", "os.open"): "for reading",
    ("set_aside.py", "tempfile.TemporaryFile"): "a file without a name",
    ("set_aside.py", "tofile"): "into the file without a name",
    ("stations/gnss/raw_files.py", "tempfile.TemporaryDirectory"): "in the system's folder for temporary files",
    ("stations/gnss/raw_files.py", "write_bytes"): "in the system's folder for temporary files",
    ("stations/gnss/rtklib.py", "tempfile.TemporaryDirectory"): "in the system's folder for temporary files",
    ("stations/gnss/rtklib.py", "write_bytes"): "in the system's folder for temporary files",
    ("stations/gnss/rtklib.py", "write_text"): "in the system's folder for temporary files",
    ("workflow/adjust/report.py", "tempfile.TemporaryDirectory"): "in the system's folder for them",
    ("workflow/adjust/report.py", "write_text"): "in the system's folder for temporary files",
    ("archive/fork_server.py", "tempfile.TemporaryDirectory"): "in the system's folder for them",
    ("archive/task.py", "write_text"): "/proc/self/clear_refs",
    ("archive/fork_server.py", "os.open"): "/dev/null",
    ("cli/terminal.py", "os.open"): "/dev/null",
    ("cli/main.py", "open for writing"): "/dev/null",
    ("report/templates.py", "tempfile.mkstemp"): "beside orip's own compiled modules",
    ("report/templates.py", "chmod"): "beside orip's own compiled modules",
    ("report/templates.py", "os.replace"): "beside orip's own compiled modules",
    ("schemas/generate.py", "mkdir"): "run by those who change orip, in orip's own folder",
    ("schemas/generate.py", "write_text"): "run by those who change orip, in orip's own folder",
}


def test_every_place_that_changes_files_is_known() -> None:
    places = list(_places())
    found = {(path, name) for path, name, _ in places}
    unknown = [f"{path}:{line}: {name}" for path, name, line in places if (path, name) not in ALLOWED]
    assert not unknown, "go through orip.files.text.own_files or orip.files.text.atomic: " + ", ".join(unknown)
    assert not ALLOWED.keys() - found, "no longer there"


def test_the_search_finds_every_way_to_change_a_file() -> None:
    ways = {
        "path.unlink()": "unlink",
        "path.replace(other)": "replace",
        "os.replace(a, b)": "os.replace",
        "shutil.rmtree(a)": "shutil.rmtree",
        "rmtree(a)": "shutil.rmtree",
        "TemporaryDirectory()": "tempfile.TemporaryDirectory",
        "open(a, 'w')": "open for writing",
        "path.open(mode='r+b')": "open for writing",
        "path.open('xb')": "open for writing",
        "path.open(mode)": "open for writing",
        "sqlite3.connect(a)": "connect",
    }
    head = "from shutil import rmtree\nfrom tempfile import TemporaryDirectory\n"
    for way, name in ways.items():
        assert [found for found, _ in _changes(ast.parse(head + way))] == [name], way
    for harmless in ("text.replace('a', 'b')", "path.open('rb')", "open(a)", "replace(record, name='a')"):
        assert not list(_changes(ast.parse(harmless))), harmless


def _places() -> Iterator[tuple[str, str, int]]:
    methods = "|".join({*_METHODS, *_OF_OS})
    some_change = re.compile(rf"\.({methods})\(|\bopen\(|\b({'|'.join(_MODULES)})\b|\bfrom os import\b")
    for path in sorted(PACKAGE.rglob("*.py")):
        name, text = path.relative_to(PACKAGE).as_posix(), path.read_text(encoding="utf-8")
        if name != OWN_FILES and some_change.search(text):
            for change, line in _changes(ast.parse(text)):
                yield name, change, line


def _changes(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Yield what may change files, and the line."""
    nodes = list(ast.walk(tree))
    imported = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom) and node.module in {*_MODULES, "os"}
        for alias in node.names
    }
    for node in nodes:
        if isinstance(node, ast.Call):
            name = _change(node, imported)
            if name is not None and name not in _HARMLESS:
                yield name, node.lineno


def _change(call: ast.Call, imported: dict[str, str]) -> str | None:
    function = call.func
    if isinstance(function, ast.Name):
        if function.id == "open":
            return _opening(call, 1)
        name = imported.get(function.id, "")
        return name if name.partition(".")[0] in _MODULES or name.removeprefix("os.") in _OF_OS else None
    if not isinstance(function, ast.Attribute):
        return None
    owner = function.value.id if isinstance(function.value, ast.Name) else ""
    if owner in _MODULES:
        return f"{owner}.{function.attr}"
    if owner == "os" and function.attr in _OF_OS:
        return f"os.{function.attr}"
    if function.attr == "open":
        return _opening(call, 1 if owner in ("io", "gzip", "zipfile") else 0)
    if function.attr == "replace" and len(call.args) == 1 and not call.keywords:
        return "replace"
    return function.attr if function.attr in _METHODS else None


def _opening(call: ast.Call, place: int) -> str | None:
    """Tell whether a file is opened for writing, or may be."""
    given = [word.value for word in call.keywords if word.arg == "mode"] + call.args[place : place + 1]
    if not given:
        return None
    mode = given[0]
    if isinstance(mode, ast.Constant) and isinstance(mode.value, str):
        return "open for writing" if set(mode.value) & set("wax+") else None
    return "open for writing"
