"""Exposure stations from the files of GNSS and INS: formats, interpolation, which event is which photo's."""

from __future__ import annotations
