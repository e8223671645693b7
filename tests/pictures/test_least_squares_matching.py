"""Least-squares matching against rendered photos, whose points are known, and against numerical partials."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from pictures.rendered_plane import RenderedPlane, render
from scipy.ndimage import gaussian_filter, map_coordinates
from support.long_cases import every

from orip.images.matching.least_squares import Fate, MatchedRays, MatchSettings, Windows, match_rays
from orip.images.matching.patches import (
    Template,
    mean_patch,
    partials,
    patch_grid,
    sample,
    sample_patches,
    spline_coefficients,
)
from orip.pictures.matching.tracks import HALF, cut_windows, in_window
from orip.structs import replace

SIDE = 340


class Scene:
    """Rays of places of a rendered plane, with features that are about a pixel off."""

    def __init__(self, plane: RenderedPlane, rng: np.random.Generator, count: int = 6) -> None:
        self.plane = plane
        size = 1.4 * SIDE
        ticks = np.linspace(0.32 * size, 0.68 * size, count)
        self.places = np.array([(x, y) for x in ticks for y in ticks]) + rng.uniform(-2.0, 2.0, (count * count, 2))
        rays = [
            (point, photo, plane.pixels(photo, place[None])[0])
            for point, place in enumerate(self.places)
            for photo in range(len(plane.photos))
        ]
        rays = [ray for ray in rays if (ray[2] > 20).all() and (ray[2] < SIDE - 20).all()]
        point = np.array([ray[0] for ray in rays])
        rays = [ray for ray in rays if (point == ray[0]).sum() >= 2]
        self.point = np.unique([ray[0] for ray in rays], return_inverse=True)[1]
        self.of = np.array([ray[0] for ray in rays])
        self.photo = np.array([ray[1] for ray in rays])
        self.truth = np.array([ray[2] for ray in rays])
        self.start = self.truth + 0.7 * rng.standard_normal(self.truth.shape)
        first = np.flatnonzero(np.diff(self.point, prepend=-1))[self.point]
        shape = np.array([plane.partials(p, self.places[o]) for p, o in zip(self.photo, self.of, strict=True)])
        self.affine = shape @ np.linalg.inv(shape[first]) + 0.05 * rng.standard_normal(shape.shape)

    def windows(self) -> Windows:
        pixels = np.zeros((len(self.photo), 2 * HALF + 1, 2 * HALF + 1), dtype=np.uint8)
        for photo, grey in enumerate(self.plane.photos):
            here = self.photo == photo
            pixels[here] = cut_windows(grey, self.start[here])
        return Windows(self.point, pixels, in_window(self.start), self.affine)

    def errors(self, found: MatchedRays) -> tuple[NDArray[np.float64], float, int]:
        """Return errors of matched rays (r, 2) once each point has its best place on the plane, chi-square, freedom."""
        places = self.start + found.centre - in_window(self.start)
        errors, square, freedom = [], 0.0, 0
        for point in np.unique(self.point):
            rays = np.flatnonzero((self.point == point) & (found.fate == Fate.MATCHED))
            if not rays.size:
                continue
            roots = [np.linalg.inv(np.linalg.cholesky(found.covariance[ray])) for ray in rays]
            shapes = [self.plane.partials(int(self.photo[ray]), self.places[self.of[ray]]) for ray in rays]
            off = places[rays] - self.truth[rays]
            design = np.vstack([root @ shape for root, shape in zip(roots, shapes, strict=True)])
            right = np.hstack([root @ value for root, value in zip(roots, off, strict=True)])
            moved = np.linalg.lstsq(design, right, rcond=None)[0]
            errors.append(off - np.array([shape @ moved for shape in shapes]))
            square += float(((right - design @ moved) ** 2).sum())
            freedom += len(right) - 2
        return np.vstack(errors), square, freedom


def scene(photos: int = 4, seed: int = 1, **how: float) -> Scene:
    rng = np.random.default_rng(seed)
    return Scene(render(photos, SIDE, rng, **how), rng)


@pytest.mark.parametrize(
    ("photos", "noise", "blur", "most"),
    every(2, [(2, 2.0, 0.6, 0.05), (4, 2.0, 0.6, 0.05), (4, 5.0, 0.9, 0.11)]),
)
def test_rays_are_as_precise_as_they_say(photos: int, noise: float, blur: float, most: float) -> None:
    given = scene(photos, noise=noise, blur=blur)
    found = match_rays(given.windows(), MatchSettings())
    assert np.mean(found.fate == Fate.MATCHED) > 0.9
    errors, square, freedom = given.errors(found)
    assert np.sqrt((errors**2).sum() / freedom) < most
    # 216 degrees of freedom, 72 with two photos: a standard error of 0.05 or 0.08, beside that of the noise's own
    # correlations, of few and overlapping patches
    assert np.sqrt(square / freedom) == pytest.approx(1.0, abs=0.33)


@pytest.mark.long
@pytest.mark.parametrize(("noise", "blur"), [(2.0, 0.6), (4.0, 0.6), (4.0, 1.0), (8.0, 0.8)])
def test_many_rays_are_as_precise_as_they_say(noise: float, blur: float) -> None:
    squares, freedoms = 0.0, 0
    for seed in range(6):
        given = scene(5, seed, noise=noise, blur=blur)
        _, square, freedom = given.errors(match_rays(given.windows(), MatchSettings()))
        squares, freedoms = squares + square, freedoms + freedom
    assert np.sqrt(squares / freedoms) == pytest.approx(1.0, abs=0.15)


@pytest.mark.long
@pytest.mark.parametrize("photos", [3, 4, 6, 10])
def test_few_photos_are_as_precise_as_they_say(photos: int) -> None:
    squares, freedoms = 0.0, 0
    for noise, seed in ((2.0, 1), (2.0, 2), (4.0, 3)):
        given = scene(photos, seed, noise=noise)
        _, square, freedom = given.errors(match_rays(given.windows(), MatchSettings()))
        squares, freedoms = squares + square, freedoms + freedom
    assert np.sqrt(squares / freedoms) == pytest.approx(1.0, abs=0.15)


def test_gain_and_offset_do_not_matter() -> None:
    given = scene()
    windows = given.windows()
    darker = windows.pixels.astype(float)
    odd = given.photo % 2 == 1
    darker[odd] = 0.6 * darker[odd] + 30.0
    changed = Windows(windows.point, np.rint(darker).astype(np.uint8), windows.centre, windows.affine)
    one, other = (match_rays(rays, MatchSettings()) for rays in (windows, changed))
    good = (one.fate == Fate.MATCHED) & (other.fate == Fate.MATCHED)
    assert good.mean() > 0.9
    assert np.abs(one.centre - other.centre)[good].max() < 0.05  # rounding to whole grey values is left


def test_a_wrong_ray_is_rejected_and_the_others_stay() -> None:
    given = scene()
    windows = given.windows()
    pixels = windows.pixels.copy()
    wrong = np.flatnonzero(given.point == 3)[-1]
    pixels[wrong] = pixels[np.flatnonzero(given.point == 20)[0]][::-1]
    found = match_rays(Windows(windows.point, pixels, windows.centre, windows.affine), MatchSettings())
    assert found.fate[wrong] in {Fate.CORRELATION, Fate.NO_CONVERGENCE, Fate.DRIFT, Fate.DEFORMED}
    others = (given.point == 3) & (np.arange(len(pixels)) != wrong)
    assert (found.fate[others] == Fate.MATCHED).all()
    errors, _, freedom = given.errors(found)
    assert np.sqrt((errors**2).sum() / freedom) < 0.05


def test_a_blurred_photo_does_not_make_the_errors_of_all_points_larger() -> None:
    given = scene()
    windows = given.windows()
    before = match_rays(windows, MatchSettings())
    pixels = windows.pixels.copy()
    blurred = (given.point < 4) & (given.photo == 1)
    pixels[blurred] = gaussian_filter(pixels[blurred], (0.0, 2.0, 2.0))
    after = match_rays(replace(windows, pixels=pixels), MatchSettings())
    assert (after.fate[blurred] == Fate.MATCHED).all()
    others = (given.point >= 4) & (before.fate == Fate.MATCHED) & (after.fate == Fate.MATCHED)
    larger = np.trace(after.covariance[others].T) / np.trace(before.covariance[others].T)
    assert np.median(larger) == pytest.approx(1.0, abs=0.2)


def test_patches_that_are_alike_to_the_last_grey_value_are_not_of_two_exposures() -> None:
    given = scene(2)
    windows = given.windows()
    first = np.flatnonzero(given.photo == 0)[np.searchsorted(np.unique(given.point), given.point)]
    copied = replace(windows, pixels=windows.pixels[first], centre=windows.centre[first], affine=windows.affine[first])
    assert (match_rays(copied, MatchSettings()).fate == Fate.WEAK).all()


def flat(pixels: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(128.0 + rng.standard_normal(pixels.shape), 0, 255).astype(np.uint8)


def stripes(pixels: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    wave = 128.0 + 60.0 * np.sin(np.arange(pixels.shape[1]) / 3.0)
    return np.clip(wave[:, None] + rng.standard_normal(pixels.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("texture", [flat, stripes])
def test_without_texture_in_both_directions_nothing_is_matched(
    texture: Callable[[NDArray[np.uint8], np.random.Generator], NDArray[np.uint8]],
) -> None:
    given = scene(2)
    windows = given.windows()
    pixels = texture(windows.pixels, np.random.default_rng(0))
    straight = np.repeat(np.eye(2)[None], len(pixels), axis=0)
    found = match_rays(Windows(windows.point, pixels, windows.centre, straight), MatchSettings())
    assert not (found.fate == Fate.MATCHED).any()


def test_values_and_gradients_between_pixels() -> None:
    windows = np.random.default_rng(3).integers(0, 256, (2, 21, 23)).astype(np.uint8)
    coefficients = spline_coefficients(windows, 0.0)
    places = np.random.default_rng(4).uniform(4.0, 16.0, (2, 2, 50))
    value, by_column, by_row = sample(coefficients, places[0], places[1])
    for number, window in enumerate(windows):
        expected = map_coordinates(window.astype(float), places[::-1, number], order=3, mode="mirror")
        np.testing.assert_allclose(value[number], expected, atol=2e-3)
    step = 0.05
    numerical = []
    for dx, dy in ((step, 0.0), (0.0, step)):
        ahead = sample(coefficients, places[0] + dx, places[1] + dy)[0]
        behind = sample(coefficients, places[0] - dx, places[1] - dy)[0]
        numerical.append((ahead - behind) / (2.0 * step))
    # the windows are noise: their third partials of up to 2000, times step^2 / 6
    np.testing.assert_allclose(by_column, numerical[0], atol=1.6)
    np.testing.assert_allclose(by_row, numerical[1], atol=1.6)


def test_the_partials_of_patches() -> None:
    given = scene(2)
    windows, grid = given.windows(), patch_grid(6, 1.0)
    coefficients = spline_coefficients(windows.pixels, 1.5)

    def values(affine: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
        found = sample_patches(coefficients, affine, centre, grid)
        return found.value.astype(float) * found.contrast[:, None]

    found = sample_patches(coefficients, windows.affine, windows.centre, grid)
    own = Template(found.value, found.by_u, found.by_v)
    analytical = partials(own, windows.affine, grid)[:, :6] * found.contrast[:, None, None]
    step = 0.02
    for number in range(6):
        change = np.zeros(6)
        change[number] = step
        shape, shift = change[:4].reshape(2, 2) / grid.half, change[4:]
        ahead = values(windows.affine + shape, windows.centre + shift)
        behind = values(windows.affine - shape, windows.centre - shift)
        numerical = (ahead - behind) / (2.0 * step)
        expected = analytical[:, number]
        expected = expected - (found.weight * expected).sum(axis=1, keepdims=True) / found.weight.sum(1, keepdims=True)
        assert np.abs(numerical - expected).max() < 0.02 * np.abs(expected).max()


def test_the_mean_of_patches() -> None:
    given = scene(2)
    windows = given.windows()
    found = sample_patches(spline_coefficients(windows.pixels, 0.8), windows.affine, windows.centre, patch_grid(5, 1.0))
    share = np.ones(len(windows.point), dtype=np.float32)
    mean = mean_patch(found, share, windows.point)
    for point in (0, 7):
        rays = windows.point == point
        np.testing.assert_allclose(
            mean.value[rays], found.value[rays].mean(axis=0)[None].repeat(rays.sum(), 0), atol=1e-5
        )
