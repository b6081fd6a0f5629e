"""The exported file answers as the network does, for batches of any size. What is wrong with it is named."""

import json

import cv2
import numpy as np
import pytest
import torch
from fakes import FakeDrones, saved, tiny, tiny_config
from torch.utils.data import default_collate

from dronekeypp import checkpoint
from dronekeypp import exported as exported_module
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.export import IR_VERSION, export, largest_differences
from dronekeypp.exported import DESCRIPTION, OUTPUTS, OnnxNetwork
from dronekeypp.model import DroneKeyPP

GEOMETRIC = {"rays": "split", "pose": "geometric", "classifier": "features"}
SWITCHES = {"rays": "split", "rotation": "allocentric", "translation": "site", "keypoint_head": "heatmap"}


def seven_frames():
    """The inputs of a network for seven frames: image, K, square."""
    items = default_collate([FakeDrones(7)[i] for i in range(7)])
    return items["image"], items["K"], items["square"]


@pytest.mark.parametrize("changes", [{}, SWITCHES, GEOMETRIC])
def test_it_answers_as_the_network_does(changes, tmp_path):
    """Every output of the file is close to the network's, in batches of 3, 3 and 1."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    path = export(saved(tmp_path / "net", **changes), tmp_path / "net.onnx")
    assert onnx.load(path).ir_version == IR_VERSION
    assert [p.name for p in tmp_path.glob("*.onnx")] == ["net.onnx"]
    network, exported = checkpoint.load(tmp_path / "net"), checkpoint.load(path)
    assert exported.config == network.config
    differences = largest_differences(network, exported, FakeDrones(7), batch=3)
    geometric = "pose" in changes
    expected = {*OUTPUTS, "covariance"} if geometric else set(OUTPUTS)
    assert set(differences) == expected
    if geometric:
        covariance = network(*seven_frames())["covariance"].detach()
        assert differences.pop("covariance") < 1e-2 * float(covariance.abs().max())
    # The keypoints of an untrained network coincide. The geometric pose is then metres away, and its search
    # is badly conditioned.
    tolerance = 1e-2 if geometric else 1e-3
    for name, difference in differences.items():
        assert difference < tolerance, name
    assert differences["R"] < 1e-4
    assert max(differences.values()) > 0


def numbers_of(row):
    """The numbers of a row's first six columns, some of which hold several."""
    return np.array(" ".join(row[:6]).split(), dtype=float)


def test_predict_takes_it(tmp_path):
    """The verb `predict` writes the same pose with the exported file as with the checkpoint."""
    pytest.importorskip("onnxscript")
    net = saved(tmp_path / "net")
    assert main(["export", str(net), str(tmp_path / "net.onnx")]) == 0
    picture, camera = tmp_path / "shot.png", tmp_path / "camera.json"
    cv2.imwrite(str(picture), np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8))
    camera.write_text('{"K": [[200, 0, 80], [0, 200, 60], [0, 0, 1]]}')
    rows = []
    for name in ("net", "net.onnx"):
        out = tmp_path / f"out_{name}"
        command = ["predict", str(tmp_path / name), str(picture), "--camera", str(camera)]
        assert main([*command, "--box", "40,30,60,40", "--out", str(out)]) == 0
        rows.append((out / "poses.csv").read_text().splitlines()[1].split(","))
    np.testing.assert_allclose(numbers_of(rows[0]), numbers_of(rows[1]), atol=0.1)  # millimetres


def test_what_cannot_be_exported_or_read(tmp_path):
    """Each way in which an export or an exported file can be wrong has an error of its own."""
    onnx = pytest.importorskip("onnx")
    with pytest.raises(InputError, match="call it .onnx"):
        export(saved(tmp_path / "net"), tmp_path / "net.pt")
    with pytest.raises(InputError, match=r"no DroneKey\+\+ with an encoder"):
        export(saved(tmp_path / "truth", encoder="truth"), tmp_path / "a.onnx")
    with pytest.raises(InputError, match="not found: make it with"):
        OnnxNetwork(tmp_path / "none.onnx")
    model = DroneKeyPP(tiny_config())
    with torch.no_grad():
        model.decoder.mlp_pose[-1].bias.fill_(float("nan"))
    with pytest.raises(InputError, match="the network's answer is not finite"):
        largest_differences(model.eval(), model, FakeDrones(4))
    export(saved(tmp_path / "good"), tmp_path / "good.onnx")
    file = onnx.load(tmp_path / "good.onnx")
    entry = next(entry for entry in file.metadata_props if entry.key == DESCRIPTION)
    description = json.loads(entry.value)
    entry.value = json.dumps({**description, "settings": tiny(image_size=128)})
    onnx.save(file, tmp_path / "edited.onnx")
    with pytest.raises(InputError, match="edited.onnx: was changed after it was written"):
        OnnxNetwork(tmp_path / "edited.onnx")
    del description["checksum"]
    entry.value = json.dumps({**description, "settings": tiny(image_size=128)})
    onnx.save(file, tmp_path / "other.onnx")
    with pytest.raises(InputError, match="its settings are not those of its graph"):
        OnnxNetwork(tmp_path / "other.onnx")
    entry.value = json.dumps({**description, "settings": tiny(colour=1)})
    onnx.save(file, tmp_path / "setting.onnx")
    with pytest.raises(InputError, match="setting.onnx: unknown setting 'colour'"):
        OnnxNetwork(tmp_path / "setting.onnx")
    entry.value = "{"
    onnx.save(file, tmp_path / "json.onnx")
    with pytest.raises(InputError, match="json.onnx: its settings: not valid JSON"):
        OnnxNetwork(tmp_path / "json.onnx")
    (tmp_path / "broken.onnx").write_bytes(b"nothing")
    with pytest.raises(InputError, match="not a readable ONNX file"):
        OnnxNetwork(tmp_path / "broken.onnx")


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(exported_module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r'pip install -e "\.\[onnx\]"'):
        export(tmp_path, tmp_path / "net.onnx")
    with pytest.raises(InputError, match=r'pip install -e "\.\[onnx\]"'):
        OnnxNetwork(tmp_path / "net.onnx")
