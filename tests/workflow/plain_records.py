"""The records of a project as plain dictionaries: what the record commands should do, written without any of orip."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

Table = dict[str, Any]


class Refusal(Exception):  # noqa: N818  # no error of the model
    """A command that is not done."""


REFERENCES = (
    ("photo", "camera", "camera"),
    ("template", "temtick", "temtick"),
    ("photo", "template", "template"),
    ("model", "left", "photo"),
    ("model", "right", "photo"),
    ("bundle", "points_of", "bundle"),
)


class PlainRecords:
    """Lists of tables by kind, in the order of the stores; models in their bundle. A method that refuses raises."""

    def __init__(self) -> None:
        self.kinds: dict[str, list[Table]] = {kind: [] for kind in ("camera", "temtick", "template", "photo", "bundle")}

    def copy(self) -> PlainRecords:
        return deepcopy(self)

    def tables(self, kind: str, bundle: str = "") -> list[Table]:
        return self.find("bundle", bundle)["models"] if kind == "model" else self.kinds[kind]

    def everywhere(self, kind: str) -> list[tuple[list[Table], Table]]:
        lists = [bundle["models"] for bundle in self.kinds["bundle"]] if kind == "model" else [self.kinds[kind]]
        return [(tables, table) for tables in lists for table in tables]

    def find(self, kind: str, name: str, bundle: str = "") -> Table:
        for table in self.tables(kind, bundle):
            if same(table["name"], name):
                return table
        raise Refusal

    def has(self, kind: str, name: str, bundle: str = "") -> bool:
        return any(same(table["name"], name) for table in self.tables(kind, bundle))

    # what the commands do

    def add(self, kind: str, table: Table, before: str | None, bundle: str = "") -> None:
        tables = self.tables(kind, bundle)
        if kind == "photo":
            table["template"] = self._as_defined(table["template"])
        if self.has(kind, table["name"], bundle):
            if self.find(kind, table["name"], bundle) != table:
                raise Refusal
            return
        index = len(tables) if before is None else tables.index(self.find(kind, before, bundle))
        tables.insert(index, table)
        if kind == "photo":
            self._put_on(table["name"], table["template"])
        self.check()

    def edit(self, kind: str, name: str, values: Table, bundle: str = "") -> None:
        table = self.find(kind, name, bundle)
        table.update(values)
        if kind == "photo":
            table["template"] = self._as_defined(table["template"])
            self._put_on(table["name"], table["template"])
        if kind == "template" and "photos" in values:
            if len({photo.upper() for photo in values["photos"]}) < len(values["photos"]):
                raise Refusal
            self._make_photos(values["photos"])
            listed = [self.find("photo", photo)["name"] for photo in values["photos"]]
            for photo in self.kinds["photo"]:
                if photo["name"] in listed and not same(photo["template"], table["name"]):
                    photo["template"] = table["name"]
                elif photo["name"] not in listed and same(photo["template"], table["name"]):
                    photo["template"] = None
            for other in self.kinds["template"]:
                other["photos"] = [photo for photo in other["photos"] if other is table or photo not in listed]
            table["photos"] = listed
        self.check()

    def rename(self, kind: str, name: str, new: str, bundle: str = "") -> None:
        table = self.find(kind, name, bundle)
        if not same(name, new) and self.has(kind, new, bundle):
            raise Refusal
        old, table["name"] = table["name"], new
        for where, key, what in REFERENCES:
            if what == kind:
                for _, record in self.everywhere(where):
                    record[key] = new if same(record[key], old) else record[key]
        if kind == "photo":
            for template in self.kinds["template"]:
                template["photos"] = [new if same(photo, old) else photo for photo in template["photos"]]

    def duplicate(self, kind: str, name: str, new: str, values: Table, bundle: str = "") -> None:
        table = {**deepcopy(self.find(kind, name, bundle)), "name": new, **values}
        if kind == "template":
            table["photos"] = []
        if kind == "bundle" and not same(name, new):
            table["points_of"] = table["points_of"] or self.find(kind, name)["name"]
        self.add(kind, table, None, bundle)

    def delete(self, kind: str, name: str, with_referents: bool, bundle: str = "") -> None:
        table = self.find(kind, name, bundle)
        for where, key, what in REFERENCES:
            for _, record in list(self.everywhere(where)):
                if what == kind and same(record[key], name):
                    if not with_referents:
                        raise Refusal
                    self._delete_referent(where, record)
        tables = self.tables(kind, bundle)
        tables[:] = [record for record in tables if record is not table]
        if kind == "photo":
            self._put_on(name, None)

    def _delete_referent(self, kind: str, table: Table) -> None:
        for tables, record in self.everywhere(kind):
            if record is table:
                bundle = next((b["name"] for b in self.kinds["bundle"] if b["models"] is tables), "")
                self.delete(kind, table["name"], True, bundle)

    def _make_photos(self, names: list[str]) -> None:
        """Add the photos that are not there, with the camera of those that are, or the only one."""
        beside = {self.find("photo", name)["camera"].upper() for name in names if self.has("photo", name)}
        cameras = list(beside or {camera["name"].upper() for camera in self.kinds["camera"]})
        for name in names:
            if not self.has("photo", name):
                if len(cameras) != 1:
                    raise Refusal
                camera = self.find("camera", cameras[0])["name"]
                self.kinds["photo"].append({"name": name, "camera": camera, "template": None, "X0": None})

    def _as_defined(self, template: str | None) -> str | None:
        """Return the name of a template as the template spells it."""
        return None if template is None else self.find("template", template)["name"]

    def _put_on(self, photo: str, template: str | None) -> None:
        for record in self.kinds["template"]:
            here = template is not None and same(record["name"], template)
            if not here:
                record["photos"] = [name for name in record["photos"] if not same(name, photo)]
            elif not any(same(name, photo) for name in record["photos"]):
                record["photos"].append(photo)

    def check(self) -> None:
        """Raise Refusal if something is wrong."""
        for camera in self.kinds["camera"]:
            if camera["c"] <= 0:
                raise Refusal
        for where, key, what in REFERENCES:
            for _, table in self.everywhere(where):
                if table[key] is not None and not self.has(what, table[key]):
                    raise Refusal
        for bundle in self.kinds["bundle"]:
            places = [(model["row"], model["column"]) for model in bundle["models"]]
            if len(set(places)) < len(places) or any(same(m["left"], m["right"]) for m in bundle["models"]):
                raise Refusal


def same(a: str | None, b: str | None) -> bool:
    return a is not None and b is not None and a.upper() == b.upper()
