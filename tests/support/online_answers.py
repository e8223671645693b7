"""Answers of a session of measuring after all that follows from a measurement."""

from __future__ import annotations

from orip.online.answers import Answer
from orip.online.block.measurements import Measurement
from orip.online.measuring import Measuring


def last_answer(measuring: Measuring, measurement: Measurement) -> Answer:
    """Measure, reconsider, and return what the answer is then."""
    answer = measuring.measure(measurement)
    return measuring.reconsider() or answer
