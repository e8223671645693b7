"""A reader who does what a page says: writes its files, runs its commands, and looks whether they print the same."""

from __future__ import annotations

import io
import os
import re
import shlex
import socket
import subprocess
import sys
import traceback
from contextlib import chdir, redirect_stdout
from pathlib import Path
from unittest.mock import patch

from cli.command_line import commands_put_together_once
from documentation.pages import Step

from orip.cli.main import main

PORT = "4788"
"""The port of the pages, which is the program's default; the reader takes a free one in its place."""

MARGIN = 9
"""Where messages begin, behind the word that says what they are about."""

SHELL_WORDS = re.compile(r"[|<>&;*`$]")
"""A command with one of these is given to the shell."""


class Reader:
    """Does the steps of a page in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.exit_code = 0
        self.printed = ""
        self._names: dict[str, object] = {"__name__": "__main__"}
        self._servers: list[subprocess.Popen[str]] = []
        self._port = _free_port()
        self._variables = {
            "NO_COLOR": "1", "COLUMNS": "120", "ORIP_LINK": f"tcp://127.0.0.1:{self._port}",
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        }  # fmt: skip

    def do(self, step: Step) -> str:
        """Write the file of a step, or run its command or statement; return what it printed."""
        self.printed = self._do(step).replace(f":{self._port}", f":{PORT}")  # the digits alone may be those of a figure
        return self.printed

    def _do(self, step: Step) -> str:
        if step.file:
            path = self.folder / step.file
            path.parent.mkdir(exist_ok=True)
            path.write_text(step.text.replace(PORT, self._port), encoding="utf-8")
            return ""
        if step.statement:
            return self._python(step)
        command = step.command.replace(PORT, self._port)
        if command == "echo $?":
            printed, self.exit_code = f"{self.exit_code}\n", 0
            return printed
        assert self.exit_code == 0, f"line {step.line}: exit code {self.exit_code} of what came before\n{self.printed}"
        if command.startswith("cd "):
            self.folder = (self.folder / command.removeprefix("cd ")).resolve()
            return ""
        if command.endswith(" &"):
            return self._serve(command.removesuffix(" &"))
        if command.startswith("orip ") and not SHELL_WORDS.search(re.sub(r"'[^']*'", "", command)):
            self.exit_code, printed = orip(self.folder, shlex.split(command)[1:], self._variables)
        else:
            self.exit_code, printed = self._shell(command)
        return printed

    def leave(self) -> None:
        """End what runs in the background."""
        for server in self._servers:
            server.terminate()
            server.communicate(timeout=20)

    def _python(self, step: Step) -> str:
        """Run a statement as an interactive Python would; of an error only its kind and message are printed."""
        stream = io.StringIO()
        with redirect_stdout(stream), chdir(self.folder), patch.object(sys, "displayhook", sys.__displayhook__):
            try:
                exec(compile(step.statement, f"line {step.line}", "single"), self._names)
            except Exception as error:  # noqa: BLE001
                return "".join(["Traceback (most recent call last):\n", *traceback.format_exception_only(error)])
        return stream.getvalue()

    def _shell(self, command: str) -> tuple[int, str]:
        done = subprocess.run(
            command, shell=True, cwd=self.folder, env={**os.environ, **self._variables}, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=120,
        )  # fmt: skip
        return done.returncode, done.stdout

    def _serve(self, command: str) -> str:
        server = subprocess.Popen(
            [*shlex.split(command), "--listen", f"127.0.0.1:{self._port}"], cwd=self.folder,
            env={**os.environ, **self._variables}, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self._servers.append(server)
        assert server.stdout is not None
        return server.stdout.readline()


def orip(folder: Path, arguments: list[str], variables: dict[str, str]) -> tuple[int, str]:
    """Run the program in this process; return its exit code and what it printed on either stream."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
    before = Path.cwd()
    os.chdir(folder)
    try:
        with (
            patch.multiple(sys, argv=["orip", *arguments], stdout=stream, stderr=stream),
            patch.dict(os.environ, variables),
            commands_put_together_once(),
        ):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        os.chdir(before)
    return code, stream.buffer.getvalue().decode("utf-8")  # type: ignore[attr-defined]


def agrees(expected: tuple[str, ...], printed: str) -> bool:
    """Tell whether a text is what a page shows of it."""
    pattern = "".join(map(_line_pattern, _unbroken("\n".join(expected)).splitlines()))
    text = _unbroken(printed)
    return re.fullmatch(pattern, text if text.endswith("\n") or not text else text + "\n") is not None


def _line_pattern(line: str) -> str:
    if line.strip() == "...":
        return r"(?:.*\n)*?"
    pattern = r".*?".join(map(re.escape, line.rstrip().split("...")))
    # columns are as wide as their longest number, and its last digits are rounding: another processor, another library
    pattern = re.sub(r"(?:\\ ){2,}", r"\\ +", pattern)
    pattern = re.sub(r"(?:\\-){3,}", "-+", pattern)
    return re.sub(r"(\d\\.\d{3})\d+(?=e\\?[-+]\d)", r"\1\\d+", pattern) + r" *\n"


def _unbroken(text: str) -> str:
    """Return a text with the parts of messages, which begin below their first word, in one line."""
    return re.sub(rf"\n {{{MARGIN}}}(?! )", " ", text)


def _free_port() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])
