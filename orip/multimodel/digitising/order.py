"""In which order points are digitised, from which photo they are transferred, and how new ones are numbered."""

from __future__ import annotations

import re
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from itertools import count
from typing import NamedTuple

from msgspec import Struct

from orip.records.photo import Stage

# New points are digitised model by model, in each model point by point; those that are measured again point by point,
# in all their photos before the next point. A point that no photo has yet is measured stereoscopically in the two
# photos of a model. In every further photo it is measured against a photo that has it already, whose plate is locked:
# its stereo partner. Partners are sought in the models that photo makes, then on the other stage in the strip nearest
# to it; so a point comes from one strip into a model of the next in two steps, first into the photo on the other stage,
# then from there into the second photo of the model.
#
# Photos are in the form of `record_key`, models too.


class PhotoPair(NamedTuple):
    """A model: its name, its photos, and its place in the block."""

    model: str
    left: str
    right: str
    row: int
    column: int

    @property
    def photos(self) -> tuple[str, str]:
        """Return both photos."""
        return self.left, self.right


class Turn(NamedTuple):
    """One point to be digitised in some photos before the next turn comes; `model` is None where no model is meant."""

    point: str
    photos: tuple[str, ...]
    model: str | None = None


class DigitisingStep(NamedTuple):
    """What is digitised at once.

    Attributes
    ----------
    photos : tuple of one or two photos
        Two are the left and the right photo of `model`.
    partner : str or None
        The photo whose plate is locked where the point was measured in it.
    model : str or None
        The model to be active; None where the photo is in none.
    """

    photos: tuple[str, ...]
    partner: str | None
    model: str | None


Wanted = Mapping[str, Collection[str]]
"""The photos in which each point is to be digitised, points in their order."""


class DigitisedBlock(Struct, frozen=True):
    """The models of a block by row and column, and the stage of each photo; one without a stage is no partner."""

    models: tuple[PhotoPair, ...]
    stages: Mapping[str, Stage]

    def in_order(self, photos: Collection[str]) -> list[str]:
        """Return photos in the order in which the models show them, those of no model last."""
        shown = dict.fromkeys(photo for model in self.models for photo in model.photos)
        return [*(photo for photo in shown if photo in photos), *(photo for photo in photos if photo not in shown)]

    def turns_by_photo(self, wanted: Wanted) -> Iterator[Turn]:
        """Yield turns for one eye: photo by photo."""
        photos = dict.fromkeys(photo for of_point in wanted.values() for photo in of_point)
        for photo in self.in_order(photos):
            yield from (Turn(point, (photo,)) for point, of_point in wanted.items() if photo in of_point)

    def turns_by_point(self, wanted: Wanted) -> Iterator[Turn]:
        """Yield turns point by point, each in all its photos."""
        for point, photos in wanted.items():
            yield Turn(point, tuple(self.in_order(photos)))

    def turns_by_model(self, wanted: Wanted, measured: Wanted) -> Iterator[Turn]:
        """Yield turns model by model.

        A photo's turn comes in the first model in which the point is, or will be, in the other photo too; where there
        is none, in its first model.

        Parameters
        ----------
        wanted, measured : mapping of point to photos
            What is to be digitised, and in which photos points are measured already.
        """
        turns: dict[str | None, list[Turn]] = {model.model: [] for model in self.models}
        turns[None] = []
        for point, photos in wanted.items():
            for model, in_model in self._models_of_photos(photos, measured.get(point, ())).items():
                turns[model].append(Turn(point, tuple(self.in_order(in_model)), model))
        for of_model in turns.values():
            yield from of_model

    def next_step(self, turn: Turn, measured: Iterable[str]) -> DigitisingStep:
        """Return what to digitise next of a turn that still has photos.

        Parameters
        ----------
        measured : iterable of str
            Photos in which the point is measured, other than those of the turn.
        """
        together = [
            (partner, photo)
            for partner in measured
            for photo in turn.photos
            if self.stages.get(partner) not in (None, self.stages[photo])
        ]
        if together:
            partner, photo = min(together, key=lambda pair: self._rank(turn, *pair))
            return DigitisingStep((photo,), partner, self._model_to_see(turn, partner, photo))
        for model in self._first(turn.model):
            if set(model.photos) <= set(turn.photos):
                return DigitisingStep(model.photos, None, model.model)
        return DigitisingStep(turn.photos[:1], None, self._model_to_see(turn, turn.photos[0], turn.photos[0]))

    def is_side_lap(self, step: DigitisingStep) -> bool:
        """Tell whether a point is transferred between two strips: the eyes see a side lap in stereo across it alone."""
        photo, partner = ({model.row for model in self.models if one in model.photos} for one in self._seen(step))
        return bool(photo and partner) and photo.isdisjoint(partner)

    @staticmethod
    def _seen(step: DigitisingStep) -> tuple[str, str]:
        return step.photos[0], step.photos[-1] if step.partner is None else step.partner

    def _models_of_photos(self, photos: Collection[str], measured: Collection[str]) -> dict[str | None, list[str]]:
        """Return the photos whose turn comes in each model."""
        left = set(photos)
        there = left | set(measured)
        found: dict[str | None, list[str]] = {}
        for model in self.models:
            mine = [photo for photo in model.photos if photo in left]
            if mine and there.issuperset(model.photos):
                found[model.model] = mine
                left.difference_update(mine)
        for photo in self.in_order(left):
            first = next((model.model for model in self.models if photo in model.photos), None)
            found.setdefault(first, []).append(photo)
        return found

    def _first(self, name: str | None) -> list[PhotoPair]:
        """Return the models, the named one first."""
        return sorted(self.models, key=lambda model: model.model != name)

    def _model_of(self, *photos: str) -> str | None:
        return next((model.model for model in self.models if set(photos) <= set(model.photos)), None)

    def _model_to_see(self, turn: Turn, partner: str, photo: str) -> str | None:
        """Return the model of photo and partner, else that of the turn if it has the photo, else any that has."""
        of_turn = [model.model for model in self._first(turn.model)[:1] if photo in model.photos and turn.model]
        return self._model_of(partner, photo) or next(iter(of_turn), self._model_of(photo))

    def _rank(self, turn: Turn, partner: str, photo: str) -> tuple[bool, bool, int, int]:
        """Rank a partner: first in a model with the photo, that of the turn before others; then by their distance."""
        distances = [
            (abs(a.row - b.row), abs(a.column - b.column))
            for a in self.models
            for b in self.models
            if partner in a.photos and photo in b.photos
        ]
        rows, columns = min(distances, key=sum, default=(len(self.models), 0))
        model = self._model_of(partner, photo)
        return model is None, model != turn.model, rows + columns, rows


def from_point(turns: Sequence[Turn], point: str) -> Sequence[Turn] | None:
    """Return the turns from the first one of a point; None if it has none."""
    first = next((place for place, turn in enumerate(turns) if turn.point == point), None)
    return None if first is None else turns[first:]


def numbered(first: str) -> Iterator[str]:
    """Yield 1000, 1001 ... or G1, G2 ...; a name without a number gets one."""
    stem, digits = re.fullmatch(r"(.*?)([0-9]*)", first).groups()  # type: ignore[union-attr]  # matches anything
    for number in count(int(digits or 1)):
        yield f"{stem}{number:0{len(digits)}d}"


def next_name(first: str, taken: Container[str]) -> str:
    """Return the first name of a series that is not taken."""
    return next(name for name in numbered(first) if name not in taken)
