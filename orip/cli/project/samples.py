"""What `orip init` prints about projects that it has made, samples or new ones."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from orip.cli.terminal import Terminal

if TYPE_CHECKING:
    from orip.workflow.sample_projects import ProjectMade, SampleWritten


def list_samples(terminal: Terminal) -> None:
    """Print the samples, one a line, and what to write."""
    from orip.workflow.sample_projects import SAMPLES

    if terminal.json:
        rows = [{"name": name, "text": text} for name, text in SAMPLES.items()]
        terminal.document("samples", {"command": "init", "samples": rows})
        return
    width = max(map(len, SAMPLES))
    for name, text in SAMPLES.items():
        terminal.data(f"{name:{width}}  {text}")
    terminal.say("write one with: orip init --sample NAME DIR")


def tell_sample(terminal: Terminal, written: SampleWritten) -> None:
    """Say what was written, and the command that comes next."""
    terminal.say(f"wrote    {written.folder}: {', '.join(written.files)}")
    next_command = f"orip{_option(written.folder)} run"
    terminal.say(f"next     {next_command}", "bold")
    if terminal.json:
        terminal.document(
            "sample-written",
            {
                "command": "init",
                "sample": written.name,
                "folder": str(written.folder),
                "files": list(written.files),
                "next": next_command,
            },
        )


def tell_made(terminal: Terminal, made: ProjectMade) -> None:
    """Say which project was made, and the command that comes next."""
    next_command = f"orip{_option(made.folder)} {made.next}"
    terminal.say(f"wrote    {made.folder / 'orip.toml'}: project {made.name}")
    if len(made.files) > 1:
        terminal.say(f"         and {', '.join(name for name in made.files if name != 'orip.toml')}: fill them in")
    terminal.say(f"next     {next_command}", "bold")
    if terminal.json:
        terminal.document(
            "project-made",
            {
                "command": "init" if len(made.files) == 1 else "new",
                "project": made.name,
                "folder": str(made.folder),
                "files": list(made.files),
                "next": next_command,
            },
        )


def _option(folder: Path) -> str:
    """Return the option that names the project folder, as a shell wants it; none where the user is in it."""
    if folder == Path():
        return ""
    return f" -C {shlex.quote(str(folder)) if os.name == 'posix' else folder}"
