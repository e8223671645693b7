"""Projects with a plan, and what the commands write of them."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from cli.command_line import orip

from orip.files.control.stations_text import read_stations

TOML = """project = { name = "PLANNED", crs = "EPSG:25832" }

[plan]
pixel = 0.02
forward = 70.0
side = 50.0
ground = 30.0
tie_points = 30
position_error = [0.015, 0.015, 0.03]
corners = [[561900.0, 5934000.0], [562100.0, 5934000.0], [562100.0, 5934100.0], [561900.0, 5934100.0]]

[[camera]]
name = "P4"
c = 8.8
sensor = { columns = 5472, rows = 3648, width = 13.2, height = 8.8 }
unknown = ["C", "DX", "DY", "A3"]

[[bundle]]
name = "B"
measurement_precision = "0.3px"
"""


def project(folder: Path, **changed: str) -> Path:
    folder.mkdir(exist_ok=True)
    text = TOML
    for key, value in changed.items():
        lines = [line for line in text.splitlines() if not line.startswith(f"{key} = ")]
        at = lines.index("[plan]") + 1
        text = "\n".join([*lines[:at], *([f"{key} = {value}"] if value else []), *lines[at:]]) + "\n"
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    return folder


def document(folder: Path, *arguments: str) -> dict:
    return orip(folder, *arguments, "--json").document


def stations(folder: Path):
    return read_stations(folder / "PLANNED.PLAN", "PLANNED.PLAN").value


def written(folder: Path, form: str, name: str) -> bytes:
    assert orip(folder, "plan", "export", form, name, "--force").code == 0
    return (folder / name).read_bytes()


def text_of(element: ET.Element, name: str) -> list[str]:
    return [one.text or "" for one in element.iter() if one.tag.rpartition("}")[2] == name]
