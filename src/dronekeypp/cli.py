"""`python -m dronekeypp VERB`: one verb a command. Exit status 0, or 2 with one line on stderr."""

import argparse
import sys
from pathlib import Path

from dronekeypp.errors import InputError

SHIPPED = (
    Path("data_samples/checkpoint"),
    Path("data_samples/beyond"),
)  # the paper's network and the geometric one


def _names(text):
    return [part.strip() for part in text.split(",") if part.strip()]


def _numbers(text):
    try:
        return [int(part) for part in _names(text)]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: write scene numbers, for example 6,7") from None


def _shard(text):
    try:
        i, n = text.split("/")
        return int(i), int(n)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: write I/N, for example 0/4") from None


def _generate(args):
    from dronekeypp.sixdronesyn.generate import generate

    manifest = generate(
        args.out,
        args.scenes,
        args.drones,
        args.frames,
        args.size,
        args.stride,
        args.seed,
        args.environments,
        args.workers,
        args.shard,
    )
    counts = ", ".join(f"{n} {split}" for split, n in manifest["frames"].items())
    print(
        f"{args.out}: {sum(manifest['frames'].values())} of {manifest['planned_frames']} frames ({counts}), digest {manifest['digest']}"
    )


def _validate(args):
    from dronekeypp.sixdronesyn.validate import validate

    faults = validate(args.dataset, progress=True)
    if faults:
        for fault in faults[:-1]:
            print(fault, file=sys.stderr)
        raise InputError(faults[-1])
    print(f"{args.dataset}: sound")


def _train(args):
    from dronekeypp.presets import parse_overrides
    from dronekeypp.train import train

    train(
        args.dataset,
        args.out,
        preset=args.preset,
        overrides=parse_overrides(args.set),
        resume=args.resume,
        method=args.method,
    )


def _pretrain(args):
    from dronekeypp.presets import parse_overrides
    from dronekeypp.pretrain import pretrain

    pretrain(
        args.datasets,
        args.out,
        args.val,
        epochs=args.epochs,
        overrides=parse_overrides(args.set),
        resume=args.resume,
    )


def _evaluate(args):
    from dronekeypp.evaluate import evaluate_checkpoint

    evaluate_checkpoint(args.checkpoint, args.dataset, split=args.split, json_file=args.json)


def _reproduce(args):
    from dronekeypp.presets import parse_overrides
    from dronekeypp.reproduce import reproduce

    reproduce(
        args.name, args.preset, args.seeds, parse_overrides(args.set), args.data, args.root, args.stride, args.environments, args.photographs,
        args.real, args.workers,
    )  # fmt: skip


def _box(text):
    try:
        x, y, w, h = (float(part) for part in text.split(","))
        return x, y, w, h
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text}: write x,y,w,h in pixels, for example 800,420,120,60"
        ) from None


def _predict(args):
    from dronekeypp.predict import predict

    predict(
        args.checkpoint,
        args.footage,
        args.camera,
        args.out,
        args.boxes,
        args.box,
        args.smooth,
        not args.no_overlay,
        rate=args.rate,
    )


def _export(args):
    from dronekeypp.export import OnnxNetwork, export, largest_differences, load_checkpoint
    from dronekeypp.sixdronesyn.dataset import SixDroneSyn

    out = export(args.checkpoint, args.out)
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
    if args.check:
        network, _ = load_checkpoint(args.checkpoint)
        dataset = SixDroneSyn(args.check, "test", size=network.config.image_size)
        found = largest_differences(network, OnnxNetwork(out), dataset)
        print(
            f"largest differences to PyTorch over {len(dataset)} test frames: "
            + ", ".join(f"{k} {v:.1e}" for k, v in found.items())
        )


def _check(args):
    from dronekeypp.needs import check

    if not check():
        raise InputError("something is missing; the lines above say how to mend it")


