"""Lenses fitted: orip's polynomial to one that it does not hold exactly, and OpenCV's rational lens to a camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.conversion.lens_exact import Polynomial
from orip.exchange.conversion.lens_table import STEP
from orip.interior.distortion import distorted_by_coefficients
from orip.records.camera import DISTORTION_PARAMETERS

# The radial profile is a quotient of polynomials of the squared tangent. It is fitted from several denominators, one of
# them that of linear least squares with the denominator before as weight (Sanathanan and Koerner, 1963); with the best
# profiles all parameters of the lens are fitted.

RATIONAL = ("k4", "k5", "k6")
"""Coefficients of the denominator."""

_NUMERATOR = ("k1", "k2", "k3")
_PLANE = ("fx", "fy", "cx", "cy")
_DECENTRING = ("p1", "p2")

_STARTS = (
    (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.4, 0.1), (-0.4, 0.0, 0.0), (-1.0, 1.0, 0.0), (-1.3, 1.3, -0.6),
    (-0.5, 0.5, 0.0), (1.0, 1.0, 0.0),
)  # fmt: skip
"""Denominators without a pole in the frame, their coefficients for squared tangents in units of the largest one."""

_REWEIGHTED = 8
_MOST_PLACES = 400
"""Of a profile; more tell nothing new."""

_MOST_EVALUATIONS = 200
_TRIED = 2
"""Profiles, the best ones, with which the whole lens is fitted."""

_BEYOND = 1.25
"""Radii up to this part of the frame's corner have no pole."""

_LEAST_DENOMINATOR = 0.02
"""Of its value in the centre; where less is left of it, a pole is near in the complex plane."""

_AVOIDED, _PENALTY = 0.05, 10.0
"""A denominator below this value is a misfit of the difference, in focal lengths times the penalty."""

_PLACES = 60
"""At which the denominator is seen while a lens is fitted."""

_TOLERANCE = 1e-14

Misfit = Callable[[Mapping[str, Any]], Any]


