"""Commands of the plate processor, `orip drive` and `orip digitise`, and what they print."""

from __future__ import annotations