def _bench(args):
    from dronekeypp.bench import bench

    bench(args.checkpoint or SHIPPED, args.json, args.threads, args.rounds, args.seconds)


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, like everything else here."""

    def error(self, message):
        raise InputError(f"{message}; see `{self.prog} --help`")


def parser():
    """The command line, for the entry point and for tests."""
    top = _Parser(prog="python -m dronekeypp", description="DroneKey++: generate the data, train, evaluate.")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    p = verbs.add_parser("generate", help="render 6DroneSyn, or a part of it; run it again to resume")
    p.add_argument("out", type=Path)
    p.add_argument("--scenes", type=_numbers, metavar="6,7", help="scene numbers, 1 to 13 (default: all)")
    p.add_argument("--drones", type=_names, metavar="Mini2,Tello", help="drone names (default: all)")
    p.add_argument(
        "--frames", choices=("crop", "full"), default="crop", help="the square around the drone, or 1920×1080"
    )
    p.add_argument(
        "--size",
        type=int,
        default=128,
        metavar="PX",
        help="side of a crop (default 128; whole frames ignore it)",
    )
    p.add_argument("--stride", type=int, default=1, metavar="N", help="keep every N-th frame of each flight")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument(
        "--environments",
        type=Path,
        metavar="DIR",
        help="your own equirectangular images (default: 22 procedural ones)",
    )
    p.add_argument("--workers", type=int, default=1, metavar="N", help="processes")
    p.add_argument("--shard", type=_shard, default=(0, 1), metavar="I/N", help="render only part I of N")
    p.set_defaults(run=_generate)

    p = verbs.add_parser("validate", help="prove a data set sound, or name each fault")
    p.add_argument("dataset", type=Path)
    p.set_defaults(run=_validate)

    p = verbs.add_parser(
        "pretrain", help="train a backbone on the training scenes, the stand-in for ImageNet weights"
    )
    p.add_argument("datasets", type=Path, nargs="+", metavar="DATASET")
    p.add_argument(
        "--val",
        type=Path,
        metavar="DATASET",
        help="whose validation scenes to measure on (default: the first)",
    )
    p.add_argument("--out", type=Path, required=True, metavar="FILE")
    p.add_argument("--epochs", type=int, default=7)
    p.add_argument("--set", action="append", metavar="key=value")
    p.add_argument("--resume", action="store_true")
    p.set_defaults(run=_pretrain)

    p = verbs.add_parser("train", help="train DroneKey++, or a baseline")
    p.add_argument("dataset", type=Path)
    p.add_argument("--out", type=Path, required=True, metavar="RUN")
    p.add_argument("--preset", default="cpu", help="cpu (default) or paper")
    p.add_argument("--method", default="DroneKey++", help="DroneKey++ (default), DroneKey or DronePose")
    p.add_argument(
        "--set",
        action="append",
        metavar="key=value",
        help="change one setting of the preset; repeat as you like",
    )
    p.add_argument("--resume", action="store_true", help="go on where RUN stopped")
    p.set_defaults(run=_train)

    p = verbs.add_parser("evaluate", help="measure a checkpoint: rotation, translation, class, keypoints")
    p.add_argument("checkpoint", type=Path)
    p.add_argument("dataset", type=Path)
    p.add_argument("--split", default="test", choices=("train", "val", "test"))
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    p.set_defaults(run=_evaluate)

    p = verbs.add_parser("predict", help="poses of a drone in your own footage; run it again to resume")
    p.add_argument("checkpoint", type=Path)
    p.add_argument("footage", type=Path, metavar="INPUT", help="a video, a folder of images, one image")
    p.add_argument(
        "--camera",
        type=Path,
        required=True,
        metavar="FILE",
        help="calibration as OpenCV writes it (YAML, XML, JSON), or plain JSON",
    )
    p.add_argument(
        "--boxes",
        type=Path,
        metavar="FILE",
        help="of the drone, from any detector: COCO JSON, YOLO txt (folder), CSV, MOT",
    )
    p.add_argument(
        "--box",
        type=_box,
        metavar="X,Y,W,H",
        help="of the drone in the first frame, without such a file; a tracker carries it on",
    )
    p.add_argument("--out", type=Path, required=True, metavar="DIR")
    p.add_argument(
        "--smooth",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="sigma of a Gaussian over the poses (default 0: none)",
    )
    p.add_argument(
        "--rate",
        type=float,
        default=30.0,
        metavar="FPS",
        help="of a folder of images (default 30); a video knows its own",
    )
    p.add_argument("--no-overlay", action="store_true", help="write no video")
    p.set_defaults(run=_predict)

    p = verbs.add_parser("export", help="write DroneKey++ as one ONNX file (optional extra: onnx)")
    p.add_argument("checkpoint", type=Path)
    p.add_argument("out", type=Path, metavar="FILE.onnx")
    p.add_argument("--check", type=Path, metavar="DATASET", help="compare with PyTorch on its test split")
    p.set_defaults(run=_export)

    p = verbs.add_parser(
        "check", help="what the course needs of this machine: [ok], or [missing] with the mend"
    )
    p.set_defaults(run=_check)

    p = verbs.add_parser(
        "bench", help="frames a second, beside YOLOv8n-pose + PnP and two larger networks, in turn"
    )
    p.add_argument(
        "--checkpoint",
        type=Path,
        action="append",
        help=f"repeat as you like; default: {' and '.join(map(str, SHIPPED))}",
    )
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    p.add_argument("--threads", type=int, metavar="N", help="default: one a core")
    p.add_argument("--rounds", type=int, default=7, metavar="N")
    p.add_argument("--seconds", type=float, default=1.0, metavar="S", help="of each contender in each round")
    p.set_defaults(run=_bench)

    p = verbs.add_parser(
        "reproduce",
        help="measure a table from nothing: render, train, evaluate, write; run it again to resume",
    )
    p.add_argument(
        "name",
        metavar="NAME",
        help="table3 to table6, heads, rays, degraded, priors, figure6, domains, beyond, claims",
    )
    p.add_argument("--preset", default="cpu", help="cpu (default) or paper")
    p.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="trainings a row (default: 1 or, of an ablation, what its entry says, mostly 3)",
    )
    p.add_argument("--set", action="append", metavar="key=value", help="change one setting of every run")
    p.add_argument(
        "--data", type=Path, metavar="DATASET", help="default: data/6dronesyn; rendered if it is not there"
    )
    p.add_argument(
        "--stride",
        type=int,
        default=1,
        metavar="N",
        help="of the rendering: keep every N-th frame of each flight",
    )
    p.add_argument("--environments", type=Path, metavar="DIR", help="of the rendering: your own panoramas")
    p.add_argument(
        "--photographs",
        type=Path,
        metavar="DIR",
        help="domains, figure6: photographed panoramas to set against the drawn ones",
    )
    p.add_argument(
        "--real",
        type=Path,
        metavar="DIR",
        help="figure6 only: real drone frames with boxes.csv (default: the recorded features)",
    )
    p.add_argument(
        "--root",
        type=Path,
        default=Path("."),
        metavar="DIR",
        help="where runs/, figures/ and data_samples/results/ lie",
    )
    p.add_argument("--workers", type=int, default=2, metavar="N", help="rendering processes")
    p.set_defaults(run=_reproduce)
    return top


def main(argv=None):
    """Run one verb; returns the exit status."""
    try:
        args = parser().parse_args(argv)
        args.run(args)
    except (InputError, OSError) as error:
        # a data loading process puts its whole traceback into the message; the last line is ours
        line = (str(error).strip().splitlines() or [type(error).__name__])[-1]
        print(f"error: {line.removeprefix('dronekeypp.errors.InputError: ')}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    return 0
