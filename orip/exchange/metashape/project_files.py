"""Projects of Metashape and PhotoScan: `.psz`, one zip file, and `.psx` with a folder of zip files."""

from __future__ import annotations

import zipfile
import zlib
from io import BytesIO
from pathlib import Path, PurePosixPath

from msgspec import Struct

from orip.exchange.sources.text import Faults
from orip.exchange.sources.xml_tree import XmlElement, XmlFields, read_xml, xml_of
from orip.files.text.lines import read_bytes
from orip.files.text.regular_file import LARGEST_FILE, beginning
from orip.files.text.shown import shown_token

_LARGEST_GROWTH = 100
"""Times the size of the zip file that all its members may have; more is made to fill the memory."""

_ALWAYS = 1 << 20
"""Bytes that members may have in any case."""


def is_inside(name: str) -> bool:
    """Return whether a relative path stays in the folder that it begins in."""
    path = PurePosixPath(name.replace("\\", "/"))
    return bool(name) and not path.is_absolute() and ".." not in path.parts and ":" not in path.parts[0]


class ZipMembers:
    """A zip file that is open.

    Parameters
    ----------
    faults : Faults
        Of the zip file; takes the complaints.
    most : int
        Bytes that all members together may have.
    """

    def __init__(self, archive: zipfile.ZipFile, faults: Faults, most: int) -> None:
        self._archive = archive
        self._left = most
        self.faults = faults

    def of_member(self, name: str) -> Faults:
        """Return the faults of a member; they are those of the zip file."""
        return Faults(f"{self.faults.shown}/{shown_token(name)}", self.faults.complaints)

    def read(self, name: str) -> bytes | None:
        """Return the bytes of a member; None, and a complaint kept, if it cannot be read."""
        if not is_inside(name):
            self.faults.complain(f"'{shown_token(name)}' leads out of the zip file; it is not read")
            return None
        try:
            size = self._archive.getinfo(name).file_size
            if size > self._left:
                self.faults.complain(f"'{shown_token(name)}' says that it has {size} bytes, more than can be; not read")
                return None
            self._left -= size
            return self._archive.read(name)
        except KeyError:
            self.faults.complain(f"the zip file has no '{shown_token(name)}'; save the project again")
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError, ValueError):
            self.faults.complain(f"'{shown_token(name)}' is damaged or encrypted; save the project again")
        return None


def open_zip(path: Path, faults: Faults) -> ZipMembers | None:
    """Return a zip file whose members are all inside it; None, and complaints kept, if it is not one."""
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    if data is None:
        return None
    try:
        archive = zipfile.ZipFile(BytesIO(data))
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, EOFError, IndexError):
        faults.complain("this is not a zip file, or it is damaged; save the project again")
        return None
    outside = [name for name in archive.namelist() if not is_inside(name)]
    if outside:
        faults.complain(f"member '{shown_token(outside[0])}' leads out of the zip file; nothing of it is read")
        return None
    return ZipMembers(archive, faults, min(_ALWAYS + _LARGEST_GROWTH * len(data), LARGEST_FILE))


# The document of a project has its chunks, a chunk has frames, and a frame has its tie points, each in the document or
# in another zip file that it names by a path from its own folder. All of them are joined here to one chunk, as exported
# XML has it.

_DOCUMENT = "doc.xml"
_PROJECT_NAME = "{projectname}"
_TIE_POINTS = ("point_cloud", "tie_points")
_NEWEST = 2
"""Major version of the documents; their layout differs by version."""

_ZIP = b"PK"
_BEGINNING = 1000


class _Node(Struct, frozen=True):
    """An element, the document that it is in, and the zip file and the folder that its paths refer to."""

    element: XmlElement
    fields: XmlFields
    members: ZipMembers
    folder: Path


class TieCloud(Struct, frozen=True):
    """The tie points of a frame: the element that lists its files, and the zip file that has them."""

    element: XmlElement
    fields: XmlFields
    members: ZipMembers


class ProjectChunk(Struct, frozen=True):
    """The chunk of a project.

    Parameters
    ----------
    frame : tuple of (XmlElement, XmlFields), or None
        The first frame, and the document that it is in.
    """

    element: XmlElement
    fields: XmlFields
    frame: tuple[XmlElement, XmlFields] | None
    ties: TieCloud | None
    notes: tuple[str, ...]


