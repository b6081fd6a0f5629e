"""Random cameras are read back from every format, and damaged files give the right camera or one error."""

import codecs
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camera_files import TEXTS, TREES, Camera, lenses, written
from hypothesis import given, settings
from hypothesis import strategies as st

from dronekeypp.errors import InputError
from dronekeypp.footage import read_camera

# The same examples in every run, and no measuring of time.
steady = settings(derandomize=True, database=None, deadline=None, max_examples=12)
damaging = settings(steady, max_examples=25)
FORMATS = (*TREES, *TEXTS)
# Where distortion, size and lens model may be missing, a file without them is another good file.
OPTIONAL = ("plain.json", "opencv.json", "opencv2.json", "camera.json", "opencv.yml")


@st.composite
def cameras(draw, name):
    """A camera of a plausible lens that a file of this name can hold."""
    width = draw(st.integers(320, 4096))
    height = round(width * draw(st.sampled_from([9 / 16, 3 / 4, 1, 4 / 3])))
    lens, count = draw(st.sampled_from(lenses(name)))
    fx = width * draw(st.floats(0.4, 5))
    coefficients = st.floats(-0.05, 0.05).filter(lambda value: abs(value) > 1e-6)
    return Camera(
        fx=fx,
        fy=fx * draw(st.floats(0.95, 1.05)),
        cx=width * draw(st.floats(0.45, 0.55)),
        cy=height * draw(st.floats(0.45, 0.55)),
        width=width,
        height=height,
        lens=lens,
        distortion=tuple(draw(st.lists(coefficients, min_size=count, max_size=count))),
    )


def read(name, content):
    """What is read of a file with this name and content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_camera(path)


def is_read_as(found, camera, name):
    """Tell whether the calibration is that of the camera."""
    K = np.reshape(camera.matrix(0.5), (3, 3))
    size = None if name == "scene_camera.json" or not camera.width else (camera.width, camera.height)
    same = np.allclose(found.K, K, rtol=1e-12, atol=1e-9) and found.size == size
    if camera.lens == "none":
        return same and found.distortion is None
    if found.distortion is None or found.fisheye != (camera.lens == "fisheye"):
        return False
    return same and np.array_equal(found.distortion, camera.distortion)


@pytest.mark.parametrize("name", FORMATS)
@steady
@given(data=st.data())
def test_every_format_is_read_back(name, data):
    camera = data.draw(cameras(name))
    text = written(name, camera)
    mark = data.draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "crlf"]))
    content = text.replace("\n", "\r\n").encode() if mark == "crlf" else text.encode(mark)
    assert is_read_as(read(name, content), camera, name), codecs.decode(content, errors="replace")


def smaller_cameras(camera, name):
    """What a file says from which distortion, size or lens model is gone, where those may be missing."""
    if name not in OPTIONAL:
        return []
    without = [replace(camera, lens="none", distortion=()), replace(camera, width=0, height=0)]
    if camera.lens == "fisheye":
        without.append(replace(camera, lens="brown"))
    return without


def right_or_refused(name, content, camera, also=()):
    """Assert that damaged content is refused in one line, or read as what was written."""
    try:
        found = read(name, content)
    except InputError as error:
        assert "\n" not in str(error) and name in str(error)
        return
    assert any(is_read_as(found, one, name) for one in (camera, *also)), content


def places(tree):
    """Every dictionary in a tree, with each of its keys."""
    found = []
    if isinstance(tree, dict):
        for key, value in tree.items():
            found += [(tree, key), *places(value)]
    elif isinstance(tree, list):
        for value in tree:
            found += places(value)
    return found


SWAPS = (str, lambda value: None, lambda value: True, lambda value: [value], lambda value: {"a": value})
SWAPS = (*SWAPS, lambda value: [], lambda value: float("inf"), lambda value: "", lambda value: [[], value])


@pytest.mark.parametrize("name", TREES)
@damaging
@given(data=st.data())
def test_a_key_that_is_dropped_renamed_or_holds_another_type(name, data):
    camera = data.draw(cameras(name))
    build, text, _ = TREES[name]
    tree = build(camera)
    holder, key = data.draw(st.sampled_from(places(tree)))
    damage = data.draw(st.sampled_from(["drop", "rename", "swap"]))
    value = holder.pop(key)
    if damage == "rename":
        new = data.draw(st.sampled_from([f"{key}x", f"my_{key}", key.upper(), key[::-1], "note", key[1:]]))
        holder.setdefault(new, value)
    elif damage == "swap":
        holder[key] = data.draw(st.sampled_from(SWAPS))(value)
    right_or_refused(name, text(tree), camera, smaller_cameras(camera, name))


@pytest.mark.parametrize("name", TREES)
@steady
@given(data=st.data())
def test_a_key_that_comes_twice(name, data):
    camera = data.draw(cameras(name))
    text = written(name, camera)
    _, key = data.draw(st.sampled_from(places(TREES[name][0](camera))))
    twice = text.replace(f'"{key}":', f'"{key}": null, "{key}":', 1)
    if not name.endswith(".json"):
        lines = text.splitlines(keepends=True)
        place = next(i for i, line in enumerate(lines) if line.strip().startswith(f"{key}:"))
        indent = lines[place][: len(lines[place]) - len(lines[place].lstrip())]
        twice = "".join([*lines[:place], f"{indent}{key}: 1\n", *lines[place:]])
    with pytest.raises(InputError, match="comes twice"):
        read(name, twice)


@pytest.mark.parametrize("name", FORMATS)
@damaging
@given(data=st.data())
def test_a_file_that_is_cut_off(name, data):
    camera = data.draw(cameras(name))
    content = written(name, camera).encode()
    cut = data.draw(st.integers(0, len(content) - 1))
    right_or_refused(name, content[:cut], camera)
    right_or_refused(name, content[:cut] + b"\0" * (len(content) - cut), camera)


@damaging
@given(data=st.data())
def test_words_of_colmap_that_are_dropped_doubled_or_swapped(data):
    camera = data.draw(cameras("cameras.txt"))
    words = written("cameras.txt", camera).splitlines()[-1].split()
    place = data.draw(st.integers(0, len(words) - 1))
    instead = data.draw(st.sampled_from([[], [words[place]] * 2, ["nan"], ["x"], ["-1"], ["1,5"]]))
    line = " ".join([*words[:place], *instead, *words[place + 1 :]])
    # Parameters may be any numbers, and so may the camera's own.
    if instead != ["-1"] or place == 1:
        right_or_refused("cameras.txt", f"{line}\n", camera)
