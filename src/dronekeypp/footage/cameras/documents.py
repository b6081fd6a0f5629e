"""Read the text of a camera file, and JSON, YAML or XML in it, as plain dictionaries, lists and values.

Size and depth are checked before anything recursive sees the text, and a key that comes twice is refused:
which of the two is meant, nobody knows. OpenCV's own reader is not used, because it ends the process on deep
nesting and returns the last of two keys.
"""

from __future__ import annotations

import codecs
import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from dronekeypp.errors import InputError

MOST_JSON = 64 * 2**20  # bytes; the scene_camera.json of a long flight has a few
MOST_TEXT = 4 * 2**20  # bytes of any other file
DEEPEST = 32  # brackets in brackets; OpenCV's and Kalibr's files have four
MARKS = (  # a byte order mark says how the text is encoded; UTF-32 first, because UTF-16 begins alike
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def read_text(path: Path) -> str:
    """Return the text of a camera file, without the byte order mark.

    Raises:
        InputError: It is missing, no file but a pipe or a device, too large, cut off in the middle of a
            line, or no text.
    """
    if not path.exists():
        raise InputError(f"{path}: camera file not found")
    if not path.is_file():
        raise InputError(f"{path}: not a file that can be read twice; give the camera as a plain file")
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_JSON + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    encoding = next((name for mark, name in MARKS if content.startswith(mark)), "utf-8")
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file; a camera file is YAML, XML, JSON or text") from None
    is_json = text.lstrip()[:1] in ("{", "[")
    most = MOST_JSON if is_json else MOST_TEXT
    if len(content) > most:
        raise InputError(
            f"{path}: larger than {most // 2**20} MiB, too large for a camera; "
            "of a recording keep one message"
        )
    if "\0" in text:
        raise InputError(f"{path}: holds NUL bytes; was it written whole?")
    # The last number of a torn text cannot be told from a whole one, but programs end their last line. In
    # JSON and XML the end is marked.
    marked = text.lstrip()[:1] in ("{", "[", "<")
    if text.strip() and not marked and not (text[-1].isspace() or text[-1] in "]}\"'"):
        raise InputError(
            f"{path}: ends in the middle of a line; was it written whole? If so, end its last line"
        )
    return text


def read_documents(text: str, path: Path) -> list[Any]:
    """Return what a text holds: of JSON and XML one value, of YAML one for each document.

    Raises:
        InputError: It is not valid, nested too deep, or a key comes twice. The message begins with `path`.
    """
    start = text.lstrip()[:1]
    if start in ("{", "["):
        documents = [_read_json(text, path)]
    elif start == "<":
        documents = [_read_xml(text, path)]
    else:
        documents = _read_yaml(text, path)
    for document in documents:
        _check_depth(document, path)
    return documents


def _too_deep(path: Path) -> InputError:
    return InputError(f"{path}: nested more than {DEEPEST} deep; no camera file is")


def _twice(path: Path, key: str) -> InputError:
    return InputError(f"{path}: {key} comes twice; keep one")


def _check_depth(document: Any, path: Path) -> None:
    """Raise InputError where dictionaries and lists lie in each other deeper than DEEPEST."""
    level, depth = [document], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise _too_deep(path)
        below: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                below.extend(v for v in value.values() if isinstance(v, (dict, list)))
            elif isinstance(value, list):
                below.extend(v for v in value if isinstance(v, (dict, list)))
        level = below


def _read_json(text: str, path: Path) -> Any:
    def no_key_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key, value in pairs:
            if key in values:
                raise _twice(path, key)
            values[key] = value
        return values

    try:
        return json.loads(_with_digits(text), object_pairs_hook=no_key_twice)
    except InputError:
        raise
    except RecursionError:
        raise _too_deep(path) from None
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON ({error})") from None


def _with_digits(text: str) -> str:
    """Return JSON with "960." written as "960.0", which OpenCV 3 leaves out, outside of strings."""
    string_or_point = r'("(?:[^"\\]|\\.)*")|(?<=\d)\.(?=[\s,\]}eE])'
    return re.sub(string_or_point, lambda match: match.group(1) or ".0", text)


class _BoundedBuilder(ElementTree.TreeBuilder):
    """Build a tree of XML, but no deep one, and none with entities of its own."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path, self.depth = path, 0

    def start(self, tag: str, attributes: dict[str, str]) -> ElementTree.Element:
        self.depth += 1
        if self.depth > DEEPEST:
            raise _too_deep(self.path)
        return super().start(tag, attributes)

    def end(self, tag: str) -> ElementTree.Element:
        self.depth -= 1
        return super().end(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise InputError(f"{self.path}: declares a document type; OpenCV's XML has none")


def _read_xml(text: str, path: Path) -> Any:
    parser = ElementTree.XMLParser(target=_BoundedBuilder(path))
    try:
        parser.feed(text.lstrip())
        root = parser.close()
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not valid XML ({error})") from None
    if root.tag != "opencv_storage":
        raise InputError(f"{path}: XML, but not of OpenCV: its root is {root.tag}, not opencv_storage")
    return _xml_value(root, path)


def _xml_value(element: ElementTree.Element, path: Path) -> Any:
    """Return what an element of OpenCV's XML says: a list where its parts are called "_"."""
    if len(element) == 0:
        return _xml_scalars((element.text or "").strip())
    tags = [part.tag for part in element]
    if set(tags) == {"_"}:
        return [_xml_value(part, path) for part in element]
    values: dict[str, Any] = {}
    for part in element:
        if part.tag in values:
            raise _twice(path, part.tag)
        values[part.tag] = _xml_value(part, path)
    return values


def _xml_scalars(text: str) -> Any:
    """Return the number, the list of numbers or the words that a text is."""
    if text.startswith('"'):
        return text.strip('"')
    try:
        numbers = [_number(word) for word in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers


def _number(word: str) -> int | float:
    return int(word) if re.fullmatch(r"[-+]?\d{1,300}", word) else float(word)


class _YamlLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
    """Read YAML with the numbers of YAML 1.2.

    PyYAML's own of YAML 1.1 take 0640 for 416, 12:30 for 750, and 1e5 for a word.
    """

    yaml_implicit_resolvers: dict[str, Any] = {}
    file = Path()


def _yaml_mapping(loader: _YamlLoader, node: yaml.MappingNode) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            raise InputError(f"{loader.file}: a key of line {key_node.start_mark.line + 1} is no name")
        if key_node.value in values:
            raise _twice(loader.file, key_node.value)
        values[key_node.value] = loader.construct_object(value_node, deep=True)
    return values


def _yaml_number(loader: _YamlLoader, node: yaml.ScalarNode) -> int | float:
    word = node.value
    return float(word.replace(".", "")) if word[-1:] in "fFnN" else _number(word)


def _yaml_null(loader: _YamlLoader, node: yaml.ScalarNode) -> str | None:
    """Return None where null is written, and no words where nothing is: the file may be torn there."""
    return None if node.value else ""


for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|Nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
):
    _YamlLoader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), _first)
