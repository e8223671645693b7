"""`orip digitise features`: points, lines and areas with codes, collected across the models of a block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from orip.errors import InputError, OripError, ProjectWarning, UsageError
from orip.files.log.stereo import StereoFile
from orip.files.text.lines import field_name_fault
from orip.multimodel.digitising.operator import Named, Visit
from orip.multimodel.digitising.order import next_name
from orip.multimodel.digitising.session import Entry, Outcome, Session
from orip.multimodel.digitising.setup import Digitised, DigitisingSetup
from orip.multimodel.digitising.wanted import BundlePoints, bundle_points, model_named
from orip.multimodel.state import Position
from orip.records.definition import StereoModel
from orip.records.measurement import FEATURE_KINDS, FeatureKind, StereoVertex
from orip.records.names import record_key
from orip.wording import listed_names

_MOST_CODES = 9
"""As many as there are keys from 1 on."""

_HINT = (
    "the right foot switch takes a vertex, the left one takes the last one back; ENTER ends a line or area, a number "
    "chooses the code, a name typed here names the feature; ZERO ends. Models change at their frame lines"
)


class FeatureCode(NamedTuple):
    """What is collected: its kind and code."""

    kind: FeatureKind
    code: str


class FeaturesChoice(NamedTuple):
    """What is collected, in which model it begins (None: the first one), and the .STE file it goes to."""

    codes: tuple[FeatureCode, ...]
    file: Path
    model: str | None = None
    first: str = "1"


def feature_codes(words: Sequence[str]) -> tuple[FeatureCode, ...]:
    """Return the codes of words such as ``LINE:ROAD``.

    Raises
    ------
    UsageError
        With all words that are none.
    """
    found, wrong = [], []
    for word in words:
        kind, _, code = word.partition(":")
        known = next((one for one in FEATURE_KINDS if one == kind.upper()), None)
        if known is None or field_name_fault(code) is not None:
            wrong.append(f"'{word}'")
        else:
            found.append(FeatureCode(known, code))
    if wrong or not 0 < len(found) <= _MOST_CODES:
        what = f"{', '.join(wrong)}: no code" if wrong else f"{len(found)} codes"
        message = f"{what}; name one to {_MOST_CODES}, each as {', '.join(f'{one}:CODE' for one in FEATURE_KINDS)}"
        raise UsageError(message)
    return tuple(found)


def digitise_features(setup: DigitisingSetup, bundle: str | None, choice: FeaturesChoice) -> Digitised:
    """Collect features in the models of the last adjustment; each vertex is in the file before the next one is taken.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films("solutions")
    points = bundle_points(films, bundle)
    models = {record_key(model.name): model for model in points.bundle.models}
    if not models:
        message = f"bundle {points.bundle.name} has no models to see in stereo; add some with 'orip model add'"
        raise InputError.single(message)
    ordered = sorted(models.values(), key=lambda model: (model.row, model.column))
    first = ordered[0] if choice.model is None else model_named(points.bundle, choice.model)
    path = films.project.folder / choice.file
    file = StereoFile(path, films.project.shown(path))
    if (left := file.unfinished) is not None and (left.kind, left.code) not in choice.codes:
        file.require_finished()
    with setup.session(films, f"all of it is in {file.shown}; repeat the command") as session:
        session.link.change_model(first.name)
        session.link.guide("OBJECT")
        session.link.automatic(True)
        _Collecting(session, points, models, file, choice).collect()
    return Digitised(
        file.shown, False, tuple(session.entries), session.ending, (), (*films.warnings, *session.warnings)
    )  # fmt: skip


class _Collecting:
    """What the operator collects: the code and name in force, and whether a line or area is open."""

    def __init__(
        self,
        session: Session,
        points: BundlePoints,
        models: Mapping[str, StereoModel],
        file: StereoFile,
        choice: FeaturesChoice,
    ) -> None:
        self._session, self._points, self._models, self._file = session, points, models, file
        self._codes, self._first = choice.codes, choice.first
        self._code, self._name, self._open = choice.codes[0], "", False
        if (left := file.unfinished) is not None:
            self._code, self._name, self._open = FeatureCode(left.kind, left.code), left.name, True
            session.tell(f"going on with {left.kind} {left.code} {left.name}, vertex {len(left.vertices) + 1}")

    def collect(self) -> None:
        """Do what the operator wants until he ends."""
        codes = (f"{number} {kind} {code}" for number, (kind, code) in enumerate(self._codes, start=1))
        self._session.tell(f"codes: {', '.join(codes)}")
        while True:
            self._name = self._name or self._free()
            event = self._session.operator.act(self._session.link, Visit((), "FOOT LEFT", is_new=True, hint=_HINT))
            if event is None:
                self._session.ending = "no further input"
                if (left := self._file.unfinished) is not None:
                    text = f"{left.code} {left.name} lacks vertices; repeat the command to go on with it"
                    self._session.warnings.append(ProjectWarning("unfinished", self._file.shown, text))
                return
            try:
                if isinstance(event, Named):
                    self._leave()
                    self._name = event.name
                elif event.kind == "RIGHT" and event.plates is not None:
                    self._take(event.plates)
                elif event.kind == "LEFT":
                    self._take_back()
                elif event.key == "ENTER":
                    self._leave()
                elif event.key.isdigit() and 0 < int(event.key) <= len(self._codes):
                    self._leave()
                    self._code, self._name = self._codes[int(event.key) - 1], ""
                else:
                    self._leave()
                    self._session.ending = "ended by the operator"
                    return
            except OripError as fault:
                self._session.tell(str(fault))

    def _free(self) -> str:
        taken = {one.name for one in self._file.features if record_key(one.code) == record_key(self._code.code)}
        return next_name(self._first, taken)

    def _take(self, plates: tuple[Position, Position]) -> None:
        """Record a vertex in the photos of the model that is active now."""
        status = self._session.link.status()
        model = self._models.get(record_key(status.model))
        if model is None:
            known = listed_names(one.name for one in self._models.values())
            message = f"model {status.model} is none of bundle {self._points.bundle.name}, which has {known}"
            raise OripError(message)
        left, right = (self._points.measured_at(photo, plates) for photo in (model.left, model.right))
        vertex = StereoVertex(model.left, left, model.right, right)
        feature = self._file.put(self._code.kind, self._code.code, self._name, vertex)
        self._enter("digitised", f"{feature.code} {feature.name}", model.name)
        self._open = feature.kind != "POINT"
        if not self._open:
            self._name = ""

    def _take_back(self) -> None:
        feature = self._file.undo()
        self._enter("skipped", f"{feature.code} {feature.name}", self._session.link.status().model)
        self._code, self._name = FeatureCode(feature.kind, feature.code), feature.name
        self._open = feature.kind != "POINT" and len(feature.vertices) > 1

    def _enter(self, outcome: Outcome, name: str, model: str) -> None:
        self._session.enter(Entry("vertex", model, name, outcome, "nowhere", None, None))

    def _leave(self) -> None:
        """End the line or area that is open; raises OripError where it lacks vertices."""
        self._file.require_finished()
        if self._open:
            feature = self._file.features[-1]
            self._session.tell(f"{feature.kind} {feature.code} {feature.name} has {len(feature.vertices)} vertices")
            self._name, self._open = "", False
