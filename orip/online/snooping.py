"""What does not fit: taken out at once, the worst first, and tested again when more has been measured."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from orip.online.answers import ErrorScale, Suspect
from orip.online.block.online_block import OnlineBlock
from orip.online.sequential.observation_rows import ObservationKey
from orip.online.sequential.standings import falls

_ALIKE = 0.9
"""Correlation of residuals from which an error of one observation cannot be told from one of the other."""

_RAYS_AGAINST_CONTROL = 2
"""Rays of a control point that do not fit from which the control may be what is wrong."""

_FITTING = 2
"""Rays of a point that do not fit from which those that are in may be what is wrong."""

_MANY = 3
"""Points of a photo that do not fit from which its orientation may be wrong."""

_ALL = 200
"""Observations up to which all are tested again when one of them was taken out; of more, those that nearly failed."""

_NEARLY = 0.7
"""Part of its limit that the test quantity of such an observation exceeds: what is taken out hides others."""


_FEW_POINTS = 12
"""Points of a photo up to which a new one is also a check of the others."""

_AGAIN = 5
"""Times at most that all of a block in a local system is tested where it starts."""


class Snooping:
    """The observations that are suspect.

    Parameters
    ----------
    scale : ErrorScale
        Of the limits of the tests.
    """

    def __init__(self, block: OnlineBlock, scale: ErrorScale) -> None:
        self.block, self.scale = block, scale
        self.suspects: dict[ObservationKey, Suspect] = {}
        self.disagreeing: set[ObservationKey] = set()
        """Control that contradicts most other control: it stays out until all of it is looked at again."""

    def suspect(self, suspect: Suspect) -> None:
        """Take an observation out as suspect."""
        self.block.leave_out(suspect.key)
        self.suspects[suspect.key] = suspect

    def forgive(self, keys: Iterable[ObservationKey]) -> None:
        """Let suspects be taken in again."""
        for key in keys:
            self.suspects.pop(key, None)
            self.block.left_out.discard(key)

    def snoop_first(self, latest: ObservationKey | None = None) -> None:
        """Take out what does not fit of the first photos, and linearise them at their solution without it.

        Meanwhile the values are those of a robust adjustment: what is wrong, and still in, would lead away.
        """
        self.scale.estimated()
        with self.block.relinearised(0):
            self.snoop(list(self.block.equations.included), latest)
        self.block.settle()
        self.block.lose_unsettled()
        self.scale.estimate_again()
        if self.block.local is None:
            return
        # values found one after the other may be too far off for the first tests
        for _ in range(_AGAIN):
            if not self.snoop(list(self.block.equations.included), latest):
                break
            self.block.settle()
            self.block.lose_unsettled()
            self.scale.estimate_again()

    def concerned(self, key: ObservationKey, new: Iterable[ObservationKey]) -> list[ObservationKey]:
        """Return the observations that new ones may show to be wrong: of the same points, and of photos with few."""
        fresh = dict.fromkeys([key, *new])
        points = dict.fromkeys(other.point for other in fresh if other.point)
        photos = dict.fromkeys(other.photo for other in fresh if other.photo)
        few = [photo for photo in photos if len(self.block.measurements.points_in(photo)) <= _FEW_POINTS]
        included = self.block.equations.included
        return list(dict.fromkeys([*self.block.included_of(few, points), *(key for key in fresh if key in included)]))

    def snoop(
        self, keys: Collection[ObservationKey], latest: ObservationKey | None = None, most: int | None = None
    ) -> list[Suspect]:
        """Take those out that do not fit, the worst first; of several that cannot be told apart, the latest one.

        Parameters
        ----------
        most : int or None
            As many as are taken out for their own tests; None: all.

        Returns
        -------
        list of Suspect
            With others that these have shown to be wrong.
        """
        found: list[Suspect] = []
        results, are_many = _Results(self), len(keys) > _ALL
        # an observation drops out by itself where it can no longer be computed
        while tested := [key for key in keys if key in self.block.equations.included]:
            worst, w, limit = results.worst(tested)
            if w <= limit:
                break
            alike = self._alike(worst, tested)
            if latest in alike and latest is not None:
                alike = [worst, *(other for other in alike if other != latest)]
                worst = latest
            found.append(Suspect(worst, w, limit, tuple(alike)))
            self.suspect(found[-1])
            if len(tested) <= _ALL:
                self.block.settle()
            if self._gives_up(worst.photo):
                break
            if worst.kind == "photo":
                found += self._blamed_control(worst.point)
            if most is not None and len(found) >= most:
                break
            if len(tested) > _ALL:
                keys = [key for key in tested if results.ratio(key) > _NEARLY]
            results.grow_old(forgotten=not are_many)
        found += self._outvoted(dict.fromkeys(one.key.point for one in found if one.key.kind == "photo"))
        return [one for one in found if one.key in self.suspects]

    def tested(self, keys: Sequence[ObservationKey]) -> list[tuple[float, float]]:
        """Return the root of the fall of the square sum without each observation, and its limit."""
        squares, checked = falls(self.block.equations.standings(keys))
        limits = {count: self.scale.limit(max(count, 1)) for count in np.unique(checked).tolist()}
        return [(w, limits[count]) for w, count in zip(np.sqrt(squares).tolist(), checked.tolist(), strict=True)]

    def review(self) -> list[ObservationKey]:
        """Take in what is suspect and fits by now, the nearest to fit first; return what was tried."""
        taken = []
        tried = [key for key in self.suspects if key not in self.disagreeing]
        for key in sorted(tried, key=lambda key: self.suspects[key].w):
            rows = self.block.rows(self.block.rays_with_values(points=[key.point])).get(key)
            if rows is None:
                continue
            square, checked = self.block.equations.trial(key, rows).square()
            if np.sqrt(square) <= self.scale.limit(max(checked, 1)):
                self.forgive([key])
                self.block.equations.include(key, rows)
                taken.append(key)
        points = dict.fromkeys(key.point for key in taken)
        self.block.settle(points)
        self.snoop(self.block.included_of(points=points))
        return taken

    def _blamed_control(self, point: str) -> list[Suspect]:
        """Suspect the control of a point, and not its rays, where several of these fit each other without it."""
        rays = [key for key in self.suspects if key.point == point and key.kind == "photo"]
        control = ObservationKey("control", "", point)
        if len(rays) < _RAYS_AGAINST_CONTROL or control not in self.block.equations.included:
            return []
        before = {key: self.suspects[key] for key in rays}
        (w, limit) = max((one.w, one.limit) for one in before.values())
        self.block.leave_out(control)
        self.forgive(rays)
        self.block.include((key.photo, key.point) for key in rays)
        self.block.settle([point])
        inside = [key for key in rays if key in self.block.equations.included]
        wrong = [key for key, (w, limit) in zip(inside, self.tested(inside), strict=True) if w > limit]
        if len(wrong) < len(rays) - 1:
            self.suspects[control] = Suspect(control, w, limit, ())
            return [self.suspects[control]]
        for one in before.values():
            self.suspect(one)
        self.block.left_out.discard(control)
        self.block.include(self.block.rays_with_values(points=[point]))
        self.block.settle([point])
        return []

    def _outvoted(self, points: Iterable[str]) -> list[Suspect]:
        """Suspect the rays of points that are in, and not the others, where these are more and fit each other.

        While a photo has few points, its wrong ray may turn it as it likes, and the right ones seem to be wrong.
        """
        found: list[Suspect] = []
        for point in points:
            out = [key for key in self.suspects if key.kind == "photo" and key.point == point]
            inside = [key for key in self.block.included_of(points=[point]) if key.kind == "photo"]
            if len(out) < _FITTING or len(out) <= len(inside):
                continue
            before = {key: self.suspects[key] for key in out}
            self._exchange(point, inside, out)
            back = [key for key in out if key in self.block.equations.included]
            if len(back) < len(out) or any(w > limit for w, limit in self.tested(back)):
                self._exchange(point, back, inside)
                for one in before.values():
                    self.suspect(one)
                continue
            rows = self.block.rows((key.photo, point) for key in inside)
            for key in inside:
                square, checked = self.block.equations.trial(key, rows[key]).square() if key in rows else (0.0, 0)
                self.suspect(Suspect(key, float(np.sqrt(square)), self.scale.limit(max(checked, 1)), ()))
                found.append(self.suspects[key])
        return found

    def _exchange(self, point: str, out: Collection[ObservationKey], back: Collection[ObservationKey]) -> None:
        """Take some rays of a point out and others in."""
        for key in out:
            self.block.leave_out(key)
        self.forgive(back)
        self.block.include((key.photo, point) for key in back)
        self.block.settle([point])

    def _gives_up(self, photo: str) -> bool:
        """Take a photo out again whose points mostly do not fit: its orientation is wrong, and not they."""
        wrong = [key for key in self.suspects if photo and key.photo == photo]
        if photo and photo not in self.block.values.orientations:
            # it has not settled, and is out already
            self.forgive(wrong)
            return True
        fitting = len(self.block.included_of(photos=[photo]))
        if len(wrong) < _MANY or len(wrong) <= fitting:
            return False
        self.forgive(wrong)
        self.block.forget_photo(photo)
        text = (
            f"photo {photo} waits: {len(wrong)} of its {len(wrong) + fitting} points do not fit; measure more of them"
        )
        self.block.values.photos_wait[photo] = text
        return True

    def _alike(self, key: ObservationKey, among: Iterable[ObservationKey]) -> list[ObservationKey]:
        others = [other for other in among if other != key and (other.point == key.point or other.photo == key.photo)]
        found = self.block.equations.correlations(key, others)
        return [other for other, rho in zip(others, found, strict=True) if np.abs(rho).max(initial=0.0) > _ALIKE]


class _Results:
    """Results of tests while observations are taken out: of many, those alone are tested again that decide."""

    def __init__(self, snooping: Snooping) -> None:
        self._snooping = snooping
        self._found: dict[ObservationKey, tuple[float, float]] = {}
        self._fresh: set[ObservationKey] = set()

    def grow_old(self, *, forgotten: bool) -> None:
        """Something was taken out: all have to be tested again, or those that turn out to decide."""
        self._fresh.clear()
        if forgotten:
            self._found.clear()

    def ratio(self, key: ObservationKey) -> float:
        """Return the test quantity of an observation, when it was tested last, over its limit."""
        w, limit = self._found[key]
        return w / limit

    def worst(self, keys: Sequence[ObservationKey]) -> tuple[ObservationKey, float, float]:
        """Return the observation that fits worst, its test quantity and limit."""
        again = [key for key in keys if key not in self._found]
        while True:
            self._found.update(zip(again, self._snooping.tested(again), strict=True))
            self._fresh.update(again)
            worst = max(keys, key=self.ratio)
            old = [key for key in keys if key not in self._fresh]
            if self.ratio(worst) > 1.0:
                # what was taken out changes its neighbours most; all others are tested before it is said that they fit
                old = [key for key in old if worst not in self._fresh and _are_neighbours(key, worst)]
            if not old:
                return worst, *self._found[worst]
            again = old


def _are_neighbours(one: ObservationKey, other: ObservationKey) -> bool:
    """Return whether observations are the same, or of the same photo or point."""
    return (
        one == other or (one.photo != "" and one.photo == other.photo) or (one.point != "" and one.point == other.point)
    )
