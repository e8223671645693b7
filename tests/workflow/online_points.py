"""The photo points of a project, taken out of its measurement files to be typed in again."""

from __future__ import annotations

from pathlib import Path

from workflow.small_projects import Point

from orip.online.session import OnlineSession


def typed_points(folder: Path) -> list[Point]:
    """Take the photo points out of the measurement files of a project, and return those that count."""
    session = OnlineSession(folder, None)
    rays = session.measuring.block.measurements.observations
    found = [
        (photo, point, *session.to_log(photo, (float(x), float(y))))
        for photo, point, (x, y) in zip(rays.photos, rays.points, rays.measured, strict=True)
    ]
    for log in folder.glob("*.MEA"):
        kept, is_of_points = [], False
        for line in log.read_text(encoding="utf-8").splitlines():
            words = line.split("!")[0].split()
            if words[:1] in (["POINTS"], ["PHOTO"], ["TEMPLATE"]):
                is_of_points = words[0] == "POINTS"
            if not (is_of_points and words):
                kept.append(line)
        log.write_text("\n".join([*kept, ""]), encoding="utf-8")
    return found
