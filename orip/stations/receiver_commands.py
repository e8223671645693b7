"""`orip gnss`: what is computed from the observations of receivers."""

from __future__ import annotations

import typer

from orip.cli.options import add_group


def register(app: typer.Typer) -> None:
    """Add the group of commands; without the name of one of them it is `positions`."""
    text = (
        "Positions of a receiver, or a network of receivers that stand, with RTKLIB.\n\n"
        "'orip gnss ROVER BASE NAV...' is 'orip gnss positions ROVER BASE NAV...'.\n\n"
        "Example: orip gnss flight.obs base.obs flight.nav"
    )
    add_group(app, "gnss", text, _register, default="positions")


def _register(group: typer.Typer) -> None:
    from orip.stations.gnss_command import register_positions
    from orip.stations.gnss_network_command import register_network

    register_positions(group)
    register_network(group)
