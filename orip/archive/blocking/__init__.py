"""Helmert's blocking: photo points by sub-blocks, each with its own normal equations, wherever it is computed."""

from __future__ import annotations
