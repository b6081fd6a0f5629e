"""Each kind of JSON file of ours, damaged: what is read is right, or it is refused in one line.

A data set, a run, a checkpoint, a result and a journal are written once and their files damaged by chance.
"""

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from damage import damages
from fakes import FakeDrones, saved, tiny_config
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plain_bop import make_plain_folder
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from dronekeypp import checkpoint, train
from dronekeypp.classes import DroneClass
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.predict import journal
from dronekeypp.presets import TrainConfig
from dronekeypp.reproduce.results import read_result, write_result
from dronekeypp.sixdronesyn import frame_log, own
from dronekeypp.sixdronesyn.folders import read_manifest
from dronekeypp.sixdronesyn.generate import finish, generate
from dronekeypp.sixdronesyn.validate import validate

USUAL = settings(
    deadline=None, derandomize=True, max_examples=25, suppress_health_check=list(HealthCheck), database=None
)
FLIGHT = "test/060060"
OF_A_FLIGHT = tuple(
    f"{FLIGHT}/{name}.json" for name in ("flight", "scene_camera", "scene_gt", "scene_gt_info")
)
TRAINING = dict(epochs=2, batch=8, lr=1e-3, device="cpu", warmup=0)


@contextlib.contextmanager
def damaged(path, damage):
    """A file with damage, and whole again afterwards."""
    good = path.read_bytes()
    path.write_text(damage(good.decode()))
    try:
        yield
    finally:
        path.write_bytes(good)


def outcome(read, *args):
    """What a function returns, or None where it refuses in one line."""
    try:
        return read(*args)
    except InputError as error:
        assert str(error) and "\n" not in str(error)
        return None


# --- data sets --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def root(tmp_path_factory, environments):
    """Two flights of two crops each, and their files. Every damage is mended."""
    root = tmp_path_factory.mktemp("damaged") / "set"
    options = dict(scene_numbers=[3, 6], drone_names=["Tello"], edition=2, size=64, stride=60)
    generate(root, environments=environments, progress=False, **options)
    return root


def items(root, split):
    """What a data set hands out, but for the pictures, as text."""
    dataset = open_dataset(root, split)
    facts = [dataset.drones[i].to_dict() for i in sorted(set(dataset.labels))]
    arrays = {key: value.tolist() for key, value in dataset.annotations().items()}
    return json.dumps([facts, len(dataset.drones), arrays, dataset.digest])


FILES = ("manifest.json", "models/models_info.json", *OF_A_FLIGHT)


@pytest.mark.parametrize("name", FILES)
@USUAL
@given(damage=damages())
def test_a_data_set_hands_out_what_was_written_or_nothing(name, root, damage):
    good = items(root, "test")
    with damaged(root / name, damage):
        assert outcome(items, root, "test") in (None, good)


@pytest.mark.parametrize("name", ("coco_test.json", "test_targets_bop19.json", *FILES))
@settings(USUAL, max_examples=8)
@given(damage=damages())
def test_validate_finds_every_damage(name, root, damage):
    good = json.loads((root / name).read_text())
    with damaged(root / name, damage):
        faults = outcome(validate, root)
        if faults == []:  # what the file says is the same, or stands for the same
            assert name in ("manifest.json", "models/models_info.json") or (
                json.loads((root / name).read_text()) == good
            )
        for fault in faults or []:
            assert "\n" not in fault


@settings(USUAL, max_examples=15)
@given(damage=damages(), name=st.sampled_from(FILES))
def test_generate_goes_on_or_says_why_not(root, damage, name):
    with damaged(root / name, damage):
        outcome(read_manifest, root)
        files = {path: path.read_bytes() for path in root.rglob("*.json")}
        outcome(finish, root)
        for path, content in files.items():
            path.write_bytes(content)


@settings(USUAL, max_examples=12)
@given(damage=damages(), data=st.data())
def test_a_folder_of_other_people_is_read_or_refused(plain, damage, data):
    name = data.draw(st.sampled_from(("scene_camera.json", "scene_gt.json", "scene_gt_info.json")))
    flight = next((plain / "test").iterdir())
    with damaged(flight / name, damage):
        outcome(items, plain, "test")
    with damaged(plain / "models" / "models_info.json", damage):
        outcome(items, plain, "test")


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return make_plain_folder(tmp_path_factory.mktemp("plain"))


@USUAL
@given(lines=st.lists(st.one_of(st.binary(max_size=30), st.just(b'[60, "x"]'), st.just(b"[true, 1]"))))
def test_a_torn_list_of_frames_is_resumed(root, lines):
    folder = root / FLIGHT
    manifest = read_manifest(root)
    number, (image, *_) = next(iter(json.loads((folder / "flight.json").read_text())["digests"].items()))
    good = frame_log.line(int(number), frame_log.Finished(image)).encode()
    log = folder / frame_log.NAME
    log.write_bytes(b"".join(line.replace(b"\n", b"") + b"\n" for line in lines) + good + good[:-3])
    try:
        assert frame_log.read(folder, manifest["settings"]) == {int(number): frame_log.Finished(image)}
        assert log.read_bytes().endswith(good)
    finally:
        log.unlink()


