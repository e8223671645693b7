"""Every document with its name, the type of its content, and what writes it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from msgspec import Struct

from orip.schemas import instruments, measuring, planning, preliminary, project, result
from orip.schemas import project as archive

SchemaName = Literal[
    "absolute", "archive-diff", "archive-report", "archive-run", "archive-simulate", "archive-status",
    "camera-plot", "check", "compare", "control-edit", "control-list", "covariance", "detect", "digitise",
    "digitise-ground", "drive-download", "drive-emulate", "drive-panel", "drive-profile", "drive-table",
    "drive-to", "drive-watch", "drive-where", "error", "export", "export-toml", "formats", "gnss",
    "gnss-network", "import", "imu", "imu-noise", "init", "match", "measure", "model-coordinates", "observation-edit",
    "observations",
    "online-demo", "online-reconsidered", "plan", "plan-clock", "plan-compare", "plan-export", "plan-flown",
    "plan-follow", "plan-forecast", "plan-place", "plan-show", "prelim", "project-made", "record", "record-edit",
    "records", "relative", "report", "result", "result-part", "results", "sample-written", "samples",
    "restitute-compute", "restitute-export", "restitute-show", "screen", "similarities",
    "stations-import", "status", "todo", "todo-next", "update", "update-undone",
]  # fmt: skip


class DocumentType(Struct, frozen=True):
    """A kind of document.

    Parameters
    ----------
    content : type
        Its keys, apart from `schema`.
    written_by : tuple of str
        Commands that print it with ``--json``, without their arguments; or files.
    version : int
        Raised when a key is removed or changes its meaning; further keys raise it as well, as no others are allowed.
    """

    content: type[Struct]
    written_by: tuple[str, ...]
    version: int = 1


def _each(words: Iterable[str], verbs: str) -> tuple[str, ...]:
    return tuple(f"{word} {verb}" for word in words for verb in verbs.split())


_RECORDS = ("camera", "temtick", "photo", "template", "bundle", "model")
_CONTROL = _each(["control"], "points elements distances directions figures stations differences preliminary")

DOCUMENTS: Mapping[SchemaName, DocumentType] = {
    "absolute": DocumentType(preliminary.Absolute, ("prelim absolute",)),
    "archive-diff": DocumentType(archive.ArchiveDiff, ("archive diff",)),
    "archive-report": DocumentType(archive.ArchiveReport, ("archive report",)),
    "archive-run": DocumentType(archive.ArchiveRun, ("archive run",)),
    "archive-simulate": DocumentType(archive.ArchiveSimulate, ("archive simulate",)),
    "archive-status": DocumentType(archive.ArchiveStatus, ("archive status",)),
    "camera-plot": DocumentType(project.CameraPlot, ("camera plot",)),
    "check": DocumentType(preliminary.Check, ("check",)),
    "compare": DocumentType(preliminary.Compare, ("compare",)),
    "control-edit": DocumentType(
        project.ControlEdit,
        (*_each(_CONTROL, "add insert edit kill"), *_each(_CONTROL[:-1], "disregard include"), f"{_CONTROL[0]} reject"),
    ),
    "control-list": DocumentType(project.ControlLines, _each(_CONTROL, "list")),
    "covariance": DocumentType(result.Covariance, ("results",)),
    "detect": DocumentType(instruments.Detect, _each(["detect"], "board sheet tags")),
    "digitise": DocumentType(
        measuring.Digitised, _each(["digitise"], "template photo points fiducials ticks features")
    ),
    "digitise-ground": DocumentType(measuring.GroundDigitised, ("digitise ground",)),
    "drive-download": DocumentType(measuring.Download, ("drive download",)),
    "drive-emulate": DocumentType(measuring.Listening, ("drive emulate",)),
    "drive-panel": DocumentType(measuring.Panel, _each(["drive"], "guide lock prism foot key")),
    "drive-profile": DocumentType(measuring.Profile, ("drive profile",)),
    "drive-table": DocumentType(measuring.DriveTable, ("drive table",)),
    "drive-to": DocumentType(measuring.Driven, _each(["drive"], "goto forward model next move")),
    "drive-watch": DocumentType(measuring.Watching, ("drive watch",)),
    "screen": DocumentType(measuring.Screen, ("screen",)),
    "drive-where": DocumentType(measuring.Where, ("drive where",)),
    "error": DocumentType(project.Error, ("any command that fails",)),
    "export": DocumentType(project.Export, ("export",)),
    "export-toml": DocumentType(project.ExportToml, ("export-toml",)),
    "formats": DocumentType(project.Formats, ("import", "export")),
    "import": DocumentType(project.Import, ("import",)),
    "gnss": DocumentType(instruments.Gnss, ("gnss positions",)),
    "gnss-network": DocumentType(instruments.GnssNetwork, ("gnss network",)),
    "imu": DocumentType(instruments.Imu, ("imu smooth",)),
    "imu-noise": DocumentType(instruments.ImuNoise, ("imu noise",)),
    "init": DocumentType(project.Init, ("init",)),
    "match": DocumentType(instruments.Match, ("match",)),
    "measure": DocumentType(measuring.Measure, ("measure",)),
    "model-coordinates": DocumentType(preliminary.ModelCoordinates, ("prelim show",)),
    "observation-edit": DocumentType(
        measuring.ObservationEdit, _each(["observations"], "disregard include kill rename edit remeasure")
    ),
    "observations": DocumentType(measuring.Observations, ("observations list",)),
    "online-demo": DocumentType(measuring.OnlineDemo, ("online",)),
    "online-reconsidered": DocumentType(measuring.OnlineReconsidered, ("online",)),
    "plan": DocumentType(planning.PlanMade, ("plan make",)),
    "plan-clock": DocumentType(planning.PlanClock, ("plan clock",)),
    "plan-compare": DocumentType(planning.PlanCompare, ("plan compare",)),
    "plan-export": DocumentType(planning.PlanExport, ("plan export",)),
    "plan-follow": DocumentType(planning.PlanFollow, ("plan follow",)),
    "plan-flown": DocumentType(planning.PlanFlown, ("plan flown",)),
    "plan-forecast": DocumentType(planning.PlanForecast, ("plan forecast",)),
    "plan-place": DocumentType(planning.PlanPlace, ("plan place",)),
    "plan-show": DocumentType(planning.PlanShow, ("plan show",)),
    "prelim": DocumentType(preliminary.Prelim, ("prelim", "prelim update")),
    "project-made": DocumentType(project.ProjectMade, ("init", "new", "photos")),
    "record": DocumentType(project.Record, _each(_RECORDS, "show")),
    "record-edit": DocumentType(project.RecordEdit, _each(_RECORDS, "add copy edit rename delete")),
    "records": DocumentType(project.Records, _each(_RECORDS, "list")),
    "relative": DocumentType(preliminary.Relative, ("prelim relative",)),
    "report": DocumentType(preliminary.Report, ("report",)),
    "restitute-compute": DocumentType(planning.RestituteCompute, ("restitute compute",)),
    "restitute-export": DocumentType(planning.RestituteExport, ("restitute export",)),
    "restitute-show": DocumentType(planning.RestituteShow, ("restitute show",)),
    "result": DocumentType(result.Result, ("result.json", "solve", "run", "adjust"), version=2),
    "result-part": DocumentType(result.PartOfResult, ("results",)),
    "results": DocumentType(result.Results, ("run",), version=2),
    "sample-written": DocumentType(project.SampleWritten, ("init",)),
    "samples": DocumentType(project.Samples, ("init",)),
    "similarities": DocumentType(preliminary.Similarities, _each(["prelim"], "bridge connect")),
    "stations-import": DocumentType(project.StationsImport, ("stations import",)),
    "status": DocumentType(project.ProjectStatus, ("status",)),
    "todo": DocumentType(measuring.Todo, ("observations todo",)),
    "todo-next": DocumentType(measuring.TodoNext, ("observations todo",)),
    "update": DocumentType(preliminary.Update, ("update",)),
    "update-undone": DocumentType(preliminary.UpdateUndone, ("update",)),
}


def identifier(name: SchemaName) -> str:
    """Return what a document has as its `schema`: the name of its kind and the version."""
    return f"orip.{name}/{DOCUMENTS[name].version}"
