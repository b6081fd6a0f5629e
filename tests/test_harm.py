"""Nothing is harmed: no file of somebody else's, no result that nobody reads, no folder by a bad setting."""

import errno
import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from fakes import FakeDrones, saved, tiny_config
from safetensors.torch import load_file

from dronekeypp import cli, files, output, train
from dronekeypp.errors import InputError
from dronekeypp.evaluate import loading
from dronekeypp.files import (
    append_to,
    check_writable,
    make_folder,
    remove_unfinished,
    write_beside,
    writing_beside,
)
from dronekeypp.presets import TrainConfig

ROOT = Path(__file__).parents[1]
LEFT = ".poses.csv.0123456789abcdef.tmp.csv"  # by a kill while poses.csv was written


# --- temporary files --------------------------------------------------------------------------------------


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "poses.csv"
    names = set()
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), writing_beside(path) as beside:
            assert beside.read_bytes() == b"" and beside.suffix == ".csv"
            names.add(beside.name)
            beside.write_text("half")
            raise ZeroDivisionError
        assert not list(tmp_path.iterdir())
    assert len(names) == 2
    write_beside(path, b"whole")
    assert [p.name for p in tmp_path.iterdir()] == ["poses.csv"] and path.read_bytes() == b"whole"


def test_a_temporary_file_is_never_somebody_elses(tmp_path, monkeypatch):
    """Where a file or a link of that very name lies, nothing is written to it."""
    victim = tmp_path / "victim"
    victim.write_text("mine")
    monkeypatch.setattr(files.secrets, "token_hex", lambda _: "0123456789abcdef")
    (tmp_path / LEFT).symlink_to(victim)
    with pytest.raises(FileExistsError):
        write_beside(tmp_path / "poses.csv", b"theirs")
    assert victim.read_text() == "mine" and (tmp_path / LEFT).is_symlink()


def test_a_link_in_place_of_a_file_is_replaced_and_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "poses.csv").symlink_to(victim)
    write_beside(tmp_path / "poses.csv", b"ours")
    assert victim.read_text() == "mine" and not (tmp_path / "poses.csv").is_symlink()
    for link in ("log", "folder"):
        (tmp_path / link).symlink_to(victim if link == "log" else tmp_path)
    with pytest.raises(InputError, match="log: a link"):
        append_to(tmp_path / "log")
    with pytest.raises(InputError, match="folder: a link"):
        make_folder(tmp_path / "folder")


def test_only_what_a_kill_left_of_known_files_is_removed(tmp_path):
    others = (".letter.tmp", ".poses.csv.7.tmp.csv", ".mine.csv.0123456789abcdef.tmp.csv", "poses.csv.tmp")
    for name in (*others, LEFT):
        (tmp_path / name).write_text("half")
    (tmp_path / LEFT.replace("0", "a")).symlink_to(tmp_path / ".letter.tmp")
    (tmp_path / LEFT.replace("0", "b")).mkdir()
    before = {path.name for path in tmp_path.iterdir()}
    remove_unfinished(tmp_path, ("poses.csv",))
    assert before - {path.name for path in tmp_path.iterdir()} == {LEFT}


def test_what_another_process_is_writing_is_not_removed(tmp_path):
    with writing_beside(tmp_path / "poses.csv") as beside:
        beside.write_text("half")
        remove_unfinished(tmp_path, ("poses.csv",))
        assert beside.is_file()
    assert (tmp_path / "poses.csv").read_text() == "half"


