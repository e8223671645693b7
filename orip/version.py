"""The version of the program, which stands on listings and is part of every run id."""

from __future__ import annotations

__version__ = "0.1.0"
