"""Observations and orbits in RINEX 2 written in the versions 3 and 4 (RINEX 3.05 and 4.01, appendices A)."""

from __future__ import annotations

from datetime import datetime, timedelta

from trajectory.receiver_streams import GPS_START, epochs_of

_BODY = "END OF HEADER"


def _line(text: str, label: str) -> str:
    return f"{text:<60}{label}\n"


def observations(text: str, version: str) -> str:
    """Return the GPS observations of a RINEX 2 file with C1, L1, L2, P2."""
    kept = ("MARKER NAME", "ANT # / TYPE", "APPROX POSITION XYZ", "ANTENNA: DELTA H/E/N", "TIME OF FIRST OBS")
    header = text.partition(_BODY)[0].splitlines()
    found = _line(f"     {version}           OBSERVATION DATA    G", "RINEX VERSION / TYPE")
    found += "".join(f"{line}\n" for line in header if line[60:].strip() in kept)
    found += _line("G    4 C1C L1C C2W L2W", "SYS / # / OBS TYPES") + _line("", _BODY)
    for epoch in epochs_of(text):
        when = GPS_START + timedelta(seconds=epoch.week * 604_800.0 + epoch.seconds)
        found += f"> {when:%Y %m %d %H %M %S.%f}0  0{len(epoch.satellites):3d}\n"
        for number, (c1, l1, l2, p2) in epoch.satellites.items():
            found += (
                f"G{number:02d}"
                + "".join(f"{value:14.3f}  " if value else " " * 16 for value in (c1, l1, p2, l2))
                + "\n"
            )
    return found


def orbits(text: str, version: str) -> str:
    """Return the GPS orbits of a RINEX 2 file."""
    body = text.partition(_BODY)[2].splitlines()[1:]
    found = _line(f"     {version}           NAVIGATION DATA     G", "RINEX VERSION / TYPE") + _line("", _BODY)
    for at in range(0, len(body) - 7, 8):
        first = body[at]
        year, *rest = (int(first[3 * n + 2 : 3 * n + 5]) for n in range(5))
        when, name = datetime(2000 + year, *rest), f"G{int(first[:2]):02d}"
        found += f"> EPH {name} LNAV\n" if version.startswith("4") else ""
        found += f"{name} {when:%Y %m %d %H %M} {int(float(first[17:22])):02d}{first[22:]}\n"
        found += "".join(f" {line}\n" for line in body[at + 1 : at + 8])
    return found
