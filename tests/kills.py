"""Kill commands at random times, run them again, and compare with what they make when nobody kills them.

    python tests/kills.py FOLDER SEED KILLS [VERB …]

Everything is imported once. Every run is a fork of this process, so a kill costs no start. This process
itself computes nothing: the threads of torch and OpenCV do not outlive a fork.
"""

import csv
import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np
from conftest import paint_environments
from fakes import saved, tiny

from dronekeypp import bench, cli, convert, data, evaluate, predict, pretrain, train  # noqa: F401
from dronekeypp.sixdronesyn import generate  # noqa: F401

SAMPLES = Path(__file__).parents[1] / "data_samples"
TINY = {**tiny(), "backbone_weights": "none", "batch": 16, "device": "cpu"}


def prepare(folder):
    """Write what the commands read, but for the data set that is generated."""
    frames = data.open_dataset(SAMPLES / "frames", "test")
    images = folder / "images"
    images.mkdir(parents=True)
    rows = ["frame,x,y,w,h"]
    for i in range(0, 21, 3):
        shutil.copy(frames.folders[i] / "rgb" / "000000.jpg", images / f"shot_{i}.jpg")
        rows.append(f"shot_{i}.jpg," + ",".join(map(str, frames.frames[i].box)))
    (folder / "boxes.csv").write_text("\n".join(rows) + "\n")
    matrix = np.asarray(frames.frames[0].K) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    camera = {"camera_matrix": matrix.tolist(), "image_width": 1920, "image_height": 1080}
    (folder / "camera.json").write_text(json.dumps(camera))
    paint_environments(folder / "places")
    saved(folder / "checkpoint")


def commands_in(folder):
    """Return each command by its verb, without its output, which comes last."""
    checkpoint, images, small = (folder / name for name in ("checkpoint", "images", "small"))
    make = ["generate", "--scenes", "1,3,6", "--drones", "Tello", "--size", "64", "--stride", "60"]
    make += ["--environments", folder / "places", "--workers", "1"]
    settings = [f"--set={key}={value}" for key, value in TINY.items()]
    backbone = [text for text in settings if text.split("=")[1] in ("image_size", "batch", "device")]
    read = ["predict", checkpoint, images, "--camera", folder / "camera.json"]
    return {
        "generate": make,
        "generate-on-two": [*make[:-1], "2"],
        "convert": ["convert", SAMPLES / "frames", "--to", "coco", "--out"],
        "predict": [*read, "--boxes", folder / "boxes.csv", "--out"],
        "train": ["train", small, *settings, "--set=epochs=4", "--resume", "--out"],
        "pretrain": ["pretrain", small, *backbone, "--epochs", "2", "--resume", "--out"],
        "evaluate": ["evaluate", checkpoint, small, "--json"],
    }


def start(call):
    """Call a function in a fork of this process, silently, and return the process."""
    sys.stdout.flush()
    process = os.fork()
    if process:
        return process
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    status = 1
    try:
        status = call() or 0
    finally:
        os._exit(status)


def ended(process):
    """Wait for a process, and return its exit status."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def begin(command):
    """Begin a command in a process of its own, and return that."""
    return start(lambda: cli.main([str(word) for word in command]))


def kill(command, seconds):
    """Kill a command after so many seconds, and tell whether it was still running."""
    process = begin(command)
    time.sleep(seconds)
    os.kill(process, signal.SIGKILL)
    return ended(process) == -signal.SIGKILL


def content(path):
    """Return every file at a path by its name, without the times that a run measures of itself."""
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    found = {}
    for file in files:
        name = file.name if file == path else file.relative_to(path).as_posix()
        value = file.read_bytes()
        if file.suffix == ".csv":
            rows = list(csv.DictReader(value.decode().splitlines()))
            value = [
                {key: cell for key, cell in row.items() if key not in ("seconds", "time")} for row in rows
            ]
        elif file.name in ("last.safetensors", "backbone.safetensors"):
            value = value[8 + int.from_bytes(value[:8], "little") :]  # the header holds times
        found[name] = value
    return found


def main(folder, seed, kills, verbs):
    """Do so, and return how many kills met a running command, by verb."""
    assert ended(start(lambda: prepare(folder / "read"))) == 0
    commands = commands_in(folder / "read")
    assert ended(begin([*commands["generate"], folder / "read" / "small"])) == 0
    read = content(folder / "read")
    rng = np.random.default_rng(seed)
    hits = {}
    verbs = verbs or list(commands)
    for place, verb in enumerate(verbs):
        name = "backbone.safetensors" if verb == "pretrain" else "out"
        whole, killed = folder / "whole" / verb / name, folder / "killed" / verb / name
        for out in (whole, killed):
            out.parent.mkdir(parents=True)
        began = time.monotonic()
        assert ended(begin([*commands[verb], whole])) == 0, verb
        seconds = time.monotonic() - began
        wanted = kills // len(verbs) + (place < kills % len(verbs))
        hits[verb] = 0
        for _ in range(3 * wanted):
            if hits[verb] == wanted:
                break
            if kill([*commands[verb], killed], rng.uniform(0.1, 0.9) * seconds):
                hits[verb] += 1
            else:  # it had finished: once more from the beginning
                shutil.rmtree(killed.parent)
                killed.parent.mkdir()
        finished = verb == "pretrain" and killed.is_file()
        assert finished or ended(begin([*commands[verb], killed])) == 0, verb
        assert content(killed.parent) == content(whole.parent), verb
        assert content(folder / "read") == read, f"{verb} changed what it reads"
        print(f"{verb}: {seconds:.1f} s whole, {hits[verb]} kills met it, identical", flush=True)
    return hits


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
