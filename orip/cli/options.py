"""Options that commands share, groups of commands registered when asked for, and what edits have in common."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias, TypeVar, get_type_hints

import msgspec
import typer
from msgspec import Struct
from typer.main import get_group

from orip.cli.completion import bundles
from orip.cli.conversion import Command, Group
from orip.cli.exits import NOTHING_WRITTEN, exit_on_error
from orip.cli.terminal import ColorChoice, Terminal, warning_rows

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print more of what is done.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
Color = Annotated[
    ColorChoice | None, typer.Option("--color", help="Colour: auto (default; on a terminal), always, never.")
]
Threads = Annotated[
    int | None,
    typer.Option(
        "--threads",
        min=1,
        help="Threads of an adjustment (default: OMP_NUM_THREADS, or as many as there are processors).",
    ),
]

BundleArgument = Annotated[
    str | None,
    typer.Argument(metavar="BUNDLE", autocompletion=bundles, help="Needed only where the project has several."),
]
"""Which bundle, of the commands whose argument it is."""

ForceOption = Annotated[bool, typer.Option("--force", help="Replace a file that is no earlier output of this kind.")]
BundleOption = Annotated[
    str | None,
    typer.Option("--bundle", autocompletion=bundles, help="Needed only where the project has several bundles."),
]
"""Which bundle, of the commands whose arguments are other names."""

LINK_VARIABLE = "ORIP_LINK"
"""The environment variable that names the plate processor for all commands that use one."""

G = TypeVar("G", bound=NamedTuple)


class SharedOptions(NamedTuple):
    """The shared options as given in one place; False and None: not given there."""

    quiet: Quiet = False
    verbose: Verbose = False
    json: Json = False
    color: Color = None
    threads: Threads = None

    def then(self, later: SharedOptions) -> SharedOptions:
        """Return the options of both places; the later one wins."""
        return SharedOptions._make(after or before for before, after in zip(self, later, strict=True))

    def terminal(self) -> Terminal:
        """Return the terminal that they ask for."""
        return Terminal(self.quiet, self.verbose, self.json, self.color or "auto", self.threads)


class Invocation(Struct, frozen=True):
    """What a command gets in addition to its own options: the project folder, the shared options, and how to print."""

    folder: Path
    options: SharedOptions
    terminal: Terminal


def command(
    app: typer.Typer, name: str, *, reads_only: bool = False, without: Collection[str] = (), **settings: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function ``f(invocation, ...)`` as a command that also takes the shared options.

    A parameter that is a named tuple stands for the options that are its fields. Errors of orip end the command with
    their message and exit code; one that only reads does not claim that nothing was written. The parameters named by
    `without` are not offered and keep their defaults: commands on several kinds of records share one function, and not
    all options belong to every kind. Settings are those of typer's commands.
    """
    closing = "" if reads_only else NOTHING_WRITTEN

    def register(function: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(function, eval_str=True)
        signature, defaults = _divided(_with_shared_options(own), without)

        @functools.wraps(function)
        def run(context: typer.Context, **given: Any) -> None:
            given |= defaults
            before: Invocation = context.obj
            options = before.options.then(_taken(SharedOptions, given))
            invocation = Invocation(before.folder, options, options.terminal())
            for name, group in _groups(own):
                given[name] = _taken(group, given)
            with exit_on_error(invocation.terminal, closing), invocation.terminal.progress():
                function(invocation, **given)

        _give_signature(run, signature)
        about = _first_paragraph(inspect.getdoc(function) or "")
        app.command(name, cls=Command, short_help=about, **settings)(run)
        return run

    return register


def group_of_commands(name: str, text: str, cls: type[Group] = Group, **settings: Any) -> typer.Typer:
    """Return a group of commands, with the text that `--help` says of it. Settings are those of typer's groups."""
    about = _first_paragraph(text)
    return typer.Typer(name=name, cls=cls, help=text, short_help=about, rich_markup_mode=None, **settings)


def _first_paragraph(text: str) -> str:
    """Return the first paragraph of a help text: given by itself, lists of commands have it in full."""
    return " ".join(text.partition("\n\n")[0].split())


def without_command(group: typer.Typer) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function ``f(invocation, ...)`` as what a group of commands does when none of them is named."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(context: typer.Context, **given: Any) -> None:
            before: Invocation = context.obj
            options = before.options.then(_taken(SharedOptions, given))
            context.obj = Invocation(before.folder, options, options.terminal())
            if context.invoked_subcommand is None:
                with exit_on_error(context.obj.terminal), context.obj.terminal.progress():
                    function(context.obj, **given)

        _give_signature(run, _with_shared_options(inspect.signature(function, eval_str=True)))
        group.callback(invoke_without_command=True)(run)
        return run

    return register


def _divided(signature: inspect.Signature, without: Collection[str]) -> tuple[inspect.Signature, dict[str, Any]]:
    """Return a signature without some of its parameters, and the defaults of these."""
    offered = [parameter for name, parameter in signature.parameters.items() if name not in without]
    return signature.replace(parameters=offered), {name: signature.parameters[name].default for name in without}


def _give_signature(run: Callable[..., None], signature: inspect.Signature) -> None:
    """Let typer see the parameters of the function that `run` stands for."""
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in signature.parameters.values()}


