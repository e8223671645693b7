"""What `orip --help` lists without loading it is what the commands say of themselves."""

from __future__ import annotations

from importlib import import_module

import pytest
import typer
from typer.main import get_command, get_group

from orip.annexes import COMMANDS as COMMANDS_OF_ANNEXES
from orip.cli.main import COMMANDS, app


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_the_text_that_is_listed(name: str) -> None:
    found = get_command(app).commands[name]  # type: ignore[attr-defined]
    assert (found.name, found.get_short_help_str(1000)) == (name, COMMANDS[name].text)


def test_all_that_modules_register_is_listed() -> None:
    registered = set()
    for name, listed in COMMANDS.items():
        part = typer.Typer()
        for module in [f"orip.cli.{module}" for module in listed.modules] or [COMMANDS_OF_ANNEXES[name]]:
            import_module(module).register(part)
        registered |= set(get_group(part).commands)
    assert registered == set(COMMANDS)
