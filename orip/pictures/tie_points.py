"""From photos to tie points: features, pairs, tracks, and least-squares matching; with what was found before."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from time import perf_counter
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.errors import InputError
from orip.images.images_of_photos import reason
from orip.images.matching.least_squares import Fate, MatchSettings, Windows, match_rays
from orip.pictures.consistency import examine_rays
from orip.pictures.forecast import Pace
from orip.pictures.matching.features import Features, find_features, match_features
from orip.pictures.matching.pairs import View, neighbouring_pairs, promising_pairs, verified_matches
from orip.pictures.matching.tracks import (
    HALF,
    LEVELS,
    Approximations,
    Tracks,
    approximate,
    cut_windows,
    halved,
    in_window,
    is_inside,
    join_tracks,
    of_rays,
    parts_of,
    patch_reaches,
    select_tracks,
)
from orip.pictures.matching_cache import MatchingCache
from orip.progress import stage
from orip.records.camera import Camera
from orip.threads import available_threads, by_threads

T = TypeVar("T")
PartT = TypeVar("PartT")
Grey = NDArray[np.uint8]


class Picture(Struct, frozen=True):
    """A photo with its image.

    Parameters
    ----------
    name : str
        Of the photo.
    digest : str
        Of the image file.
    size : tuple of 2 int
        Columns and rows.
    focal : float
        Principal distance, pixels.
    read : callable
        Returns grey values (rows, columns) of 8 bits.
    """

    name: str
    digest: str
    size: tuple[int, int]
    focal: float
    read: Callable[[], Grey]


class TieSettings(Struct, frozen=True):
    """How tie points are found.

    Parameters
    ----------
    points : int
        Of a photo, about.
    features : int
        Of a photo.
    refines : bool
        Places are refined by least-squares matching; else they are those of the features.
    matching : MatchSettings
    places : ndarray (n, 3) or None
        Approximate places of the photos, NaN where not known: neighbours are compared.
    neighbours : int
        With which a photo is compared then.
    cameras : tuple of Camera
        Of each photo: the rays are examined by an adjustment. None: they are not.
    """

    points: int = 300
    features: int = 5000
    refines: bool = True
    matching: MatchSettings = MatchSettings()
    places: NDArray[np.float64] | None = None
    neighbours: int = 24
    cameras: tuple[Camera, ...] = ()


class TiePoints(Struct, frozen=True):
    """Tie points and how they came about.

    Parameters
    ----------
    tracks : Tracks
    place : ndarray (r, 2)
        Pixels from the outer corner of the first one.
    error : ndarray (r, 2)
        Standard deviations, pixels.
    features : tuple of int
        Of each photo.
    pairs, compared : int
        Pairs of photos with verified matches, and those compared.
    joined, contradictory : int
        Tracks, and those with two features in a photo.
    fates : dict of Fate to int
        Rays matched, and rejected.
    factor : float or None
        By which the errors that the patches say were multiplied, as the rays among themselves say; the largest one
        of several parts of the block.
    """

    tracks: Tracks
    place: NDArray[np.float64]
    error: NDArray[np.float64]
    features: tuple[int, ...]
    pairs: int
    compared: int
    joined: int
    contradictory: int
    fates: dict[Fate, int]
    factor: float | None


_RESERVE = 1.5
"""Times as many points are matched as are to be left."""
_RAYS_OF_BATCH = 400
"""Matched together: what they need is some 60 MB."""
_RAYS_OF_SHEET = 60_000
"""Whose windows are in memory together: 5 kB each."""
_FEATURE_ERROR = 0.15
"""Standard deviation of a feature's place, in its size."""


