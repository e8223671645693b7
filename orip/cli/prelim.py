"""`orip prelim`: preliminary values, the whole chain or a single step of it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from orip.cli.options import BundleOption, Invocation, command, group_of_commands, without_command
from orip.cli.prelim_output import (
    absolute_document,
    chain_document,
    coordinates_document,
    raise_failures,
    relative_document,
    similarity_document,
    tell_chain,
    without_absolute,
)
from orip.errors import NotSolvableError, UsageError
from orip.threads import limited_threads

if TYPE_CHECKING:
    from orip.workflow.adjust.prelim_steps import PrelimInput, SimilaritySteps
    from orip.workflow.project.bundle_state import BundleState


Model = Annotated[str | None, typer.Argument(metavar="MODEL", help="Only this one, point by point; default: all.")]
Rows = Annotated[list[int] | None, typer.Argument(metavar="ROW", help="Only these two; default: all.")]
After = Annotated[
    Literal["relative", "bridged", "connected", "absolute"],
    typer.Option("--after", help="Show the values after this step."),
]

prelim_group = group_of_commands(
    "prelim", "Preliminary values of photos and points, from measurements and control only.\n\nExample: orip prelim"
)


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    app.add_typer(prelim_group)


@without_command(prelim_group)
def prelim_command(invocation: Invocation, bundle: BundleOption = None) -> None:
    """Find preliminary values, list how in PRELIM_RESULT.OUT, and keep them.

    Orientations go into the photo store (elements that are not constant), coordinates into BUNDLE.PRE (points in it
    that were not computed stay). The steps can be looked at one by one, which changes nothing.

    Example: orip prelim relative M12
    """
    _chain(invocation, bundle)


@command(prelim_group, "update")
def update_command(invocation: Invocation, bundle: BundleOption = None) -> None:
    """Find preliminary values and keep them: what 'orip prelim' does.

    Example: orip prelim update
    """
    _chain(invocation, bundle)


@command(prelim_group, "relative", reads_only=True)
def relative_command(invocation: Invocation, model: Model = None, bundle: BundleOption = None) -> None:
    """Show the relative orientation of each model, or of one with its points.

    Example: orip prelim relative M12
    """
    from orip.files.listings.preliminary import relative_orientation_lines, relative_overview, relative_remarks
    from orip.workflow.adjust.prelim_steps import relative_orientations

    with limited_threads(invocation.terminal.threads):
        given = _given(invocation, bundle)
        found = relative_orientations(given, model)
    if invocation.terminal.json:
        invocation.terminal.document("relative", relative_document(found))
    else:
        points = [line for one in found.oriented for line in relative_orientation_lines(one)]
        lines = [*relative_overview(found.oriented), *(points if model else relative_remarks(found.oriented))]
        invocation.terminal.data("\n".join(lines))
    if model is None:
        invocation.terminal.warn(given.unmeasured_models)
    raise_failures(found.failures)


@command(prelim_group, "bridge", reads_only=True)
def bridge_command(invocation: Invocation, model: Model = None, bundle: BundleOption = None) -> None:
    """Show the bridging of all models along the rows, or of one to the next with its points.

    Example: orip prelim bridge M12
    """
    from orip.workflow.adjust.prelim_steps import bridges

    with limited_threads(invocation.terminal.threads):
        given = _given(invocation, bundle)
        found = bridges(given, model)
    if model is None:
        invocation.terminal.warn(given.unmeasured_models)
    _show_similarities(invocation, found, alone=model is not None, nothing="bridge: no row has two models")


@command(prelim_group, "connect", reads_only=True)
def connect_command(invocation: Invocation, rows: Rows = None, bundle: BundleOption = None) -> None:
    """Show the connection of all rows, or of two of them with their points.

    Example: orip prelim connect 1 2
    """
    from orip.workflow.adjust.prelim_steps import connections

    if rows and len(set(rows)) != 2:
        message = f"two different rows are connected, not {' '.join(map(str, rows))}: orip prelim connect ROW ROW"
        raise UsageError(message)
    with limited_threads(invocation.terminal.threads):
        pair = (rows[0], rows[1]) if rows else None
        given = _given(invocation, bundle)
        found = connections(given, pair)
    if pair is None:
        invocation.terminal.warn(given.unmeasured_models)
    _show_similarities(invocation, found, alone=pair is not None, nothing="connect: there is one row of models")


@command(prelim_group, "absolute", reads_only=True)
def absolute_command(invocation: Invocation, bundle: BundleOption = None) -> None:
    """Show the absolute orientation of the block: its control points with their residuals.

    Example: orip prelim absolute
    """
    from orip.files.listings.preliminary import similarity_lines
    from orip.solving.starting_values import not_oriented
    from orip.workflow.adjust.prelim_steps import values_of

    terminal = invocation.terminal
    with limited_threads(terminal.threads):
        given = _given(invocation, bundle)
        values = values_of(given)
    if terminal.json:
        terminal.document("absolute", absolute_document(values, given.project.definition.ground_unit))
    elif values.absolute is not None:
        terminal.data("\n".join(similarity_lines(values.absolute, given.project.definition.ground_unit)))
    elif any(photo.rotation is not None for photo in values.photos):
        terminal.say(f"absolute none: {without_absolute([photo.how for photo in values.photos])}")
    if values.absolute is None and (complaint := not_oriented(values)):
        raise NotSolvableError(complaint)


@command(prelim_group, "show", reads_only=True)
def show_command(invocation: Invocation, after: After = "absolute", bundle: BundleOption = None) -> None:
    """Show the model coordinates of photos and points after a step.

    Example: orip prelim show --after bridged
    """
    from orip.files.listings.preliminary import model_coordinate_lines
    from orip.workflow.adjust.prelim_steps import model_coordinates

    with limited_threads(invocation.terminal.threads):
        given = _given(invocation, bundle)
        found = model_coordinates(given, after)
    if invocation.terminal.json:
        invocation.terminal.document("model-coordinates", coordinates_document(found))
    else:
        invocation.terminal.data("\n".join(model_coordinate_lines(found, given.project.definition.ground_unit)))


def _given(invocation: Invocation, bundle: str | None) -> PrelimInput:
    from orip.workflow.adjust.prelim_steps import prelim_input

    return prelim_input(_bundle(invocation, bundle))


def _bundle(invocation: Invocation, bundle: str | None) -> BundleState:
    from orip.workflow.adjust.solve import ADJUSTED_FROM
    from orip.workflow.project.bundle_state import read_bundle

    return read_bundle(invocation.folder, bundle, *ADJUSTED_FROM)


def _chain(invocation: Invocation, bundle: str | None) -> None:
    from orip.solving.starting_values import not_oriented
    from orip.workflow.adjust.prelim import keep_values, prelim
    from orip.workflow.project.commit import carry_out

    with limited_threads(invocation.terminal.threads):
        given = _bundle(invocation, bundle)
        outcome = carry_out(given.state, partial(keep_values, prelim(given))).outcome
    tell_chain(invocation.terminal, outcome)
    if invocation.terminal.json:
        invocation.terminal.document("prelim", chain_document(outcome))
    if complaint := not_oriented(outcome.values):
        raise NotSolvableError(complaint)


def _show_similarities(invocation: Invocation, found: SimilaritySteps, *, alone: bool, nothing: str) -> None:
    from orip.files.listings.preliminary import similarity_lines, similarity_overview, similarity_remarks

    if invocation.terminal.json:
        invocation.terminal.document("similarities", similarity_document(found))
    elif found.steps:
        points = [line for step in found.steps for line in similarity_lines(step, "")]
        lines = [*similarity_overview(found.steps), *(points if alone else similarity_remarks(found.steps))]
        invocation.terminal.data("\n".join(lines))
    elif not found.failures:
        invocation.terminal.say(f"nothing to {nothing}")
    raise_failures(found.failures)