def test_a_result_goes_to_a_plain_file_only(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    for name in ("pipe", "link"):
        with pytest.raises(InputError, match="a link, a pipe or a device"):
            check_writable(tmp_path / name)
    with pytest.raises(InputError, match="a folder"):
        check_writable(tmp_path)
    (tmp_path / LEFT).write_text("half")
    check_writable(tmp_path / "poses.csv")
    assert not (tmp_path / LEFT).exists()


# --- stdout -----------------------------------------------------------------------------------------------


# A verb that computes, prints and does not look back, and one that prints what no ASCII terminal knows.
VERB = """
import sys
from dronekeypp import cli
cli.VERBS = [("check", "", lambda _: None, lambda _: print("35° → 36°", flush=True))]
sys.exit(cli.main(["check"]))
"""


def run(*arguments, reader):
    """Run Python with an ASCII stdout that nobody reads ("gone"), whose disk is full, or that is read."""
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    options = dict(cwd=ROOT, text=True, stderr=subprocess.PIPE, env=environment)
    command = [sys.executable, *map(str, arguments)]
    if reader == "gone":
        read, write = os.pipe()
        os.close(read)
        with open(write, "w") as stdout:
            return subprocess.run(command, stdout=stdout, **options)
    if reader == "full":
        if not Path("/dev/full").exists():
            pytest.skip("this system has no full disk to try")
        with open("/dev/full", "w") as stdout:
            return subprocess.run(command, stdout=stdout, **options)
    return subprocess.run(command, stdout=subprocess.PIPE, **options)


def test_an_ascii_terminal_is_no_error():
    done = run("-c", VERB, reader="there")
    assert (done.returncode, done.stdout, done.stderr) == (0, "35? ? 36?\n", "")


@pytest.mark.parametrize("reader", ["gone", "full"])
def test_stdout_that_cannot_be_written_is_one_line(reader):
    done = run("-c", VERB, reader=reader)
    [line] = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("error: stdout cannot be written") and "is kept" in line


def test_the_rows_are_kept_where_nobody_reads_the_table(tmp_path):
    checkpoint, crops = saved(tmp_path / "checkpoint"), ROOT / "data_samples" / "crops"
    json_file, bop = tmp_path / "rows.json", tmp_path / "poses.csv"
    command = ("-u", "-m", "dronekeypp", "evaluate", checkpoint, crops, "--split", "val")
    done = run(*command, "--json", json_file, "--bop", bop, reader="gone")
    assert done.returncode == 2 and "stdout cannot be written" in done.stderr
    assert json_file.is_file() and bop.is_file()


def test_an_error_of_another_file_is_not_one_of_stdout(monkeypatch, capfd):
    monkeypatch.setattr(sys, "stdout", sys.__stdout__)

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device", "run/last.safetensors")

    monkeypatch.setattr(cli, "VERBS", [("check", "", lambda _: None, full)])
    assert cli.main(["check"]) == 2
    assert "last.safetensors" in capfd.readouterr().err


def test_an_epoch_is_kept_before_it_is_printed(tmp_path, monkeypatch):
    monkeypatch.setattr(train.loop, "print", lambda *_, **__: 1 / 0, raising=False)
    arguments = (FakeDrones(8), FakeDrones(8), tmp_path / "run", tiny_config(), settings())
    with pytest.raises(ZeroDivisionError):
        train.train_on(*arguments, progress=True)
    assert (tmp_path / "run" / "last.safetensors").is_file()


def test_nothing_is_wrapped_where_stdout_is_no_file(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(sys, "stdout", text)
    with output.printing():
        print("35°")
    assert text.getvalue() == "35°\n"


# --- training ---------------------------------------------------------------------------------------------


def settings(**changes):
    return TrainConfig(epochs=1, batch=4, lr=1e-3).replace(**changes)


def train_tiny(out, resume=False, **changes):
    return train.train_on(FakeDrones(8), FakeDrones(8), out, tiny_config(), settings(**changes), resume)


def test_a_refused_training_does_not_bind_the_corrected_one(tmp_path):
    broken = FakeDrones(8)
    broken.data["t"][5] = float("nan")
    run = tmp_path / "run"
    with pytest.raises(InputError, match="is not finite"):
        train.train_on(broken, FakeDrones(8), run, tiny_config(), settings(lr=1.0))
    assert not list(run.iterdir())
    train_tiny(run)
    assert (run / "config.json").is_file()


def test_a_kill_in_the_first_epoch_leaves_a_folder_that_can_be_used(tmp_path, monkeypatch):
    run = tmp_path / "run"
    monkeypatch.setattr(train.TrainState, "save", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        train_tiny(run)
    assert sorted(path.name for path in run.iterdir()) == ["best", "config.json"]
    monkeypatch.undo()
    (run / ".last.safetensors.0123456789abcdef.tmp.safetensors").write_bytes(b"half")
    train_tiny(run, lr=1e-4)
    assert not [path for path in run.iterdir() if path.name.startswith(".")]


def test_somebody_elses_config_is_left_alone(tmp_path):
    (tmp_path / "config.json").write_text('{"theme": "dark"}')
    (tmp_path / ".letter.tmp").write_text("mine")
    for resume in (False, True):
        with pytest.raises(InputError, match="choose another folder"):
            train_tiny(tmp_path, resume=resume)
    assert (tmp_path / "config.json").read_text() == '{"theme": "dark"}'
    assert (tmp_path / ".letter.tmp").read_text() == "mine"


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_torn_state_names_a_way_that_works(share, tmp_path):
    run = tmp_path / "run"
    best = train_tiny(run)
    weights = load_file(best / "model.safetensors")
    state = run / "last.safetensors"
    state.write_bytes(state.read_bytes()[: int(share * state.stat().st_size)])
    with pytest.raises(InputError) as error:
        train_tiny(run, resume=True, epochs=1)
    message = str(error.value)
    assert f"remove the folder {run} or choose another; {best} is whole" in message
    assert load_file(best / "model.safetensors").keys() == weights.keys()
    shutil.rmtree(run)
    train_tiny(run)


class Dying(FakeDrones):
    """A data set whose loading process is killed, as by a system that is out of memory."""

    def __getitem__(self, i):
        if torch.utils.data.get_worker_info() is not None:
            os.kill(os.getpid(), 9)
        return super().__getitem__(i)


def test_a_killed_loading_process_is_one_line(tmp_path):
    with pytest.raises(InputError, match="loads data died.*--shm-size.*workers=0.*--resume") as error:
        train.train_on(Dying(8), FakeDrones(8), tmp_path / "run", tiny_config(), settings(workers=1))
    assert "\n" not in str(error.value)


def test_a_fault_in_a_loading_process_stays_what_it_is():
    message = "Caught RuntimeError in DataLoader worker process 0.\nRuntimeError: shapes do not fit"
    with pytest.raises(RuntimeError, match="shapes do not fit"), loading(workers=2):
        raise RuntimeError(message)
    with pytest.raises(InputError, match="died"), loading(workers=2):
        raise RuntimeError("unable to write to file </torch_7_8>: No space left on device (28)")


# --- memory -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"width": 8192, "layers": 256, "ffn": 65536}, "million weights, at most"),
        ({"image_size": 4096, "heads": 64, "width": 256}, "attention weights a layer, at most"),
    ],
)
def test_a_network_that_asks_for_all_memory_is_refused(changes, match):
    with pytest.raises(InputError, match=match):
        tiny_config(**changes)


@pytest.mark.parametrize(
    ("model", "training", "match"),
    [
        ({"decoder_width": 65536, "decoder_layers": 64}, {}, "a network of this size needs"),
        ({}, {"batch": 10**9}, "batch=1000000000 with image_size=32 needs"),
        ({}, {"workers": 10**6}, "workers=1000000 with batch=4 needs"),
    ],
)
def test_a_training_that_asks_for_all_memory_is_refused(model, training, match, tmp_path, monkeypatch):
    class Endless(FakeDrones):
        def __len__(self):
            return 10**9

    monkeypatch.setattr(train.run, "describe_data", lambda *_: {})
    with pytest.raises(InputError, match=match):
        train.train_on(
            Endless(8), FakeDrones(8), tmp_path / "run", tiny_config(**model), settings(**training)
        )
    assert not (tmp_path / "run").exists()


def test_a_checkpoint_whose_config_asks_for_all_memory_is_refused(tmp_path):
    from dronekeypp import checkpoint

    folder = saved(tmp_path / "checkpoint")
    path = folder / "config.json"
    description = json.loads(path.read_text())
    del description["checksum"]
    description["settings"]["decoder_width"] = 65536
    path.write_text(json.dumps(description))
    with pytest.raises(InputError, match="config.json describes a network of .* do not belong together"):
        checkpoint.load(folder)


@pytest.mark.parametrize("name", ["manifest.json", "models/models_info.json", "train/000110/scene_gt.json"])
def test_a_file_nested_without_end_is_one_line(name, small_dataset, tmp_path, capsys):
    root = tmp_path / "set"
    shutil.copytree(small_dataset, root)
    assert (root / name).is_file()
    (root / name).write_text("[" * 500_000 + "]" * 500_000)
    assert cli.main(["train", str(root), "--out", str(tmp_path / "run")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert str(root / name) in line and not (tmp_path / "run").exists()


def test_settings_nested_without_end_are_one_line():
    with pytest.raises(InputError, match="TrainConfig: not valid JSON"):
        TrainConfig.from_json("[" * 500_000 + "]" * 500_000)
