"""A checkpoint says what it is: its method, its drones with their hubs, its settings. It is held to that."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from fakes import saved, tiny, tiny_config

from dronekeypp import checkpoint
from dronekeypp.baselines import DroneKey, DronePose
from dronekeypp.classes import FIRST_EDITION, DroneClass, match, names_of
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.evaluate import evaluate_checkpoint
from dronekeypp.files import write_json
from dronekeypp.model import DroneKeyPP
from dronekeypp.settings import usable
from dronekeypp.sixdronesyn.bop import read_entries
from dronekeypp.sixdronesyn.flight_file import frame_digest
from dronekeypp.sixdronesyn.manifest_check import FINISHED

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "data_samples"
HUBS = np.array([[0.1, 0.1, 0], [0.1, -0.1, 0], [-0.1, -0.1, 0], [-0.1, 0.1, 0]])

NOBODY = {"name": "A", "label": "A", "hubs": None, "hubs_digest": None}


def drones(*names, scale=1.0):
    return tuple(DroneClass(name, scale * HUBS, name.lower()) for name in names)


@pytest.mark.parametrize("name", ["checkpoint", "beyond"])
def test_the_shipped_ones_name_their_drones(name):
    network = checkpoint.load(SAMPLES / name)
    assert tuple(names_of(network.drones)) == FIRST_EDITION
    assert network.drones[0].title == "Mini 3 Pro" and abs(network.drones[0].wheelbase - 0.247) < 1e-4
    info = json.loads((SAMPLES / "crops" / "models" / "models_info.json").read_text())
    for number, drone in enumerate(network.drones, 1):
        np.testing.assert_allclose(1000 * drone.hubs, info[str(number)]["keypoints"], atol=0.01)


@pytest.mark.parametrize("network", [DroneKeyPP, DroneKey, DronePose])
def test_numbers_are_counted_as_they_are(network):
    config = network.Config.from_dict(usable(network.Config, tiny(), {}))
    whole = network(config, load_backbone=False)
    numbers = sum(tensor.numel() for tensor in (*whole.parameters(), *whole.buffers()))
    drawn = torch.get_rng_state()
    assert checkpoint.count_numbers(network, config) == numbers
    assert torch.equal(torch.get_rng_state(), drawn)  # counting changes no training


def test_a_network_is_loaded_without_what_it_does_not_need():
    """Each of these takes a fifth of a second to a second to import, at the start of every command."""
    code = f"""
import sys
import dronekeypp.predict
from dronekeypp import checkpoint
for name in ("checkpoint", "beyond"):
    checkpoint.load({str(SAMPLES)!r} + "/" + name)
