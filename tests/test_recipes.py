"""README, "Extend it": each recipe is carried out as printed, and what a guest has to touch is counted."""

import difflib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import pyvista as pv
from plain_bop import make_plain_folder

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "dronekeypp"
TINY = ["epochs=1", "frames=64", "val_frames=32", "batch=32", "device=cpu", "backbone_weights=none"]


def recipe(title):
    """The code blocks of a recipe of the README, in order."""
    section = (ROOT / "README.md").read_text().split("## Extend it")[1].split("\n## ")[0]
    text = section.split(f"**{title}**")[1].split("\n**")[0]
    return re.findall(r"```\w+\n(.*?)```", text, re.S)


@pytest.fixture
def house(tmp_path):
    """A copy of the package that a guest may change."""
    copy, before = tmp_path / "src" / "dronekeypp", tmp_path / "before"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(copy, before)
    return copy


def run(house, *words, **variables):
    """One command of the copied package. Returns its output."""
    environment = {**os.environ, "PYTHONPATH": str(house.parent), **variables}
    command = [sys.executable, "-m", "dronekeypp", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=house.parent)
    assert done.returncode == 0, done.stderr
    return done.stdout


def train_and_evaluate(house, dataset, *options):
    settings = [word for setting in TINY for word in ("--set", setting)]
    run(house, "train", dataset, "--out", house.parent / "run", *settings, *options)
    return run(house, "evaluate", house.parent / "run", dataset)


def touched(house):
    """What the guest changed: {file: edits}. A new file is one edit, and so is a run of changed lines."""
    edits = {}
    for path in sorted(house.rglob("*.py")):
        name = path.relative_to(house).as_posix()
        original = house.parents[1] / "before" / name
        if not original.is_file():
            edits[name] = 1
            continue
        before, after = original.read_text().splitlines(), path.read_text().splitlines()
        changes = difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
        count = sum(kind != "equal" for kind, *_ in changes)
        if count:
            edits[name] = count
    return edits


def insert(path, before, text):
    """One edit: put `text` in front of the line that begins with `before`."""
    content = path.read_text()
    assert content.count(f"\n{before}") == 1
    path.write_text(content.replace(f"\n{before}", f"\n{text}{before}"))


def test_a_rotation_head(house):
    head, entry = recipe("A rotation head")
    file = house / "model" / "rotation_heads.py"
    insert(file, "ROTATION_HEADS", f"{head}\n\n")
    insert(file, '    "allocentric"', entry)
    table = train_and_evaluate(house, ROOT / "data_samples" / "crops", "--set", "rotation=quaternion")
    assert "Mini3" in table
    edits = touched(house)
    assert list(edits) == ["model/rotation_heads.py"] and sum(edits.values()) <= 3


def test_a_baseline(house):
    network, entry = recipe("A baseline")
    (house / "baselines" / "one_layer.py").write_text(network)
    insert(house / "checkpoint.py", '    "DronePose"', entry)
    table = train_and_evaluate(house, ROOT / "data_samples" / "crops", "--method", "OneLayer")
    assert "Mini3" in table and "nan" in table  # it names no drone and finds no keypoints
    assert touched(house) == {"baselines/one_layer.py": 1, "checkpoint.py": 1} and entry.count("\n") == 1


def test_a_data_set_of_real_frames(house, tmp_path):
    frames = make_plain_folder(tmp_path / "frames")
    for gt in frames.rglob("scene_gt.json"):
        table = json.loads(gt.read_text())
        for objects in table.values():
            objects[0].pop("keypoints_visible")
        gt.write_text(json.dumps(table))
    assert "Mini3" in train_and_evaluate(house, frames, "--set", "mirror=false")
    assert touched(house) == {}


def test_a_drone_of_ones_own(house, environments, tmp_path):
    readme = (ROOT / "README.md").read_text().split("**Your own drone.**")[1]
    description = json.loads(re.search(r"```json\n(.*?)```", readme, re.S)[1])
    mine = tmp_path / "my_drones"
    mine.mkdir()
    (mine / "racer.json").write_text(json.dumps(description))
    arms = [pv.Cube(x_length=300, y_length=24, z_length=20).rotate_z(angle) for angle in (50, -50)]
    (arms[0] + arms[1]).extract_surface(algorithm="dataset_surface").triangulate().save(mine / "racer.stl")
    few = ["--scenes", "1,3,6", "--drones", "Mini2,Racer", "--stride", "60", "--size", "64"]
    known = {"DRONEKEYPP_DRONES": str(mine)}
    run(house, "generate", tmp_path / "eight", *few, "--environments", environments, **known)
    assert "Racer" in train_and_evaluate(
        house, tmp_path / "eight"
    )  # no variable: the data set knows its drones
    names = [
        drone["name"] for drone in json.loads((house.parent / "run/best/config.json").read_text())["drones"]
    ]
    assert len(names) == 8 and names[7] == "Racer"
    assert touched(house) == {}