def find_tie_points(
    pictures: Sequence[Picture],
    features: Sequence[Features],
    settings: TieSettings,
    cache: MatchingCache,
    pace: Pace,
) -> TiePoints:
    """Return tie points of photos.

    The same images give the same points, bit for bit, on any number of threads.

    Parameters
    ----------
    features : sequence of Features
        Of `features_of`.
    pace : Pace
        Is told how long pairs take.
    """
    compared, matches = _matches(pictures, features, settings, cache, pace)
    tracks, contradictory = join_tracks(features, matches)
    counts = tuple(len(photo) for photo in features)
    if not len(tracks):
        nothing = np.zeros((0, 2))
        return TiePoints(tracks, nothing, nothing, counts, len(matches), compared, 0, contradictory, {}, None)
    sizes = [picture.size for picture in pictures]
    place = of_rays(tracks, [photo.place for photo in features])
    inside = is_inside(tracks, place, sizes)
    count = np.bincount(tracks.track, weights=inside, minlength=len(tracks))
    kept = inside & (count[tracks.track] >= 2)
    joined, tracks, place = len(tracks), tracks.take(kept), place[kept]
    scale = of_rays(tracks, [photo.scale for photo in features])
    error = _FEATURE_ERROR * scale
    most = round(_RESERVE * settings.points) if settings.refines else settings.points
    half = settings.matching.half if settings.refines else 0
    chosen = np.isin(tracks.track, select_tracks(tracks, place, error, patch_reaches(scale, half), sizes, most))
    tracks, place = tracks.take(chosen), place[chosen]
    error = np.repeat(error[chosen][:, None], 2, axis=1)
    fates: dict[Fate, int] = {}
    if settings.refines:
        tracks, place, error, fates = _refined(pictures, features, tracks, settings.matching)
    factor = None
    if settings.refines and settings.cameras and len(tracks):
        part = parts_of(tracks, len(pictures))[tracks.photo]
        good = np.ones(len(part), dtype=np.bool_)
        for number in range(part.max() + 1):
            here = np.flatnonzero(part == number)
            examined = examine_rays(tracks.take(part == number), place[here], error[here], settings.cameras)
            good[here] = examined.is_good
            error[here] *= examined.factor or 1.0
            factor = max((one for one in (factor, examined.factor) if one is not None), default=None)
        good &= np.bincount(tracks.track, weights=good)[tracks.track] >= 2
        fates[Fate.CONTRADICTS] = int(np.count_nonzero(~good))
        tracks, place, error = tracks.take(good), place[good], error[good]
    if settings.refines:
        reach = patch_reaches(of_rays(tracks, [photo.scale for photo in features]), half)
        final = select_tracks(tracks, place, error.mean(axis=1), reach, sizes, settings.points)
        chosen = np.isin(tracks.track, final)
        tracks, place, error = tracks.take(chosen), place[chosen], error[chosen]
    return TiePoints(tracks, place, error, counts, len(matches), compared, joined, contradictory, fates, factor)


def features_of(
    pictures: Sequence[Picture], settings: TieSettings, cache: MatchingCache, pace: Pace
) -> list[tuple[Features | None, str]]:
    """Return the features of each photo; or None, and what is wrong with the image; `pace` is told how long it took."""

    def find(picture: Picture) -> tuple[Features | None, str]:
        known = cache.features(picture.digest)
        if known is None:
            begin = perf_counter()
            try:
                grey = picture.read()
            except InputError as error:
                return None, reason(error)
            known = find_features(grey, picture.size, settings.features)
            cache.keep_features(picture.digest, known)
            pace.photo(perf_counter() - begin)
        return known, ""

    return list(_in_turn("features", find, pictures, pace.judge))


def _matches(
    pictures: Sequence[Picture],
    features: Sequence[Features],
    settings: TieSettings,
    cache: MatchingCache,
    pace: Pace,
) -> tuple[int, dict[tuple[int, int], NDArray[np.intp]]]:
    """Return how many pairs were compared, and the matches of those that have some."""
    from orip.pictures.matching.features import DETAIL

    if settings.places is None:
        pairs = promising_pairs(features)
    else:
        pairs = neighbouring_pairs(settings.places, settings.neighbours)
    pace.expect(len(pairs))
    views = [View(*picture.size, picture.focal, max(1.0, max(picture.size) / DETAIL)) for picture in pictures]
    partners: dict[int, list[int]] = {}
    for one, other in pairs:
        partners.setdefault(one, []).append(other)

    def match(one: int) -> list[NDArray[np.intp]]:
        known = cache.matches(pictures[one].digest)
        keys = [f"{pictures[other].digest} {views[one].focal:.6g} {views[other].focal:.6g}" for other in partners[one]]
        missing = [(key, other) for key, other in zip(keys, partners[one], strict=True) if key not in known]
        for key, other in missing:
            begin = perf_counter()
            found = match_features(features[one], features[other])
            known[key] = verified_matches(features[one], features[other], found, (views[one], views[other]))
            pace.pair(perf_counter() - begin)
        if missing:
            cache.keep_matches(pictures[one].digest, known)
        return [known[key] for key in keys]

    found = {}
    for one, of_one in zip(partners, _in_turn("pairs", match, list(partners), pace.judge), strict=True):
        found.update({(one, other): pairs for other, pairs in zip(partners[one], of_one, strict=True) if len(pairs)})
    return len(pairs), found


