"""Values of the command line, converted without a library; and asking before what cannot be undone."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_origin

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from orip.errors import UsageError
from orip.files.text.shown import visible

# typer converts and checks the others with pydantic, which takes longer to load than `orip status` takes to answer.

Parameter = TyperArgument | TyperOption

_OF_TYPER = ("get_runtime_param", "type_descriptor", "display_type")
"""What typer converts and describes by. It is not documented, and another version may have other names."""

_NUMBERS: dict[Any, str] = {int: "a whole number", float: "a number"}
"""Kinds of numbers, as they are named where a value is none."""

_PLACEHOLDERS: dict[Any, str] = {int: "N", float: "NUMBER", str: "TEXT", Path: "PATH"}
"""What stands for the value of an option in the help, unless the option has a word of its own."""


class Conversion:
    """How the value of a parameter is converted: at once if that is possible, else by typer.

    Parameters
    ----------
    typers : callable
        Returns how typer does it.
    kind : type
        What is wanted.
    """

    def __init__(self, typers: Callable[[], Any], kind: Any) -> None:
        self._typers, self._kind = typers, kind

    def coerce(self, value: Any, param: Parameter, ctx: Any) -> Any:
        """Return the value.

        Raises
        ------
        typer.BadParameter
            With what was found, and what is allowed.
        """
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        is_list = get_origin(self._kind) is list
        (kind,) = get_args(self._kind) if is_list else (self._kind,)
        values = value if is_list else [value]
        if not all(_is_simple(kind, one) for one in values):
            return self._typers().coerce(value, param=param, ctx=ctx)
        converted = [_number(kind, one, param, ctx) if kind in _NUMBERS else kind(one) for one in values]
        return converted if is_list else converted[0]


def _is_simple(kind: Any, value: Any) -> bool:
    """Tell whether a value is converted here."""
    if kind is Path:
        return isinstance(value, str | Path) and _can_be_read(value)
    return (kind is str and isinstance(value, str)) or (kind in _NUMBERS and isinstance(value, str | int | float))


def _can_be_read(path: str | Path) -> bool:
    """Tell whether a path is one of those of which typer finds nothing wrong: none of orip's has to exist."""
    return os.access(path, os.R_OK) or not os.path.exists(path)  # noqa: PTH110  # as typer asks


def _number(kind: type[int | float], value: str | float, param: Parameter, ctx: Any) -> float:
    """Return a number that is finite and within the limits of its parameter."""
    limits = param.type_descriptor.parameter_info
    low = -math.inf if limits.min is None else limits.min
    high = math.inf if limits.max is None else limits.max
    try:
        number = kind(value)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and low <= number <= high):
        message = f"'{value}' is not {_NUMBERS[kind]}{_within(low, high)}"
        raise typer.BadParameter(message, ctx=ctx, param=param)
    return number


def _within(low: float, high: float) -> str:
    """Return the limits of a number in words; nothing, where there are none."""
    if math.isinf(low):
        return "" if math.isinf(high) else f" of {high:g} or less"
    return f" of {low:g} or more" if math.isinf(high) else f" from {low:g} to {high:g}"


def convert_at_once(parameters: Any) -> Any:
    """Return parameters, of which typer converts only those values that need it; all, where typer does so otherwise."""
    for parameter in parameters:
        if isinstance(parameter, Parameter) and _is_converted_by_typer(parameter):
            conversion = Conversion(parameter.get_runtime_param, parameter.type_descriptor.annotation)
            parameter.get_runtime_param = partial(_itself, conversion)  # type: ignore[method-assign]
            if not parameter.type_descriptor.is_choice:
                parameter.display_type = partial(_placeholder, parameter)  # type: ignore[method-assign]
    return parameters


def _is_converted_by_typer(parameter: Parameter) -> bool:
    has_names = all(hasattr(parameter, name) for name in _OF_TYPER)
    return has_names and "get_runtime_param" not in vars(parameter)


def _itself(conversion: Conversion) -> Any:
    """Return what stands for typer's own conversion."""
    return conversion


def _placeholder(parameter: Parameter, ctx: Any) -> str:  # noqa: ARG001  # typer passes it by name
    """Return the word for a value in the help; none after the name of an argument, which is such a word itself."""
    if isinstance(parameter, TyperArgument):
        return ""
    kind: Any = parameter.type_descriptor.annotation
    (kind,) = get_args(kind) if get_origin(kind) is list else (kind,)
    return _PLACEHOLDERS.get(kind, "VALUE")


class Command(TyperCommand):
    """A command whose values are converted at once where that is possible."""

    def get_params(self, ctx: Any) -> Any:
        """Return the parameters, that for help among them."""
        return convert_at_once(super().get_params(ctx))


class Group(TyperGroup):
    """A group of commands whose values are converted at once where that is possible."""

    def get_params(self, ctx: Any) -> Any:
        """Return the parameters, that for help among them."""
        return convert_at_once(super().get_params(ctx))


def require_confirmation(question: str, yes: bool) -> None:
    """Go on if the user has agreed in advance (``--yes``) or agrees on the terminal.

    Raises
    ------
    UsageError
        If there is nobody to ask, as in a script.
    typer.Abort
        If the answer is no.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        message = f"{question} Say so with --yes"
        raise UsageError(message)
    typer.confirm(visible(question), abort=True, err=True)
