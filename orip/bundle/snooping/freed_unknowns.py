"""Unknowns that nothing determines any more once observations are left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orip.adjustment.joint_effects import TESTABLE, joint_effects
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.solve import SolvedBlock

_MOVES = 0.05
"""An unknown moves if it moves by this part of its standard deviation when the free movement is as large as its own."""

_OWN_GROUPS = ("POINT", "THEODOLITE")


@dataclass(frozen=True, slots=True)
class FreedUnknowns:
    """What is no longer determined.

    Parameters
    ----------
    names : tuple of str
        Points, theodolite sets, photos and cameras.
    are_own : bool
        They are points and theodolite sets of the observations left out, and nothing else.
    """

    names: tuple[str, ...]
    are_own: bool


NOTHING_FREED = FreedUnknowns((), True)


def freed_unknowns(solved: SolvedBlock, out: IntArray, more: tuple[int, ...]) -> FreedUnknowns:
    """Return what is no longer determined when more observations are left out.

    Where the residuals of observations left out, with cofactors I - H, have a combination e that no other observation
    checks, all others are met for any size of the movement Q A^T e of the unknowns.

    Parameters
    ----------
    solved : SolvedBlock
        An adjustment in which `more` and perhaps some of `out` are in use.
    out : array of int
        Observations left out before.
    more : tuple of int
    """
    equations = solved.equations
    design = equations.design
    own = np.array(more, dtype=np.int64)
    used = out[equations.active[out]]
    touching = np.isin(design[used].tocoo().col, design[own].indices)
    near = used[np.unique(design[used].tocoo().row[touching])] if len(used) else used
    for others in (near, used):
        rows = np.concatenate([own, others])
        effects = joint_effects(equations, solved.normals, solved.problem.layout, rows)
        values, vectors = np.linalg.eigh(np.eye(len(rows)) - effects.cofactor)
        free = vectors[:, values <= TESTABLE]
        if free.shape[1]:
            moving = _moving(solved, np.asarray(design[rows].T @ free))
            return _named(solved, moving, np.unique(design[rows].indices))
    return NOTHING_FREED


def _moving(solved: SolvedBlock, right: FloatArray) -> BoolArray:
    cofactors = solved.cofactors
    variance = np.concatenate([cofactors.reduced.diagonal(), np.einsum("bii->bi", cofactors.blocks).ravel()])
    scale = np.where(variance > 0.0, np.sqrt(np.where(variance > 0.0, variance, 1.0)), np.inf)
    return np.asarray((np.abs(solved.normals.solve(right)) / scale[:, None]).max(axis=1) > _MOVES)


def _named(solved: SolvedBlock, moving: BoolArray, touched: IntArray) -> FreedUnknowns:
    unknowns = [(column, name) for column in np.flatnonzero(moving) if (name := solved.problem.unknowns.names[column])]
    own = set(touched.tolist())
    names = dict.fromkeys((name.group, name.name) for _, name in unknowns)
    return FreedUnknowns(
        tuple(f"{group.lower()} {name}" for group, name in names),
        all(column in own and name.group in _OWN_GROUPS for column, name in unknowns),
    )