def _in_turn(
    what: str, task: Callable[[PartT], T], parts: Sequence[PartT], after: Callable[[], None] = lambda: None
) -> Iterator[T]:
    """Yield what a task returns of each part: as many at once as there are threads; `after` is called after these."""
    left = iter(parts)
    done = 0
    with stage(what, len(parts)) as advance:
        while some := list(islice(left, available_threads())):
            yield from by_threads(task, some, 1)
            done += len(some)
            advance(done)
            after()


def _refined(
    pictures: Sequence[Picture], features: Sequence[Features], tracks: Tracks, settings: MatchSettings
) -> tuple[Tracks, NDArray[np.float64], NDArray[np.float64], dict[Fate, int]]:
    """Return the rays that least-squares matching has confirmed, where they are, and what became of all."""
    given = approximate(tracks, features)
    place = of_rays(given.tracks, [photo.place for photo in features])
    error = np.zeros_like(place)
    fate = np.zeros(len(place), dtype=np.int8)
    sheets = list(_runs(given.tracks.track, _RAYS_OF_SHEET))
    with stage("matching", len(place)) as advance:
        for sheet in sheets:
            pixels = _windows(pictures, given, place, sheet)
            batches = list(_runs(given.tracks.track[sheet], _RAYS_OF_BATCH))
            results = iter(_batches(given, place, sheet, pixels, batches, settings))
            done = sheet.start
            for batch in batches:
                rays = slice(sheet.start + batch.start, sheet.start + batch.stop)
                place[rays], error[rays], fate[rays] = next(results)
                done += batch.stop - batch.start
                advance(done)
    matched = fate == Fate.MATCHED
    fates = {reason: int(np.count_nonzero(fate == reason)) for reason in Fate}
    return given.tracks.take(matched), place[matched], error[matched], fates


def _batches(
    given: Approximations,
    place: NDArray[np.float64],
    sheet: slice,
    pixels: Grey,
    batches: Iterable[slice],
    settings: MatchSettings,
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int8]]]:
    """Yield places, errors and fates of the rays of each batch."""
    zoom = 2.0 ** given.level[sheet][:, None]
    start = place[sheet] / zoom
    affine = given.affine[sheet] / zoom[:, :, None]
    track = given.tracks.track[sheet]

    def match(batch: slice) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int8]]:
        windows = Windows(track[batch] - track[batch.start], pixels[batch], in_window(start[batch]), affine[batch])
        found = match_rays(windows, settings)
        moved = (start[batch] + found.centre - windows.centre) * zoom[batch]
        return moved, np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) * zoom[batch], found.fate

    left = iter(batches)
    while some := list(islice(left, available_threads())):
        yield from by_threads(match, some, 1)


def _runs(track: NDArray[np.intp], most: int) -> Iterator[slice]:
    """Yield rays of whole tracks, about `most` of them."""
    ends = np.append(np.flatnonzero(np.diff(track)) + 1, len(track))
    start = 0
    while start < len(track):
        stop = int(ends[min(int(np.searchsorted(ends, start + most)), len(ends) - 1)])
        yield slice(start, stop)
        start = stop


def _windows(pictures: Sequence[Picture], given: Approximations, place: NDArray[np.float64], sheet: slice) -> Grey:
    """Return the windows of rays; each image is read once."""
    pixels = np.zeros((sheet.stop - sheet.start, 2 * HALF + 1, 2 * HALF + 1), dtype=np.uint8)
    photo, level, places = given.tracks.photo[sheet], given.level[sheet], place[sheet]

    def cut(number: int) -> None:
        grey = pictures[number].read()
        for reduction in range(LEVELS):
            here = (photo == number) & (level == reduction)
            pixels[here] = cut_windows(grey, places[here] / 2**reduction)
            grey = halved(grey)

    for _ in _in_turn("windows", cut, np.unique(photo).tolist()):
        pass
    return pixels
