"""Words of the command line that need no conversion: typer would load pydantic to convert them all the same.

That takes as long as everything else that a quick command does.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from typer.core import TyperCommand, TyperGroup


class PlainCommand(TyperCommand):
    """A command that takes texts, and options that are not given, as they are."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters."""
        return _with_plain_values(super().get_params(ctx))


class PlainGroup(TyperGroup):
    """A group of commands that takes texts, and options that are not given, as they are."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters."""
        return _with_plain_values(super().get_params(ctx))


def _with_plain_values(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if "process_value" not in vars(parameter):
            parameter.process_value = partial(_processed, parameter, parameter.process_value)
    return parameters


def _processed(parameter: Any, convert: Callable[[Any, Any], Any], context: Any, value: Any) -> Any:
    takes_several = parameter.multiple or parameter.nargs != 1
    if value is None and not parameter.required:
        value = () if takes_several else None
    elif takes_several or not type(value) is str is parameter.type_descriptor.annotation:
        return convert(context, value)
    return value if parameter.callback is None else parameter.callback(context, parameter, value)
