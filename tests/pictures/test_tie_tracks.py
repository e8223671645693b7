"""Features compared, joined to tracks and selected: against worked cases."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from orip.pictures.matching.features import Features, cells, match_features, spread
from orip.pictures.matching.pairs import View, neighbouring_pairs, promising_pairs, verified_matches
from orip.pictures.matching.tracks import Tracks, approximate, join_tracks, of_rays, select_tracks


def features(place: NDArray[np.float64], rng: np.random.Generator, scale: float = 4.0) -> Features:
    descriptor = rng.integers(0, 90, (len(place), 128)).astype(np.uint8)
    return Features(place, np.full(len(place), scale), np.zeros(len(place)), descriptor)


def pairs(*rows: tuple[int, int]) -> NDArray[np.intp]:
    return np.array(rows, dtype=np.intp).reshape(-1, 2)


def test_tracks_are_joined_and_contradictory_ones_dropped() -> None:
    rng = np.random.default_rng(0)
    photos = [features(rng.uniform(0, 100, (5, 2)), rng) for _ in range(3)]
    matches = {(0, 1): pairs((0, 0), (1, 1), (2, 2)), (1, 2): pairs((0, 0), (1, 4)), (0, 2): pairs((1, 3))}
    tracks, contradictory = join_tracks(photos, matches)
    assert contradictory == 1  # 0:1 - 1:1 - 2:4 and 0:1 - 2:3
    found = {
        tuple((int(p), int(f)) for t, p, f in zip(tracks.track, tracks.photo, tracks.feature, strict=True) if t == n)
        for n in range(len(tracks))
    }
    assert found == {((0, 0), (1, 0), (2, 0)), ((0, 2), (1, 2))}


def test_two_directions_at_one_place_are_one_feature() -> None:
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 100, (3, 2))
    twice = features(np.vstack([place, place[:1]]), rng)
    tracks, contradictory = join_tracks([twice, features(place, rng)], {(0, 1): pairs((0, 0), (3, 0))})
    assert contradictory == 0
    assert len(tracks) == 1
    assert len(tracks.track) == 2


def test_a_selection_is_even_and_prefers_many_rays() -> None:
    rng = np.random.default_rng(1)
    # in the left third many points of three photos; elsewhere few, of the first and second photo
    left = rng.uniform([0, 0], [300, 900], (600, 2))
    right = rng.uniform([300, 0], [900, 900], (150, 2))
    track = np.concatenate([np.repeat(np.arange(600), 3), 600 + np.repeat(np.arange(150), 2)])
    photo = np.concatenate([np.tile([0, 1, 2], 600), np.tile([0, 1], 150)])
    place = np.concatenate([np.repeat(left, 3, axis=0), np.repeat(right, 2, axis=0)])
    tracks = Tracks(track, photo, np.arange(len(track)))
    chosen = select_tracks(tracks, place, np.ones(len(place)), np.zeros(len(place)), [(900, 900)] * 3, 81)
    first_ray = np.searchsorted(track, chosen)
    of_two = chosen >= 600
    assert 20 <= np.count_nonzero(~of_two) <= 35  # a third of 81 parts, one each
    assert np.count_nonzero(of_two) == pytest.approx(27 - np.count_nonzero(~of_two) + 12, abs=12)
    parts = cells(place[first_ray][~of_two], (900, 900), 81)
    assert len(np.unique(parts)) >= len(parts) - 12  # twelve at most are there for the pairs


def test_patches_of_selected_tracks_do_not_overlap() -> None:
    rng = np.random.default_rng(3)
    place = np.repeat(rng.uniform(0, 300, (400, 2)), 3, axis=0)
    reach = np.repeat(rng.uniform(5, 15, 400), 3)
    tracks = Tracks(np.repeat(np.arange(400), 3), np.tile([0, 1, 2], 400), np.arange(1200))
    chosen = select_tracks(tracks, place, np.ones(1200), reach, [(300, 300)] * 3, 81)
    own, half = place[3 * chosen], reach[3 * chosen]
    apart = np.abs(own[:, None] - own[None]).max(axis=2) - half[:, None] - half
    assert (apart[~np.eye(len(own), dtype=bool)] >= 0).all()
    assert len(chosen) > 50


def test_features_of_a_crowded_place_do_not_displace_the_others() -> None:
    rng = np.random.default_rng(2)
    crowd, rest = rng.uniform(0, 50, (500, 2)), rng.uniform(0, 600, (100, 2))
    place = np.vstack([crowd, rest])
    response = np.concatenate([np.full(500, 9.0), np.full(100, 1.0)]) + rng.uniform(0, 0.1, 600)
    chosen = spread(place, response, (600, 600), 120)
    assert len(chosen) == 120
    assert np.count_nonzero(chosen >= 500) > 80


def test_matches_are_mutual_and_clear() -> None:
    rng = np.random.default_rng(3)
    one = features(rng.uniform(0, 100, (40, 2)), rng)
    order = rng.permutation(40)
    noisy = np.clip(one.descriptor[order].astype(int) + rng.integers(-3, 4, (40, 128)), 0, 255).astype(np.uint8)
    noisy[5] = noisy[6]  # whose feature has two that are as near: not clear
    found = match_features(one, Features(one.place[order], one.scale, one.angle, noisy))
    assert {tuple(row) for row in found.tolist()} == {(int(order[k]), k) for k in range(40) if k not in {5, 6}}
    nothing = Features(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 128), dtype=np.uint8))
    assert match_features(one, nothing).shape == (0, 2)


def test_only_matches_of_one_relative_orientation_stay() -> None:
    pytest.importorskip("pycolmap")
    rng = np.random.default_rng(4)
    ground = rng.uniform([-4, -3, 8], [4, 3, 14], (120, 3))
    moved = (ground - [1.5, 0.2, 0.3]) @ np.array([[0.995, 0, 0.0998], [0, 1, 0], [-0.0998, 0, 0.995]])
    images = [500.0 * part[:, :2] / part[:, 2:] + [400, 300] for part in (ground, moved)]
    images[1][:40] = rng.uniform([0, 0], [800, 600], (40, 2))
    one, other = (features(image, rng) for image in images)
    view = View(800, 600, 500.0, 1.0)
    found = verified_matches(one, other, np.column_stack([np.arange(120)] * 2), (view, view))
    assert set(range(40, 120)) <= set(found[:, 0].tolist())
    assert np.count_nonzero(found[:, 0] < 40) < 8  # some wrong ones are near their epipolar lines by chance
    again = verified_matches(one, other, np.column_stack([np.arange(120)] * 2), (view, view))
    assert np.array_equal(found, again)
    chance = rng.permutation(120)
    assert not len(verified_matches(one, other, np.column_stack([np.arange(120), chance]), (view, view)))


def test_pairs_of_many_photos_are_those_that_show_the_same() -> None:
    rng = np.random.default_rng(5)
    strip = features(rng.uniform(0, 100, (1320, 2)), rng)
    photos = []
    for number in range(32):  # each shares half of its features with the next one
        part = slice(40 * number, 40 * number + 80)
        photos.append(Features(strip.place[part], strip.scale[part], strip.angle[part], strip.descriptor[part]))
    assert promising_pairs(photos) == [(number, number + 1) for number in range(31)]
    assert len(promising_pairs(photos[:5])) == 10


def test_neighbours() -> None:
    places = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    assert neighbouring_pairs(places, 1)[0] == (0, 1)
    assert (0, 5) not in neighbouring_pairs(places, 2)
    places[5] = np.nan
    assert {(number, 5) for number in range(5)} <= set(neighbouring_pairs(places, 1))


def test_the_first_ray_has_the_median_scale() -> None:
    rng = np.random.default_rng(6)
    scales = [2.0, 8.0, 3.0, 4.5]
    photos = [features(rng.uniform(0, 100, (3, 2)), rng, scale) for scale in scales]
    tracks = Tracks(np.repeat([0, 1], [4, 3]), np.array([0, 1, 2, 3, 0, 2, 3]), np.array([1, 1, 1, 1, 2, 2, 2]))
    found = approximate(tracks, photos)
    scale = of_rays(found.tracks, [photo.scale for photo in photos])
    first = np.flatnonzero(np.diff(found.tracks.track, prepend=-1))
    assert scale[first].tolist() == [3.0, 4.5]  # the smaller track comes first
    assert np.allclose(np.sqrt(np.linalg.det(found.affine[first])), np.maximum(0.42 * scale[first], 1.0))
    assert len(found.tracks.track) == 7 - 1  # 2 against 4.5 is too far