def _with_shared_options(own: inspect.Signature) -> inspect.Signature:
    """Return the signature for typer: the context in place of the invocation, and the shared options at the end."""
    keyword = inspect.Parameter.KEYWORD_ONLY
    context = inspect.Parameter("context", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
    _session, *parameters = own.parameters.values()
    groups = dict(_groups(own))
    expanded = [context]
    for parameter in parameters:
        if parameter.name in groups:
            expanded += _fields(groups[parameter.name])
        else:
            expanded.append(parameter.replace(kind=keyword))
    return inspect.Signature([*expanded, *_fields(SharedOptions)])


def _groups(own: inspect.Signature) -> Iterator[tuple[str, type[Any]]]:
    """Yield the parameters that stand for several options, with their named tuples."""
    for parameter in own.parameters.values():
        kind = parameter.annotation
        if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
            yield parameter.name, kind


def _fields(group: type[Any]) -> list[inspect.Parameter]:
    """Return the fields of a named tuple of options as parameters."""
    hints = get_type_hints(group, include_extras=True)
    return [
        inspect.Parameter(
            key, inspect.Parameter.KEYWORD_ONLY, default=group._field_defaults[key], annotation=hints[key]
        )
        for key in group._fields
    ]


def _taken(group: type[G], given: dict[str, Any]) -> G:
    """Take the options of a named tuple out of what was given."""
    return group(*(given.pop(key) for key in group._fields))


Registration = Callable[[typer.Typer], None]


def add_group(app: typer.Typer, name: str, text: str, register: Registration, default: str | None = None) -> None:
    """Add a group of commands to a program or another group.

    Parameters
    ----------
    text : str
        What `--help` says of the group.
    register : function of a typer.Typer
        Adds the commands of the group.
    default : str, optional
        The command that is meant where the first word names none.
    """

    class LateGroup(Group):
        """The group of that name; commands that the program added to it are there from the beginning."""

        complete = False

        def list_commands(self, ctx: Any) -> list[str]:
            self._put_together()
            return super().list_commands(ctx)

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            self._put_together()
            return super().get_command(ctx, cmd_name)

        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            if default and args and args[0] != "--help" and args[0] not in self.list_commands(ctx):
                args = [default, *args]
            return super().parse_args(ctx, args)

        def _put_together(self) -> None:
            if not self.complete:
                group = group_of_commands(name, text)
                register(group)
                self.commands = {**get_group(group).commands, **self.commands}
                self.complete = True

    app.add_typer(group_of_commands(name, text, cls=LateGroup, no_args_is_help=True))


if TYPE_CHECKING:
    from orip.workflow.observations.control import ControlOutcome
    from orip.workflow.records.commands import RecordsOutcome

    EditOutcome: TypeAlias = ControlOutcome | RecordsOutcome

DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Show the difference and write nothing.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")]


class EditOptions(NamedTuple):
    """Options of every command that edits."""

    bundle: BundleOption = None
    dry_run: DryRunOption = False


def tell_edit(terminal: Terminal, verb: str, outcome: EditOutcome, unchanged: str) -> None:
    """Say whether anything was edited, before the changes are listed; `unchanged` names what stays."""
    terminal.warn(outcome.warnings)
    if not outcome.changes:
        terminal.say(f"{verb} unchanged: {unchanged} so already")
    elif outcome.dry_run:
        terminal.say(f"{verb} would do the following; nothing is written")


def edit_document(command: str, outcome: EditOutcome, **more: Any) -> dict[str, Any]:
    """Return what an edit did, as a document for programs."""
    return {
        "command": command,
        **more,
        "unchanged": not outcome.changes,
        "dry_run": outcome.dry_run,
        "changes": msgspec.to_builtins(outcome.changes),
        "warnings": warning_rows(outcome.warnings),
    }
