"""What a replay finds wrong or worth knowing, each with the line of the log that it comes from."""

from __future__ import annotations

from orip.errors import Complaint, ProjectWarning
from orip.records.observations.measurement import TextPlace


class Findings:
    """Complaints and warnings, in the order of the log whenever they were found."""

    def __init__(self) -> None:
        self._complaints: list[Complaint] = []
        self._warnings: list[ProjectWarning] = []
        self._files: dict[str, int] = {}

    def reads(self, place: TextPlace) -> None:
        """Note that a record is being taken: files are reported in the order in which they are read."""
        self._files.setdefault(place.path, len(self._files))

    def complain(self, place: TextPlace | None, message: str) -> None:
        """Add a complaint; without a place it concerns what was stored before."""
        complaint = Complaint(message, place.path, place.line) if place else Complaint(message)
        if complaint not in self._complaints:
            self._complaints.append(complaint)

    def warn(self, place: TextPlace, code: str, text: str) -> None:
        """Add a warning."""
        self._warnings.append(ProjectWarning(code, f"{place.path}:{place.line}", text))

    def complaints(self) -> tuple[Complaint, ...]:
        """Return the complaints, sorted by file and line."""
        return tuple(
            sorted(self._complaints, key=lambda finding: (self._files.get(finding.path, -1), finding.line or 0))
        )

    def warnings(self) -> tuple[ProjectWarning, ...]:
        """Return the warnings."""
        return tuple(self._warnings)
