"""The speed table: every contender answers, and ratios belong to the same device and batch.

Nothing here judges a time.
"""

import json

import pytest
import torch
from fakes import saved, tiny_config
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.fx.experimental.proxy_tensor import make_fx

from dronekeypp.baselines import DroneKey, yolo
from dronekeypp.bench import (
    COMPILED,
    EAGER,
    GRAPHS,
    LIBRARY,
    ONNX,
    PAPER_SIZED,
    POSE34,
    YOLO,
    YOLO_IN_ONNX,
    Contender,
    bench,
    contenders,
    detector_of,
    detectors_beside,
    named,
    row_of,
    table,
)
from dronekeypp.bench.rendering import rendering_speed
from dronekeypp.bench.stages import build, crops_of, cut, pictures, pose_of_crop
from dronekeypp.cli import main
from dronekeypp.errors import InputError
from dronekeypp.export import export
from dronekeypp.exported import OnnxNetwork
from dronekeypp.model import DroneKeyPP

KEYS = (
    *("name", "engine", "device", "batch", "threads", "frames_per_s", "ratio_to_yolov8n_pose"),
    *("ratios_in_onnx_runtime", "peak_mb", "params", "flops", "stages"),
)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="module")
def geometric(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("bench") / "geometric", rays="split", pose="geometric")


def rows_of(checkpoints, *chosen):
    """The rows of one short round."""
    return bench(checkpoints, rounds=1, seconds=0.0, chosen=chosen, progress=False)["rows"]


def test_rows_of_two_contenders(checkpoint, tmp_path):
    chosen = [
        Contender("DroneKey++", EAGER, "cpu", 2, 1, str(checkpoint)),
        Contender(POSE34, EAGER, "cpu", 1, 1, ""),
    ]
    file = tmp_path / "speed.json"
    result = bench(checkpoint, file, rounds=1, seconds=0.0, chosen=chosen, progress=False)
    assert result == json.loads(file.read_text())
    ours, theirs = result["rows"]
    assert tuple(ours) == KEYS == tuple(theirs)
    assert set(ours["stages"]) == {"crop", "network", "pose"}
    assert set(theirs["stages"]) == {"crop", "network and pose"}
    network = DroneKeyPP.from_pretrained(checkpoint)
    assert ours["params"] == sum(p.numel() for p in network.parameters())
    assert theirs["params"] > 21e6  # ResNet-34
    assert theirs["flops"] == pytest.approx(2 * 3.66e9, rel=0.02)  # torchvision: 3.66 GMAC at 224 px
    assert ours["ratio_to_yolov8n_pose"] is None and ours["peak_mb"] > 50 and ours["frames_per_s"] > 0
    assert len(table(result["rows"]).splitlines()) == 3


def test_the_exported_file_takes_part(geometric, tmp_path):
    if not OnnxNetwork.installed():
        pytest.skip("the optional extra is not installed")
    file = export(geometric, tmp_path / "net.onnx")
    [row] = rows_of(geometric, Contender("DroneKey++, geometric", ONNX, "cpu", 2, 1, str(file)))
    assert row["engine"] == ONNX and set(row["stages"]) == {"crop", "network and pose"}
    network = DroneKeyPP.from_pretrained(geometric)
    assert row["params"] == sum(p.numel() for p in network.parameters())


def test_without_a_compiler_the_others_are_measured(checkpoint, monkeypatch, capsys):
    monkeypatch.setenv("CXX", "/no/such/compiler")
    monkeypatch.setenv("TORCHINDUCTOR_FORCE_DISABLE_CACHES", "1")
    chosen = [Contender("DroneKey++", engine, "cpu", 1, 1, str(checkpoint)) for engine in (EAGER, COMPILED)]
    assert [row["engine"] for row in rows_of(checkpoint, *chosen)] == [EAGER]
    assert "DroneKey++, compiled, cpu is left out: torch.compile failed" in capsys.readouterr().out


def test_a_ratio_is_taken_within_a_round():
    chosen = [
        Contender(YOLO, LIBRARY, "cpu", 1, 2, ""),
        Contender("DroneKey++", EAGER, "cpu", 1, 2, ""),
        Contender("DroneKey++", EAGER, "cpu", 64, 2, ""),
    ]
    rounds = []
    for times in ((0.2, 0.4, 0.8), (0.1, 0.1, 0.1), (0.1, 0.1, 0.1)):
        rounds.append([{"crop": 0.0, "whole": whole, "peak_mb": 9.0} for whole in times])
    theirs = detector_of(chosen[1], chosen, rounds)
    row = row_of(chosen[1], {"params": 1, "flops": 2}, rounds[1], theirs, {})
    assert row["ratio_to_yolov8n_pose"] == 4 and row["frames_per_s"] == 10
    assert detector_of(chosen[2], chosen, rounds) is None  # another batch


