"""Answers to measurements: each is tested as soon as others check it, and what is wrong is named at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
from msgspec import Struct

from orip.online.advice import advice
from orip.online.answers import Answer, Candidate, Suspect, words_of
from orip.online.control_examination import ControlExamination
from orip.online.error_scale import ErrorScale
from orip.online.first_photos import COMMON_POINTS, may_start
from orip.online.first_values import SOON, THOROUGH, FirstValues
from orip.online.measurements import Measurement
from orip.online.online_block import OnlineBlock
from orip.online.snooping import Snooping
from orip.records.names import record_key
from orip.sequential.observation_rows import ObservationKey
from orip.structs import replace

ALPHA = 0.001
"""Error probability of the test of one observation; sigma0 is the one a priori."""

_ADVISED = 3
"""What to measure next, in an answer."""

_FEW_POINTS = 12
"""Points of a photo up to which a new one is also a check of the others."""

_LATER = 0.1
"""Part by which the measurements have to increase before it is tried again to orient the first photos."""

_MUCH_LATER = 0.25
"""Part by which they have to increase before all values are found again."""

_TOO_MANY, _MORE_THAN_A_FEW = 0.03, 5
"""Part of the photo points, and how many of them, that are suspect where the values may be wrong, and not they."""


class _Found(Struct):
    """What a measurement has brought about so far."""

    suspects: list[Suspect]
    cleared: list[ObservationKey]
    oriented: list[str]
    placed: list[str]


class Measuring:
    """A session of measuring.

    Parameters
    ----------
    block : OnlineBlock
        With what was measured before.
    first : FirstValues
        How the first photos of it are oriented.
    """

    def __init__(self, block: OnlineBlock, first: FirstValues = THOROUGH) -> None:
        self.block = block
        self.excluded: set[ObservationKey] = set(block.left_out)
        self._next_start = 0
        self._next_adjustment = 0.0
        self._begun_with = len(block.measurements)
        self._scale = ErrorScale(block, ALPHA)
        self._snooping = Snooping(block, self._scale)
        self._control = ControlExamination(block, self._snooping, self._scale)
        if len(block.measurements):
            self._start(block.measurements.photos, first)
            self._snoop_first()
            self._control.examine_if_doubted()

    @property
    def suspects(self) -> dict[ObservationKey, Suspect]:
        """Return the observations that do not fit."""
        return self._snooping.suspects

    def measure(self, measurement: Measurement) -> Answer:
        """Take a measurement: a new one, or in the place of an older one of the same point in the same photo.

        Raises
        ------
        InputError
            If the photo is not defined or has no interior orientation; nothing has changed then.
        """
        photo, point, xy = measurement
        before, key = self.block.sigma0, self.block.key(photo, point)
        if self.block.measurements.put((key.photo, point, xy)):
            self.block.take_out(key)
            self._snooping.forgive([key])
            self.excluded.discard(key)
        examined = self._control.examined
        found = self._advance(point, key)
        # both take their time, and an answer has to come soon
        is_quick = self._control.examined == examined
        if is_quick and len(self.block.measurements) >= self._begun_with * (1.0 + _MUCH_LATER):
            found = self._begun_again_if_doubted(found)
        return self._answer(key, before, found)

    def exclude(self, photo: str, point: str) -> Answer:
        """Leave a photo point out, by the operator's decision.

        Raises
        ------
        KeyError
            If it is not measured.
        """
        key, before = self._measured(photo, point), self.block.sigma0
        self.block.take_out(key)
        self.suspects.pop(key, None)
        self.excluded.add(key)
        self.block.left_out.add(key)
        return self._answer(key, before, _Found([], [], [], []))

    def include(self, photo: str, point: str) -> Answer:
        """Take a photo point in that was left out or is suspect, by the operator's decision; it is tested again.

        Raises
        ------
        KeyError
            If it is not measured.
        """
        key, before = self._measured(photo, point), self.block.sigma0
        self.excluded.discard(key)
        self._snooping.forgive([key])
        return self._answer(key, before, self._advance(key.point, key))

    def remove(self, photo: str, point: str) -> None:
        """Delete what was measured of a point in a photo.

        Raises
        ------
        KeyError
            If it is not measured.
        """
        key = self._measured(photo, point)
        self.suspects.pop(key, None)
        self.excluded.discard(key)
        self.block.remove(key)

    def answer(self, photo: str, point: str) -> Answer:
        """Return how a photo point stands now.

        Raises
        ------
        KeyError
            If it is not measured.
        """
        return self._answer(self._measured(photo, point), self.block.sigma0, _Found([], [], [], []))

    def relinearise(self) -> None:
        """Linearise all equations at the solution, until nothing moves any more, and test the suspects again."""
        for _ in range(3):
            self.block.relinearise()
        self.examine()

    def examine(self) -> None:
        """Look again at what does not fit, with all that is measured by now.

        Everything begins again if more has been measured since that was done the last time: what is wrong must not
        depend on the order of measuring.
        """
        if not self.suspects:
            return
        self._snooping.review()
        self._control.examine_if_doubted(now=True)
        if len(self.block.measurements) > self._begun_with:
            self._begun_again()

    def next(self, photos: Collection[str], most: int) -> tuple[Candidate, ...]:
        """Return what to measure next in some photos, the most profitable first."""
        return advice(self.block, photos, most) if self.block.values.orientations else ()

    def limit(self, checked: int) -> float:
        """Return the limit of w of an observation of which so many equations are checked."""
        return self._scale.limit(checked)

    def waiting(self) -> dict[str, str]:
        """Return what photos and points wait for, by ``photo NAME`` and ``point NAME``."""
        values = self.block.values
        photos = {f"photo {name}": text for name, text in values.photos_wait.items() if name not in values.orientations}
        points = {f"point {name}": text for name, text in values.points_wait.items() if name not in values.points}
        return {**photos, **points}

    def _measured(self, photo: str, point: str) -> ObservationKey:
        key = self.block.key(photo, point)
        if self.block.measurements.at(key.photo, point) is None:
            message = f"point {point} is not measured in photo {photo}"
            raise KeyError(message)
        return key

    def _advance(self, point: str, key: ObservationKey) -> _Found:
        """Find values that can be found now, take in what has them, and test it."""
        block, found = self.block, _Found([], [], [], [])
        if not (block.values.orientations and block.values.points):
            oriented = set(block.values.orientations)
            self._start([key.photo], SOON)
            found.oriented = [photo for photo in block.values.orientations if photo not in oriented]
            found.placed = list(block.values.points)
            found.suspects = self._snoop_first(key)
            found.suspects += self._control.examine_if_doubted()
            return found
        found.oriented, found.placed = block.values.advance(block.measurements, [key.photo], [point])
        control = self._snooping.disagreeing
        again = [other for other in self.suspects if other.point == point and other not in control]
        self._snooping.forgive(again)
        fresh = dict.fromkeys([point, *found.placed])
        rays = block.rays_with_values(found.oriented, fresh)
        new = block.include(ray for ray in rays if block.key(*ray) not in block.equations.included)
        if found.oriented:
            self._adjust_cameras()
        block.settle(fresh)
        if self._scale.estimated():
            again += self._snooping.review()
        found.suspects = self._snooping.snoop(self._concerned(key, new), key)
        block.lose_unsettled()
        found.suspects += self._control.examine_if_doubted()
        found.cleared = [other for other in dict.fromkeys(again) if other in block.equations.included]
        before = set(again)
        found.suspects = [one for one in found.suspects if one.key not in before or one.key == key]
        return found

    def _begun_again_if_doubted(self, found: _Found) -> _Found:
        """Start again from all measurements where too many are suspect, and go on from there if more of them fit.

        What is measured first may orient photos wrongly, so that what is right does not fit later.

        Returns
        -------
        _Found
            What has been found all in all.
        """
        before, photos = self.suspects, set(self.block.values.orientations)
        suspects = sum(key.kind == "photo" for key in before)
        if suspects <= max(_MORE_THAN_A_FEW, _TOO_MANY * len(self.block.measurements)) or not self._begun_again():
            return found
        return _Found(
            [one for key, one in self.suspects.items() if key not in before or one in found.suspects],
            [*found.cleared, *(key for key in before if key not in self.suspects)],
            [photo for photo in self.block.values.orientations if photo in found.oriented or photo not in photos],
            [point for point in found.placed if point in self.block.values.points],
        )

    def _begun_again(self) -> bool:
        """Start again from all measurements, and go on from there unless fewer of them fit; return whether it is so."""
        self._begun_with = len(self.block.measurements)
        other = Measuring(self.block.begun_again(self.excluded), SOON)
        if len(other.block.equations.included) < len(self.block.equations.included):
            return False
        self.block, self._scale = other.block, other._scale
        self._snooping, self._control = other._snooping, other._control
        self._next_adjustment = self._begun_with * (1.0 + _LATER)
        return True

    def _snoop_first(self, latest: ObservationKey | None = None) -> list[Suspect]:
        """Take out what does not fit of the first photos, and linearise them at their solution without it."""
        self._scale.estimated()
        with self.block.robust_values():
            found = self._snooping.snoop(list(self.block.equations.included), latest)
        self.block.settle()
        self.block.lose_unsettled()
        self._scale.estimate_again()
        return found

    def _start(self, photos: Iterable[str], first: FirstValues) -> None:
        """Orient the first photos, if there is enough in some of them for that."""
        block = self.block
        if len(block.measurements) < self._next_start:
            return
        if not any(may_start(block.measurements, photo) for photo in photos):
            block.values.photos_wait = {
                photo: f"photo {photo} waits: no two photos have {COMMON_POINTS} common points, and no photo has "
                f"{COMMON_POINTS - 1} known points"
                for photo in block.measurements.photos
            }
            return
        block.start(first)
        self._next_start = int(len(block.measurements) * (1.0 + _LATER))

    def _adjust_cameras(self) -> None:
        """Adjust the block with the unknowns of its cameras, where enough has been measured since that was done."""
        block = self.block
        records = block.measurements.inputs.records
        has_unknowns = any(
            records.camera_of(records.photos[record_key(photo)]).unknown for photo in block.values.orientations
        )
        if has_unknowns and len(block.measurements) >= self._next_adjustment:
            block.adjust()
            self._next_adjustment = len(block.measurements) * (1.0 + _LATER)

    def _concerned(self, key: ObservationKey, new: Iterable[ObservationKey]) -> list[ObservationKey]:
        """Return the observations that new ones may show to be wrong: of the same points, and of photos with few."""
        fresh = dict.fromkeys([key, *new])
        points = dict.fromkeys(other.point for other in fresh if other.point)
        photos = dict.fromkeys(other.photo for other in fresh if other.photo)
        few = [photo for photo in photos if len(self.block.measurements.points_in(photo)) <= _FEW_POINTS]
        included = self.block.equations.included
        return list(dict.fromkeys([*self.block.included_of(few, points), *(key for key in fresh if key in included)]))

    def _answer(self, key: ObservationKey, before: float | None, found: _Found) -> Answer:
        answer = Answer(
            key.photo, key.point, "waiting", "",
            sigma0=self.block.sigma0, sigma0_before=before, suspects=tuple(found.suspects),
            cleared=tuple(found.cleared), oriented=tuple(found.oriented), placed=tuple(found.placed),
            next=self.next([key.photo], _ADVISED),
        )  # fmt: skip
        if key in self.excluded:
            return replace(answer, state="excluded", text=f"{words_of(key)} is left out by your decision")
        if key in self.suspects:
            suspect = self.suspects[key]
            text = f"{words_of(key)} does not fit: w {suspect.w:.1f}, limit {suspect.limit:.1f}{_also(suspect)}"
            return replace(answer, state="suspect", text=text, w=suspect.w, limit=suspect.limit)
        if key not in self.block.equations.included:
            return replace(answer, text=self._wait(key))
        standing = self.block.equations.standing(key)
        square, checked = standing.square()
        redundancy = tuple(float(value) for value in standing.redundancy)
        if checked < len(redundancy):
            text = f"{words_of(key)} is not checked yet" if not checked else (
                f"{words_of(key)} is checked in one direction only"
            )  # fmt: skip
            w, limit = None, None
            if checked:
                w, limit = float(np.sqrt(square)), self._scale.limit(checked)
            return replace(answer, state="unchecked", text=text, w=w, limit=limit, redundancy=redundancy)
        w, limit = float(np.sqrt(square)), self._scale.limit(checked)
        text = f"{words_of(key)} fits: w {w:.1f}, limit {limit:.1f}"
        return replace(answer, state="included", text=text, w=w, limit=limit, redundancy=redundancy)

    def _wait(self, key: ObservationKey) -> str:
        """Return what a photo point waits for."""
        values = self.block.values
        if key.photo not in values.orientations:
            return values.photos_wait.get(key.photo, f"photo {key.photo} waits: it is not oriented")
        return values.points_wait.get(key.point, f"point {key.point} waits: it has no coordinates")


def _also(suspect: Suspect) -> str:
    if not suspect.alike:
        return "; measure it again"
    names = ", ".join(map(words_of, suspect.alike))
    return f"; an error in {names} would look the same: measure these again, or the point in one more photo"
