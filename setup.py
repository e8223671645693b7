"""What pyproject.toml cannot say: the sample projects in a wheel, and the options of Microsoft's compiler."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.errors import CompileError

SAMPLES = Path("sample_projects")
PATTERNS = (
    "*.md",
    "*/*.md",
    "*/*.toml",
    "*/*.MEA",
    "*/*.PNT",
    "*/*.PRE",
    "*/*.LEN",
    "*/*.STA",
    "*/*.MRK",
    "*/*.pos",
    "*/*.py",
    "*/truth.json",
)
"""What a sample project is made of, and not what orip writes into its folder."""


MSVC_ARGUMENTS = ["/O2", "/fp:precise"]
"""For `-O3` of pyproject.toml; /fp:precise does not reorder sums."""


WHAT_HELPS = (
    "see the compiler's message above; it needs a C compiler and the headers of Python "
    "(Debian, Ubuntu: apt install gcc python3-dev; macOS: xcode-select --install; Windows: Build Tools for C++)"
)


class BuildExtensions(build_ext):
    """Compiles the extensions; the options in pyproject.toml are those of gcc and clang.

    An installation is there without them, and says when it runs what it lacks. Whoever asks for the extensions alone
    (`setup.py build_ext`) has nothing but them to ask for: there it is an error, as an older one may lie in the place.
    """

    def run(self) -> None:
        """Build the extensions, and say which of them are not there."""
        self.failed: list[str] = []
        super().run()
        if self.failed:
            message = f"the compiled part of orip was not built: {', '.join(self.failed)}; {WHAT_HELPS}"
            if "build_ext" in self.distribution.commands:
                raise CompileError(message)
            self.warn(f"{message}. Without it orip is slower, and has no preliminary values")

    def build_extension(self, ext: Extension) -> None:
        """Build an extension with the options of the compiler that was found."""
        try:
            self._build(ext)
        except Exception:  # setuptools goes on, as the extensions are optional
            self.failed.append(ext.name)
            raise

    def _build(self, ext: Extension) -> None:
        if self.compiler.compiler_type == "msvc":
            ext.extra_compile_args = MSVC_ARGUMENTS
        elif self.compiler.compiler_type == "unix":
            self._compile_at_once()
        super().build_extension(ext)

    def _compile_at_once(self) -> None:
        """Let the compiler work on all sources of an extension at the same time: on two cores that halves the wait."""
        compile_all = type(self.compiler).compile.__get__(self.compiler)

        def compile_each(sources: list[str], *args: Any, **kwargs: Any) -> list[str]:
            with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
                found = list(pool.map(lambda source: compile_all([source], *args, **kwargs), sources))
            return [name for names in found for name in names]

        self.compiler.compile = compile_each


class BuildWithSamples(build_py):
    """Copies the sample projects into the package that is built, where orip looks for them.

    An editable install finds them in the clone.
    """

    def run(self) -> None:
        """Build the package, then copy the samples."""
        super().run()
        if not self.editable_mode:
            for source, target in self._samples():
                self.mkpath(str(target.parent))
                self.copy_file(str(source), str(target))

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Return what is built, the samples too."""
        samples = [] if self.editable_mode else [str(target) for _, target in self._samples()]
        return [*super().get_outputs(include_bytecode), *samples]

    def get_source_files(self) -> list[str]:
        """Return what a source distribution needs, the samples too."""
        return [*super().get_source_files(), *(str(source) for source, _ in self._samples())]

    def _samples(self) -> list[tuple[Path, Path]]:
        package = Path(self.build_lib) / "orip"
        return [(source, package / source) for pattern in PATTERNS for source in sorted(SAMPLES.glob(pattern))]


setup(cmdclass={"build_ext": BuildExtensions, "build_py": BuildWithSamples})
