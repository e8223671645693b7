"""Values of the command line that need no conversion: texts, paths that can be read, and whatever is not given.

typer converts and checks the others with pydantic, which takes longer to load than `orip status` takes to answer.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

Parameter = TyperArgument | TyperOption

_OF_TYPER = ("get_runtime_param", "type_descriptor")
"""What typer converts by. It is not documented, and another version may have other names."""


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
        """Return the value; typer raises what is wrong with it."""
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        if self._kind is str and isinstance(value, str):
            return value
        if self._kind is Path and isinstance(value, str | Path) and _can_be_read(value):
            return Path(value)
        if self._kind == list[str] and all(isinstance(item, str) for item in value):
            return list(value)
        return self._typers().coerce(value, param=param, ctx=ctx)


def _can_be_read(path: str | Path) -> bool:
    """Tell whether a path is one of those of which typer finds nothing wrong: none of orip's has to exist."""
    return os.access(path, os.R_OK) or not os.path.exists(path)  # noqa: PTH110  # as typer asks


def convert_at_once(parameters: Any) -> Any:
    """Return parameters, of which typer converts only those values that need it; all, where typer does so otherwise."""
    for parameter in parameters:
        if isinstance(parameter, Parameter) and _is_converted_by_typer(parameter):
            conversion = Conversion(parameter.get_runtime_param, parameter.type_descriptor.annotation)
            parameter.get_runtime_param = partial(_itself, conversion)  # type: ignore[method-assign]
    return parameters


def _is_converted_by_typer(parameter: Parameter) -> bool:
    has_names = all(hasattr(parameter, name) for name in _OF_TYPER)
    return has_names and "get_runtime_param" not in vars(parameter)


def _itself(conversion: Conversion) -> Any:
    """Return what stands for typer's own conversion."""
    return conversion


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
