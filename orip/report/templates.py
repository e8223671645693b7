"""Templates of the pages: compiled once and kept, with the words that they explain."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2.bccache import Bucket, BytecodeCache
from markupsafe import Markup, escape

from orip.report.table import fixed, probability, significant

if TYPE_CHECKING:
    from jinja2 import Environment

TERMS: Mapping[str, str] = {
    "ENP": "exponent of numerical precision: the number of decimal digits by which the last corrections undercut the "
    "standard deviations of the unknowns",
    "singular": "not determined: the observations say nothing about this unknown, and it keeps its value",
    "gate": "a limit in orip.toml that the result has to keep",
    "Danish method": "weights of observations with large residuals are reduced step by step, so that wrong ones lose "
    "their influence",
    "down-weighted": "given less influence, because the residual is larger than the a-priori error explains",
    "redundancy": "number of observations beyond those that are needed: what checks the others",
    "sigma0": "standard error of unit weight: about 1 where the residuals are as large as the a-priori errors say",
    "normalised residual": "size of a residual in units of its own standard deviation; above about 4 it is not chance",
    "a-priori error": "the standard deviation that was expected of an observation before the adjustment",
    "datum": "what fixes position, rotation and scale of the block on the ground",
}
"""Words that not every reader knows, and what they mean; the glossary of the manual has more."""

_TERM = re.compile(rf"\b({'|'.join(map(re.escape, TERMS))})(s?)\b", re.IGNORECASE)
_MEANINGS = {term.casefold(): meaning for term, meaning in TERMS.items()}


def explained(text: object) -> Markup:
    """Return a text with an explanation, shown where the pointer rests, on each word of `TERMS` the first time."""
    seen: set[str] = set()

    def explain(found: re.Match[str]) -> str:
        term = found[1].casefold()
        if term in seen:
            return found[0]
        seen.add(term)
        return f'<abbr title="{escape(_MEANINGS[term])}">{found[0]}</abbr>'

    return Markup(_TERM.sub(explain, str(escape(text))))


def rendered(name: str, content: Mapping[str, Any]) -> str:
    """Return the page that a template makes of its content."""
    return f"{_environment().get_template(name).render(content)}\n"


def template_source(name: str) -> str:
    """Return the text of a template, or of what stands beside the templates."""
    environment = _environment()
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("orip.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=CompiledTemplates(),
    )
    environment.filters.update(
        significant=significant, fixed=fixed, probability=probability, freedom=_freedom, explained=explained
    )
    environment.globals["included"] = lambda name: Markup(template_source(name))
    environment.globals["terms"] = TERMS
    return environment


def _freedom(redundancy: float) -> str:
    """Return degrees of freedom: a whole number, unless weights that were lost make it another one."""
    return fixed(redundancy, 1).removesuffix(".0")


# Templates as they were compiled last, and the compressed script of the page.

_FOLDER = Path(__file__).parent / "__pycache__"


class CompiledTemplates(BytecodeCache):
    """Reads and writes compiled templates in the folder of compiled modules, if that can be written.

    Jinja2 compares the digest of the template, and its own version and that of Python.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read a template, if it is there."""
        with suppress(OSError), self._path(bucket).open("rb") as file:
            bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write a template; killed at any instant, the file is whole or not there."""
        _keep(self._path(bucket), bucket.bytecode_to_string())

    @staticmethod
    def _path(bucket: Bucket) -> Path:
        return _FOLDER / f"{bucket.key}.{sys.implementation.cache_tag}.template"


def kept(name: str, made: Callable[[], bytes]) -> bytes:
    """Return the content of a kept file, which is made where it is not there; its name tells what it was made from."""
    path = _FOLDER / name
    with suppress(OSError):
        return path.read_bytes()
    content = made()
    _keep(path, content)
    return content


def _keep(path: Path, content: bytes) -> None:
    """Write a file, if that can be; killed at any instant, it is whole or not there."""
    if sys.dont_write_bytecode:
        return
    with suppress(OSError):
        descriptor, written = tempfile.mkstemp(dir=_FOLDER, suffix=path.suffix)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        Path(written).chmod(0o644)  # as compiled modules have it
        os.replace(written, path)  # noqa: PTH105
