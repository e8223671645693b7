"""Options of every command, help, streams, and what importing the command line does not import."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from cli.command_line import orip

from orip.cli.conversion import convert_at_once
from orip.cli.main import app
from orip.cli.options import SharedOptions

COMMANDS = sorted(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("before", "after", "merged"),
    [
        ({}, {}, ("auto", None)),
        ({"color": "never"}, {"threads": 2}, ("never", 2)),
        ({"color": "never"}, {"color": "always"}, ("always", None)),
        ({"color": "always"}, {"color": "auto"}, ("auto", None)),
        ({"threads": 2}, {"threads": 1}, ("auto", 1)),
        ({"threads": 2}, {}, ("auto", 2)),
    ],
)
def test_options_of_both_places_combine(before: dict, after: dict, merged: tuple) -> None:  # type: ignore[type-arg]
    terminal = SharedOptions(**before).then(SharedOptions(**after)).terminal()
    assert (terminal.color, terminal.threads) == merged


@pytest.mark.parametrize("option", ["--json", "--quiet", "--verbose", "--color=always", "--threads=2"])
def test_shared_options_before_and_after_mean_the_same(project: Path, option: str) -> None:
    before, after = orip(project, option, "init"), orip(project, "init", option)
    assert before.code == after.code == 0
    again = orip(project, option, "init")
    assert (again.out, again.err) == (after.out, after.err)


@pytest.mark.parametrize("words", [("run", "-C", "x"), ("camera", "list", "-C", "x"), ("solve", "--project", "x")])
def test_a_folder_after_the_command_is_told_where_it_stands(project: Path, words: tuple[str, ...]) -> None:
    said = orip(project, *words)
    assert said.code == 2
    command = " ".join(word for word in words if word not in ("-C", "--project", "x"))
    assert f"write orip -C DIR {command}; see 'orip {command} --help'" in said.err


def test_quiet_verbose_and_color(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert orip(project, "run", "-q").err == ""
    assert "read FIRST.MEA" in orip(project, "-v", "measure").err
    assert "\x1b[" not in orip(project, "run").out
    assert "\x1b[1mstatus" in orip(project, "--color", "always", "run").out
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[1mstatus" in orip(project, "run", "--color", "always").out, "asked for on the command line"


def test_files_are_named_as_from_inside_the_project(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    folder = Path(os.path.relpath(project))
    assert orip(folder, "run", "-q").code == 0
    for words, file in (
        ("report", "made.html"),
        ("export-toml", "made.toml"),
        ("results residuals", "made.csv"),
        ("results covariance", "made.npz"),
        ("observations todo", "made.txt"),
    ):
        said = orip(folder, *words.split(), "--output", file)
        assert said.code == 0, said.err
        assert (project / file).is_file()
    assert not list(elsewhere.iterdir())


@pytest.mark.parametrize("command", ["run", "init", "measure", "solve", "report", "status", "check"])
def test_a_folder_without_a_project(tmp_path: Path, command: str) -> None:
    said = orip(tmp_path, command)
    assert said.code != 0
    assert "go to the project's folder, name it with -C DIR, or begin with a sample" in said.err


def test_a_project_in_the_folder_is_named(tmp_path: Path) -> None:
    assert orip(tmp_path, "init", "cliff").code == 0
    assert "this is not an orip project, but cliff in it is; go to the project's folder" in orip(tmp_path, "run").err
    (inner := tmp_path / "cliff" / "pictures").mkdir()
    assert f"this is not an orip project, but {tmp_path / 'cliff'} is, around it; go to" in orip(inner, "run").err


def test_folders_that_are_no_names_and_folders_that_refuse(project: Path, tmp_path: Path) -> None:
    said = orip(tmp_path, "new", "survey/QUARRY")
    assert (said.code, said.err) == (
        2, "error: 'survey/QUARRY' is a folder: write the project's name before it, 'orip new QUARRY survey/QUARRY'\n"
    )  # fmt: skip
    said = orip(project, "init", "--sample", "small_frame_block", "FIRST.PNT/cliff")
    assert said.code == 1
    assert f"{project / 'FIRST.PNT'}; check its permissions and the disk, or choose another folder" in said.err


def test_sources_that_are_none(project: Path) -> None:
    said = orip(project, "import", "agisoft", "x", "y")
    assert said.err.startswith("error: there is no format 'agisoft'; known are: colmap, ")
    assert "agisoft', nor a format 'agisoft'; name the file" in orip(project, "import", "agisoft", "x").err
    said = orip(project.parent, "import", project.name)
    assert f"{project} is a project of orip, not of another program: adjust it with 'orip -C" in said.err


@pytest.mark.parametrize("name", ["Orip.toml", "orip.toml.txt"])
def test_a_project_file_under_another_name_is_named(project: Path, name: str) -> None:
    (project / "orip.toml").rename(project / name)
    said = orip(project, "run")
    assert said.code == 3
    assert said.err == f"error: {name}: this file is not read: the project's file is called orip.toml; rename it\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(project: Path, command: str) -> None:
    said = orip(project, command, "--help")
    assert said.code == 0
    assert "Example: orip " in said.out


def test_program_help_names_every_command(project: Path) -> None:
    said = orip(project, "--help")
    assert said.code == 0
    for command in COMMANDS:
        assert f" {command} " in said.out


def every_command(tree: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the words of every command and group with it."""
    yield words, tree
    context = typer.Context(tree)
    for name in tree.list_commands(context) if hasattr(tree, "list_commands") else ():
        yield from every_command(tree.get_command(context, name), (*words, name))


