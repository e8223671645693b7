"""Writing stereo measurements (.STE) while they are measured: each vertex is on the disk before it is acknowledged."""

from __future__ import annotations

from pathlib import Path

from orip.errors import InputError, OripError
from orip.files.log.stereo import feature_header, read_stereo, vertex_line
from orip.files.text.atomic import replace_text, reporting_failure, require_no_link
from orip.files.text.lines import existing_text, field_name_fault
from orip.records.names import record_key
from orip.records.stereo import LEAST_VERTICES, FeatureKind, StereoFeature, StereoVertex
from orip.structs import replace

# With every vertex the file is replaced as a whole: whoever reads it, or finds it after the machine went down, has all
# that was acknowledged and no half line. A line that was not finished is the last feature of the file, and goes on.

_HEADING = "! Measured in stereo: feature, below it left photo x y, right photo x y of each vertex\n"


class StereoFile:
    """A file of stereo measurements that grows; what others write to it meanwhile stays.

    Parameters
    ----------
    path : Path
        Need not exist.
    shown : str
        The file as the user would name it.

    Raises
    ------
    InputError
        With all that is wrong in the file.
    OripError
        If it is a link.
    """

    def __init__(self, path: Path, shown: str) -> None:
        self._path, self.shown = path, shown
        with reporting_failure(shown, "name another file"):
            require_no_link(path)
        self._text: str | None = None
        self._lengths: list[tuple[int, bool]] = []
        self.features: list[StereoFeature] = []
        self._catch_up()

    @property
    def unfinished(self) -> StereoFeature | None:
        """Return the last feature if it lacks vertices."""
        last = self.features[-1] if self.features else None
        return last if last is not None and len(last.vertices) < LEAST_VERTICES[last.kind] else None

    def put(self, kind: FeatureKind, code: str, name: str, vertex: StereoVertex) -> StereoFeature:
        """Write a vertex of a feature, which is the last one of the file or a new one, and return the feature.

        Raises
        ------
        OripError
            If code or name cannot be, or the feature cannot go on, or the file cannot be written: it is unchanged then.
        """
        self._catch_up()
        last = self.features[-1] if self.features else None
        goes_on = last is not None and (last.kind, last.code, last.name) == (kind, code, name)
        if last is None or not goes_on or kind == "POINT":
            self._require_new(kind, code, name)
            goes_on, last = False, StereoFeature(kind, code, name, ())
        before = self._text or ""
        start = before if before.endswith("\n") or not before else f"{before}\n"
        header = "" if goes_on else f"{feature_header(kind, code, name)}\n"
        self._write(f"{start or _HEADING}{header}{vertex_line(vertex)}\n")
        self._lengths.append((len(before), goes_on))
        grown = replace(last, vertices=(*last.vertices, vertex))
        self.features[len(self.features) - goes_on :] = [grown]
        return grown

    def undo(self) -> StereoFeature:
        """Take back the vertex that was written last, and return its feature with it.

        Raises
        ------
        OripError
            If this run has written none that is left, or another program has changed the file since.
        """
        self._catch_up()
        if not self._lengths:
            message = f"nothing that was measured in this run is left; edit {self.shown} by hand"
            raise OripError(message)
        length, went_on = self._lengths[-1]
        self._write((self._text or "")[:length])
        self._lengths.pop()
        taken = self.features.pop()
        if went_on:
            self.features.append(replace(taken, vertices=taken.vertices[:-1]))
        return taken

    def require_finished(self) -> None:
        """Refuse to leave the last feature if it lacks vertices.

        Raises
        ------
        OripError
        """
        if (last := self.unfinished) is not None:
            message = (
                f"{last.kind} {last.code} {last.name} has {len(last.vertices)} of at least {LEAST_VERTICES[last.kind]} "
                "vertices: measure the others, or undo"
            )
            raise OripError(message)

    def _require_new(self, kind: FeatureKind, code: str, name: str) -> None:
        for word in (code, name):
            if fault := field_name_fault(word):
                raise OripError(fault)
        if any((record_key(one.code), one.name) == (record_key(code), name) for one in self.features):
            message = f"{code} {name} is in {self.shown} already; give this {kind} another name"
            raise OripError(message)
        self.require_finished()

    def _catch_up(self) -> None:
        """Read what another program has written; what was measured before that is not undone any more."""
        found = existing_text(self._path, self.shown)
        if found == self._text:
            return
        read = read_stereo(self._path, self.shown, is_growing=True)
        if read.complaints:
            raise InputError(list(read.complaints))
        self._text, self.features, self._lengths = found, list(read.value), []

    def _write(self, text: str) -> None:
        with reporting_failure(self.shown, "the file is unchanged, and the vertex not recorded"):
            replace_text(self._path, text)
        self._text = text
