"""The schema files, made of the types: ``python -m orip.schemas.generate`` writes them when a type has changed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec

from orip.schemas.catalogue import DOCUMENTS, SchemaName, identifier

FOLDER = Path(__file__).parent / "files"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema(name: SchemaName) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a kind of document."""
    document = DOCUMENTS[name]
    definitions = msgspec.json.schema(document.content)["$defs"]
    content = definitions.pop(document.content.__name__)
    properties = {"schema": {"const": identifier(name)}} | _without_schema(content.pop("properties"))
    return {
        "$schema": DIALECT,
        "$id": f"urn:orip:{name}:{document.version}",
        "title": identifier(name),
        "description": content.pop("description"),
        "type": content.pop("type"),
        "properties": properties,
        "required": ["schema", *(key for key in content.pop("required") if key != "schema")],
        "additionalProperties": content.pop("additionalProperties"),
        **({"$defs": definitions} if definitions else {}),
    }


def _without_schema(properties: dict[str, Any]) -> dict[str, Any]:
    return {key: of_key for key, of_key in properties.items() if key != "schema"}


def schema_text(name: SchemaName) -> str:
    """Return the text of a schema file."""
    return json.dumps(json_schema(name), indent=2, ensure_ascii=False) + "\n"


def main() -> None:
    """Write all schema files."""
    FOLDER.mkdir(exist_ok=True)
    for name in DOCUMENTS:
        (FOLDER / f"{name}.schema.json").write_text(schema_text(name), encoding="utf-8")


if __name__ == "__main__":
    main()
