"""orip: bundle adjustment of ORIPROGRAM-style project folders.

What scripts and notebooks may use is named in `__all__`, that of `orip.api`. It is imported when it is first asked for:
no command waits for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orip.version import __version__ as __version__

if TYPE_CHECKING:
    from orip.api import *  # noqa: F403  # the names are those of `orip.api.__all__`
    from orip.api import __all__ as __all__
else:  # a type checker is to know the names, not that any name may be asked for

    def __getattr__(name: str) -> object:
        """Import what is asked for."""
        if name == "__all__" or not name.startswith("__"):
            from importlib import import_module

            api = import_module("orip.api")
            if name == "__all__" or name in api.__all__:
                return getattr(api, name)
        message = f"module 'orip' has no attribute {name!r}"
        raise AttributeError(message)

    def __dir__() -> list[str]:
        """Return the public names and those of the module itself."""
        return sorted({*__getattr__("__all__"), *globals()})
