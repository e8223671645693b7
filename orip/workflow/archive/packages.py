"""What archives need beside orip itself."""

from __future__ import annotations

from orip.workflow.cluster.connection import require_installed


def require_dask() -> None:
    """Raise UsageError if what archives need is not installed."""
    require_installed("archives need", ("distributed", "pyarrow"))
