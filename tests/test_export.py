"""The exported file answers as the network does, for any batch, and says what is wrong with it."""

import numpy as np
import pytest
import torch
from fakes import FakeDrones, saved, tiny
from torch.utils.data import default_collate

from dronekeypp import export as export_module
from dronekeypp.baselines import DroneKey
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.export import (
    CONFIG_KEY,
    DOUBT,
    OUTPUTS,
    OnnxNetwork,
    export,
    largest_differences,
    load_checkpoint,
)
from dronekeypp.model import DroneKeyPP, ModelConfig

GEOMETRIC = {"rays": "split", "pose": "geometric", "classifier": "features"}
SWITCHES = {"rays": "split", "rotation": "allocentric", "translation": "site", "keypoint_head": "heatmap"}


def example():
    items = default_collate([FakeDrones(7)[i] for i in range(7)])
    return items["image"], items["K"], items["square"]


@pytest.mark.parametrize("changes", [{}, SWITCHES, GEOMETRIC])
def test_it_answers_as_the_network_does(changes, tmp_path):
    pytest.importorskip("onnxscript")
    path = export(saved(tmp_path / "net", **changes), tmp_path / "net.onnx")
    assert [p.name for p in tmp_path.iterdir() if p.suffix == ".onnx"] == ["net.onnx"]
    (network, _), exported = load_checkpoint(tmp_path / "net"), OnnxNetwork(path)
    assert exported.config == network.config
    found = largest_differences(network, exported, FakeDrones(7), batch=3)  # batches of 3, 3 and 1
    assert set(found) == set(OUTPUTS + DOUBT if "pose" in changes else OUTPUTS)
    doubt = found.pop("covariance", 0.0)
    if doubt:
        assert doubt < 1e-2 * float(network(*example())["covariance"].detach().abs().max())
    loose = (
        1e-2 if "pose" in changes else 1e-3
    )  # an untrained network's keypoints coincide: metres away, and badly conditioned
    assert all(value < loose for value in found.values()) and found["R"] < 1e-4 and max(found.values()) > 0


def test_predict_takes_it(tmp_path, capsys):
    pytest.importorskip("onnxscript")
    import cv2

    net = saved(tmp_path / "net")
    assert main(["export", str(net), str(tmp_path / "net.onnx")]) == 0
    cv2.imwrite(
        str(tmp_path / "shot.png"), np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    )
    (tmp_path / "camera.json").write_text('{"K": [[200, 0, 80], [0, 200, 60], [0, 0, 1]]}')
    rows = []
    for name in ("net", "net.onnx"):
        command = [
            "predict",
            str(tmp_path / name),
            str(tmp_path / "shot.png"),
            "--camera",
            str(tmp_path / "camera.json"),
            "--box",
            "40,30,60,40",
        ]
        assert main([*command, "--out", str(tmp_path / f"out_{name}")]) == 0
        rows.append((tmp_path / f"out_{name}" / "poses.csv").read_text().splitlines()[1].split(","))
    a, b = (np.array([float(v) for part in row[:6] for v in part.split()]) for row in rows)
    np.testing.assert_allclose(a, b, atol=0.1)  # millimetres


def test_what_cannot_be_exported_or_read(tmp_path, monkeypatch):
    onnx = pytest.importorskip("onnx")
    with pytest.raises(InputError, match="call it .onnx"):
        export(saved(tmp_path / "net"), tmp_path / "net.pt")
    with pytest.raises(InputError, match="no network with an encoder"):
        export(saved(tmp_path / "truth", encoder="truth"), tmp_path / "a.onnx")
    DroneKey(ModelConfig(**tiny(pool="mean"))).save_pretrained(tmp_path / "key")
    with pytest.raises(InputError, match="holds a network of DroneKey; this takes DroneKey"):
        load_checkpoint(tmp_path / "key")
    with pytest.raises(InputError, match="not found: make it with"):
        OnnxNetwork(tmp_path / "none.onnx")
    model = DroneKeyPP(ModelConfig(**tiny()))
    with torch.no_grad():
        model.decoder.mlp_pose[-1].bias.fill_(float("nan"))
    with pytest.raises(InputError, match="the network's answer is not finite"):
        largest_differences(model.eval(), model, FakeDrones(4))
    export(saved(tmp_path / "plain"), tmp_path / "plain.onnx")
    file = onnx.load(tmp_path / "plain.onnx")
    entry = next(entry for entry in file.metadata_props if entry.key == CONFIG_KEY)
    entry.value = ModelConfig(**tiny(image_size=128)).to_json()
    onnx.save(file, tmp_path / "other.onnx")
    with pytest.raises(InputError, match="its settings are not those of its graph"):
        OnnxNetwork(tmp_path / "other.onnx")
    (tmp_path / "broken.onnx").write_bytes(b"nothing")
    with pytest.raises(InputError, match="not a readable ONNX file"):
        OnnxNetwork(tmp_path / "broken.onnx")


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(export_module.importlib.util, "find_spec", lambda name: None)
    for call in (lambda: export(tmp_path, tmp_path / "net.onnx"), lambda: OnnxNetwork(tmp_path / "net.onnx")):
        with pytest.raises(InputError, match=r'pip install -e "\.\[onnx\]"'):
            call()
