"""Random boxes in every format are read back, and damaged files end in the right boxes or in one line."""

import copy
import json
import tempfile
from pathlib import Path

import box_files
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dronekeypp.errors import InputError
from dronekeypp.footage import read_boxes

SIZES = ((640, 360), (1920, 1080))
USUAL = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@st.composite
def footages(draw):
    """(names, boxes, size) of two to six pictures. At least two have a drone."""
    size = draw(st.sampled_from(SIZES))
    count = draw(st.integers(2, 6))
    first, step = draw(st.integers(0, 12)), draw(st.sampled_from((1, 1, 10)))
    pattern = draw(st.sampled_from(("{:06d}.jpg", "shot_{}.png", "{}.jpg", "my flight {:03d}.JPG")))
    names = tuple(pattern.format(first + step * number) for number in range(count))
    boxes = []
    for number in range(count):
        w, h = draw(st.integers(800, 20000)) / 100, draw(st.integers(800, 10000)) / 100
        x = draw(st.integers(10, int(100 * (size[0] - w)))) / 100
        y = draw(st.integers(10, int(100 * (size[1] - h)))) / 100
        boxes.append((x, y, w, h) if number < 2 or draw(st.booleans()) else None)
    return names, draw(st.permutations(boxes)), size


def check_right(found, boxes):
    for frame, box in found.items():
        assert boxes[frame] is not None, f"frame {frame} has no drone, but {box}"
        np.testing.assert_allclose(box, boxes[frame], atol=0.1)


def outcome(file, names, size, folder):
    """The boxes of a file, or None where it is refused in one line."""
    try:
        return read_boxes(file, names, *size, folder)
    except InputError as error:
        assert str(error) and "\n" not in str(error)
        return None


@pytest.mark.parametrize("writer", box_files.EVERY)
@settings(USUAL, max_examples=12)
@given(footage=footages())
def test_random_boxes_are_read_back(writer, footage):
    names, boxes, size = footage
    with tempfile.TemporaryDirectory() as folder:
        file = writer(Path(folder), names, boxes, size)
        found = outcome(file, names, size, folder)
    if found is None:  # numbers that are names as well, or an outline that may be keypoints, are refused
        assert writer in (*box_files.BY_POSITION, box_files.yolo_outline)
    else:
        assert list(found) == [frame for frame, box in enumerate(boxes) if box is not None]
        check_right(found, boxes)


def places(content):
    """Every container of a JSON value, with each of its keys."""
    found = []
    for key in content if isinstance(content, dict) else range(len(content)):
        found.append((content, key))
        if isinstance(content[key], dict | list):
            found += places(content[key])
    return found


WORDS = ("x", "nan", "inf", "1_0")
OTHER_TYPES = (None, True, [], {}, "x", [1, 2], -1.5, "nan", 1e400)


def damage_json(draw, text):
    content = json.loads(text)
    container, key = draw(st.sampled_from(places(content)))
    how = draw(st.sampled_from(("drop", "rename", "type", "repeat")))
    value = container[key]
    if how == "type":
        container[key] = draw(st.sampled_from([v for v in OTHER_TYPES if type(v) is not type(value)]))
    elif how == "repeat" and isinstance(container, dict):
        other = json.dumps(draw(st.sampled_from(OTHER_TYPES)))
        container["repeated"] = copy.deepcopy(value)
        return json.dumps(content).replace('"repeated"', f'"{key}": {other}, "{key}"')
    else:
        del container[key]
        if how == "rename" and isinstance(container, dict):
            container[f"{key}_"] = value
    return json.dumps(content)


def damage_text(draw, text):
    """Drop, repeat or replace a word or a line."""
    lines = text.splitlines(keepends=True)
    number = draw(st.integers(0, len(lines) - 1))
    how = draw(st.sampled_from(("line", "twice", "drop", "word")))
    if how == "line":
        del lines[number]
    elif how == "twice":
        lines.insert(number, lines[number])
    else:
        separator = next(s for s in (";", ",", " ", ">", "\n") if s in text)
        words = lines[number].rstrip("\n").split(separator)
        place = draw(st.integers(0, len(words) - 1))
        words[place : place + 1] = [] if how == "drop" else [draw(st.sampled_from(WORDS))]
        lines[number] = separator.join(words) + "\n"
    return "".join(lines)


@pytest.mark.parametrize("writer", box_files.EVERY)
@settings(USUAL, max_examples=25)
@given(data=st.data(), footage=footages())
def test_damaged_files_end_in_the_right_boxes_or_in_one_line(writer, data, footage):
    names, boxes, size = footage
    with tempfile.TemporaryDirectory() as folder:
        file = writer(Path(folder), names, boxes, size)
        hurt = data.draw(st.sampled_from(sorted(file.iterdir()))) if file.is_dir() else file
        text = hurt.read_text()
        if text and data.draw(st.integers(0, 2)) == 0:
            text = text[: data.draw(st.integers(0, len(text) - 1))]
        elif text and hurt.suffix == ".json":
            text = damage_json(data.draw, text)
        elif text:
            text = damage_text(data.draw, text)
        hurt.write_text(text)
        check_right(outcome(file, names, size, folder) or {}, boxes)


@settings(USUAL, max_examples=200)
@given(content=st.binary(max_size=200), suffix=st.sampled_from((".json", ".csv", ".txt", ".xml")))
def test_anything_at_all_is_refused_in_one_line(content, suffix):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"a{suffix}"
        file.write_bytes(content)
        outcome(file, ("a.jpg",), (640, 360), folder)
