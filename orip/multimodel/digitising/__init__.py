"""Measuring through the plate processor: what to drive to, who measures it, and the log that it leaves."""

from __future__ import annotations
