"""Dask: connecting to a cluster, and the passes over a block's tree as its tasks."""

from __future__ import annotations
