"""Read Pascal VOC's XML, one file a picture, as labelImg and many others write it.

Reference: the VOC2012 development kit, http://host.robots.ox.ac.uk/pascal/VOC/voc2012/. Its pixels count from
1; programs do not agree on that, so the corners are taken as they are.

    <annotation><folder>walk</folder><filename>000001.jpg</filename>
      <size><width>1920</width><height>1080</height></size>
      <object><name>drone</name><bndbox>
        <xmin>1162</xmin><ymin>492</ymin><xmax>1433</xmax><ymax>573</ymax></bndbox></object></annotation>
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PureWindowsPath
from xml.etree.ElementTree import Element, ParseError, XMLPullParser

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import Box, BoxFile, BoxRow, Kind, Picture, as_box, as_size, number
from dronekeypp.footage.boxes.text import read_text

LARGEST = 2**20  # characters: an annotation of one picture
DEEPEST = 20  # elements inside each other; VOC has five
CORNERS = ("xmin", "ymin", "xmax", "ymax")


def read_voc(path: Path, files: Sequence[Path]) -> BoxFile:
    """Read annotations, each of one picture. `path` is the file, or the folder where the `files` lie.

    A file of a picture that is not of the footage may be broken.
    """
    content = BoxFile(path, "Pascal VOC", named=True)
    for file in files:
        try:
            root = _parsed(file)
            picture, rows = _annotation(file, root, len(content.pictures))
        except InputError as error:
            picture, rows = Picture(file.stem, str(file), None, str(error)), []
        content.pictures.append(picture)
        content.rows += rows
    return content


def _parsed(file: Path) -> Element:
    """Return the root of an XML file.

    Definitions of entities can make a small file huge, so none is allowed.
    """
    text = read_text(file)
    if len(text) > LARGEST or "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{file}: too large for an annotation, or it defines entities; neither is read")
    parser = XMLPullParser(("start", "end"))
    depth, root = 0, None
    try:
        for start in range(0, len(text), 4096):  # in pieces, so that the depth is known before it is large
            parser.feed(text[start : start + 4096])
            for event, element in parser.read_events():
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                if depth > DEEPEST:
                    raise InputError(f"{file}: elements nested more than {DEEPEST} deep; not an annotation")
        parser.close()
    except (ParseError, ValueError) as error:
        raise InputError(f"{file}: not valid XML ({error})") from None
    if root is None or root.tag != "annotation":
        found = "nothing" if root is None else f"<{root.tag}>"
        raise InputError(f"{file}: Pascal VOC begins with <annotation>, this with {found}")
    return root


def _annotation(file: Path, root: Element, index: int) -> tuple[Picture, list[BoxRow]]:
    """Return the picture and the boxes of an annotation."""
    name = _text(root, "filename", file)
    base = PureWindowsPath(name).name
    if base and file.stem not in (base, PureWindowsPath(base).stem):
        raise InputError(f"{file}: its filename is {name}; call the file like its picture")
    folder = _text(root, "folder", file)
    if folder and base == name:
        name = f"{folder}/{name}"
    size = None
    if root.find("size") is not None:
        size = as_size(_text(root, "size/width", file), _text(root, "size/height", file), str(file))
    rows = []
    for count, thing in enumerate(root.findall("object"), 1):
        where = f"{file} object {count}"
        kind = _text(thing, "name", where)
        rows.append(
            BoxRow(where, index, _corners(thing, where), kind=Kind(None, kind) if kind else None),
        )
    return Picture(name or file.stem, str(file), size), rows


def _text(element: Element, tag: str, where: object) -> str:
    """Return the text of an element that may be there once."""
    found = element.findall(tag)
    if len(found) > 1:
        raise InputError(f"{where}: <{tag}> is there {len(found)} times")
    return (found[0].text or "").strip() if found else ""


def _corners(thing: Element, where: str) -> Box | None:
    """Return the box of an object from its corners."""
    try:
        low_x, low_y, high_x, high_y = (number(_text(thing, f"bndbox/{name}", where)) for name in CORNERS)
    except ValueError:
        raise InputError(f"{where}: bndbox needs the numbers {', '.join(CORNERS)}") from None
    return as_box([low_x, low_y, high_x - low_x, high_y - low_y], where)
