"""How precise the features of a project are: they are found in images that were made smaller (``config.yaml``)."""

from __future__ import annotations

import re
from pathlib import Path

from orip.exchange.sources.faults import Faults
from orip.exchange.sources.text import text_lines

_SETTING = re.compile(r"\s*feature_process_size\s*:\s*([0-9]{2,6})\b")


def feature_precision(config: Path, faults: Faults, larger_side: int) -> float | None:
    """Return the a-priori error of a feature in pixels of the original image: a pixel of the one it was found in.

    1 where images were not made smaller; None where the settings do not say.
    """
    for line in text_lines(config, faults):
        found = _SETTING.match(line)
        if found:
            return max(1.0, larger_side / int(found[1]))
    return None
