"""The link to a plate processor: the line protocol, the emulator that serves it, and the client."""

from __future__ import annotations