class RadialProfile(Struct, frozen=True):
    """The radial distortion factor of a camera at squared tangents.

    Parameters
    ----------
    squares, factor, weight : arrays (n,)
        Squared tangents above 0, the factor, and the tangent, by which an error of the factor counts in the image.
    """

    squares: FloatArray
    factor: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, directions: FloatArray, image: FloatArray, point: tuple[float, float], c: float) -> RadialProfile:
        """Return the profile of directions (n, 2) and their image (n, 2) about a principal point."""
        squares = np.square(directions).sum(axis=1)
        seen = np.flatnonzero(squares > 0.0)
        seen = seen[np.argsort(squares[seen])][:: max(1, len(seen) // _MOST_PLACES)]
        along = ((image[seen] - np.asarray(point)) * directions[seen]).sum(axis=1)
        return cls(squares[seen], along / (c * squares[seen]), np.sqrt(squares[seen]))


def fitted_rational(
    start: Mapping[str, float], profile: RadialProfile, misfit: Misfit, held: tuple[str, ...] = ()
) -> dict[str, float] | None:
    """Return the parameters of the lens that come nearest without a pole in the frame; None where there are none.

    Parameters
    ----------
    start : mapping of str to float
        All parameters of the lens.
    misfit : callable
        From parameters to what is left of the image, array (n, 2).
    held : tuple of str
        Parameters beside those of the radial profile that keep their values.
    """
    unit = float(profile.squares.max())
    powers = (profile.squares / unit)[:, None] ** np.arange(1, 4)
    fits = sorted((_profile_fit(profile, powers, below) for below in _denominators(profile, powers)), key=_cost)
    names = (*_NUMERATOR, *RATIONAL, *(name for name in (*_PLANE, *_DECENTRING) if name not in held))
    found = []
    for fit in [one for one in fits if one.has_no_pole(unit)][:_TRIED]:
        scale = fit.above[0]
        radial = {
            name: value / scale / unit**n
            for n, (name, value) in enumerate(zip(_NUMERATOR, fit.above[1:], strict=True), 1)
        }
        radial |= {name: value / unit**n for n, (name, value) in enumerate(zip(RATIONAL, fit.below, strict=True), 1)}
        values = {**start, **radial, "fx": scale * start["fx"], "fy": scale * start["fy"]}
        fitted = fitted_parameters(values, names, _without_pole(misfit, unit, start["fy"]))
        found += [one for one in (values, fitted) if not has_pole(one, unit)]
    return min(found, key=lambda one: float(np.square(misfit(one)).sum()), default=None)


def _without_pole(misfit: Misfit, unit: float, focal: float) -> Misfit:
    """Return a misfit to which denominators that are too small are added, in the unit of the focal length."""
    squares = np.linspace(0.0, _BEYOND**2 * unit, _PLACES)

    def with_penalty(values: Mapping[str, Any]) -> Any:
        divisor = 1.0 + squares * (values["k4"] + squares * (values["k5"] + squares * values["k6"]))
        short = np.where(divisor.real < _AVOIDED, _PENALTY * focal * (_AVOIDED - divisor), 0.0)
        return np.concatenate([misfit(values).ravel(), short])

    return with_penalty


class _ProfileFit(Struct, frozen=True):
    """A quotient: four coefficients of the numerator, three of the denominator, and the sum of squared misfits."""

    above: tuple[float, ...]
    below: tuple[float, ...]
    cost: float

    def has_no_pole(self, unit: float) -> bool:
        values = {name: value / unit**n for n, (name, value) in enumerate(zip(RATIONAL, self.below, strict=True), 1)}
        return self.above[0] > 0.0 and np.isfinite(self.cost) and not has_pole(values, unit)


def _cost(fit: _ProfileFit) -> float:
    return fit.cost


def _denominators(profile: RadialProfile, powers: FloatArray) -> list[FloatArray]:
    """Return denominators to start from, the last one that of the iterated linear fit."""
    reweighted: FloatArray = np.zeros(3)
    for _ in range(_REWEIGHTED):
        divisor = 1.0 + powers @ reweighted
        weight = profile.weight / np.where(np.abs(divisor) > _LEAST_DENOMINATOR, divisor, 1.0)
        rows = np.column_stack([np.ones(len(powers)), powers, -profile.factor[:, None] * powers])
        solved, *_ = np.linalg.lstsq(rows * weight[:, None], profile.factor * weight, rcond=None)
        reweighted = np.asarray(solved[4:], dtype=np.float64)
    return [*map(np.array, _STARTS), reweighted]


def _profile_fit(profile: RadialProfile, powers: FloatArray, below: FloatArray) -> _ProfileFit:
    """Return the quotient that fits a profile, from a denominator and the numerator that belongs to it."""
    from scipy.optimize import least_squares

    rows = np.column_stack([np.ones(len(powers)), powers])

    beyond = np.linspace(0.0, _BEYOND**2, _PLACES)[:, None] ** np.arange(1, 4)

    def residuals(values: FloatArray) -> FloatArray:
        found = ((rows @ values[:4]) / (1.0 + powers @ values[4:]) - profile.factor) * profile.weight
        short = _PENALTY * np.maximum(0.0, _AVOIDED - 1.0 - beyond @ values[4:])
        return np.asarray(np.nan_to_num(np.concatenate([found, short]), nan=_FAR, posinf=_FAR, neginf=-_FAR))

    def partials(values: FloatArray) -> FloatArray:
        divisor = 1.0 + powers @ values[4:]
        by_above = rows / divisor[:, None]
        by_below = -(by_above @ values[:4] / divisor)[:, None] * powers
        is_short = _AVOIDED - 1.0 - beyond @ values[4:] > 0.0
        of_short = np.where(is_short[:, None], -_PENALTY * beyond, 0.0)
        of_profile = np.column_stack([by_above, by_below]) * profile.weight[:, None]
        return np.asarray(np.nan_to_num(np.vstack([of_profile, np.column_stack([np.zeros((_PLACES, 4)), of_short])])))

    with np.errstate(all="ignore"):  # a step may meet a pole
        weight = (profile.weight / (1.0 + powers @ below))[:, None]
        above, *_ = np.linalg.lstsq(rows * weight, profile.factor * profile.weight, rcond=None)
        solved = least_squares(
            residuals, np.concatenate([above, below]), partials, method="lm", x_scale="jac", max_nfev=_MOST_EVALUATIONS
        )
    return _ProfileFit(tuple(solved.x[:4].tolist()), tuple(solved.x[4:].tolist()), float(solved.cost))


def has_pole(values: Mapping[str, float], largest_square: float) -> bool:
    """Return whether the denominator is near 0 within squared tangents up to the largest one, with a margin."""
    squares = np.linspace(0.0, _BEYOND**2 * largest_square, 400)
    denominator = 1.0 + squares * (values["k4"] + squares * (values["k5"] + squares * values["k6"]))
    return bool(denominator.min() < _LEAST_DENOMINATOR)


def fitted_parameters(start: Mapping[str, float], names: tuple[str, ...], misfit: Misfit) -> dict[str, float]:
    """Return the parameters with the least sum of squared misfits from a start (Levenberg, Marquardt).

    Partials are those of a complex step. The start is returned where nothing is better.
    """
    from scipy.optimize import least_squares

    begin = np.array([start[name] for name in names], dtype=np.float64)

    def residuals(values: FloatArray) -> FloatArray:
        found = np.asarray(misfit({**start, **dict(zip(names, values.tolist(), strict=True))})).ravel()
        return np.where(np.isfinite(found), found, _FAR)

    def partials(values: FloatArray) -> FloatArray:
        now = {**start, **dict(zip(names, values.tolist(), strict=True))}
        found = np.stack([misfit({**now, name: now[name] + 1j * STEP}).imag.ravel() / STEP for name in names], axis=1)
        return np.where(np.isfinite(found), found, 0.0)

    with np.errstate(all="ignore"):  # a step may go too far; the next ones come back
        solved = least_squares(
            residuals, begin, partials, method="lm", x_scale="jac", max_nfev=_MOST_EVALUATIONS,
            ftol=_TOLERANCE, xtol=_TOLERANCE, gtol=_TOLERANCE,
        )  # fmt: skip
    better = solved.cost <= 0.5 * float(np.square(residuals(begin)).sum())
    return {**start, **dict(zip(names, solved.x.tolist(), strict=True))} if better else dict(start)


_FAR = 1e12
"""In place of what is no number."""


# With the polynomial at ideal coordinates, measured coordinates are linear in DX, DY, C, C³ A3, C⁵ A5, C⁷ A7, C² P1,
# C² P2, C B1 and C B2: one linear least-squares problem.

_FITTED = tuple(name for name in DISTORTION_PARAMETERS if name != "A1")
"""A1 does the same as C."""

_POWER = {name: (int(name[1]) if name[0] == "A" else 2 if name[0] == "P" else 1) for name in _FITTED}
"""A coefficient of directions is that of lengths times C to this power."""


def fitted_polynomial(directions: FloatArray, image: FloatArray) -> tuple[Polynomial, FloatArray]:
    """Return the polynomial that comes nearest to a lens, and its residuals.

    Parameters
    ----------
    directions : array (n, 2)
        Over the frame.
    image : array (n, 2)
        Where the lens has them.

    Returns
    -------
    Polynomial, array (n, 2)
        Fitted minus given, in the unit of `image`.
    """
    x, y = directions.T
    by_coefficients = distorted_by_coefficients(x, y)
    columns = [DISTORTION_PARAMETERS.index(name) for name in _FITTED]
    design = np.zeros((len(x), 2, 3 + len(columns)))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    design[:, :, 2] = directions
    design[:, :, 3:] = by_coefficients[:, :, columns]
    rows = design.reshape(len(x) * 2, -1)
    scale = np.linalg.norm(rows, axis=0)
    scaled, *_ = np.linalg.lstsq(rows / scale, image.ravel(), rcond=None)
    found = scaled / scale
    residuals = (rows @ found).reshape(-1, 2) - image
    c = float(found[2])
    coefficients = {name: float(value) / c ** _POWER[name] for name, value in zip(_FITTED, found[3:], strict=True)}
    return Polynomial(c, (float(found[0]), float(found[1])), coefficients), residuals
