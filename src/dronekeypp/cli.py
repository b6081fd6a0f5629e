"""`python -m dronekeypp VERB` runs one verb a command.

The exit status is 0, or 2 with one line on stderr. Each verb imports what it needs when it is called: `check`
runs before anything is installed.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence

from dronekeypp import arguments
from dronekeypp.errors import InputError

Verb = Callable[[Namespace], None]


def _generate(args: Namespace) -> None:
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
    frames = manifest["frames"]
    counts = ", ".join(f"{count} {split}" for split, count in frames.items())
    of = f"{sum(frames.values())} of {manifest['planned_frames']} frames"
    print(f"{args.out}: {of} ({counts}), digest {manifest['digest']}")


def _validate(args: Namespace) -> None:
    from dronekeypp.sixdronesyn.validate import validate

    faults = validate(args.dataset, progress=True)
    if faults:
        for fault in faults[:-1]:
            print(fault, file=sys.stderr)
        raise InputError(faults[-1])
    print(f"{args.dataset}: sound")


def _pretrain(args: Namespace) -> None:
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


def _train(args: Namespace) -> None:
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


def _evaluate(args: Namespace) -> None:
    from dronekeypp.evaluate import evaluate_checkpoint

    evaluate_checkpoint(args.checkpoint, args.dataset, split=args.split, json_file=args.json)


def _predict(args: Namespace) -> None:
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


def _export(args: Namespace) -> None:
    from dronekeypp import checkpoint, data
    from dronekeypp.export import export, largest_differences
    from dronekeypp.exported import OnnxNetwork

    out = export(args.checkpoint, args.out)
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
    if args.check:
        network = checkpoint.load(args.checkpoint)
        dataset = data.open_dataset(args.check, "test", size=network.config.image_size)
        differences = largest_differences(network, OnnxNetwork(out), dataset)
        listed = ", ".join(f"{name} {value:.1e}" for name, value in differences.items())
        print(f"largest differences to PyTorch over {len(dataset)} test frames: {listed}")


def _check(args: Namespace) -> None:
    from dronekeypp.needs import check

    if not check():
        raise InputError("something is missing; the lines above say how to mend it")


def _bench(args: Namespace) -> None:
    from dronekeypp.bench import bench
    from dronekeypp.files import repository_root

    checkpoints = args.checkpoint
    if not checkpoints:
        checkpoints = [repository_root() / folder for folder in arguments.SHIPPED]
    bench(checkpoints, args.json, args.threads, args.rounds, args.seconds)


def _reproduce(args: Namespace) -> None:
    from dronekeypp.presets import parse_overrides
    from dronekeypp.reproduce import reproduce

    reproduce(
        args.name,
        args.preset,
        args.seeds,
        parse_overrides(args.set),
        args.data,
        args.root,
        args.stride,
        args.environments,
        args.photographs,
        args.real,
        args.workers,
    )


def parser() -> ArgumentParser:
    """Return the parser of the command line.

    What it parses has `run`, the function of the verb.
    """
    top = arguments.Parser(
        prog="python -m dronekeypp", description="DroneKey++: generate the data, train, evaluate."
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    def add(name: str, meaning: str, arguments_of: Callable[[ArgumentParser], None], run: Verb) -> None:
        verb = verbs.add_parser(name, help=meaning)
        arguments_of(verb)
        verb.set_defaults(run=run)

    meaning = "render 6DroneSyn, or a part of it; run it again to resume"
    add("generate", meaning, arguments.generate, _generate)
    meaning = "prove a data set sound, or name each fault"
    add("validate", meaning, arguments.validate, _validate)
    meaning = "train a backbone on the training scenes, the stand-in for ImageNet weights"
    add("pretrain", meaning, arguments.pretrain, _pretrain)
    meaning = "train DroneKey++, or a baseline"
    add("train", meaning, arguments.train, _train)
    meaning = "measure a checkpoint: rotation, translation, class, keypoints"
    add("evaluate", meaning, arguments.evaluate, _evaluate)
    meaning = "poses of a drone in your own footage; run it again to resume"
    add("predict", meaning, arguments.predict, _predict)
    meaning = "write DroneKey++ as one ONNX file (optional extra: onnx)"
    add("export", meaning, arguments.export, _export)
    meaning = "what the course needs of this machine: [ok], or [missing] with the mend"
    add("check", meaning, arguments.check, _check)
    meaning = "frames a second, beside YOLOv8n-pose + PnP and two larger networks, in turn"
    add("bench", meaning, arguments.bench, _bench)
    meaning = "measure a table from nothing: render, train, evaluate, write; run it again to resume"
    add("reproduce", meaning, arguments.reproduce, _reproduce)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb, and return the exit status."""
    try:
        args = parser().parse_args(argv)
        args.run(args)
    except (InputError, OSError) as error:
        # A data loading process puts its whole traceback into the message; the last line is ours.
        line = (str(error).strip().splitlines() or [type(error).__name__])[-1]
        print(f"error: {line.removeprefix('dronekeypp.errors.InputError: ')}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    return 0
