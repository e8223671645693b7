"""The plan of an archive's run: which projects, how, and where; read by `orip archive status`."""

from __future__ import annotations

import json
from pathlib import Path

from msgspec import Struct, ValidationError, convert
from msgspec.structs import asdict

from orip.archive.tables import SCHEMA
from orip.errors import InputError, UsageError
from orip.files.archive.layout import ResultsFolder
from orip.files.text.atomic import replace_text, reporting_failure
from orip.files.text.own_files import make_named_folder
from orip.files.text.regular_file import NoRegularFileError, regular_bytes
from orip.files.text.shown import shown_token


class ArchivePlan(Struct, frozen=True):
    """What a run of an archive does.

    Parameters
    ----------
    base : str
        The folder from which projects are named, absolute.
    projects : tuple of str
        Their names.
    settings : str
        Digest of method, gates and version of orip.
    method : str
        The method in words.
    orip : str
        Version of orip.
    dashboard : str
        Address of Dask's dashboard; empty where orip has started the workers, which have none.
    began : float
        Seconds since 1970.
    """

    base: str
    projects: tuple[str, ...]
    settings: str
    method: str
    orip: str
    dashboard: str
    began: float


def write_plan(results: ResultsFolder, plan: ArchivePlan) -> None:
    """Write the plan.

    Raises
    ------
    OripError
        If the folder or the disk refuses.
    """
    with reporting_failure(results.plan, "remove the cause, or name another folder with --out"):
        make_named_folder(results.folder)
        replace_text(results.plan, json.dumps({"schema": SCHEMA, **asdict(plan)}, indent=1) + "\n")


def read_plan(folder: Path, shown: str) -> ArchivePlan:
    """Read the plan of a results folder.

    Raises
    ------
    UsageError
        If the folder holds no results of an archive.
    InputError
        If the plan is damaged, no file, or of another schema.
    """
    results = ResultsFolder(folder)
    at = f"{shown}/{results.plan.name}"
    try:
        found = json.loads(regular_bytes(results.plan))
        schema = found.pop("schema")
        if schema == SCHEMA:
            return convert(found, ArchivePlan)
    except NoRegularFileError as error:
        message = f"is {error.kind}, not a file; remove it, and 'orip archive run' writes one"
        raise InputError.single(message, at) from None
    except OSError:
        message = (
            f"'{shown}' holds no results of an archive: there is no {results.plan.name}; 'orip archive run' makes it"
        )
        raise UsageError(message) from None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, ValidationError):
        schema = "something else"
    message = f"holds {shown_token(str(schema))} where this version reads {SCHEMA}; 'orip archive run' writes it again"
    raise InputError.single(message, at)
