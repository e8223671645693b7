"""Projects of Metashape, written by hand: a document with a chunk, its frame, and tie points as PLY files."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from exchange.test_metashape import SCALE, SHIFT, TURN, document

from orip.records.exchanged import ExchangedProject

_POINTS, _FRAMES = "<points", "<frames>"


def ply(columns: dict[str, np.ndarray], types: dict[str, str]) -> bytes:
    """Return vertices with properties of float, int or uint."""
    layout = np.dtype(
        [(name, {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4"}[types[name]]) for name in columns]
    )
    count = len(next(iter(columns.values())))
    rows = np.zeros(count, dtype=layout)
    for name, values in columns.items():
        rows[name] = values
    properties = "".join(f"property {types[name]} {name}\n" for name in columns)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n"
    return head.encode() + rows.tobytes()


def tie_files(project: ExchangedProject) -> dict[str, bytes]:
    """Return tie points with the coordinates of the chunk, and their list; camera ids are places and 3."""
    chunk = (project.points.coordinates - SHIFT) @ TURN / SCALE
    tracks = np.arange(len(chunk)) + 100
    kinds = {"x": "double", "y": "double", "z": "double", "id": "uint"}
    files = {
        "tracks.ply": ply({"red": np.zeros(len(chunk))}, {"red": "float"}),
        "points0.ply": ply({"x": chunk[:, 0], "y": chunk[:, 1], "z": chunk[:, 2], "id": tracks}, kinds),
    }
    listed = [
        f'<tracks path="tracks.ply" count="{len(chunk)}"/><points component_id="0" path="points0.ply" count="1"/>'
    ]
    for photo in range(len(project.photos)):
        rows = np.flatnonzero(project.rays.photo == photo)
        x, y = project.rays.image[rows].T
        track = tracks[project.rays.point[rows]]
        # the last one belongs to a track that has no point
        columns = {"x": [*x, 1.0], "y": [*y, 1.0], "size": np.ones(len(rows) + 1), "id": [*track, 99999]}
        types = {"x": "double", "y": "double", "size": "float", "id": "int"}
        files[f"p{photo}.ply"] = ply({name: np.array(values) for name, values in columns.items()}, types)
        listed.append(f'<projections camera_id="{photo + 3}" path="p{photo}.ply" count="{len(rows) + 1}"/>')
    return {**files, "list": "\n".join(listed).encode()}


def packed(path: Path, members: dict[str, bytes | str]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def psz(path: Path, project: ExchangedProject) -> Path:
    """Write a project of one zip file."""
    files = tie_files(project)
    cloud = f"<point_cloud>{files.pop('list').decode()}</point_cloud>"
    text = document(project).replace("</frame></frames>", f"{cloud}</frame></frames>")
    text = text.replace("<chunk ", '<chunks active_id="0"><chunk id="0" ').replace("</chunk>", "</chunk></chunks>")
    return packed(path, {"doc.xml": text, **files})


def psx(path: Path, project: ExchangedProject) -> Path:
    """Write a project with a folder beside it."""
    files = tie_files(project)
    text = document(project)
    chunk = text[text.index("<chunk ") : text.index("</document>")]
    begin, end = chunk.index("<frame "), chunk.index("</frames>")
    frame = chunk[begin:end].replace("</frame>", '<point_cloud path="point_cloud/point_cloud.zip"/></frame>')
    chunk = chunk[:begin] + '<frame id="0" path="0/frame.zip"/>' + chunk[end:]
    folder = path.with_name(f"{path.stem}.files")
    chunks = (
        '<document version="1.2.0"><chunks next_id="1" active_id="0"><chunk id="0" path="0/chunk.zip"/></chunks>'
        "</document>"
    )
    packed(folder / "project.zip", {"doc.xml": chunks})
    packed(folder / "0" / "chunk.zip", {"doc.xml": chunk})
    packed(folder / "0" / "0" / "frame.zip", {"doc.xml": frame})
    listed = f'<point_cloud version="1.7.0">{files.pop("list").decode()}</point_cloud>'
    packed(folder / "0" / "0" / "point_cloud" / "point_cloud.zip", {"doc.xml": listed, **files})
    path.write_text('<document version="1.2.0" path="{projectname}.files/project.zip"/>', encoding="utf-8")
    return path
