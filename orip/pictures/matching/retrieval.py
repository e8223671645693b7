"""Which photos probably show the same, from one vector a photo: before any two photos are compared.

Jegou, H., Douze, M., Schmid, C., Perez, P. (2010): Aggregating local descriptors into a compact image representation
(VLAD), CVPR; each word by itself of unit length: Arandjelovic, R. and Zisserman, A. (2013): All about VLAD, CVPR. The
words are means of the photos' own descriptors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from orip.pictures.matching.features import Features

_WORDS = 64
_OF_PHOTO = 1000
"""Features of a photo, the largest, that its vector is made of."""
_SAMPLE = 30_000
"""Descriptors of all photos together that words are the means of."""
_ROUNDS = 10
_SEED = 1
_PIECE = 256


def likely_pairs(features: Sequence[Features], most: int) -> list[tuple[int, int]]:
    """Return pairs of photos of which one is among the most similar ones of the other, sorted.

    Parameters
    ----------
    features : sequence of Features
    most : int
        Photos that each is paired with, at least.
    """
    words = visual_words(features)
    vectors = np.array([photo_vector(photo, words) for photo in features], dtype=np.float32)
    chosen = np.zeros((len(features), len(features)), dtype=bool)
    for start in range(0, len(features), _PIECE):
        similarity = vectors[start : start + _PIECE] @ vectors.T
        rows = np.arange(len(similarity))[:, None]
        similarity[rows[:, 0], start + rows[:, 0]] = -np.inf
        chosen[start + rows, np.argsort(-similarity, axis=1, kind="stable")[:, :most]] = True
    chosen |= chosen.T
    np.fill_diagonal(chosen, val=False)
    one, other = np.nonzero(np.triu(chosen))
    return list(zip(one.tolist(), other.tolist(), strict=True))


def visual_words(features: Sequence[Features]) -> NDArray[np.float32]:
    """Return mean descriptors of clusters (k-means), (64, 128) or as many as there are descriptors."""
    share = max(1, _SAMPLE // max(len(features), 1))
    descriptors = np.concatenate([photo.descriptor[:share] for photo in features]).astype(np.float32)
    if not len(descriptors):
        return np.zeros((1, descriptors.shape[1]), dtype=np.float32)
    count = min(_WORDS, len(descriptors))
    begin = np.random.default_rng(_SEED).choice(len(descriptors), count, replace=False)
    words = descriptors[np.sort(begin)]
    for _ in range(_ROUNDS):
        nearest = _nearest(descriptors, words)
        members = np.bincount(nearest, minlength=count)
        total = np.zeros_like(words)
        np.add.at(total, nearest, descriptors)
        words = np.where(members[:, None] > 0, total / np.maximum(members, 1)[:, None], words).astype(np.float32)
    return words


def photo_vector(features: Features, words: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the vector of a photo: by how much its descriptors differ from their words; of unit length, or zero."""
    descriptors = features.descriptor[:_OF_PHOTO].astype(np.float32)
    total = np.zeros_like(words)
    if len(descriptors):
        nearest = _nearest(descriptors, words)
        np.add.at(total, nearest, descriptors - words[nearest])
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.float32(1e-9))
    vector = total.ravel()
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9), dtype=np.float32)


def _nearest(descriptors: NDArray[np.float32], words: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the word at the least distance of each descriptor."""
    found: NDArray[np.intp] = np.argmin((words * words).sum(axis=1) - 2.0 * (descriptors @ words.T), axis=1)
    return found
