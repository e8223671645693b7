"""Unknowns that nothing determines any more once observations are left out."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.joint_effects import TESTABLE, FactoredRows
from orip.arrays import FloatArray, IntArray
from orip.bundle.solve import SolvedBlock

_MOVES = 0.05
"""An unknown is free if it moves by this part of its standard deviation with a free movement of unit length."""

_OWN_GROUPS = ("POINT", "THEODOLITE")


class FreedUnknowns(Struct, frozen=True):
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


def freed_unknowns(
    solved: SolvedBlock, rows: IntArray, factored: FactoredRows, out: IntArray, more: IntArray
) -> FreedUnknowns:
    """Return what is no longer determined when more observations are left out.

    Where the residuals of observations left out, with cofactors I - H, have a combination e that no other
    observation checks, all others are met for any size of the movement Q A^T e of the unknowns. It moves nothing but
    eliminated points where the part of W^T e in the reduced system is zero.

    Parameters
    ----------
    solved : SolvedBlock
        An adjustment in which these observations are in use; its design matrix is stored.
    rows : array (c,) of int
        Observations among all of the block.
    factored : FactoredRows
        W of these rows.
    out, more : arrays of int
        Places in `rows` of what is left out already, and of what is to be left out.
    """
    of_points = factored.of_points
    columns = of_points[more].indices
    near = np.unique(of_points[out][:, columns].tocoo().row) if len(out) and len(columns) else np.empty(0, np.int64)
    for others in (out[near], out):
        places = np.concatenate([more, others]).astype(np.int64)
        some = factored.of(places)
        values, vectors = np.linalg.eigh(np.eye(len(places)) - some.cofactor())
        free = vectors[:, values <= TESTABLE]
        if free.shape[1]:
            local = bool((np.linalg.norm(some.of_reduced @ free, axis=0) <= _MOVES).all())
            return _own_points(solved, rows[more]) if local else _moving(solved, rows[places], free)
    return NOTHING_FREED


def _own_points(solved: SolvedBlock, rows: IntArray) -> FreedUnknowns:
    columns = np.unique(solved.equations.design[rows].indices)
    return _named(solved, columns[columns >= solved.problem.layout.reduced], columns)


def _moving(solved: SolvedBlock, rows: IntArray, free: FloatArray) -> FreedUnknowns:
    design, cofactors = solved.equations.design[rows], solved.cofactors
    variance = np.concatenate([cofactors.reduced.diagonal(), np.einsum("bii->bi", cofactors.blocks).ravel()])
    scale = np.where(variance > 0.0, np.sqrt(np.where(variance > 0.0, variance, 1.0)), np.inf)
    movement = np.abs(solved.normals.solve(np.asarray(design.T @ free))) / scale[:, None]
    return _named(solved, np.flatnonzero(movement.max(axis=1) > _MOVES), np.unique(design.indices))


def _named(solved: SolvedBlock, columns: IntArray, touched: IntArray) -> FreedUnknowns:
    unknowns = [(column, name) for column in columns.tolist() if (name := solved.problem.unknowns.names[column])]
    own = set(touched.tolist())
    names = dict.fromkeys((name.group, name.name) for _, name in unknowns)
    return FreedUnknowns(
        tuple(f"{group.lower()} {name}" for group, name in names),
        all(column in own and name.group in _OWN_GROUPS for column, name in unknowns),
    )