def is_project(path: Path) -> bool:
    """Return whether a file is a project of Metashape: by its name, and by how it begins."""
    if path.suffix.lower() == ".psz":
        return path.is_file() and beginning(path, 2).encode(errors="replace") == _ZIP
    return path.suffix.lower() == ".psx" and "<document" in beginning(path, _BEGINNING)


def read_project_chunk(path: Path, faults: Faults) -> ProjectChunk | None:
    """Read the active chunk of a project; None, and complaints kept, if it cannot be read."""
    root = _packed(path, faults) if path.suffix.lower() == ".psz" else _beside(path, faults)
    if root is None:
        return None
    notes: list[str] = []
    chunk = _active_chunk(root, notes)
    if chunk is None:
        return None
    frames = list(chunk.element.within("frame"))
    if len(frames) > 1:
        notes.append(f"Of {len(frames)} frames the first was taken.")
    frame = _opened(frames[0], chunk) if frames else None
    if frame is None:
        return ProjectChunk(chunk.element, chunk.fields, None, None, tuple(notes))
    listed = next((child for child in frame.element.children if child.tag in _TIE_POINTS), None)
    cloud = None if listed is None else _opened(listed, frame)
    ties = None if cloud is None else TieCloud(cloud.element, cloud.fields, cloud.members)
    return ProjectChunk(chunk.element, chunk.fields, (frame.element, frame.fields), ties, tuple(notes))


def _packed(path: Path, faults: Faults) -> _Node | None:
    return _document(path, faults)


def _beside(path: Path, faults: Faults) -> _Node | None:
    """Return the document of the zip file that a `.psx` names."""
    root = read_xml(path, faults)
    if root is None:
        return None
    named = root.attributes.get("path")
    if root.tag != "document" or named is None:
        faults.complain("this is not a project of Metashape: a <document> with a path should be here", root.line)
        return None
    return _document_at(named.replace(_PROJECT_NAME, path.stem), root, path.parent, XmlFields(faults))


def _active_chunk(root: _Node, notes: list[str]) -> _Node | None:
    if not _is_known(root):
        return None
    chunks = list(root.element.within("chunk"))
    if not chunks:
        root.fields.faults.complain("the project has no chunk", root.element.line)
        return None
    active = next(root.element.within("chunks"), root.element).attributes.get("active_id")
    chosen = next((chunk for chunk in chunks if chunk.attributes.get("id") == active), chunks[0])
    if len(chunks) > 1:
        notes.append(f"Of {len(chunks)} chunks the active one was taken.")
    return _opened(chosen, root)


def _is_known(root: _Node) -> bool:
    version = root.element.attributes.get("version", "")
    major = version.partition(".")[0]
    if major.isascii() and major.isdigit() and len(major) < 4 and int(major) <= _NEWEST:
        return True
    root.fields.faults.complain(
        f"documents of version '{shown_token(version)}' are not known, those up to {_NEWEST} are; export the cameras "
        "as XML, or Blocks Exchange XML",
        root.element.line,
    )
    return False


def _opened(element: XmlElement, owner: _Node) -> _Node | None:
    """Return the document that an element names by its path; the element itself where it names none."""
    named = element.attributes.get("path")
    if named is None or element.children:
        return _Node(element, owner.fields, owner.members, owner.folder)
    return _document_at(named, element, owner.folder, owner.fields)


def _document_at(named: str, element: XmlElement, folder: Path, fields: XmlFields) -> _Node | None:
    """Return the document of a zip file that is named by a path from a folder, and is in that folder."""
    target = folder / named.replace("\\", "/")
    if not is_inside(named) or not target.resolve().is_relative_to(folder.resolve()):
        fields.faults.complain(
            f"the path '{shown_token(named)}' leads out of the project; it is not read", element.line
        )
        return None
    beside = PurePosixPath(fields.faults.shown)
    beside = beside.parent if beside.name != _DOCUMENT else beside.parent.parent
    shown = (beside / PurePosixPath(shown_token(named.replace("\\", "/")))).as_posix()
    return _document(target, Faults(shown, fields.faults.complaints))


def _document(path: Path, faults: Faults) -> _Node | None:
    members = open_zip(path, faults)
    data = None if members is None else members.read(_DOCUMENT)
    if members is None or data is None:
        return None
    inside = members.of_member(_DOCUMENT)
    root = xml_of(data, inside)
    return None if root is None else _Node(root, XmlFields(inside), members, path.parent)
