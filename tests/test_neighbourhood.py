"""No command changes anything outside the place that it writes to: not beside it, in $HOME or in /tmp."""

import json
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from conftest import paint_environments
from fakes import saved, tiny

from dronekeypp import data
from dronekeypp.bench import EAGER, Contender, bench
from dronekeypp.cli import main
from dronekeypp.exported import OnnxNetwork

SAMPLES = Path(__file__).parents[1] / "data_samples"
SETTINGS = {**tiny(), "backbone_weights": "none", "batch": 16, "device": "cpu"}


@pytest.fixture
def world(small_dataset, tmp_path, monkeypatch):
    """A folder that is $HOME, the working folder and all else that a command may know, with what it reads."""
    read = tmp_path / "read"
    shutil.copytree(small_dataset, read / "set")
    frames = data.open_dataset(SAMPLES / "frames", "test")
    (read / "images").mkdir()
    rows = ["frame,x,y,w,h"]
    for i in (0, 3):
        shutil.copy(frames.folders[i] / "rgb" / "000000.jpg", read / "images" / f"shot_{i}.jpg")
        rows.append(f"shot_{i}.jpg," + ",".join(map(str, frames.frames[i].box)))
    (read / "boxes.csv").write_text("\n".join(rows) + "\n")
    matrix = np.asarray(frames.frames[0].K) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    camera = {"camera_matrix": matrix.tolist(), "image_width": 1920, "image_height": 1080}
    (read / "camera.json").write_text(json.dumps(camera))
    paint_environments(read / "places")
    saved(read / "checkpoint")
    for name in ("out", "home", "tmp", "cwd"):
        (tmp_path / name).mkdir()
        (tmp_path / name / ".letter.tmp").write_text("mine")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for variable in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.setenv(variable, str(tmp_path / "tmp"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.chdir(tmp_path / "cwd")
    return tmp_path


def everything(folder, besides):
    """What lies in a folder: of each file its content and its time, of each link where it leads."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.name.startswith("torchinductor_"):  # torch makes it for itself, at its first import
            continue
        if path == besides or besides in path.parents:
            continue
        if path.is_symlink():
            found[path] = os.readlink(path)
        elif path.is_file():
            found[path] = path.stat().st_mtime_ns, path.read_bytes()
        else:
            found[path] = None
    return found


TRAIN = [f"--set={key}={value}" for key, value in SETTINGS.items()]
BACKBONE = [f"--set={key}={SETTINGS[key]}" for key in ("image_size", "batch", "device")]
PREDICT = "predict read/checkpoint read/images --camera read/camera.json --boxes read/boxes.csv --out"
GENERATE = "generate --scenes 6 --drones Tello --size 64 --stride 90 --environments read/places"
COMMANDS = {
    "generate": [*GENERATE.split(), "out/set"],
    "validate": ["validate", "read/set"],
    "convert": ["convert", str(SAMPLES / "frames"), "--to", "coco", "--out", "out/coco"],
    "pretrain": ["pretrain", "read/set", *BACKBONE, "--epochs", "1", "--out", "out/backbone.safetensors"],
    "train": ["train", "read/set", *TRAIN, "--set=epochs=1", "--out", "out/run"],
    "train with two loaders": [
        "train",
        "read/set",
        *TRAIN,
        "--set=epochs=1",
        "--set=workers=2",
        "--out",
        "out/a",
    ],
    "evaluate": "evaluate read/checkpoint read/set --json out/rows.json --bop out/poses.csv".split(),
    "predict": [*PREDICT.split(), "out/poses", "--json", "out/summary.json"],
    "export": "export read/checkpoint out/net.onnx".split(),
    "check": ["check"],
    "refused": [*PREDICT.split(), "read/set"],
}


def absolute(word, world):
    """A word of a command with its path below the world."""
    return str(world / word) if word.startswith(("read/", "out/")) else word


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_outside_the_output_changes(name, world, capsys):
    if name == "export" and not OnnxNetwork.installed():
        pytest.skip("the optional extra is not installed")
    before = everything(world, world / "out")
    samples = everything(SAMPLES / "frames", world / "out")
    status = main([absolute(word, world) for word in COMMANDS[name]])
    assert status == (2 if name == "refused" else 0), capsys.readouterr().err
    assert everything(world, world / "out") == before
    assert everything(SAMPLES / "frames", world / "out") == samples
    left = [path.name for path in (world / "out").rglob(".*") if "tmp" in path.name]
    assert left == [".letter.tmp"]  # nobody's leftovers, and somebody else's file


def test_bench_changes_nothing_either(world):
    before = everything(world, world / "out")
    chosen = [Contender("DroneKey++", EAGER, "cpu", 1, 1, str(world / "read" / "checkpoint"))]
    bench(world / "read" / "checkpoint", world / "out" / "speed.json", 1, 1, 0.01, chosen, progress=False)
    assert everything(world, world / "out") == before
    assert sorted(path.name for path in (world / "out").iterdir()) == [".letter.tmp", "speed.json"]
