"""Documents of orip's against the schema files that it comes with."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from jsonschema import Draft202012Validator

from orip.schemas.generate import FOLDER


@cache
def validator(name: str) -> Draft202012Validator:
    """Return the validator of a kind of document, made of its file."""
    schema = json.loads((FOLDER / f"{name}.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def schema_faults(document: Any) -> list[str]:
    """Return what the schema that a document names finds wrong with it."""
    name = document["schema"].removeprefix("orip.").partition("/")[0]
    return [f"{'.'.join(map(str, fault.path))}: {fault.message}" for fault in validator(name).iter_errors(document)]