def test_in_onnx_runtime_a_network_stands_beside_the_detectors_there():
    large, small = YOLO_IN_ONNX
    chosen = [
        Contender("DroneKey++", ONNX, "cpu", 1, 2, ""),
        Contender(large, ONNX, "cpu", 1, 2, ""),
        Contender(small, ONNX, "cpu", 1, 2, ""),
        Contender(small, ONNX, "cpu", 64, 2, ""),
        Contender("DroneKey++", EAGER, "cpu", 1, 2, ""),
    ]
    rounds = []
    for times in ((0.1, 0.1), (0.4, 0.8), (0.2, 0.2), (9.0, 9.0), (0.1, 0.1)):
        rounds.append([{"crop": 0.0, "whole": whole, "peak_mb": 9.0} for whole in times])
    beside = detectors_beside(chosen[0], chosen, rounds)
    row = row_of(chosen[0], {"params": 1, "flops": 2}, rounds[0], None, beside)
    assert row["ratio_to_yolov8n_pose"] is None
    assert row["ratios_in_onnx_runtime"] == {large: 6, small: 2}
    assert f"2.00 × {small}" in table([row])
    assert detectors_beside(chosen[4], chosen, rounds) == {}  # another engine


def test_who_takes_part(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(yolo, "installed", lambda: False)
    chosen = contenders({"DroneKey++": "folder"}, {}, 2)
    assert {c.device for c in chosen} == {"cpu", "cuda"} and {c.batch for c in chosen} == {1, 64, 512}
    assert {c.name for c in chosen} == {"DroneKey++", PAPER_SIZED, POSE34}
    assert {c.engine for c in chosen} == {EAGER, COMPILED, GRAPHS}
    graphs = {(c.name, c.device, c.batch) for c in chosen if c.engine == GRAPHS}
    assert graphs == {("DroneKey++", "cuda", 1), (PAPER_SIZED, "cuda", 1)}
    beside = [c.engine for c in chosen if (c.name, c.device, c.batch) == ("DroneKey++", "cuda", 1)]
    assert beside == [EAGER, COMPILED, GRAPHS]
    throughput = {c.engine for c in chosen if (c.name, c.device, c.batch) == ("DroneKey++", "cuda", 512)}
    assert throughput == {EAGER, COMPILED}
    monkeypatch.setattr(yolo, "installed", lambda: True)
    chosen = contenders({"DroneKey++": "folder"}, {"DroneKey++": "file.onnx"}, 2)
    assert {c.device for c in chosen if c.engine == ONNX} == {"cpu"}
    assert {c.device for c in chosen if c.name == YOLO} == {"cpu", "cuda"}
    in_onnx = {(c.name, c.engine, c.device) for c in chosen if c.name in YOLO_IN_ONNX}
    assert in_onnx == {(name, ONNX, "cpu") for name in YOLO_IN_ONNX}
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    chosen = contenders({"DroneKey++": "folder"}, {}, 2)
    assert {c.device for c in chosen} == {"cpu"} and GRAPHS not in {c.engine for c in chosen}
    assert not {c.name for c in chosen} & set(YOLO_IN_ONNX)  # there is no ONNX Runtime


def test_a_cuda_graph_s_stages_give_the_network_s_pose(checkpoint, tmp_path, monkeypatch):
    """torch.compile is replaced: it gets what makes one graph of fixed shapes, and changes no answer."""
    asked = {}

    def compiled(function, **settings):
        asked.update(settings)
        return function

    monkeypatch.setattr(torch, "compile", compiled)
    _, stages = build(Contender("DroneKey++", GRAPHS, "cpu", 2, 1, str(checkpoint)), tmp_path)
    assert asked["fullgraph"] and not asked["dynamic"] and asked["options"]["triton.cudagraphs"]
    frames, network = pictures(2), DroneKeyPP.from_pretrained(checkpoint).eval()
    with torch.inference_mode():
        poses = stages["network and pose"](stages["crop"](frames))
        wanted = network(*cut(frames, network.config.image_size, "cpu"))
    torch.testing.assert_close(poses[:, :9].unflatten(1, (3, 3)), wanted["R"])
    torch.testing.assert_close(poses[:, 9:], wanted["t"])


@pytest.mark.parametrize("changes", [{}, {"rotation": "sixd"}, {"rays": "split", "pose": "geometric"}])
def test_nothing_of_a_cuda_graph_comes_from_the_cpu(changes):
    """The network is traced as if it lay on a GPU: a constant from the CPU would be a node elsewhere.

    The tensors are made up, so what would wait for a number from the GPU is an error.
    """
    network = DroneKeyPP(tiny_config(**changes)).eval()
    crops, squares = crops_of(pictures(2), network.config.image_size)
    state = {**dict(network.named_parameters()), **dict(network.named_buffers())}
    with FakeTensorMode(), torch.no_grad():

        def on_gpu(tensor):
            return torch.empty(tensor.shape, dtype=tensor.dtype, device="cuda")

        def call(state, *inputs):
            return torch.func.functional_call(Whole(network), state, inputs)

        state = {f"network.{name}": on_gpu(tensor) for name, tensor in state.items()}
        traced = make_fx(call)(state, on_gpu(crops), on_gpu(torch.empty(2, 3, 3)), on_gpu(squares))
    nodes = list(traced.graph.nodes)
    assert len(nodes) > 100 and "get_attr" not in {node.op for node in nodes}
    elsewhere = []
    for node in nodes:
        value = node.meta.get("val")
        if isinstance(value, torch.Tensor) and value.device.type != "cuda":
            elsewhere.append(node)
    assert elsewhere == []


class Whole(torch.nn.Module):
    """What a CUDA graph holds, as a module, so that its parameters can be replaced."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, crops, K, squares):
        return pose_of_crop(self.network)(crops, K, squares)


def test_the_detector_takes_part(checkpoint):
    if not yolo.installed():
        pytest.skip("the optional extra is not installed")
    [row] = rows_of(checkpoint, Contender(YOLO, LIBRARY, "cpu", 1, 1, ""))
    assert row["ratio_to_yolov8n_pose"] == 1 and row["params"] > 3e6
    assert set(row["stages"]) == {"crop", "network", "pose"}


@pytest.mark.parametrize("name", YOLO_IN_ONNX)
def test_the_detector_takes_part_in_onnx_runtime(name, tmp_path):
    if not (yolo.installed() and OnnxNetwork.installed()):
        pytest.skip("the optional extras are not installed")
    result = bench([], rounds=1, seconds=0.0, chosen=[Contender(name, ONNX, "cpu", 2, 1, "")], progress=False)
    [row] = result["rows"]
    assert row["params"] > 3e6 and row["ratios_in_onnx_runtime"] == {name: 1}
    # 9.2 GFLOP at 640 px.
    assert row["flops"] == pytest.approx(9.2e9 * (YOLO_IN_ONNX[name] / 640) ** 2, rel=0.1)
    assert set(row["stages"]) == {"crop", "network", "pose"}


def test_several_checkpoints_have_names(checkpoint, geometric):
    folders = named([checkpoint, geometric])
    assert folders == {"DroneKey++": str(checkpoint), "DroneKey++, geometric": str(geometric)}
    assert list(named([checkpoint, checkpoint])) == ["DroneKey++", f"DroneKey++ ({checkpoint.name})"]
    chosen = [Contender(name, EAGER, "cpu", 1, 1, folder) for name, folder in folders.items()]
    rows = rows_of([checkpoint, geometric], *chosen)
    assert [row["name"] for row in rows] == ["DroneKey++", "DroneKey++, geometric"]
    assert rows[0]["params"] != rows[1]["params"]


def test_the_shipped_checkpoints_have_the_names_of_the_recorded_rows():
    names = set(named(["data_samples/checkpoint", "data_samples/beyond"]))
    with open("data_samples/results/speed.json") as file:
        recorded = {row["name"] for row in json.load(file)["rows"]}
    assert names == recorded - {YOLO, *YOLO_IN_ONNX, POSE34, PAPER_SIZED}


def test_bad_calls(checkpoint, tmp_path, capsys):
    with pytest.raises(InputError, match="its folder does not exist"):
        bench(checkpoint, tmp_path / "none" / "speed.json")
    with pytest.raises(InputError, match="rounds=0, threads=2: at least 1"):
        bench(checkpoint, rounds=0, threads=2)
    DroneKey(DroneKey.Config(image_size=32)).save_pretrained(tmp_path / "key")
    with pytest.raises(InputError, match=r"key is no DroneKey\+\+ with an encoder"):
        bench(tmp_path / "key")
    with pytest.raises(InputError, match="truth is no DroneKey"):
        bench(saved(tmp_path / "truth", encoder="truth"))
    assert main(["bench", "--checkpoint", str(tmp_path)]) == 2
    assert "not found: a checkpoint is a folder" in capsys.readouterr().err


def test_the_speed_of_generate():
    """A small part of the second edition is rendered twice; the second time counts."""
    speed = rendering_speed(1, scene_numbers=(6,), drone_names=("Tello",), stride=30)
    assert speed.pop("frames_per_s") > 0
    assert speed == {"frames": 12, "size": 128, "workers": 1}
