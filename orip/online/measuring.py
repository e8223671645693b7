"""Answers to measurements: each is tested as soon as others check it, and what is wrong is named at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np

from orip.adjustment.outlier_tests import OutlierTest
from orip.online.answers import Answer, Suspect, words_of
from orip.online.online_block import Measurement, OnlineBlock
from orip.records.names import record_key
from orip.sequential.observation_rows import ObservationKey
from orip.wording import counted

ALPHA = 0.001
"""Error probability of the test of one observation; sigma0 is the one a priori."""

_ALIKE = 0.9
"""Correlation of residuals from which an error of one observation cannot be told from one of the other."""

_FEW_POINTS = 12
"""Points of a photo up to which a new one is also a check of the others."""

_LATER = 0.1
"""Part by which the measurements have to increase before it is tried again to orient the first photos."""

_MANY = 3
"""Points of a photo that do not fit from which its orientation may be wrong."""

_PAIR = 5
"""Points common to two photos, or control points of one, from which the first photos may be oriented."""


@dataclass(slots=True)
class _Found:
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
    """

    def __init__(self, block: OnlineBlock) -> None:
        self.block = block
        self.suspects: dict[ObservationKey, Suspect] = {}
        self.excluded: set[ObservationKey] = set(block.left_out)
        self._next_start = 0.0
        self._test = OutlierTest(ALPHA, 1.0, None)
        if block.block is not None:
            self._start()
            self._snoop(set(block.equations.included))

    def measure(self, measurement: Measurement) -> Answer:
        """Take a measurement: a new one, or in the place of an older one of the same point in the same photo.

        Raises
        ------
        InputError
            If the photo is not defined or has no interior orientation; nothing has changed then.
        """
        photo, point, _ = measurement
        before = self.block.sigma0
        measured_before = self.block.put(measurement)
        row = self.block.row_of(photo, point)
        assert row is not None, "it has just been measured"
        photo = self.block.observations.photos[row]
        key = self._key(photo, point)
        if measured_before:
            self.block.take_out(key)
            self._forgive([key])
            self.excluded.discard(key)
        found = self._advance(point, key)
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
        self._forgive([key])
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
        self.block.remove(key.photo, point)

    def answer(self, photo: str, point: str) -> Answer:
        """Return how a photo point stands now.

        Raises
        ------
        KeyError
            If it is not measured.
        """
        return self._answer(self._measured(photo, point), self.block.sigma0, _Found([], [], [], []))

    def relinearise(self) -> None:
        """Linearise all equations at the solution, until nothing moves any more."""
        for _ in range(3):
            self.block.relinearise()

    def waiting(self) -> dict[str, str]:
        """Return what photos and points wait for, by ``photo NAME`` and ``point NAME``."""
        values = self.block.values
        photos = {f"photo {name}": text for name, text in values.photos_wait.items() if name not in values.orientations}
        points = {f"point {name}": text for name, text in values.points_wait.items() if name not in values.points}
        return {**photos, **points}

    def _measured(self, photo: str, point: str) -> ObservationKey:
        row = self.block.row_of(photo, point)
        if row is None:
            message = f"point {point} is not measured in photo {photo}"
            raise KeyError(message)
        return self._key(self.block.observations.photos[row], point)

    def _key(self, photo: str, point: str) -> ObservationKey:
        """Return the key of a photo point, with the name of the photo as it is defined."""
        assert self.block.block is not None, "something is measured"
        names = {record_key(record.name): record.name for record in self.block.block.photos}
        return ObservationKey("photo", names[record_key(photo)], point)

    def _advance(self, point: str, key: ObservationKey) -> _Found:
        """Find values that can be found now, take in what has them, and test it."""
        block, found = self.block, _Found([], [], [], [])
        assert block.block is not None, "something is measured"
        if not block.values.orientations:
            self._start()
            found.oriented, found.placed = list(block.values.orientations), list(block.values.points)
            found.suspects = self._snoop(set(block.equations.included), key)
            return found
        found.oriented, found.placed = block.values.advance(block.block, [key.photo], [point])
        again = [other for other in self.suspects if other.point == point]
        self._forgive(again)
        new = block.include(found.oriented, {point, *found.placed})
        if found.oriented:
            block.adjust()
        block.settle()
        found.suspects = self._snoop(self._concerned(key, new), key)
        found.cleared = [other for other in again if other in block.equations.included]
        before = set(again)
        found.suspects = [one for one in found.suspects if one.key not in before or one.key == key]
        return found

    def _start(self) -> None:
        """Orient the first photos, if there is enough for that."""
        block = self.block
        assert block.block is not None, "something is measured"
        if len(block.observations.photos) < self._next_start:
            return
        if not _may_start(block):
            block.values.photos_wait = {
                photo.name: f"photo {photo.name} waits: no two photos have {_PAIR} common points, and no photo has "
                f"{_PAIR - 1} known points"
                for photo in block.block.photos
            }
            return
        block.values.start(block.block)
        self._next_start = len(block.observations.photos) * (1.0 + _LATER)
        if block.values.orientations:
            block.start()
            block.settle()

    def _concerned(self, key: ObservationKey, new: Iterable[ObservationKey]) -> set[ObservationKey]:
        """Return the observations that new ones may show to be wrong: of the same points, and of photos with few."""
        included = self.block.equations.included
        fresh = {key, *new}
        points = {other.point for other in fresh if other.point}
        sizes: dict[str, int] = {}
        for other in included:
            sizes[other.photo] = sizes.get(other.photo, 0) + 1
        photos = {other.photo for other in fresh if other.photo and sizes.get(other.photo, 0) <= _FEW_POINTS}
        return {other for other in included if other in fresh or other.point in points or other.photo in photos}

    def _snoop(self, keys: Collection[ObservationKey], latest: ObservationKey | None = None) -> list[Suspect]:
        """Take those out that do not fit, the worst first; of several that cannot be told apart, the latest one."""
        found: list[Suspect] = []
        # an observation drops out by itself where it can no longer be computed
        while tested := [key for key in keys if key in self.block.equations.included]:
            worst, w, limit = max(((key, *self._tested(key)) for key in tested), key=lambda one: one[1] / one[2])
            if w <= limit:
                break
            alike = self._alike(worst, tested)
            if latest in alike and latest is not None:
                alike = [worst, *(other for other in alike if other != latest)]
                worst = latest
            suspect = Suspect(worst, w, limit, tuple(alike))
            self.block.take_out(worst)
            self.block.left_out.add(worst)
            self.suspects[worst] = suspect
            found.append(suspect)
            self.block.settle()
            if self._gives_up(worst.photo):
                break
        return [one for one in found if one.key in self.suspects]

    def _gives_up(self, photo: str) -> bool:
        """Take a photo out again whose points mostly do not fit: its orientation is wrong, and not they."""
        wrong = [key for key in self.suspects if photo and key.photo == photo]
        fitting = sum(key.photo == photo for key in self.block.equations.included)
        if len(wrong) < _MANY or len(wrong) <= fitting:
            return False
        self._forgive(wrong)
        self.block.forget_photo(photo)
        text = (
            f"photo {photo} waits: {len(wrong)} of its {len(wrong) + fitting} points do not fit; measure more of them"
        )
        self.block.values.photos_wait[photo] = text
        return True

    def _tested(self, key: ObservationKey) -> tuple[float, float]:
        """Return the root of the fall of the square sum without an observation, and its limit."""
        square, checked = self.block.equations.standing(key).square()
        return float(np.sqrt(square)), self._test.group_limit(max(checked, 1))

    def _alike(self, key: ObservationKey, among: Iterable[ObservationKey]) -> list[ObservationKey]:
        others = [other for other in among if other != key and (other.point == key.point or other.photo == key.photo)]
        found = self.block.equations.correlations(key, others)
        return [other for other, rho in zip(others, found, strict=True) if np.abs(rho).max(initial=0.0) > _ALIKE]

    def _forgive(self, keys: Iterable[ObservationKey]) -> None:
        for key in keys:
            self.suspects.pop(key, None)
            self.block.left_out.discard(key)

    def _answer(self, key: ObservationKey, before: float | None, found: _Found) -> Answer:
        answer = Answer(
            key.photo, key.point, "waiting", "",
            sigma0=self.block.sigma0, sigma0_before=before, suspects=tuple(found.suspects),
            cleared=tuple(found.cleared), oriented=tuple(found.oriented), placed=tuple(found.placed),
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
                w, limit = float(np.sqrt(square)), self._test.group_limit(checked)
            return replace(answer, state="unchecked", text=text, w=w, limit=limit, redundancy=redundancy)
        w, limit = self._tested(key)
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


def _may_start(block: OnlineBlock) -> bool:
    """Return whether two photos may be oriented by common points, or one by known points."""
    assert block.block is not None, "something is measured"
    measured = block.block
    shown = np.zeros((len(measured.photos), len(measured.point_names)), dtype=bool)
    shown[measured.photo_points.photo, measured.photo_points.point] = True
    known = {point.name for point in measured.control_points if None not in point.coordinates}
    control = np.array([name in known for name in measured.point_names], dtype=bool)
    common = shown.astype(np.int64) @ shown.T.astype(np.int64)
    np.fill_diagonal(common, 0)
    given = bool(np.isfinite(measured.photo_orientation).all(axis=1).any())
    return given or bool((common >= _PAIR).any() or ((shown & control).sum(axis=1) >= _PAIR - 1).any())


def summary(measuring: Measuring) -> str:
    """Return the state of the block in a line."""
    block = measuring.block
    values, sigma0 = block.values, block.sigma0
    parts = [
        f"{counted(len(block.observations.photos), 'photo point')} measured",
        f"{counted(len(values.orientations), 'photo')} oriented",
        f"{counted(len(values.points), 'point')} placed",
        "no redundancy" if sigma0 is None else f"sigma0 {sigma0:.3f} with redundancy {block.equations.redundancy}",
    ]
    if measuring.suspects:
        parts.append(f"{len(measuring.suspects)} suspect")
    return ", ".join(parts)