heavy = ("torch._dynamo", "sympy", "torchvision", "matplotlib", "scipy")
print([name for name in heavy if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_names_hubs_and_digests_go_to_disk_and_back(tmp_path):
    network = DroneKeyPP(tiny_config(classes=3))
    network.know(drones("A", "B", "C"))
    network.save_pretrained(tmp_path)
    stored = json.loads((tmp_path / "config.json").read_text())
    assert [entry["name"] for entry in stored["drones"]] == ["A", "B", "C"]
    assert stored["drones"][0]["hubs_digest"] == drones("A")[0].digest
    again = checkpoint.load(tmp_path)
    assert names_of(again.drones) == ["A", "B", "C"] and again.drones[2].title == "c"
    np.testing.assert_allclose(again.drones[1].hubs, HUBS)
    with pytest.raises(InputError, match="2 drones for a network with 3 classes"):
        network.know(drones("A", "B"))


def test_a_run_folder_stands_for_its_best(tmp_path):
    saved(tmp_path / "run" / "best")
    (tmp_path / "run" / "config.json").write_text("{}")
    assert checkpoint.find(tmp_path / "run") == tmp_path / "run" / "best"
    assert checkpoint.weights_file(tmp_path / "run") == tmp_path / "run" / "best" / "model.safetensors"
    assert checkpoint.load(tmp_path / "run").config == checkpoint.load(tmp_path / "run" / "best").config


@pytest.mark.parametrize("network", [DroneKeyPP(tiny_config()), DroneKey(), DronePose()])
def test_every_registered_method_loads_by_its_name(network, tmp_path):
    network.save_pretrained(tmp_path)
    assert type(checkpoint.load(tmp_path)) is type(network)
    assert checkpoint.network_class(network.method) is type(network)
    with pytest.raises(InputError, match="unknown method 'Magic'; known: DroneKey"):
        checkpoint.network_class("Magic")


def first_format(folder, **changes):
    """Rewrite the config.json of a checkpoint as the first edition wrote it: every setting, used or not."""
    description = json.loads((folder / "config.json").read_text())
    unused = {
        "use_rays": True,
        "use_class": True,
        "use_3d": True,
        "rotation": "euler",
        "translation": "metres",
    }
    unused |= {
        "angle_zero": "middle",
        "pose": "mlp",
        "encoder": "learned",
        "classifier": "cls",
        "rays": "raw",
    }
    settings = description.get("settings", description)
    unused |= {"decoder_width": 256, "decoder_layers": 3, "backbone_stride": 16, "classes": 7}
    write_json(
        folder / "config.json",
        {"method": description["method"], **unused, **settings, **changes},
    )


@pytest.mark.parametrize(
    "changes", [{}, {"pose": "geometric", "classifier": "features"}, {"use_rays": False}]
)
def test_checkpoints_of_the_first_format_load(changes, tmp_path):
    network = checkpoint.load(saved(tmp_path, **changes))
    if "pose" in changes:  # its sharp head stood beside the decoder
        from safetensors.torch import load_file, save_file

        state = load_file(tmp_path / "model.safetensors")
        save_file(
            {k.removeprefix("decoder.") if "decoder.head." in k else k: v for k, v in state.items()},
            tmp_path / "model.safetensors",
        )
    first_format(tmp_path)
    old = checkpoint.load(tmp_path)
    assert old.config == network.config and tuple(names_of(old.drones)) == FIRST_EDITION
    for name, value in network.state_dict().items():
        assert torch.equal(value, old.state_dict()[name])


def test_a_baseline_of_the_first_format_loads_without_what_it_ignored(tmp_path):
    DroneKey(DroneKey.Config.from_dict({"width": 16, "heads": 2, "pool": "mean"})).save_pretrained(tmp_path)
    first_format(tmp_path, rays="split", rotation="sixd")
    assert checkpoint.load(tmp_path).config.width == 16
    first_format(tmp_path, colour="red")
    with pytest.raises(InputError, match="config.json: unknown setting 'colour'"):
        checkpoint.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"format": 3}, "format 3; this version of the package reads 1 and 2"),
        ({"method": "Magic"}, "unknown method 'Magic'"),
        ({"drones": []}, "names 0 drones, its settings have 7 classes"),
        ({"drones": 5}, "drones is not a list of classes"),
        ({"drones": [{}] * 7}, "a class of drones: the field name is missing"),
        ({"drones": [NOBODY] * 7}, "two of its drones are called A"),
        ({"drones": [5] * 7}, "a class of drones: is 5: an object of named fields"),
        ({"settings": 5}, "needs a mapping of settings"),
    ],
)
def test_a_broken_description_is_one_line(change, match, tmp_path, capsys):
    folder = saved(tmp_path / "net")
    description = json.loads((folder / "config.json").read_text())
    write_json(folder / "config.json", {**description, **change})
    with pytest.raises(InputError, match=f"config.json: .*{match}"):
        checkpoint.load(folder)
    assert main(["evaluate", str(folder), str(SAMPLES / "crops")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_hubs_that_were_edited_are_not_believed(tmp_path):
    network = DroneKeyPP(tiny_config(classes=2))
    network.know(drones("A", "B"))
    network.save_pretrained(tmp_path)
    description = json.loads((tmp_path / "config.json").read_text())
    description["drones"][1]["hubs"][0][0] += 0.01
    write_json(tmp_path / "config.json", description)
    with pytest.raises(InputError, match="the hubs of B were changed"):
        checkpoint.load(tmp_path)


def test_drones_are_the_same_by_name_and_hubs():
    known = drones("A", "B", "C")
    assert match(drones("C", "A", "D"), known) == [2, 0, None]
    assert match(drones("A", scale=1.01), known) == [None]  # another shape of the same name
    assert match([DroneClass("B")], known) == [1]  # hubs that nobody knows are no contradiction


def relabelled_set(folder, changes):
    """A copy of the sample crops whose models_info.json says other things: {object: {key: value} or None}.

    Its manifest is that of a data set that is not finished. Of a finished one the drones are known.
    """
    shutil.copytree(SAMPLES / "crops", folder, ignore=shutil.ignore_patterns("train", "val", "*.ply"))
    path = folder / "models" / "models_info.json"
    info = json.loads(path.read_text())
    for number, change in changes.items():
        info[number] = {**info[number], **change}
    path.write_text(json.dumps(info))
    manifest = json.loads((folder / "manifest.json").read_text())
    unfinished = {key: value for key, value in manifest.items() if key not in FINISHED}
    (folder / "manifest.json").write_text(json.dumps(unfinished))
    return folder


def test_a_network_of_seven_on_another_seven_is_told_so(tmp_path, capsys):
    strange = relabelled_set(tmp_path / "other", {str(n): {"name": f"Strange{n}"} for n in range(1, 8)})
    assert main(["evaluate", str(SAMPLES / "checkpoint"), str(strange)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "does not know Strange1, " in error and "knows Mini3, Mini2" in error


def test_what_is_shared_is_measured_and_the_rest_is_named(tmp_path, capsys):
    swapped = {"1": {"name": "Mini2"}, "2": {"name": "Mini3"}, "7": {"name": "Racer"}}
    info = json.loads((SAMPLES / "crops" / "models" / "models_info.json").read_text())
    swapped["1"]["keypoints"], swapped["2"]["keypoints"] = info["2"]["keypoints"], info["1"]["keypoints"]
    rows = evaluate_checkpoint(
        SAMPLES / "checkpoint", relabelled_set(tmp_path / "set", swapped), progress=False
    )
    printed = capsys.readouterr().out
    assert "measured on Mini2, Mini3, Air3" in printed and "the network does not know Racer" in printed
    assert {row["drone"] for row in rows} == set(FIRST_EDITION) - {"Tello"}
    # Frames of object 1 are pictures of a Mini 3 that the set now calls Mini2: the label follows the name.
    accuracy = {row["drone"]: row["class_accuracy"] for row in rows if row["scene"] == 6}
    assert accuracy["Mini2"] < 0.2 and accuracy["Mav2"] > 0.8


def test_a_network_of_seven_on_a_set_of_eight(tmp_path, capsys):
    folder = relabelled_set(tmp_path / "eight", {})
    path = folder / "models" / "models_info.json"
    info = json.loads(path.read_text())
    info["8"] = {**info["7"], "name": "Racer"}
    path.write_text(json.dumps(info))
    for gt in sorted((folder / "test").glob("*/scene_gt.json"))[:3]:
        table, about = json.loads(gt.read_text()), json.loads((gt.parent / "flight.json").read_text())
        for objects in table.values():
            objects[0]["obj_id"] = 8
        gt.write_text(json.dumps(table))
        for number, (camera, truths, infos) in read_entries(gt.parent).items():
            about["digests"][str(number)][1] = frame_digest((camera, truths[0], infos[0]))
        (gt.parent / "flight.json").write_text(json.dumps(about))
    evaluate_checkpoint(SAMPLES / "checkpoint", folder, progress=False)
    assert "the network does not know Racer" in capsys.readouterr().out


def test_an_exported_file_carries_the_same_facts(tmp_path):
    pytest.importorskip("onnxscript")
    from dronekeypp.export import export

    network = DroneKeyPP(tiny_config(classes=3))
    network.know(drones("A", "B", "C"))
    network.save_pretrained(tmp_path / "net")
    exported = checkpoint.load(export(tmp_path / "net", tmp_path / "net.onnx"))
    assert [drone.to_dict() for drone in exported.drones] == [drone.to_dict() for drone in network.drones]
    assert exported.config == network.config and exported.method == "DroneKey++"


def test_settings_of_another_width_do_not_fit(tmp_path):
    folder = saved(tmp_path)
    description = json.loads((folder / "config.json").read_text())
    del description["checksum"]
    write_json(folder / "config.json", {**description, "settings": tiny(width=32)})
    with pytest.raises(InputError, match="has shape .* the configuration needs"):
        checkpoint.load(folder)


def test_classes_without_names_are_taken_in_the_order_of_the_data_set(tmp_path, capsys):
    """A checkpoint of the first format with other than seven classes names none of them."""
    folder = saved(tmp_path / "net", classes=8, image_size=64)
    first_format(folder, classes=8)
    eight = relabelled_set(tmp_path / "eight", {})
    path = eight / "models" / "models_info.json"
    info = json.loads(path.read_text())
    path.write_text(json.dumps({**info, "8": {**info["7"], "name": "Racer"}}))
    evaluate_checkpoint(folder, eight, progress=False)
    assert "does not name its classes; they are taken in the data set's order" in capsys.readouterr().out
    with pytest.raises(InputError, match="no drone in common"):
        evaluate_checkpoint(folder, SAMPLES / "crops", progress=False)


def test_another_shape_of_the_same_name_is_left_out_and_told(tmp_path, capsys):
    info = json.loads((SAMPLES / "crops" / "models" / "models_info.json").read_text())
    moved = [[1.02 * value for value in hub] for hub in info["2"]["keypoints"]]
    folder = relabelled_set(tmp_path / "set", {"2": {"keypoints": moved}})
    evaluate_checkpoint(SAMPLES / "checkpoint", folder, progress=False)
    assert "the hubs of Mini2 are not those that it was trained on" in capsys.readouterr().out


def test_a_decoder_may_not_take_a_setting_of_the_network(monkeypatch):
    from dataclasses import dataclass

    from dronekeypp.model import Decoder
    from dronekeypp.model.network import DECODERS, ModelConfig
    from dronekeypp.settings import Settings

    @dataclass(frozen=True)
    class Greedy(Settings):
        layers: int = 2

    class GreedyDecoder(Decoder):
        Config = Greedy

    monkeypatch.setitem(DECODERS, "greedy", GreedyDecoder)
    with pytest.raises(InputError, match="GreedyDecoder: its setting 'layers' is one of the network's"):
        ModelConfig(pose="greedy")
