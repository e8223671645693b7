"""`orip results normals`: the normal equations of the last adjustment as a file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orip.bundle.results.covariance import normal_equations
from orip.errors import UsageError
from orip.files.text.atomic import replace_bytes, reporting_failure
from orip.workflow.adjust.results import solved_again
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.outputs import require_replaceable


class WrittenNormals(NamedTuple):
    """The run whose normal equations were written, and how many unknowns they have."""

    run: str
    unknowns: int


def write_normals(bundle: BundleState, output: Path | None, folder: Path, *, force: bool = False) -> WrittenNormals:
    """Write the normal equations, which are computed again; see `NormalEquations` for what they are.

    The arrays of the .npz are names, data, indices, indptr (of a sparse matrix by rows), right, removed, square_sum,
    sigma0 and run.

    Raises
    ------
    UsageError
        If the file does not end in .npz, or another one would be replaced.
    InputError
        If the bundle has not been adjusted, or what it was adjusted from has changed since.
    """
    if output is None or output.suffix.lower() != ".npz":
        message = "name the file of the normal equations: --output normals.npz, for NumPy"
        raise UsageError(message)
    found = normal_equations(solved_again(bundle))
    file = io.BytesIO()
    np.savez_compressed(
        file, names=np.array(found.names, dtype=np.str_), data=found.matrix.data, indices=found.matrix.indices,
        indptr=found.matrix.indptr, right=found.right, removed=found.removed, square_sum=np.array(found.square_sum),
        sigma0=np.array(bundle.adjusted.sigma0), run=np.array(bundle.adjusted.run),
    )  # fmt: skip
    data, path = file.getvalue(), folder / output
    with reporting_failure(path, "choose another file with --output"):
        require_replaceable(bundle.project, path, force=force, begins=data)
        replace_bytes(path, data)
    return WrittenNormals(bundle.adjusted.run, len(found.names))
