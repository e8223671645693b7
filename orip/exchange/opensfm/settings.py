"""What the settings of a project say (``config.yaml``): how precise its features are, and whether cameras were held."""

from __future__ import annotations

import re
from pathlib import Path

from msgspec import Struct

from orip.exchange.sources.faults import Faults
from orip.exchange.sources.text import text_lines

_SIZE = re.compile(r"\s*feature_process_size\s*:\s*([0-9]{2,6})\b")
_HELD = re.compile(r"\s*optimize_camera_parameters\s*:\s*(no|false|off)\b", re.IGNORECASE)


class Settings(Struct, frozen=True):
    """Settings.

    Parameters
    ----------
    feature_size : int or None
        Larger side of the images in which features were found; None where the file does not say it.
    holds_cameras : bool
        OpenSfM was told not to estimate cameras.
    """

    feature_size: int | None = None
    holds_cameras: bool = False

    def feature_precision(self, larger_side: int) -> float | None:
        """Return the a-priori error of a feature in pixels of the original image: a pixel of the one it was found in.

        1 where images were not made smaller; None where the settings do not say.
        """
        return None if self.feature_size is None else max(1.0, larger_side / self.feature_size)


def read_settings(config: Path, faults: Faults) -> Settings:
    """Return what a ``config.yaml`` says."""
    size: int | None = None
    holds = False
    for line in text_lines(config, faults):
        if size is None and (found := _SIZE.match(line)):
            size = int(found[1])
        holds = holds or _HELD.match(line) is not None
    return Settings(size, holds)
