"""The observations that are in, and the triangle that they give: taken in, tested, taken out, built again.

Points are hyper-rows, so that only what their observations say about the reduced unknowns is in the triangle. A further
observation of a point that is determined is rotated against its hyper-row and then into the triangle. After any other
change of a point its remaining observations are factored alone; their equations of the reduced unknowns are taken in
before the old ones are taken out, so that the triangle keeps its rank.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np

from orip.arrays import BoolArray, FloatArray, along_diagonal
from orip.online.sequential.hyper_rows import (
    ObservationRows,
    PointInTriangle,
    PointsInTriangle,
    ReducedRows,
    factored_point,
    reduced_together,
)
from orip.online.sequential.standings import LEAST_REDUNDANCY, Standing, Whitened, standings_of_many, whitened
from orip.online.sequential.triangle import Triangle

Key = TypeVar("Key", bound=Hashable)

_MOST_REPLACED = 4
"""Points up to which replacing their equations one by one takes less time than to build the triangle."""

_MANY = 0.25
"""Equations, over unknowns, from which N^-1 takes less time than their substitution."""

_LEAST_OF_POINT = 0.1
"""Redundancy number of an observation, reduced unknowns held, from which its point is well determined without it."""

_MOST_ROUNDING = 1000.0
"""Rounding of the triangle, see there, with which it is built again."""


class SequentialBlock(Generic[Key]):
    """Observations by their keys, and the triangle of all their equations."""

    def __init__(self) -> None:
        self.triangle = Triangle()
        self._included: dict[Key, ObservationRows] = {}
        self._of_points: dict[str, list[Key]] = {}
        self._points = PointsInTriangle()
        self._equations = 0
        self.rebuilt = 0

    @property
    def included(self) -> Mapping[Key, ObservationRows]:
        """Return the observations that are in."""
        return self._included

    @property
    def square_sum(self) -> float:
        """Return the square sum of the residuals of all equations."""
        return self.triangle.residual_square_sum

    @property
    def redundancy(self) -> int:
        """Return the number of equations less that of the unknowns that they determine."""
        return self._equations - self._points.coordinates - self.triangle.rank

    def append(self, count: int) -> None:
        """Append reduced unknowns: a new photo."""
        self.triangle.append(count)

    def include(self, key: Key, rows: ObservationRows) -> FloatArray:
        """Take an observation in.

        Returns
        -------
        array (k,)
            What is left of its equations, one after the other: w without sign, 0 where nothing checks the equation yet.

        Raises
        ------
        KeyError
            If an observation with this key is in already.
        """
        if key in self._included:
            raise KeyError(key)
        self._equations += len(rows.right)
        if rows.point is None:
            self._included[key] = rows
            return self.triangle.update(rows.reduced)
        leftovers = self._include_rows(rows.point, rows)
        self._included[key] = rows
        self._of_points.setdefault(rows.point, []).append(key)
        count = len(rows.right) - len(leftovers)
        if count:
            square_sum = self.square_sum
            self._point_changed(rows.point)
            leftovers += [0.0] * (count - 1) + [float(np.sqrt(max(self.square_sum - square_sum, 0.0)))]
        return np.array(leftovers)

    def _include_rows(self, name: str, rows: ObservationRows) -> list[float]:
        """Take equations of a point in, one after the other, and return what is left of them.

        They end before one of a point whose rays are parallel: it turns the others' equations of the reduced unknowns.
        """
        so_far = [self._included[other] for other in self._of_points.get(name, ())]
        leftovers, remaining = list[float](), rows.rows()
        while remaining:
            before = self._points.get(name)
            if before is not None and before.hyper_row.is_complete:
                return [*leftovers, *self._include_in_complete(name, before, remaining)]
            if before is not None and before.reduced:
                break
            so_far.append(remaining.pop(0))
            self._points[name] = after = factored_point(so_far)
            leftovers.append(float(sum(np.sum(self.triangle.update(of_all)) for of_all in after.reduced)))
        return leftovers

    def _include_in_complete(
        self, name: str, point: PointInTriangle, rows: Sequence[ObservationRows]
    ) -> Sequence[float]:
        """Take further equations of a determined point in, together, and return what is left of them."""
        hyper_row, found = point.hyper_row, list[ReducedRows]()
        for row in rows:
            hyper_row, reduced = hyper_row.with_row(row)
            found.append(reduced)
        together = reduced_together(found)
        self._points[name] = PointInTriangle(hyper_row, (*point.reduced, together))
        left: list[float] = self.triangle.update(together).tolist()
        return left

    def exclude(self, key: Key) -> None:
        """Take an observation out."""
        rows = self._included.pop(key)
        self._equations -= len(rows.right)
        if rows.point is None:
            self._replace((rows.reduced,), ())
        else:
            self._of_points[rows.point].remove(key)
            if not self._left(rows.point, rows):
                self._point_changed(rows.point)

    def replace(self, key: Key, rows: ObservationRows) -> None:
        """Replace the equations of an observation: measured again, or linearised again."""
        before = self._included[key]
        if rows.point != before.point:
            self.exclude(key)
            self.include(key, rows)
            return
        self._included[key] = rows
        self._equations += len(rows.right) - len(before.right)
        if rows.point is None:
            self._replace((before.reduced,), (rows.reduced,))
        else:
            self._point_changed(rows.point)

    def replace_all(self, rows: Mapping[Key, ObservationRows]) -> None:
        """Replace the equations of some observations that are in, of the same points: those of a photo that has moved.

        The triangle is changed point by point where that is less work than to build it.
        """
        self._included.update(rows)
        of_none = [key for key, new in rows.items() if new.point is None]
        points = dict.fromkeys(new.point for new in rows.values() if new.point is not None)
        if of_none or len(points) > _MOST_REPLACED:
            self.rebuild(points)
            return
        built = self.rebuilt
        for name in points:
            self._point_changed(name)
            if self.rebuilt != built:
                return

    def exclude_all(self, keys: Iterable[Key]) -> None:
        """Take many observations out, those of a photo, and build the triangle again."""
        removed = [self._included.pop(key) for key in keys]
        self.rebuild({rows.point for rows in removed if rows.point is not None})

    def relinearise(self, rows: Mapping[Key, ObservationRows]) -> None:
        """Replace all observations by the given ones, and build the triangle again."""
        self._included = dict(rows)
        self.rebuild()

    def rebuild(self, changed: Collection[str] | None = None) -> None:
        """Build the triangle from the equations of all observations that are in.

        Parameters
        ----------
        changed : collection of str or None
            Points whose observations have changed; those of all others are factored already. None: all points.
        """
        self._of_points = {}
        for key, rows in self._included.items():
            if rows.point is not None:
                self._of_points.setdefault(rows.point, []).append(key)
        known = {} if changed is None else {name: point for name, point in self._points.items() if name not in changed}
        self._points = PointsInTriangle({name: known.get(name) or self._factored(name) for name in self._of_points})
        self._equations = sum(len(rows.right) for rows in self._included.values())
        of_points = [reduced for point in self._points.values() for reduced in point.reduced]
        of_none = [rows.reduced for rows in self._included.values() if rows.point is None]
        self.triangle.build([*of_points, *of_none])
        self.rebuilt += 1

    def trial(self, key: Key, rows: ObservationRows) -> Standing:
        """Return how an observation, not in yet, would fit if it were; nothing changes.

        Equations in unknowns that nothing else determines are met by these, and have no redundancy.
        """
        name = rows.point
        point = None if name is None else self._points.get(name)
        if name is not None and (point is None or not point.hyper_row.is_complete):
            return self._tried(key, rows)
        own, spread, innovation, is_open = self._whitened([rows])[0]
        if is_open.any():
            return self._tried(key, rows)
        cofactor = np.asarray(np.linalg.inv(np.eye(len(innovation)) + own.T @ own + spread.T @ spread), np.float64)
        return Standing(-cofactor @ innovation, cofactor)

    def _tried(self, key: Key, rows: ObservationRows) -> Standing:
        """Return how an observation fits that is taken in and out again."""
        name = rows.point
        point = None if name is None else self._points.get(name)
        columns = [rows.columns, *([] if point is None else [point.hyper_row.columns])]
        # a point with equations in the triangle that is not determined may have it built again
        all_of_it = point is not None and bool(point.reduced)
        saved = self.triangle.saved(0 if all_of_it else int(np.concatenate(columns).min(initial=self.triangle.size)))
        points = self._points.copy()
        self.include(key, rows)
        standing = self.standing(key)
        del self._included[key]
        self._equations -= len(rows.right)
        if name is not None:
            self._of_points[name].remove(key)
        self._points = points
        self.triangle.restore(saved)
        return standing

    def standing(self, key: Key) -> Standing:
        """Return how an observation that is in fits."""
        return self.standings([key])[0]

    def standings(self, keys: Sequence[Key]) -> list[Standing]:
        """Return how observations that are in fit."""
        observations = [self._included[key] for key in keys]
        if sum(len(rows.right) for rows in observations) > _MANY * self.triangle.size:
            return standings_of_many(self._points, self.triangle, observations)
        return [
            Standing(-innovation, np.eye(len(innovation)) - own.T @ own - spread.T @ spread)
            for own, spread, innovation, _ in self._whitened(observations)
        ]

    def predicted(self, rows: Sequence[ObservationRows]) -> list[tuple[FloatArray, FloatArray, BoolArray]]:
        """Return what the observations that are in say about others.

        Returns
        -------
        list of (difference, cofactor, is_open)
            Observed minus predicted (k,), divided by the a-priori errors; cofactors (k, k) of the prediction; and which
            of it (k,) nothing determines. An observation of a point without equations is one of the reduced unknowns.
        """
        return [
            (innovation, own.T @ own + spread.T @ spread, is_open)
            for own, spread, innovation, is_open in self._whitened(rows)
        ]

    def jointly_predicted(self, rows: Sequence[ObservationRows]) -> tuple[FloatArray, FloatArray]:
        """Return what the observations that are in say about others, of different points, together.

        Returns
        -------
        difference, cofactor : arrays (k,) and (k, k)
            As `predicted`; unknowns that nothing determines are held.
        """
        found = self._whitened(rows)
        spread = np.hstack([one.spread for one in found])
        own = along_diagonal(*(one.own.T @ one.own for one in found))
        return np.concatenate([one.innovation for one in found]), np.asarray(own + spread.T @ spread)

    def has_point(self, name: str) -> bool:
        """Return whether all coordinates of a point are determined by equations that are in."""
        return name in self._points and self._points[name].hyper_row.is_complete

    def correlations(self, key: Key, others: Sequence[Key]) -> list[FloatArray]:
        """Return the correlations (k, k') of the residuals of an observation with those of others that are in.

        Where it is near 1 or -1, an error of one cannot be told from an error of the other. 0 where nothing checks one.
        """
        rows = self._included[key]
        of_others = [self._included[other] for other in others]
        (own, spread, _, _), *others_whitened = self._whitened([rows, *of_others])
        scale = _scale(np.sum(own**2, axis=0) + np.sum(spread**2, axis=0))
        found = []
        for their_rows, (theirs, their_spread, _, _) in zip(of_others, others_whitened, strict=True):
            product = spread.T @ their_spread
            if rows.point is not None and rows.point == their_rows.point:
                product = product + own.T @ theirs
            their_scale = _scale(np.sum(theirs**2, axis=0) + np.sum(their_spread**2, axis=0))
            found.append(-scale[:, None] * product * their_scale)
        return found

    def point_correction(self, name: str, reduced: FloatArray) -> FloatArray:
        """Return the corrections (3,) of a point for corrections of the reduced unknowns; 0 where nothing tells."""
        point = self._points.get(name)
        return np.zeros(3) if point is None else point.hyper_row.coordinates_at(reduced)

    def _whitened(self, observations: Sequence[ObservationRows]) -> list[Whitened]:
        return whitened(self._points, self.triangle, observations)

    def _factored(self, name: str) -> PointInTriangle:
        return factored_point([self._included[key] for key in self._of_points[name]])

    def _left(self, name: str, rows: ObservationRows) -> bool:
        """Take an observation out that a point has lost, by as many equations as it has; False: that cannot be done.

        With W = R^-T A^T in the hyper-row and L, what is left of A there, all equations of the point say L^T (1 - W^T
        W)^-1 L more about the reduced unknowns than those that remain.
        """
        before, remaining = self._points[name], self._of_points[name]
        if not (remaining and before.hyper_row.is_complete):
            return False
        own, reduced = before.hyper_row.whitened(rows)
        values, vectors = np.linalg.eigh(np.eye(len(rows.right)) - own.T @ own)
        if values[0] < _LEAST_OF_POINT:
            return False
        self._points[name] = self._factored(name)
        scaled = vectors.T / np.sqrt(values)[:, None]
        self._replace([ReducedRows(reduced.columns, scaled @ reduced.rows, scaled @ reduced.right)], ())
        return True

    def _point_changed(self, name: str) -> None:
        """Bring what the observations of a point say about the reduced unknowns up to date."""
        before = self._points.taken(name)
        if not self._of_points[name]:
            del self._of_points[name]
            self._replace(before.reduced, ())
            return
        self._points[name] = after = self._factored(name)
        self._replace(before.reduced, after.reduced)

    def _replace(self, before: Sequence[ReducedRows], after: Sequence[ReducedRows]) -> None:
        """Take equations of the reduced unknowns in and others out, in this order."""
        for rows in after:
            self.triangle.update_at_once(rows)
        redundant = all(self.triangle.downdate(rows, LEAST_REDUNDANCY) for rows in before)
        if not redundant or self.triangle.rounding > _MOST_ROUNDING:
            self.rebuild()


def _scale(leverage: FloatArray) -> FloatArray:
    """Return 1 / sqrt(r) of equations (k,), 0 where nothing checks one."""
    redundancy = 1.0 - leverage
    checked = redundancy > LEAST_REDUNDANCY
    return np.where(checked, 1.0 / np.sqrt(np.where(checked, redundancy, 1.0)), 0.0)
