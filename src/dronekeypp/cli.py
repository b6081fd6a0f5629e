"""`python -m dronekeypp VERB` runs one verb a command.

The exit status is 0, or 2 with one line on stderr; it is 130 after Ctrl-C and 143 after SIGTERM. Each verb
imports what it needs when it is called: `check` runs before anything is installed.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence

from dronekeypp import arguments
from dronekeypp.errors import InputError
from dronekeypp.output import printing
from dronekeypp.processes import INTERRUPTED, TERMINATED, Terminated, stopping_at_sigterm

Verb = Callable[[Namespace], None]


def _generate(args: Namespace) -> None:
    from dronekeypp.sixdronesyn.generate import generate

    manifest = generate(
        args.out,
        scene_numbers=args.scenes,
        drone_names=args.drones,
        frames=args.frames,
        size=args.size,
        stride=args.stride,
        seed=args.seed,
        environments=args.environments,
        workers=args.workers,
        shard=args.shard,
        edition=args.edition,
        quadrotors=args.quadrotors,
        depth=args.depth,
        masks=args.masks,
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


def _convert(args: Namespace) -> None:
    from dronekeypp.convert import convert

    convert(args.dataset, args.to, args.out, args.keypoints, args.types)


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

    evaluate_checkpoint(
        args.checkpoint, args.dataset, split=args.split, json_file=args.json, bop_file=args.bop
    )


def _predict(args: Namespace) -> None:
    _import_torch()
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
        kinds=args.kinds,
        tracks=args.tracks,
        count_from=args.count_from,
        json_file=args.json,
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
    from dronekeypp.reproduce import reproduce_all

    reproduce_all(
        args.names,
        preset=args.preset,
        seeds=args.seeds,
        overrides=parse_overrides(args.set),
        data=args.data,
        root=args.root,
        stride=args.stride,
        environments=args.environments,
        photographs=args.photographs,
        real=args.real,
        workers=args.workers,
        trainings=args.trainings,
    )


def _import_torch() -> None:
    """Import torch without the garbage collector.

    It would look through torch's two hundred thousand objects again and again while they are made, and once
    more when the process ends. That takes half a second, and they are no garbage.
    """
    if "torch" in sys.modules:
        return
    gc.disable()
    try:
        importlib.import_module("torch")
    finally:
        gc.enable()
    gc.freeze()


# A verb, what it does in the help, its arguments, and its function.
VERBS: tuple[tuple[str, str, Callable[[ArgumentParser], None], Verb], ...] = (
    (
        "generate",
        "render 6DroneSyn, or a part of it; run it again to resume",
        arguments.generate,
        _generate,
    ),
    (
        "validate",
        "prove a data set sound, or name each fault",
        arguments.validate,
        _validate,
    ),
    (
        "convert",
        "write whole frames as a detector is trained on them; run it again to resume",
        arguments.convert,
        _convert,
    ),
    (
        "pretrain",
        "train a backbone, the stand-in for ImageNet weights",
        arguments.pretrain,
        _pretrain,
    ),
    (
        "train",
        "train DroneKey++, or a baseline",
        arguments.train,
        _train,
    ),
    (
        "evaluate",
        "measure a checkpoint: rotation, translation, class, keypoints, and BOP's errors",
        arguments.evaluate,
        _evaluate,
    ),
    (
        "predict",
        "poses of a drone in your own footage; run it again to resume",
        arguments.predict,
        _predict,
    ),
    (
        "export",
        "write DroneKey++ as one ONNX file (optional extra: onnx)",
        arguments.export,
        _export,
    ),
    (
        "check",
        "what the course needs of this machine: [ok], or [missing] with the mend",
        arguments.check,
        _check,
    ),
    (
        "bench",
        "frames a second, beside YOLOv8n-pose + PnP and two larger networks, in turn",
        arguments.bench,
        _bench,
    ),
    (
        "reproduce",
        "measure a table from nothing: render, train, evaluate, write; run it again to resume",
        arguments.reproduce,
        _reproduce,
    ),
)


def parser() -> ArgumentParser:
    """Return the parser of the command line.

    What it parses has `run`, the function of the verb.
    """
    top = arguments.Parser(
        prog="python -m dronekeypp", description="DroneKey++: generate the data, train, evaluate."
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    for name, meaning, add_arguments, run in VERBS:
        verb = verbs.add_parser(name, help=meaning)
        add_arguments(verb)
        verb.set_defaults(run=run)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb, and return the exit status."""
    try:
        with stopping_at_sigterm(), printing():
            args = parser().parse_args(argv)
            args.run(args)
    except (InputError, OSError) as error:
        # A data loading process puts its whole traceback into the message; the last line is ours.
        line = (str(error).strip().splitlines() or [type(error).__name__])[-1]
        with contextlib.suppress(OSError):  # nobody reads that either
            print(f"error: {line.removeprefix('dronekeypp.errors.InputError: ')}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as signal:
        with contextlib.suppress(OSError):
            print("stopped", file=sys.stderr)
        return TERMINATED if isinstance(signal, Terminated) else INTERRUPTED
    return 0
