"""Conventions of other programs and of orip: rotations, image coordinates, cameras, and the test which reading fits."""

from __future__ import annotations
