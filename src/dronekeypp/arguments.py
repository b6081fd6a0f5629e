"""This module defines the arguments of the command line and their help, with one function a verb.

What a verb does is in `cli`.
"""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError
from pathlib import Path
from typing import NoReturn

from dronekeypp.errors import InputError

# What `bench` measures by default, below the repository: the paper's network and the geometric one.
SHIPPED = ("data_samples/checkpoint", "data_samples/beyond")


class Parser(ArgumentParser):
    """A parser says what is wrong in one line, like everything else here."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see `{self.prog} --help`")


# --- values -----------------------------------------------------------------------------------------------


def words(text: str) -> list[str]:
    """Read words separated by commas, such as "Mini2,Tello"."""
    return [part.strip() for part in text.split(",") if part.strip()]


def numbers(text: str) -> list[int]:
    """Read whole numbers separated by commas, such as "6,7"."""
    try:
        return [int(part) for part in words(text)]
    except ValueError:
        raise ArgumentTypeError(f"{text}: write scene numbers, for example 6,7") from None


def shard(text: str) -> tuple[int, int]:
    """Read a shard I/N, such as "0/4", as (I, N)."""
    try:
        i, n = text.split("/")
        return int(i), int(n)
    except ValueError:
        raise ArgumentTypeError(f"{text}: write I/N, for example 0/4") from None


def interval(text: str) -> tuple[int, int]:
    """Read a range A:B of numbers, such as "0:100", as (A, B)."""
    try:
        first, end = text.split(":")
        return int(first), int(end)
    except ValueError:
        raise ArgumentTypeError(f"{text}: write A:B, for example 0:100") from None


def box(text: str) -> tuple[float, float, float, float]:
    """Read a box x,y,w,h in pixels, such as "800,420,120,60"."""
    try:
        x, y, w, h = text.split(",")
        return float(x), float(y), float(w), float(h)
    except ValueError:
        mend = "write x,y,w,h in pixels, for example 800,420,120,60"
        raise ArgumentTypeError(f"{text}: {mend}") from None


# --- verbs ------------------------------------------------------------------------------------------------


def generate(p: ArgumentParser) -> None:
    frames = "the square around the drone, or 1920×1080"
    size = "side of a crop (default 128; whole frames ignore it)"
    environments = "your own equirectangular images (default: 22 procedural ones)"
    quadrotors = "random quadrotors A to B − 1 in place of the seven drones (edition 2)"
    edition = (
        "1 (default): what the recorded numbers are of; "
        "2: mended shapes, a lens a flight, complete BOP files (always with --quadrotors)"
    )
    p.add_argument("out", type=Path)
    p.add_argument("--scenes", type=numbers, metavar="6,7", help="scene numbers, 1 to 13 (default: all)")
    p.add_argument("--drones", type=words, metavar="Mini2,Tello", help="drone names (default: all)")
    p.add_argument("--frames", choices=("crop", "full"), default="crop", help=frames)
    p.add_argument("--size", type=int, default=128, metavar="PX", help=size)
    p.add_argument("--stride", type=int, default=1, metavar="N", help="keep every N-th frame of each flight")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--environments", type=Path, metavar="DIR", help=environments)
    p.add_argument("--workers", type=int, default=1, metavar="N", help="processes")
    p.add_argument("--shard", type=shard, default=(0, 1), metavar="I/N", help="render only part I of N")
    p.add_argument("--quadrotors", type=interval, metavar="A:B", help=quadrotors)
    p.add_argument("--edition", type=int, metavar="N", help=edition)
    p.add_argument("--depth", action="store_true", help="also write depth images (edition 2)")
    p.add_argument("--masks", action="store_true", help="also write masks of the drone (edition 2)")


def validate(p: ArgumentParser) -> None:
    p.add_argument("dataset", type=Path)


def convert(p: ArgumentParser) -> None:
    to = "yolo for Ultralytics, coco for torchvision and others"
    out = "default: DATASET-yolo or DATASET-coco, beside the data set"
    p.add_argument("dataset", type=Path, help="with whole frames")
    p.add_argument("--to", required=True, choices=("yolo", "coco"), help=to)
    p.add_argument("--out", type=Path, metavar="DIR", help=out)
    p.add_argument("--keypoints", action="store_true", help="yolo: labels for its task `pose`")
    p.add_argument("--types", action="store_true", help="a class for each drone (default: one class)")


def pretrain(p: ArgumentParser) -> None:
    val = "whose validation scenes to measure on (default: the first)"
    p.add_argument("datasets", type=Path, nargs="+", metavar="DATASET")
    p.add_argument("--val", type=Path, metavar="DATASET", help=val)
    p.add_argument("--out", type=Path, required=True, metavar="FILE")
    p.add_argument("--epochs", type=int, default=7)
    p.add_argument("--set", action="append", metavar="key=value")
    p.add_argument("--resume", action="store_true")


def train(p: ArgumentParser) -> None:
    method = "DroneKey++ (default), DroneKey or DronePose"
    setting = "change one setting of the preset; repeat as you like"
    p.add_argument("dataset", type=Path)
    p.add_argument("--out", type=Path, required=True, metavar="RUN")
    p.add_argument("--preset", default="cpu", help="cpu (default) or paper")
    p.add_argument("--method", default="DroneKey++", help=method)
    p.add_argument("--set", action="append", metavar="key=value", help=setting)
    p.add_argument("--resume", action="store_true", help="go on where RUN stopped")


def evaluate(p: ArgumentParser) -> None:
    split = "of the data set (default: test); 6DroneSyn has train, val and test"
    bop = "also write the poses there for BOP's toolkit, which wants the name METHOD_DATASET-SPLIT.csv"
    p.add_argument("checkpoint", type=Path)
    p.add_argument("dataset", type=Path)
    p.add_argument("--split", default="test", metavar="NAME", help=split)
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    p.add_argument("--bop", type=Path, metavar="FILE", help=bop)


def predict(p: ArgumentParser) -> None:
    footage = "a video, a folder of images, one image, or a scene of a BOP data set"
    camera = "calibration of OpenCV, ROS, Kalibr, COLMAP, BOP or NeRF, or plain JSON (see README)"
    boxes = "of the drone: COCO JSON, YOLO txt or VOC XML (folders), CSV, MOT, x,y,w,h a line (README)"
    kind = "of the boxes that are the drone's, by name or number; repeat for several"
    track = "of the boxes that are the drone's; repeat for several"
    count = "the number of the first frame, where the numbers of the boxes do not tell"
    first = "of the drone in the first frame, without such a file; a tracker carries it on"
    smooth = "sigma of a Gaussian over the poses (default 0: none)"
    rate = "of a folder of images (default 30), or of a video in place of its own times"
    p.add_argument("checkpoint", type=Path)
    p.add_argument("footage", type=Path, metavar="INPUT", help=footage)
    p.add_argument("--camera", type=Path, required=True, metavar="FILE", help=camera)
    p.add_argument("--boxes", type=Path, metavar="FILE", help=boxes)
    p.add_argument("--class", dest="kinds", action="append", default=[], metavar="NAME", help=kind)
    p.add_argument("--track", dest="tracks", action="append", default=[], metavar="N", help=track)
    p.add_argument("--count-from", type=int, choices=(0, 1), help=count)
    p.add_argument("--box", type=box, metavar="X,Y,W,H", help=first)
    p.add_argument("--out", type=Path, required=True, metavar="DIR")
    p.add_argument("--smooth", type=float, default=0.0, metavar="SECONDS", help=smooth)
    p.add_argument("--rate", type=float, metavar="FPS", help=rate)
    p.add_argument("--no-overlay", action="store_true", help="write no video")
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers of the last line there")


def export(p: ArgumentParser) -> None:
    p.add_argument("checkpoint", type=Path)
    p.add_argument("out", type=Path, metavar="FILE.onnx")
    p.add_argument("--check", type=Path, metavar="DATASET", help="compare with PyTorch on its test split")


def check(p: ArgumentParser) -> None:
    """Add nothing, because the verb takes no arguments."""


def bench(p: ArgumentParser) -> None:
    checkpoint = f"repeat as you like; default: {' and '.join(SHIPPED)}"
    p.add_argument("--checkpoint", type=Path, action="append", help=checkpoint)
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    p.add_argument("--threads", type=int, metavar="N", help="default: one a core")
    p.add_argument("--rounds", type=int, default=7, metavar="N")
    p.add_argument("--seconds", type=float, default=1.0, metavar="S", help="of each contender in each round")


def reproduce(p: ArgumentParser) -> None:
    name = (
        "table3 to table6, rates, heads, rays, degraded, priors, figure6, domains, beyond, claims; "
        "several are made one after the other"
    )
    seeds = "trainings a row (default: the table's own number, mostly 3)"
    data = "default: data/6dronesyn; rendered if it is not there"
    stride = "of the rendering: keep every N-th frame of each flight"
    photographs = "domains, figure6: photographed panoramas to set against the drawn ones"
    real = "figure6 only: real drone frames with boxes.csv (default: the recorded features)"
    root = "where runs/, figures/ and data_samples/results/ lie"
    p.add_argument("names", metavar="NAME", nargs="+", help=name)
    p.add_argument("--preset", default="cpu", help="cpu (default) or paper")
    p.add_argument("--seeds", type=int, metavar="N", help=seeds)
    p.add_argument("--set", action="append", metavar="key=value", help="change one setting of every run")
    p.add_argument("--data", type=Path, metavar="DATASET", help=data)
    p.add_argument("--stride", type=int, default=1, metavar="N", help=stride)
    p.add_argument("--environments", type=Path, metavar="DIR", help="of the rendering: your own panoramas")
    p.add_argument("--photographs", type=Path, metavar="DIR", help=photographs)
    p.add_argument("--real", type=Path, metavar="DIR", help=real)
    p.add_argument("--root", type=Path, default=Path("."), metavar="DIR", help=root)
    p.add_argument("--workers", type=int, default=2, metavar="N", help="rendering processes")
    p.add_argument(
        "--trainings", type=int, default=1, metavar="N", help="trainings side by side; they share the cores"
    )