@pytest.mark.parametrize("line", ["../other/flight", "/data/flight", "..", "a/../../b", "..\\other"])
def test_a_list_names_no_flight_outside(line, plain):
    (plain / "chosen.txt").write_text(line + "\n")
    with pytest.raises(InputError, match="chosen.txt line 1: .* leads out of the data set's folder"):
        open_dataset(plain, "chosen")


# --- what validate and generate must notice ---------------------------------------------------------------


def edited(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def doubled(table):
    for entry in table.values():
        entry[0]["cam_t_m2c"] = [2 * value for value in entry[0]["cam_t_m2c"]]


def longer(table):
    table["7"]["keypoints"] = [[1.1 * value for value in hub] for hub in table["7"]["keypoints"]]


EDITS = {
    "t doubled": (f"{FLIGHT}/scene_gt.json", doubled, "keypoints_3d are .* m from R · hubs"),
    "hubs": ("models/models_info.json", longer, "keypoints_3d are .* m from R · hubs"),
    "names": (
        "models/models_info.json",
        lambda t: t["1"].update(name="A"),
        "object 1 is A, the manifest has",
    ),
    "no hubs": ("models/models_info.json", lambda t: t["1"].pop("keypoints"), "keypoints is missing"),
    "size": ("models/models_info.json", lambda t: t["1"].update(size_x=9.0), "size_x is 9, that of its mesh"),
    "diameter": ("models/models_info.json", lambda t: t["1"].update(diameter=9.0), "diameter 9 is not that"),
    "seed": (f"{FLIGHT}/flight.json", lambda about: about.update(seed=1), "seed is 1, not 0"),
    "box": (
        "coco_test.json",
        lambda c: c["annotations"][0]["bbox"].reverse(),
        "annotations.0 is not that of",
    ),
    "path": ("coco_test.json", lambda c: c["images"][0].update(file_name="../../a.jpg"), "images.0 is not"),
    "absolute": ("coco_test.json", lambda c: c["images"][1].update(file_name="/a.jpg"), "images.1 is not"),
    "outline": (
        "coco_test.json",
        lambda c: c["annotations"][0].update(segmentation=[[-9, 0, 1, 0, 1, 1]]),
        "annotations.0: its segmentation lies outside",
    ),
}


@pytest.mark.parametrize("edit", EDITS)
def test_validate_names_what_was_edited(edit, root, tmp_path):
    name, change, message = EDITS[edit]
    copy = shutil.copytree(root, tmp_path / "copy")
    edited(copy / name, change)
    faults = validate(copy)
    assert any(re.search(message, fault) for fault in faults), faults


def test_every_t_doubled_is_not_evaluated(root, tmp_path):
    copy = shutil.copytree(root, tmp_path / "copy")
    edited(copy / FLIGHT / "scene_gt.json", doubled)
    with pytest.raises(
        InputError, match="060060 frame 0: the annotation is not the one .*; delete its flight"
    ):
        open_dataset(copy, "test")


@pytest.mark.parametrize("folder", ["models", "models_eval"])
def test_a_torn_mesh_is_found_and_written_again(folder, root, tmp_path):
    copy = shutil.copytree(root, tmp_path / "copy")
    mesh = copy / folder / "obj_000007.ply"
    whole = mesh.read_bytes()
    mesh.write_bytes(whole[: len(whole) // 2])
    [fault] = validate(copy)
    assert fault.startswith(f"{mesh}: not a whole PLY file") and "run generate again" in fault
    finish(copy)
    assert mesh.read_bytes() == whole and validate(copy) == []


# --- runs, checkpoints, results ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that was stopped after its first of two epochs."""
    out = tmp_path_factory.mktemp("runs") / "run"

    def stop(state):
        raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt):
        train.train_on(
            FakeDrones(8), FakeDrones(8), out, tiny_config(), TrainConfig(**TRAINING), on_epoch=stop
        )
    return out


@settings(USUAL, max_examples=15)
@given(damage=damages())
def test_a_damaged_state_is_not_resumed(run, damage):
    path = run / "last.safetensors"
    with safe_open(path, "pt") as file:
        text = file.metadata()["state"]
    good, tensors = path.read_bytes(), load_file(path)
    state = train.state.TrainState(
        checkpoint.network_class("DroneKey++")(tiny_config()), TrainConfig(**TRAINING)
    )
    state.settings = json.loads(text)["settings"]
    save_file(tensors, path, {"state": damage(text)})
    try:
        if outcome(lambda: state.load(path) or True):
            assert state.epoch == 1 and [row["epoch"] for row in state.history] == [1]
    finally:
        path.write_bytes(good)


@USUAL
@given(damage=damages())
def test_a_damaged_config_of_a_run_is_not_resumed(run, damage):
    wanted = json.loads((run / "config.json").read_text())
    with damaged(run / "config.json", damage):
        outcome(train.run.check_folder, run, wanted, True)


@settings(USUAL, max_examples=30)
@given(damage=damages())
def test_a_damaged_checkpoint_is_another_file_or_none(network, damage):
    good = repr(checkpoint.read_config(network))
    with damaged(network / "config.json", damage):
        found = outcome(checkpoint.read_config, network)
        assert found is None or repr(found) == good


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("networks") / "net")


RESULT = {
    "name": "table",
    "hardware": "a CPU",
    "versions": {"numpy": "2"},
    "minutes": 1.5,
    "rows": [{"method": "DroneKey++", "variant": None, "seed": 0, "R_mae_deg": 3.5}],
    "told": [{"distance_ratio": [[1.0, 2.0]]}],
}


@settings(USUAL, max_examples=100)
@given(damage=damages())
def test_a_damaged_result_is_not_read(results, damage):
    with damaged(results / "data_samples" / "results" / "table.json", damage):
        found = outcome(read_result, "table", results)
        if found is not None:  # only the name of the checksum is another
            found.pop("checksum_", None)
            assert found == RESULT


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    root = tmp_path_factory.mktemp("results")
    write_result(root, RESULT)
    return root


DRONE = {
    "name": "Racer",
    "mesh": "racer.stl",
    "hubs": [[0.09, 0.11, 0.03], [0.09, -0.11, 0.03], [-0.08, -0.1, 0.03], [-0.08, 0.1, 0.03]],
    "propeller_diameter": 0.13,
    "mass": 0.4,
    "body_mm": [200, 210, 60],
    "hull_rgb": [1, 2, 3],
}


@settings(USUAL, max_examples=60)
@given(damage=damages())
def test_a_damaged_drone_of_your_own_does_not_fly(tmp_path_factory, damage):
    folder = Path(tmp_path_factory.getbasetemp())
    (folder / "racer.stl").write_bytes(b"")
    path = folder / "racer.json"
    path.write_text(json.dumps(DRONE))
    good = own.read_drone(path)
    with damaged(path, damage):
        found = outcome(own.read_drone, path)
        if found is not None:  # what may be left out was
            assert found["name"] == good["name"] and found["mass"] == good["mass"]
            np.testing.assert_array_equal(found["hubs"], good["hubs"])


@settings(USUAL, max_examples=60)
@given(damage=damages())
def test_predict_goes_on_only_in_its_own_run(journals, damage):
    out, about = journals
    rows = (out / journal.JOURNAL).read_bytes()
    with damaged(out / journal.SETTINGS, damage):
        outcome(journal.begin, out, about, [DroneClass("Tello")])
    assert (out / journal.JOURNAL).read_bytes() == rows


@pytest.fixture(scope="module")
def journals(tmp_path_factory):
    """A run of `predict` with two frames of which none has a box."""
    out = tmp_path_factory.mktemp("journals")
    about = {"checkpoint": "a", "footage": ["b", 2], "rate": 30.0, "drones": [["Tello", None]]}
    journal.begin(out, about, [DroneClass("Tello")])
    nothing = "," * (len(journal.COLUMNS) - 3)
    with open(out / journal.JOURNAL, "a") as file:
        file.write(f"0,a.jpg,no box{nothing}\n1,b.jpg,no box{nothing}\n")
    assert journal.begin(out, about, [DroneClass("Tello")]) == 2
    return out, about


def test_a_row_that_is_not_as_it_was_written_is_done_again(journals, tmp_path):
    out, _ = journals
    lines = (out / journal.JOURNAL).read_text().splitlines(keepends=True)
    full = dict.fromkeys(journal.COLUMNS, "1") | {"frame": "2", "status": "ok", "drone": "Tello"}
    for change, kept in (({}, 3), ({"status": "okk"}, 2), ({"R00": "nan"}, 2), ({"tx": "inf"}, 2)):
        row = ",".join({**full, **change}.values())
        (tmp_path / "frames.csv").write_text("".join(lines) + row + "\n")
        assert len(journal.read_journal(tmp_path / "frames.csv", ["Tello"])) == kept, change


@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit of a file's size")
def test_a_mesh_that_the_disk_does_not_hold_is_named(root, tmp_path):
    copy = shutil.copytree(root, tmp_path / "copy")
    shutil.rmtree(copy / "models_eval")
    code = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
from dronekeypp.sixdronesyn.generate import finish
finish({str(copy)!r})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode and re.search(r"File too large: '.*obj_00000\d.ply'", done.stderr), done.stderr
    for mesh in copy.rglob("*.ply"):
        assert mesh.read_bytes() == (root / mesh.relative_to(copy)).read_bytes()
