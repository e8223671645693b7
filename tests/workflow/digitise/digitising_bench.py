"""A project at an emulated plate processor in this process: the bench that digitising is tested at."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from orip.errors import LinkError
from orip.multimodel.digitising.marks import digitise_photos, digitise_template
from orip.multimodel.digitising.new_points import GroundChoice, NewPointsChoice, digitise_ground, digitise_new_points
from orip.multimodel.digitising.operator import Script, Simulation, places_of, script_requests
from orip.multimodel.digitising.points import digitise_points
from orip.multimodel.digitising.record_marks import digitise_fiducials, digitise_ticks
from orip.multimodel.digitising.setup import DigitisingSetup, log_file
from orip.multimodel.digitising.wanted import PointChoice
from orip.multimodel.link.client import PlateProcessorLink
from orip.multimodel.link.messages import greeting_of
from orip.multimodel.link.protocol import answer, downloaded, greeting
from orip.multimodel.link.station import bare_stages
from orip.multimodel.table_step import load_drive_table
from orip.workflow.observations.films import films_of

LOG = Path("NEW.MEA")


class InProcess:
    """A line to a plate processor in this process; keeps the requests."""

    def __init__(self, station):
        self.station, self.requests, self.breaks_at = station, [], None
        self.replies = []

    def send(self, data, _timeout_s=None):
        request, _, table = data.decode().partition("\n")
        if self.breaks_at is not None and len(self.requests) >= self.breaks_at:
            message = "the connection broke off"
            raise LinkError(message)
        self.requests.append(request)
        if table:
            found = downloaded(self.station, table.encode(), load_drive_table)
        else:
            found = answer(self.station, request.encode())
        self.station = found.station
        self.replies = found.reply.decode().splitlines()

    def receive(self, _timeout_s=None):
        return self.replies.pop(0)

    def close(self):
        pass

    def locked(self):
        """Return the stage that is locked."""
        return self.station.state.locked


class Recorded:
    """An operator, and what was set at the plate processor whenever he was asked for something."""

    def __init__(self, operator, line):
        self.operator, self.line, self.seen, self.prisms = operator, line, [], []

    def act(self, link, visit):
        state = self.line.station.state
        self.seen.append((visit.sought, state.locked, state.guide, state.plates, link.status().model))
        self.prisms.append(state.prisms)
        return self.operator.act(link, visit)


class Bench:
    """A project at a plate processor."""

    def __init__(self, folder, table=b""):
        self.folder, self.said = folder, []
        station = bare_stages()
        self.line = InProcess(station.loaded(table, load_drive_table) if table else station)
        self.link = PlateProcessorLink(self.line, "tcp://here", greeting_of(greeting(station, None).decode().strip()))
        self.operator = None

    def means(self, operator, log=LOG):
        """Return the means of digitising by an operator, given as one, as simulation files, or as lines of a script."""

        def of(films):
            found = operator
            if isinstance(operator, str):
                lines = script_requests(operator.split(";"), "script")
                assert lines.complaints == ()
                found = Script(lines.value, fail)
            elif isinstance(operator, tuple):
                found = Simulation(places_of(films_of(films, operator)))
            self.operator = Recorded(found, self.line)
            return self.operator

        return DigitisingSetup(self.folder, log, lambda: nullcontext(self.link), of, log_file, self.said.append)

    def template(self, name, operator, **options):
        return digitise_template(self.means(operator), name, **options)

    def photos(self, names, operator, **options):
        return digitise_photos(self.means(operator), names, **options)

    def points(self, operator, *, viewing=None, start=None, **choice):
        chosen = PointChoice(**choice)
        return digitise_points(self.means(operator), None, chosen, viewing=viewing, start=start)

    def new_points(self, operator, *, viewing=None, **choice):
        means, chosen = self.means(operator), NewPointsChoice(**choice)
        return digitise_new_points(means, None, chosen, viewing=viewing)

    def fiducials(self, camera, operator, arrangement="corners", stage="UPPER", names=()):
        return digitise_fiducials(self.means(operator), camera, arrangement, stage, names)

    def ticks(self, temtick, operator, stage="UPPER", names=()):
        return digitise_ticks(self.means(operator), temtick, stage, names)

    def ground(self, operator, **choice):
        return digitise_ground(self.means(operator), None, GroundChoice(**choice))

    @property
    def log(self):
        return (self.folder / LOG).read_text() if (self.folder / LOG).exists() else ""


def fail(_request, fault):
    raise fault


def did(found):
    """Return name and outcome of each entry."""
    return [(entry.name, entry.outcome) for entry in found.entries]


def codes(found):
    return [warning.code for warning in found.warnings]