@pytest.mark.parametrize("columns", ["40", "80"])
def test_nothing_is_cut_off_in_any_help(project: Path, monkeypatch: pytest.MonkeyPatch, columns: str) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    found = list(every_command(typer.main.get_command(app)))
    assert len(found) > 60
    for words, command in found:
        text = orip(project, *words, "--help").out
        assert "…" not in text
        assert not re.search(r"\w\.\.\.$", text, re.MULTILINE), f"orip {' '.join(words)}: a sentence is cut off"
        for option in (name for parameter in command.params for name in parameter.opts if name.startswith("--")):
            assert option in text


def test_version(project: Path) -> None:
    assert orip(project, "--version").out.startswith("orip ")


SLOW = {"scipy", "pyproj", "pydantic", "pandas", "pyarrow", "threadpoolctl"}
"""Packages that take a tenth of a second and more to import; benchmarks/startup.py measures it."""


def modules_after(statements: str, folder: Path) -> set[str]:
    """Return the modules that Python has loaded after some statements."""
    program = f"{statements}; import sys, json; print(json.dumps(sorted(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, cwd=folder).stdout
    return set(json.loads(said.splitlines()[-1]))


def test_the_command_line_imports_nothing_slow(project: Path) -> None:
    # 'orip --help' has to answer at once
    assert not {*SLOW, "numpy", "sqlite3"} & modules_after("import orip.cli.main", project)


def test_status_imports_nothing_that_computes(project: Path) -> None:
    orip(project, "run")
    statements = "from orip.cli.main import app; app(['-C', '.', 'status'], standalone_mode=False)"
    found = modules_after(statements, project)
    assert "orip.workflow.status" in found
    computing = {"orip.bundle", "orip.prelim", "orip.mistakes", "orip.interior.replay", "orip.interior.orientation"}
    assert not {*SLOW, *computing, "numpy"} & found


