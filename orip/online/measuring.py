"""Answers to measurements: each is tested as soon as others check it, and what is wrong is named at once."""

from __future__ import annotations

from collections.abc import Collection

from orip.online.advice import Before, Request, advice, answer_now, is_news
from orip.online.answers import Answer, Candidate, ErrorScale, Suspect, words_of
from orip.online.block.first_photos import SOON, THOROUGH, FirstValues, StartAttempts, may_start, no_start
from orip.online.block.local_system import local_system, on_ground
from orip.online.block.measurements import Measurement
from orip.online.block.online_block import OnlineBlock
from orip.online.control_examination import ControlExamination, control_as_given
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.snooping import Snooping
from orip.structs import replace

ALPHA = 0.001
"""Error probability of the test of one observation; sigma0 is the one a priori."""

_IN_AN_ANSWER = 1
"""Linearisations at the solution before a measurement is answered; where more are needed its test follows."""

_ADVISED = 3
"""What to measure next, in an answer."""

_LATER = 0.1
"""Part by which the measurements have to increase before the cameras are adjusted again."""

_MUCH_LATER = 0.25
"""Part by which they have to increase before all values are found again."""

_TOO_MANY, _MORE_THAN_A_FEW = 0.03, 5
"""Part of the photo points, and how many of them, that are suspect where the values may be wrong, and not they."""


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
        self._attempts = StartAttempts()
        self._adjusted_with = -1
        self._next_adjustment = 0.0
        self._begun_with = len(block.measurements)
        self._scale = ErrorScale(block, ALPHA)
        self._snooping = Snooping(block, self._scale)
        self._control = ControlExamination(block, self._snooping, self._scale)
        self._request: Request | None = None
        if len(block.measurements):
            self._start(first)
            self._snooping.snoop_first()
            self._control.examine_if_doubted()

    @property
    def suspects(self) -> dict[ObservationKey, Suspect]:
        """Return the observations that do not fit."""
        return self._snooping.suspects

    def measure(self, measurement: Measurement) -> Answer:
        """Take a measurement: a new one, or in the place of an older one of the same point in the same photo.

        What takes long is left to `reconsider`, which every further request does first.

        Raises
        ------
        InputError
            If the photo is not defined or has no interior orientation; nothing has changed then.
        """
        self.reconsider()
        photo, point, xy = measurement
        key = self.block.key(photo, point)
        sigma0 = self.block.sigma0
        self._attempts.note(self.block.project, key)
        if self.block.measurements.put((key.photo, point, xy)):
            self.block.take_out(key)
            self._snooping.forgive([key])
            self.excluded.discard(key)
        return self._advanced(key, sigma0)

    def include(self, photo: str, point: str) -> Answer:
        """Take a photo point in that was left out or is suspect; it is tested again. See `exclude`."""
        self.reconsider()
        key, sigma0 = self._measured(photo, point), self.block.sigma0
        self._attempts.note(self.block.project, key)
        self.excluded.discard(key)
        self._snooping.forgive([key])
        return self._advanced(key, sigma0)

    def reconsider(self) -> Answer | None:
        """Do what was left of the last request: what takes longer than its answer may.

        The state afterwards does not depend on when this is done.

        Returns
        -------
        Answer or None
            The answer as it is now; None: there is nothing new in it.
        """
        request, self._request = self._request, None
        if request is None:
            return None
        if self._has_values():
            is_moved = self._settle(request) | self._join(SOON, request.key.photo) | self._leave_local_system(SOON)
        else:
            is_moved = self._start_soon(request.key)
        examined = self._control.examined
        self._control.examine_if_doubted()
        # both take their time, and measurements may wait
        if self._control.examined != examined or self._begin_again_if_doubted() or is_moved:
            answer = self._answer(request.key, request.before)
            return answer if is_news(answer, request.answer) else None
        return None

    def exclude(self, photo: str, point: str) -> Answer:
        """Leave a photo point out, by the operator's decision; raises KeyError if it is not measured."""
        return self.leave_out(self._measured(photo, point))

    def leave_out(self, key: ObservationKey) -> Answer:
        """Leave out what was measured or given, by the operator's decision."""
        self.reconsider()
        before = self._before(self.block.sigma0)
        self._attempts.note(self.block.project, key)
        self.suspects.pop(key, None)
        self.excluded.add(key)
        self.block.leave_out(key)
        return self._answer(key, before)

    def take_in(self, key: ObservationKey) -> Answer:
        """Take in again what was given and is left out or suspect; it is tested."""
        self.reconsider()
        before, block = self._before(self.block.sigma0), self.block
        self._attempts.note(block.project, key)
        self.excluded.discard(key)
        self._snooping.forgive([key])
        new = block.include(block.rays_with_values([key.photo] * bool(key.photo), [key.point] * bool(key.point)))
        block.settle([key.point] * bool(key.point))
        self._snooping.snoop(self._snooping.concerned(key, new), key)
        return self._answer(key, before)

    def remove(self, photo: str, point: str) -> None:
        """Delete what was measured of a point in a photo; raises KeyError if nothing is."""
        self.reconsider()
        key = self._measured(photo, point)
        self._attempts.note(self.block.project, key)
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
        return self._answer(self._measured(photo, point), self._before(self.block.sigma0))

    def relinearise(self) -> None:
        """Linearise all equations at the solution, until nothing moves any more, and test the suspects again."""
        self.try_waiting()
        self.approach_solution()
        for _ in range(3):
            self.block.relinearise()
        self.examine()

    def examine(self) -> None:
        """Look again at what does not fit, with all that is measured by now.

        Everything begins again if more has been measured since that was done the last time: what is wrong must not
        depend on the order of measuring.
        """
        self.reconsider()
        if not self.suspects:
            return
        self._snooping.review()
        self._control.examine_if_doubted(now=True)
        if len(self.block.measurements) > self._begun_with:
            self._begin_again()

    def try_waiting(self) -> None:
        """Try to orient what waits from all that is measured, unless nothing has changed since that was done."""
        self.reconsider()
        if not self._attempts.is_due_thoroughly():
            return
        if self._has_values():
            self._join(THOROUGH)
            self._leave_local_system(THOROUGH)
        else:
            self._start(THOROUGH)
            self._snooping.snoop_first()
            self._control.examine_if_doubted()

    def approach_solution(self) -> None:
        """Linearise at the solution what is far from it, with the cameras that all that is measured determines."""
        self.reconsider()
        if self._has_values():
            if (
                self.block.values.has_camera_unknowns(self.block.measurements)
                and self._adjusted_with != self._attempts.changes
            ):
                self._adjusted_with = self._attempts.changes
                with control_as_given(self.block):
                    self.block.adjust_included()
            self.block.approach_solution()

    def next(self, photos: Collection[str], most: int) -> tuple[Candidate, ...]:
        """Return what to measure next in some photos, the most profitable first."""
        return advice(self.block, photos, most) if self.block.values.orientations else ()

    @property
    def system(self) -> str:
        """Return in words that the block is in a local system; empty on the ground."""
        return "" if self.block.local is None else self.block.local.description(self.block.measurements)

    def limit(self, checked: int) -> float:
        """Return the limit of w of an observation of which so many equations are checked."""
        return self._scale.limit(checked)

    def waiting(self) -> dict[str, str]:
        """Return what photos and points wait for, by ``photo NAME`` and ``point NAME``."""
        return self.block.values.waiting()

    def _has_values(self) -> bool:
        return bool(self.block.values.orientations and self.block.values.points)

    def _measured(self, photo: str, point: str) -> ObservationKey:
        key = self.block.key(photo, point)
        if self.block.measurements.at(key.photo, point) is None:
            message = f"point {point} is not measured in photo {photo}"
            raise KeyError(message)
        return key

    def _before(self, sigma0: float | None) -> Before:
        values = self.block.values
        return Before(sigma0, tuple(self.suspects), frozenset(values.orientations), frozenset(values.points))

    def _advanced(self, key: ObservationKey, sigma0: float | None) -> Answer:
        """Find values that can be found now, take in what has them, test it if that is soon done, and answer."""
        block, before = self.block, self._before(sigma0)
        if not self._has_values():
            block.values.photos_wait.setdefault(key.photo, no_start(key.photo))
            answer = self._answer(key, before)
            self._request = Request(key, before, answer, {}, [], is_tested=True, has_oriented=False)
            return answer
        oriented, placed = block.values.advance(block.measurements, [key.photo], [key.point])
        control = self._snooping.disagreeing
        self._snooping.forgive([other for other in self.suspects if other.point == key.point and other not in control])
        points = dict.fromkeys([key.point, *placed])
        rays = block.rays_with_values(oriented, points)
        new = block.include(ray for ray in rays if block.key(*ray) not in block.equations.included)
        with block.relinearised(_IN_AN_ANSWER):
            is_settled = block.settle(points)
            found = self._snooping.snoop(self._snooping.concerned(key, new), key, most=1) if is_settled else []
        answer = self._answer(key, before)
        if not is_settled and answer.state in ("included", "unchecked"):
            text = f"{words_of(key)}: the test is pending until the photos that it moves have been linearised again"
            answer = replace(answer, state="unchecked", text=text, w=None, limit=None, is_pending=True)
        self._request = Request(
            key, before, answer, points, new, is_tested=is_settled and not found, has_oriented=bool(oriented)
        )
        return answer

    def _settle(self, request: Request) -> bool:
        """Linearise at the solution with a new measurement, and test all that it concerns there.

        Return whether there was anything to be done.
        """
        if request.has_oriented:
            self._adjust_cameras()
        is_estimated = self._scale.estimated()
        if request.is_tested and not (request.has_oriented or is_estimated):
            return False
        self.block.settle(request.points)
        if is_estimated:
            self._snooping.review()
        self._snooping.snoop(self._snooping.concerned(request.key, request.new), request.key)
        self.block.lose_unsettled()
        return True

    def _start_soon(self, latest: ObservationKey) -> bool:
        """Orient the first photos if that takes little time; return whether there are any."""
        self._start(SOON)
        self._snooping.snoop_first(latest)
        return bool(self.block.values.orientations)

    def _join(self, first: FirstValues, photo: str = "") -> bool:
        """Orient photos that wait together by their own control; return whether the session goes on with them.

        Parameters
        ----------
        photo : str
            The only one that may have got what it waits for; empty: any.
        """
        may_join = self._attempts.may_join(self.block.measurements, self.block.values.orientations, photo)
        return may_join and self._begin_again(first)

    def _begin_again_if_doubted(self) -> bool:
        """Start again from all measurements where too many are suspect, and go on from there if more of them fit.

        What is measured first may orient photos wrongly, so that what is right does not fit later.

        Returns
        -------
        bool
            Whether the session goes on from there.
        """
        measured = len(self.block.measurements)
        suspects = sum(key.kind == "photo" for key in self.suspects)
        if measured < self._begun_with * (1.0 + _MUCH_LATER) or suspects <= max(_MORE_THAN_A_FEW, _TOO_MANY * measured):
            return False
        return self._begin_again()

    def _begin_again(self, first: FirstValues = SOON) -> bool:
        """Start again from all measurements, and go on from there unless fewer of them fit; return whether it is so."""
        self._begun_with = len(self.block.measurements)
        other = Measuring(self.block.begun_again(self.excluded), first)
        is_less = len(other.block.equations.included) < len(self.block.equations.included)
        if is_less or (other.block.local is not None and self.block.local is None):
            return False
        self._go_on_with(other)
        return True

    def _go_on_with(self, other: Measuring) -> None:
        self.block, self._scale = other.block, other._scale
        self._snooping, self._control = other._snooping, other._control
        self._next_adjustment = len(self.block.measurements) * (1.0 + _LATER)

    def _leave_local_system(self, first: FirstValues) -> bool:
        """Take the block to the ground if that loses no photo; return whether the session goes on there."""
        block, local = self.block, self.block.local
        if local is None or not self._attempts.is_due(block.measurements) or not local.may_leave(block.measurements):
            return False
        self._attempts.started(block.measurements)
        orientations, points = block.at_solution()
        other = Measuring(block.begun_again(self.excluded), on_ground(first, orientations, dict(points)))
        if other.block.local is not None or not orientations.keys() <= other.block.values.orientations.keys():
            return False
        self._begun_with = len(block.measurements)
        self._go_on_with(other)
        return True

    def _start_locally(self) -> None:
        """Orient the first two photos to each other, and all that follow from them, if that can be done."""
        if (local := local_system(self.block.measurements)) is None:
            return
        block = self.block.begun_again(self.excluded, local)
        block.start(local.first_values)
        if block.values.orientations:
            self.block, self._scale = block, ErrorScale(block, ALPHA)
            self._snooping = Snooping(block, self._scale)
            self._control = ControlExamination(block, self._snooping, self._scale)

    def _start(self, first: FirstValues) -> None:
        """Orient the first photos, if there may be enough for that since it was tried."""
        if not self._attempts.is_due(self.block.measurements):
            return
        if self.block.local is not None:
            # its photos have lost their values
            self.block = self.block.begun_again(self.excluded)
        block = self.block
        if any(may_start(block.measurements, photo) for photo in block.measurements.photos):
            self._attempts.started(block.measurements)
            block.start(first)
            if not block.values.orientations and first.known is None:
                self._start_locally()
        else:
            block.values.photos_wait = {photo: no_start(photo) for photo in block.measurements.photos}

    def _adjust_cameras(self) -> None:
        """Adjust the block with the unknowns of its cameras, where enough has been measured since that was done."""
        block = self.block
        if (
            self.block.values.has_camera_unknowns(self.block.measurements)
            and len(block.measurements) >= self._next_adjustment
        ):
            block.adjust()
            self._next_adjustment = len(block.measurements) * (1.0 + _LATER)

    def _answer(self, key: ObservationKey, before: Before) -> Answer:
        answer = answer_now(key, before, self._snooping, self.excluded, self.next([key.photo], _ADVISED))
        if (system := self.system) and self._has_values():
            answer = replace(answer, text=f"{answer.text}; {system}")
        return answer
