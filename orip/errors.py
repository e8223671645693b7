"""Errors and warnings. A message says three things: what was found, what is allowed, what to do."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import ClassVar

from msgspec import Struct

from orip.wording import counted_names, first_names

INTERRUPTED = 130
"""What the shell gets after Ctrl-C."""

UNREAD_FILE = "unread-file"
"""Code of the warning about a file of data that is not read."""

_MOST_OF_A_KIND, _FIRST_OF_MANY = 8, 3
"""Most different warnings of one code that are all printed, and how many are of more."""

_FEWEST_TOGETHER = 5
"""Complaints about a file that say the same are told as one from this number on."""

_FEWEST_ALIKE = 6
"""The same of those that differ by what they quote."""

_PARTICULARS = re.compile(r"'[^']*'|\S*\d\S*")
"""What a message quotes, and words with digits."""

_LONGEST_MESSAGE = 2000

MOST_COMPLAINTS = 50
"""Of a file, that are told: a text with another form has a fault in each of a million lines."""

_LONGEST_COMPARED, _MOST_COMPARED, _MOST_LISTED = 100, 500, 5
"""Of a name and of known names, when a similar one is looked for, and listed where none is similar."""


class Complaint(Struct, frozen=True):
    """One thing that is wrong with what the user wrote.

    Parameters
    ----------
    message : str
        What was found, what is allowed and what to do.
    path : str
        File, as the user would name it; empty where no file is meant.
    line, column : int or None
        Position in the file, counted from 1.
    """

    message: str
    path: str = ""
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        """Return ``file:line:column: message`` with the parts that are known."""
        place = ":".join([self.path, *(str(n) for n in (self.line, self.column) if n is not None)])
        return f"{place}: {self.message}" if self.path else self.message


class ProjectWarning(Struct, frozen=True):
    """Something a user should know that stops nothing.

    Parameters
    ----------
    code : str
        Stable name in kebab-case, for programs.
    where : str
        File and line, photo, point or camera concerned.
    text : str
        One sentence for people.
    """

    code: str
    where: str
    text: str

    def __str__(self) -> str:
        """Return ``where: text``, or ``where is ...``; the text alone, if it concerns nothing in particular."""
        return f"{self.where}{self.joint}{self.text}" if self.where else self.text

    @property
    def joint(self) -> str:
        """Return what stands between `where` and `text`: a blank, if the text is a sentence about it, else a colon."""
        return " " if self.text.startswith(("is ", "are ")) else ": "


def by_kind(warnings: Iterable[ProjectWarning]) -> list[ProjectWarning]:
    """Return warnings with those that say the same of several records as one, at the place of the first.

    It names the first records and their number: ``points 12, 17, 21 and 81 more``.
    """
    kinds: dict[tuple[str, str, str], list[ProjectWarning]] = {}
    for warning in dict.fromkeys(warnings):
        noun, _, name = warning.where.rpartition(" ")
        # files have no noun before their names
        kinds.setdefault((warning.code, noun if noun else f"{name} ", warning.text), []).append(warning)
    told = [_as_one(noun, alike) for (_, noun, _), alike in kinds.items()]
    number = Counter(warning.code for warning in told)
    codes: Counter[str] = Counter()
    shortened: list[ProjectWarning] = []
    for warning in told:
        codes[warning.code] += 1
        more = number[warning.code] - _FIRST_OF_MANY
        if number[warning.code] <= _MOST_OF_A_KIND or codes[warning.code] <= _FIRST_OF_MANY:
            shortened.append(warning)
        elif codes[warning.code] == _FIRST_OF_MANY + 1:
            text = f"{more} more warnings of the kind '{warning.code}'; BUNDLE_ERROR.OUT and result.json have all"
            shortened.append(ProjectWarning(warning.code, "", text))
    return shortened


_NAMED_BY_WORDS = {"element", "direction"}
"""What is named by several words: ``element PHOTO 17 X0``."""


def _as_one(noun: str, alike: Sequence[ProjectWarning]) -> ProjectWarning:
    first = alike[0]
    if len(alike) == 1:
        return first
    kind, _, names = noun.partition(" ")
    last = [warning.where.rpartition(" ")[2] for warning in alike]
    # the words after these nouns are names, which have no plural
    where = f"{kind}s {names} {first_names(last, 3)}" if kind in _NAMED_BY_WORDS else counted_names(noun, last)
    text = f"are {first.text.removeprefix('is ')}" if first.text.startswith("is ") else first.text
    return ProjectWarning(first.code, where, text)


class OripError(Exception):
    """Root of all errors that orip raises on purpose; `exit_code` is what the shell gets."""

    exit_code: ClassVar[int] = 1


HOW_TO_COMPILE = (
    "install a wheel of orip, or a C compiler (Debian, Ubuntu: apt install gcc python3-dev) and orip once more"
)
"""What helps where the extensions were not built."""


class NotCompiledError(OripError):
    """An extension that is needed was not built."""

    def __init__(self) -> None:
        super().__init__(f"preliminary values need the compiled part of orip, which is not there; {HOW_TO_COMPILE}")


class UsageError(OripError):
    """The command line asks for something that is not there."""

    exit_code = 2


class NoFolderError(UsageError):
    """The project folder does not exist, or is none."""


class UnknownNameError(UsageError, KeyError):
    """There is nothing of that name in a solution; it is a KeyError too, as of any mapping.

    Parameters
    ----------
    name : object
        What was asked for.
    kind : str
        What the name should be of, such as "point".
    known : sequence of str
        The names that there are.
    """

    def __init__(self, name: object, kind: str, known: Sequence[str]) -> None:
        alike = {one.casefold().lstrip("0"): one for one in known}.get(str(name).casefold().lstrip("0"))
        close = difflib.get_close_matches(str(name)[:_LONGEST_COMPARED], known[:_MOST_COMPARED], 1)
        near = close if alike is None else [alike]
        remedy = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(known[:_MOST_LISTED])}"
        more = f" and {len(known) - _MOST_LISTED} more" if not near and len(known) > _MOST_LISTED else ""
        self._message = f"there is no {kind} {name!r}; {remedy}{more}"
        super().__init__(self._message)

    def __str__(self) -> str:
        """Return the message; a KeyError would put it in quotes."""
        return self._message


class InputError(OripError):
    """The input is wrong; carries every complaint, not only the first.

    Parameters
    ----------
    complaints : sequence of Complaint
        At least one.
    """

    exit_code = 3

    def __init__(self, complaints: Sequence[Complaint]) -> None:
        self.complaints = tuple(map(_shortened, complaints))
        super().__init__("\n".join(map(str, self.told)))

    @property
    def told(self) -> tuple[Complaint, ...]:
        """Return what is told: of each file the first `MOST_COMPLAINTS`, equal ones once, and the number of others."""
        return tuple(_first_of_each_file(list(_equal_ones_once(self.complaints))))

    @classmethod
    def single(cls, message: str, path: str = "", line: int | None = None, column: int | None = None) -> InputError:
        """Return an error with one complaint."""
        return cls([Complaint(message, path, line, column)])


class NoProjectError(InputError):
    """A folder holds no project."""


def _shortened(complaint: Complaint) -> Complaint:
    """Return a complaint of a bounded length: names in files of strangers may have megabytes."""
    message = complaint.message
    if len(message) <= _LONGEST_MESSAGE:
        return complaint
    half = _LONGEST_MESSAGE // 2
    return Complaint(f"{message[:half]} ... {message[-half:]}", complaint.path, complaint.line, complaint.column)


def _equal_ones_once(complaints: Sequence[Complaint]) -> Iterator[Complaint]:
    """Yield complaints; those that say the same of a file as one, with their number and the first places.

    Of many that differ by numbers and quoted texts alone, as by the values in a column, the cause is one.
    """
    alike = Counter((complaint.path, _form(complaint)) for complaint in complaints)
    groups: dict[tuple[str, str], list[Complaint]] = {}
    for complaint in complaints:
        form = complaint.path, _form(complaint)
        same = form if alike[form] >= _FEWEST_ALIKE else (complaint.path, complaint.message)
        groups.setdefault(same, []).append(complaint)
    for first, *others in groups.values():
        if len(others) + 1 < _FEWEST_TOGETHER:
            yield from (first, *others)
            continue
        lines = list(dict.fromkeys(str(one.line) for one in others if one.line not in (None, first.line)))
        rest = " ..." if len(lines) > _FIRST_OF_MANY else ""
        places = f", then in line {', '.join(lines[:_FIRST_OF_MANY])}{rest}" if lines else ""
        message = f"{first.message} ({len(others) + 1} times{places})"
        yield Complaint(message, first.path, first.line, first.column)


def _form(complaint: Complaint) -> str:
    """Return a message without what it quotes, and without words that have digits."""
    return _PARTICULARS.sub("", complaint.message) if complaint.line is not None else complaint.message


def _first_of_each_file(complaints: Sequence[Complaint]) -> Iterator[Complaint]:
    """Yield the first complaints of each file, and after the last of all how many there are more of a file."""
    counts: Counter[str] = Counter()
    for complaint in complaints:
        counts[complaint.path] += 1
        if counts[complaint.path] <= MOST_COMPLAINTS:
            yield complaint
    for path, count in counts.items():
        if count > MOST_COMPLAINTS:
            more = count - MOST_COMPLAINTS
            yield Complaint(f"and {more} more error{'s' if more > 1 else ''}; correct those above first", path)


class OrientationError(OripError):
    """The marks do not give an orientation; the text says why and what to do."""

    exit_code = 3


class NotSolvableError(OripError):
    """The adjustment has no solution, or did not converge."""

    exit_code = 4


class GateError(OripError):
    """Solved, but a gate of the user's is not passed."""

    exit_code = 5


class LockedError(OripError):
    """Another run of orip holds the project's stores."""

    exit_code = 6


class LinkError(OripError):
    """The plate processor at the other end of the link is missing or busy."""

    exit_code = 7