@pytest.fixture(scope="module")
def solved_block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block with models and their drive table, of which `status` tells whether it is up to date."""
    folder = tmp_path_factory.mktemp("solved") / "block"
    assert orip(folder.parent, "init", "--sample", "small_frame_block", str(folder)).code == 0
    assert orip(folder, "run", "--no-report").code == 0
    return folder


@pytest.mark.parametrize("words", [["status"], ["measure"], ["compare", "result.json", "result.json"]])
def test_commands_that_adjust_nothing_load_nothing_that_does(solved_block: Path, words: list[str]) -> None:
    statements = f"from orip.cli.main import app; app(['-C', '.', *{words}], standalone_mode=False)"
    found = modules_after(statements, solved_block)
    assert not {"orip.adjustment", "orip.bundle.problem", "orip.prelim", "scipy.sparse", "scipy.linalg"} & found


def test_run_imports_neither_what_converts_words_nor_parts_of_libraries_that_small_blocks_do_without(
    project: Path,
) -> None:
    program = "from orip.__main__ import main\ntry: main()\nexcept SystemExit: pass\n"
    found = modules_after(f"import sys; sys.argv[1:] = ['-C', '.', 'run']; exec({program!r})", project)
    assert {"scipy.sparse", "scipy.linalg.lapack", "scipy.special._ufuncs"} <= found
    assert not {"pydantic", "numpy.f2py", "numpy.testing", "numpy.polynomial"} & found
    assert not {"scipy.linalg._basic", "scipy.special._basic", "scipy.spatial", "scipy.sparse.csgraph"} & found


IN_PARTS = "from orip.__main__ import _IN_PARTS; import orip.waiting_modules as w; w.load_in_parts(_IN_PARTS)"


def test_modules_of_a_package_are_loaded_alone(tmp_path: Path) -> None:
    found = modules_after(f"{IN_PARTS}; from scipy.linalg import lapack; from scipy.special import gammaincc", tmp_path)
    assert {"scipy.linalg.lapack", "scipy.special._ufuncs"} <= found
    assert not {"scipy.linalg._basic", "scipy.special._basic"} & found


def test_all_of_a_package_is_there_after_one_of_its_modules(tmp_path: Path) -> None:
    asked = (
        "from scipy.linalg import lapack; from scipy.sparse.linalg import LinearOperator; from scipy.linalg import inv"
    )
    assert "scipy.linalg._basic" in modules_after(f"{IN_PARTS}; {asked}, get_lapack_funcs", tmp_path)


def test_the_order_of_a_band_needs_no_other_graphs(tmp_path: Path) -> None:
    asked = "from scipy.sparse.csgraph import reverse_cuthill_mckee as order; from scipy.sparse import csr_array as a"
    found = modules_after(f"{IN_PARTS}; {asked}; order(a([[0, 1.0], [1.0, 0]]), symmetric_mode=True)", tmp_path)
    assert not {"scipy.sparse.csgraph._laplacian", "scipy.sparse.linalg", "scipy.linalg._basic"} & found
    asked = "from scipy.sparse.csgraph import reverse_cuthill_mckee, shortest_path"
    assert "scipy.sparse.csgraph._laplacian" in modules_after(f"{IN_PARTS}; {asked}", tmp_path)


@pytest.mark.parametrize(
    "asked",
    [
        "from scipy.special import factorial; assert factorial(3) == 6",
        "import scipy.special; assert 'factorial' in dir(scipy.special) and scipy.special.factorial(3) == 6",
        "from scipy.special import *; assert factorial(3) == 6",
        "from scipy import special; assert special.gammaincc(1, 0) == 1; assert special.factorial(3) == 6",
        "import scipy.special as s; assert not hasattr(s, 'what_it_has_not') and not hasattr(s, '__what__')",
    ],
)
def test_what_else_is_asked_of_a_package_is_there(asked: str, tmp_path: Path) -> None:
    assert "scipy.special._basic" in modules_after(f"{IN_PARTS}; {asked}", tmp_path)


def test_threads_find_all_of_a_package_that_one_of_them_loads(tmp_path: Path) -> None:
    asked = "from concurrent.futures import ThreadPoolExecutor as Pool; import scipy.linalg as s"
    each = (
        "list(Pool(8).map(lambda name: getattr(s, name), ['qr', 'inv', 'solve_triangular', 'eigh', 'svd', 'rq'] * 4))"
    )
    assert "scipy.linalg._basic" in modules_after(f"{IN_PARTS}; {asked}; {each}", tmp_path)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (str, "x"),
        (str, ""),
        (Path, "x/y"),
        (Path, ""),
        (Path, Path()),
        (list[str], ("a", "b")),
        (int, "2"),
        (int, "-3"),
        (int, 4),
        (float, "1e-3"),
        (float, 2.5),
        (list[int], ("1", "2")),
        (list[Path], ("x", "y/z")),
    ],
)
def test_values_are_converted_as_typer_converts_them(kind: Any, value: object) -> None:
    def function(given: object) -> None:
        """Take a value."""

    function.__annotations__["given"] = kind
    program = typer.Typer(add_completion=False)
    program.command()(function)
    command = typer.main.get_command(program)
    (parameter,) = (one for one in command.params if one.name == "given")
    context = typer.Context(command)
    expected = parameter.process_value(context, value)
    convert_at_once([parameter])
    assert parameter.process_value(context, value) == expected


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("--threads 0 status", "'0' is not a whole number of 1 or more"),
        ("--threads 1.5 status", "'1.5' is not a whole number of 1 or more"),
        ("solve --alpha 2", "'2' is not a number from 1e-09 to 0.5"),
        ("solve --alpha 0,01", "'0,01' is not a number from 1e-09 to 0.5"),
        ("drive goto 1 nan 3", "'nan' is not a number;"),
        ("prelim connect 1 b", "'b' is not a whole number;"),
    ],
)
def test_a_number_that_is_none_or_beyond_its_limits_is_refused(project: Path, words: str, found: str) -> None:
    said = orip(project, *words.split())
    assert said.code == 2
    assert said.err.startswith("error: Invalid value for ")
    assert found in said.err


def test_help_names_values_in_words_of_users() -> None:
    context = typer.Context(typer.main.get_command(app))
    of_python = re.compile(r"\b(str|int|float|list|path)\b( range)?[>\]]")
    for words, command in every_command(typer.main.get_command(app)):
        for parameter in command.get_params(context):
            shown, _ = parameter.get_help_record(context)
            assert not of_python.search(shown), f"orip {' '.join(words)}: {shown}"


def test_typer_converts_where_it_does_so_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    (option,) = (one for one in typer.main.get_command(app).params if one.name == "threads")
    monkeypatch.setattr("orip.cli.conversion._OF_TYPER", ("what_no_version_has",))
    before = dict(vars(option))
    assert convert_at_once([option]) == [option]
    assert vars(option) == before


def test_a_reader_that_has_seen_enough_is_no_error(project: Path) -> None:
    orip(project, "run")
    command = f"'{sys.executable}' -m orip.cli.main -C '{project}'"
    code = "echo ${PIPESTATUS[0]}"
    script = f"{command} dump FIRST.EXT | head -1; {code}; {command} run 2>&1 >&- | head -1; {code}"
    said = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[1] == "0"
    assert said.stdout.splitlines()[3] == "0"
    assert said.stderr == ""


@pytest.mark.skipif(os.name != "posix", reason="the shell closes its input")
def test_a_closed_stdin_is_an_empty_one(tmp_path: Path) -> None:
    script = f"'{sys.executable}' -m orip.cli.main -C '{tmp_path}' new QUARRY <&-"
    said = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert (tmp_path / "QUARRY" / "orip.toml").is_file(), "what is not asked has its default"


def test_closed_and_full_stdout(project: Path) -> None:
    command = f"'{sys.executable}' -m orip.cli.main -C '{project}'"
    words = ("status >&-", "status --json > /dev/full", "--help > /dev/full")
    script = "; ".join(f"{command} {word}; echo $?" for word in words)
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    said = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["0", "1", "1"]
    sentence = "error: the output cannot be written: No space left on device; send it to another file or disk"
    assert said.stderr.splitlines() == [sentence, sentence]
