"""The answer to a request: how a photo point stands now, and what has changed since before the request."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from msgspec import Struct

from orip.online.answers import Answer, Candidate, Suspect, words_of
from orip.online.current_values import CurrentValues
from orip.online.snooping import Snooping
from orip.sequential.observation_rows import ObservationKey
from orip.structs import replace


class Before(Struct, frozen=True):
    """What there was before a request, as far as an answer tells of changes."""

    sigma0: float | None
    suspects: tuple[ObservationKey, ...]
    oriented: frozenset[str]
    placed: frozenset[str]


class Request(Struct):
    """A request that has been answered, and what is left of it to be done.

    Parameters
    ----------
    key : ObservationKey
        The photo point that it is about.
    before : Before
    answer : Answer
    points : dict of str
        Points that may have moved.
    new : list of ObservationKey
        Observations that it has taken in.
    is_tested : bool
        Whether nothing more is to be found by testing what these concern.
    has_oriented : bool
    """

    key: ObservationKey
    before: Before
    answer: Answer
    points: dict[str, None]
    new: list[ObservationKey]
    is_tested: bool
    has_oriented: bool


def answer_now(
    key: ObservationKey,
    before: Before,
    snooping: Snooping,
    excluded: Collection[ObservationKey],
    advised: tuple[Candidate, ...],
) -> Answer:
    """Return how a photo point stands, with what has changed since before a request and what to measure next."""
    block, suspects = snooping.block, snooping.suspects
    values, included = block.values, block.equations.included
    answer = Answer(
        key.photo, key.point, "waiting", "",
        sigma0=block.sigma0,
        sigma0_before=before.sigma0,
        suspects=tuple(one for other, one in suspects.items() if other not in before.suspects),
        cleared=tuple(other for other in before.suspects if other in included),
        oriented=tuple(photo for photo in values.orientations if photo not in before.oriented),
        placed=tuple(point for point in values.points if point not in before.placed),
        next=advised,
    )  # fmt: skip
    if key in excluded:
        return replace(answer, state="excluded", text=f"{words_of(key)} is left out by your decision")
    if key in suspects:
        suspect = suspects[key]
        text = f"{words_of(key)} does not fit: w {suspect.w:.1f}, limit {suspect.limit:.1f}{_also(suspect)}"
        return replace(answer, state="suspect", text=text, w=suspect.w, limit=suspect.limit)
    if key not in included:
        return replace(answer, text=_wait(values, key))
    standing = block.equations.standing(key)
    square, checked = standing.square()
    redundancy = tuple(float(value) for value in standing.redundancy)
    if not checked:
        return replace(answer, state="unchecked", text=f"{words_of(key)} is not checked yet", redundancy=redundancy)
    w, limit = float(np.sqrt(square)), snooping.scale.limit(checked)
    answer = replace(answer, w=w, limit=limit, redundancy=redundancy)
    if checked < len(redundancy):
        return replace(answer, state="unchecked", text=f"{words_of(key)} is checked in one direction only")
    return replace(answer, state="included", text=f"{words_of(key)} fits: w {w:.1f}, limit {limit:.1f}")


def is_news(answer: Answer, before: Answer) -> bool:
    """Return whether an answer says more than the one before it, figures apart."""

    def said(one: Answer) -> tuple[object, ...]:
        return one.state, one.is_pending, {other.key for other in one.suspects}, one.cleared, one.oriented, one.placed

    return said(answer) != said(before)


def _wait(values: CurrentValues, key: ObservationKey) -> str:
    """Return what a photo point waits for."""
    if key.photo not in values.orientations:
        return values.photos_wait.get(key.photo, f"photo {key.photo} waits: it is not oriented")
    return values.points_wait.get(key.point, f"point {key.point} waits: it has no coordinates")


def _also(suspect: Suspect) -> str:
    if not suspect.alike:
        return "; measure it again"
    names = ", ".join(map(words_of, suspect.alike))
    return f"; an error in {names} would look the same: measure these again, or the point in one more photo"
