"""`orip gnss network`: a network of baselines with one mark held, to control points with their covariances."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from orip.cli.options import DryRunOption, Invocation, command
from orip.cli.terminal import warning_rows
from orip.errors import UsageError
from orip.stations.gnss_command import UsedOptions, elevation_of, frequencies_of, place_of, systems_of

if TYPE_CHECKING:
    from orip.arrays import FloatArray
    from orip.stations.gnss.network_processing import NetworkResult
    from orip.stations.network_points import NetworkPoints


def register_network(group: typer.Typer) -> None:
    """Add the command."""

    @command(group, "network")
    def network_command(
        invocation: Invocation,
        marks: Annotated[list[Path], typer.Argument(metavar="OBS...", help="Observations, a file a mark.")],
        orbits: Annotated[list[Path], typer.Option("--orbits", metavar="FILE", help="Orbits; as often as needed.")],
        used: UsedOptions,
        hold: Annotated[
            str | None,
            typer.Option("--hold", metavar="NAME=X,Y,Z", help="Mark that is held, geocentric, m; else the first."),
        ] = None,
        antex: Annotated[Path | None, typer.Option("--antex", metavar="FILE", help="Calibrations of antennas.")] = None,
        dry_run: DryRunOption = False,
    ) -> None:
        """Compute a network of receivers that stand, with one mark held, and add the marks to the control points.

        All baselines of receivers that observed at the same time are computed with RTKLIB and adjusted; the .PNT and
        .COV files get the coordinates with all their covariances.

        Example: orip gnss network A.obs B.obs C.obs --orbits day.nav --hold A=3512345.678,780123.456,5248901.234
        """
        from orip.stations.gnss.network_processing import process_network
        from orip.stations.gnss.processing import GnssFiles
        from orip.stations.network_points import network_points
        from orip.workflow.project.commit import carry_out
        from orip.workflow.records.commands import read_records

        folder = invocation.folder
        paths = [folder / mark for mark in marks]
        settings = GnssFiles(
            paths[0], paths[0], tuple(folder / path for path in orbits), "static",
            elevation=elevation_of(used.elevation), systems=systems_of(used.systems),
            frequencies=frequencies_of(used.frequencies), antex=None if antex is None else folder / antex,
        )  # fmt: skip
        held = _held(hold)
        state = read_records(folder)
        result = process_network(paths, held, settings)
        written = carry_out(state, partial(network_points, result=result, dry_run=dry_run)).outcome
        _tell(invocation, result, written, dry_run=dry_run)


def _held(text: str | None) -> tuple[str, FloatArray] | None:
    if text is None:
        return None
    name, equals, numbers = text.partition("=")
    place = place_of(numbers, "--hold") if equals else None
    if place is None:
        message = f"--hold {text}: write NAME=X,Y,Z"
        raise UsageError(message)
    return name, np.array(place)


def _tell(invocation: Invocation, result: NetworkResult, written: NetworkPoints, *, dry_run: bool) -> None:
    terminal, network = invocation.terminal, result.network
    warnings = (*result.warnings, *written.warnings)
    terminal.warn(warnings)
    if terminal.json:
        document = {
            "command": "gnss network",
            "files": list(written.files),
            "dry_run": dry_run,
            "held": result.names[result.held],
            "marks": [
                {"name": name, "place": place.tolist(), "X": float(x), "Y": float(y), "Z": float(z), "error": error}
                for name, place, (x, y, z), error in zip(
                    result.names, network.place, written.place, written.error.tolist(), strict=True
                )
            ],
            "baselines": [
                {
                    "from": result.names[one],
                    "to": result.names[other],
                    "fixed": fixed,
                    "residual": residual,
                    "wrong": bool(wrong),
                }
                for (one, other), fixed, residual, wrong in zip(
                    result.pairs, result.fixed, network.residual.tolist(), network.is_wrong, strict=True
                )
            ],
            "sigma0": None if np.isnan(network.sigma0) else network.sigma0,
            "redundancy": network.redundancy,
            "covariance": network.covariance.tolist(),
            "warnings": warning_rows(warnings),
        }
        terminal.document("gnss-network", document)
        return
    sigma0 = "no redundancy" if np.isnan(network.sigma0) else f"sigma0 {network.sigma0:.2f}"
    held = result.names[result.held]
    terminal.point("network", f"{len(result.names)} marks, {len(result.pairs)} baselines, {held} held; {sigma0}")
    for (one, other), residual in zip(result.pairs, network.residual, strict=True):
        size = 1000.0 * float(np.linalg.norm(residual))
        terminal.point("baseline", f"{result.names[one]} to {result.names[other]}, residual {size:.1f} mm")
    for name, place, error in zip(result.names, written.place, written.error, strict=True):
        x, y, z = (f"{value:.4f}" for value in place)
        said = ", ".join(f"{value:.4f}" for value in error)
        terminal.point("mark", f"{name}  {x}  {y}  {z}  sd {said}")
    terminal.point("would write" if dry_run else "wrote", ", ".join(written.files))