for _tag in ("map", "opencv-matrix", "opencv-nd-matrix"):
    _YamlLoader.add_constructor(f"tag:yaml.org,2002:{_tag}", _yaml_mapping)
_YamlLoader.add_constructor("tag:yaml.org,2002:null", _yaml_null)
for _tag in ("int", "float"):
    _YamlLoader.add_constructor(f"tag:yaml.org,2002:{_tag}", _yaml_number)


def _read_yaml(text: str, path: Path) -> list[Any]:
    # OpenCV's first line "%YAML:1.0" is no YAML.
    text = re.sub(r"\A\s*%YAML[^\n]*", "", text)
    try:
        for _ in _shallow_events(text, path):
            pass
        loader = _YamlLoader(text)
        loader.file = path
        documents = []
        while loader.check_data():
            documents.append(loader.get_data())
    except InputError:
        raise
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: not valid YAML, XML or JSON ({reason})") from None
    return [document for document in documents if document not in (None, "")]


def _shallow_events(text: str, path: Path) -> Iterator[yaml.Event]:
    """Yield the events of a YAML text, which come without recursion.

    Raises:
        InputError: It is nested too deep, or names one value twice, as bombs do.
    """
    depth = 0
    for event in yaml.parse(text, Loader=_YamlLoader):
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{path}: line {event.start_mark.line + 1}: an alias; write the value out")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise _too_deep(path)
        yield event
