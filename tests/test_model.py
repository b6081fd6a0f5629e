"""The network of Sec. III: layers against torch's own, claims of the paper, files, and every bad input."""

import json
import math

import numpy as np
import pytest
import torch
from fakes import FakeDrones, tiny_config, turn
from safetensors.torch import load_file, save_file
from torch import nn
from torch.utils.data import default_collate

from dronekeypp import camera
from dronekeypp.errors import InputError
from dronekeypp.files import write_beside
from dronekeypp.model import (
    Backbone,
    BackboneConfig,
    CompactResNet,
    DroneKeyPP,
    EncoderLayer,
    ModelConfig,
    RayFeatures,
    SelfAttention,
    backbone,
    loss_terms,
    sine_positions,
    total_loss,
)
from dronekeypp.model.decoder import centre_and_spread, from_site
from dronekeypp.train.precision import set_precision


def batch(n=3, size=32):
    dataset = FakeDrones(n, size)
    return default_collate([dataset[i] for i in range(n)])


def network(**changes):
    """A tiny network with the same random weights each time."""
    torch.manual_seed(0)
    return DroneKeyPP(tiny_config(**changes))


def run(model, items, **truth):
    return model(items["image"], items["K"], items["square"], **truth)


def assert_rotations(R):
    """R (B, 3, 3) is orthonormal."""
    torch.testing.assert_close(R @ R.transpose(1, 2), torch.eye(3).expand_as(R), atol=1e-5, rtol=0)


def parameter_count(module):
    return sum(p.numel() for p in module.parameters())


def test_attention_is_torchs_multihead_attention():
    torch.manual_seed(0)
    ours, theirs = SelfAttention(12, 3), nn.MultiheadAttention(12, 3, batch_first=True)
    with torch.no_grad():
        theirs.in_proj_weight.copy_(ours.qkv.weight)
        theirs.in_proj_bias.copy_(ours.qkv.bias)
        theirs.out_proj.load_state_dict(ours.out.state_dict())
    x = torch.randn(2, 5, 12)
    y, weights = ours(x)
    expected, expected_weights = theirs(x, x, x, average_attn_weights=False)
    torch.testing.assert_close(y, expected)
    torch.testing.assert_close(weights, expected_weights)
    torch.testing.assert_close(weights.sum(-1), torch.ones(2, 3, 5))


@pytest.mark.parametrize("norm", ["pre", "post"])
def test_layer_is_torchs_encoder_layer(norm):
    torch.manual_seed(0)
    ours = EncoderLayer(ModelConfig(width=12, heads=3, ffn=20, norm=norm))
    theirs = nn.TransformerEncoderLayer(12, 3, 20, dropout=0.0, batch_first=True, norm_first=norm == "pre")
    with torch.no_grad():
        theirs.self_attn.in_proj_weight.copy_(ours.attention.qkv.weight)
        theirs.self_attn.in_proj_bias.copy_(ours.attention.qkv.bias)
        theirs.self_attn.out_proj.load_state_dict(ours.attention.out.state_dict())
        theirs.linear1.load_state_dict(ours.ffn[0].state_dict())
        theirs.linear2.load_state_dict(ours.ffn[3].state_dict())
    x = torch.randn(2, 5, 12)
    torch.testing.assert_close(ours(x)[0], theirs(x))


def test_layers_do_not_know_the_order_of_tokens_but_positions_do():
    """A layer is equivariant to the order of its tokens. With positions added it is not."""
    torch.manual_seed(0)
    layer, x = EncoderLayer(ModelConfig(width=16, heads=2, ffn=32)), torch.randn(1, 9, 16)
    order = torch.randperm(9)
    torch.testing.assert_close(layer(x[:, order])[0], layer(x)[0][:, order])
    positions = sine_positions(3, 16)
    reordered = layer(x[:, order] + positions)[0]
    assert (reordered - layer(x + positions)[0][:, order]).abs().max() > 0.01


def test_positions_are_all_different():
    positions = sine_positions(12, 128)
    assert positions.shape == (144, 128)
    distances = torch.cdist(positions, positions) + 10 * torch.eye(144)
    assert distances.min() > 0.5


def test_shapes_and_properties_of_the_output():
    """Every output has its shape; shares sum to 1, R is a rotation, angles are turns, rays have z = 1."""
    model, items = network(layers=3), batch()
    out = run(model, items)
    B, N, d, M = 3, 3, 16, 16
    expected = {
        "keypoints": (B, 4, 2),
        "keypoints_px": (B, 4, 2),
        "gate": (B, N),
        "ir": (B, N, d),
        "cr": (B, N, 4, 2),
        "class_logits": (B, 7),
        "class_probs": (B, 7),
        "rays": (B, 4, 3),
        "e_ray": (B, 64),
        "e_cls": (B, 64),
        "keypoints_3d": (B, 4, 3),
        "angles": (B, 3),
        "R": (B, 3, 3),
        "t": (B, 3),
    }
    for name, shape in expected.items():
        assert out[name].shape == shape, name
    assert len(out["attention"]) == N
    for weights in out["attention"]:
        assert weights.shape == (B, 2, 1 + M, 1 + M)
    torch.testing.assert_close(out["gate"].sum(-1), torch.ones(B))
    torch.testing.assert_close(out["class_probs"].sum(-1), torch.ones(B))
    assert_rotations(out["R"])
    assert (out["angles"] >= 0).all()
    assert (out["angles"] < 1).all()
    torch.testing.assert_close(out["rays"][..., 2], torch.ones(B, 4))
    torch.testing.assert_close(out["keypoints_px"], camera.from_crop(out["keypoints"], items["square"]))
    torch.testing.assert_close(out["rays"], camera.rays(out["keypoints_px"], items["K"]))


def test_equations_2_to_4_by_hand():
    """Keypoints are the gated sum of every layer's own, cut at zero. The last layer sets the gate."""
    model, items = network(), batch()
    out = run(model, items)
    W, b = model.encoder.to_keypoints.weight, model.encoder.to_keypoints.bias
    for n in range(3):
        total = torch.zeros(8)
        for layer in range(2):
            total += out["gate"][n, layer] * (W @ out["ir"][n, layer] + b)
        torch.testing.assert_close(out["keypoints"][n].flatten(), total.clamp(min=0))
    gate = torch.softmax(out["ir"][:, -1] @ model.encoder.to_gate.weight.T, -1)
    torch.testing.assert_close(out["gate"], gate)


def test_a_heatmap_keypoint_is_the_mean_place_of_its_map():
    """A flat map puts the keypoint in the middle, any other at the weighted mean of the cells' centres."""
    model, items = network(keypoint_head="heatmap", gate="last", layers=1), batch()
    with torch.no_grad():
        model.encoder.to_heatmap.weight.zero_()
    assert torch.allclose(run(model, items)["keypoints"], torch.tensor(0.5))
    # There are 4 x 4 cells, and x runs first.
    centres = model.encoder.centres
    assert centres[0].tolist() == [0.125, 0.125]
    assert centres[1].tolist() == [0.375, 0.125]
    with torch.no_grad():
        model.encoder.to_heatmap.weight.normal_()
    heat = torch.softmax(model.encoder.to_heatmap(tokens_of(model, items)), dim=1)  # (B, M, 4)
    expected = torch.einsum("bmk,mc->bkc", heat, centres)
    torch.testing.assert_close(run(model, items)["keypoints"], expected)


def tokens_of(model, items):
    """The image tokens after the encoder's only layer: (B, M, d)."""
    encoder = model.encoder
    tokens = encoder.tokenise(model.backbone(items["image"])).flatten(2).transpose(1, 2) + encoder.positions
    return encoder.blocks[0](torch.cat([encoder.cls.expand(len(tokens), -1, -1), tokens], dim=1))[0][:, 1:]


def test_site_measures_against_the_rays():
    """The three numbers of `site` are a place among the rays and the log of depth times their spread.

    That product is a size in metres. So the same three numbers put a drone that looks half as large at twice
    the distance. SMALLEST_SPREAD makes this approximate.
    """
    items = batch(8)
    rays = camera.rays(camera.from_crop(items["keypoints"], items["square"]), items["K"])
    s = torch.tensor([[0.1, -0.2, -1.5]]).expand(8, 3)
    t = from_site(s, rays)
    centre, spread = centre_and_spread(rays)
    torch.testing.assert_close(t[:, 2:] * spread, torch.full((8, 1), math.exp(-1.5)))
    torch.testing.assert_close(t[:, :2] / t[:, 2:], centre + spread * s[:, :2])
    half_as_large = centre[:, None] + (rays[..., :2] - centre[:, None]) / 2
    far_rays = torch.cat([half_as_large, rays[..., 2:]], dim=-1)
    torch.testing.assert_close(from_site(s, far_rays)[:, 2], 2 * t[:, 2], rtol=0.01, atol=0)


def test_an_allocentric_head_turns_with_the_ray():
    """If the head answers the identity for every picture, R takes z to the ray of each picture."""
    model, items = network(rotation="allocentric", translation="site"), batch()
    with torch.no_grad():
        model.decoder.mlp_pose[-1].weight.zero_()
        model.decoder.embed_rays.weight.zero_()
    out = run(model, items)
    ray = torch.nn.functional.normalize(out["rays"].mean(dim=1), dim=-1)
    torch.testing.assert_close(out["R"][:, :, 2], ray)
    assert_rotations(out["R"])


@pytest.mark.parametrize("changes", [{}, {"pose": "geometric"}])
def test_what_looks_at_the_picture_trains_in_bfloat16_and_answers_in_float32(changes):
    """bfloat16 changes the outputs a little and only in training. Outputs and gradients stay float32."""
    model, items = network(**changes), batch()
    exact = run(model.train(), items)["keypoints"]
    set_precision(model, "bfloat16")
    rounded = run(model, items)
    assert rounded["keypoints"].dtype == rounded["R"].dtype == torch.float32
    assert rounded["attention"][0].dtype == torch.bfloat16
    assert not torch.equal(rounded["keypoints"], exact)
    torch.testing.assert_close(rounded["keypoints"], exact, atol=0.05, rtol=0)
    rounded["keypoints"].sum().backward()
    for parameter in model.backbone.parameters():
        assert parameter.dtype == torch.float32
        assert parameter.grad.dtype == torch.float32
    evaluated = run(model.eval(), items)["keypoints"]
    set_precision(model, "float32")
    assert torch.equal(run(model, items)["keypoints"], evaluated)
    assert torch.equal(run(model.train(), items)["keypoints"], exact)


@pytest.mark.parametrize(
    ("settings", "stages", "frozen"),
    [({}, 0, ""), ({}, 1, "0"), ({}, 2, "01"), ({"backbone": "resnet18"}, 2, "01234")],
)
def test_frozen_stages_stay_as_they_were(settings, stages, frozen):
    """Their weights get no gradient, and their batch norms stay in evaluation mode while the rest trains."""
    backbone = Backbone(BackboneConfig(image_size=32, **settings))
    backbone.freeze(stages)
    before = {key: value.clone() for key, value in backbone.state_dict().items()}
    backbone.train()(torch.rand(2, 3, 32, 32)).sum().backward()
    for key, parameter in backbone.named_parameters():
        assert (parameter.grad is None) == (key.split(".")[1] in frozen), key
    for key, value in backbone.state_dict().items():
        if key.endswith("running_mean"):
            assert torch.equal(value, before[key]) == (key.split(".")[1] in frozen), key
    backbone.freeze(0)
    assert all(module.training for module in backbone.modules())


def test_relu_is_alive_at_the_start_and_cuts_below_zero():
    model, items = network(), batch(16)
    assert (run(model, items)["keypoints"] > 0.2).all()
    with torch.no_grad():
        model.encoder.to_keypoints.bias.fill_(-5)
    assert (run(model, items)["keypoints"] == 0).all()


def test_the_pool_leaves_cls_out():
    """Without attention the [cls] token cannot reach the image tokens, so it changes no pooled vector."""
    model, items = network(layers=1), batch()
    features = model.backbone(items["image"])
    before = model.encoder(features)
    with torch.no_grad():
        model.encoder.blocks[0].attention.qkv.weight.zero_()
        model.encoder.blocks[0].attention.qkv.bias.zero_()
        reference = model.encoder(features)["ir"]
        model.encoder.cls.fill_(100.0)
    torch.testing.assert_close(model.encoder(features)["ir"], reference)
    assert before["ir"].shape == reference.shape


def test_cutting_and_resizing_a_crop_never_changes_a_ray():
    """The pose does not depend on the crop. Without rays the decoder cannot know where the crop was."""
    model, items = network(encoder="truth"), batch()
    K, square, keypoints, label = items["K"], items["square"], items["keypoints"], items["label"]
    pixels = camera.from_crop(keypoints, square)
    other_square = square * torch.tensor([0.9, 1.1, 1.7])
    first = model(None, K, square, keypoints, label)
    second = model(None, K, other_square, camera.to_crop(pixels, other_square), label)
    torch.testing.assert_close(first["rays"], second["rays"], atol=1e-6, rtol=0)
    torch.testing.assert_close(first["t"], second["t"], atol=1e-4, rtol=0)
    without_rays = network(encoder="truth", use_rays=False)
    first = without_rays(None, K, square, keypoints, label)
    second = without_rays(None, K, other_square, keypoints, label)
    assert torch.equal(first["t"], second["t"])
    assert first["e_ray"] is None


@pytest.mark.parametrize("mode, size", [("raw", 12), ("standardised", 12), ("split", 11)])
def test_ray_features(mode, size):
    """Raw features are the rays. The other modes have mean 0 and deviation 1, except z, which is always 1."""
    data = FakeDrones(400).data
    rays = camera.rays(camera.from_crop(data["keypoints"], data["square"]), data["K"])
    features = RayFeatures(mode)
    features.fit(rays)
    x = features(rays)
    assert x.shape == (400, size)
    if mode == "raw":
        assert torch.equal(x, rays.flatten(1))
        return
    torch.testing.assert_close(x.mean(0), torch.zeros(size), atol=1e-3, rtol=0)
    deviation = x.std(0, unbiased=False)
    if mode == "standardised":
        assert (deviation[2::3] < 1e-3).all()
        deviation = deviation.view(4, 3)[:, :2]
    torch.testing.assert_close(deviation, torch.ones_like(deviation), atol=1e-3, rtol=0)


def test_split_rays_part_position_distance_and_shape():
    """A drone that moves and is twice as far changes two numbers of place and one of size, not the shape.

    The gradient is finite even where all four rays are the same.
    """
    features = RayFeatures("split")
    square = torch.tensor([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
    near = torch.cat([square, torch.ones(4, 1)], dim=1)[None]
    moved = square / 2 + torch.tensor([0.2, -0.3])
    far = torch.cat([moved, torch.ones(4, 1)], dim=1)[None]
    a, b = features.unscaled(near)[0], features.unscaled(far)[0]
    torch.testing.assert_close(b[:2] - a[:2], torch.tensor([0.2, -0.3]))
    torch.testing.assert_close(a[2] - b[2], torch.tensor(2.0).log(), atol=1e-3, rtol=0)
    torch.testing.assert_close(a[3:], b[3:], atol=1e-3, rtol=0)
    one_point = torch.ones_like(near).requires_grad_()
    features(one_point).sum().backward()
    assert torch.isfinite(one_point.grad).all()


@pytest.mark.parametrize(
    "changes",
    [
        dict(pool="mean"),
        dict(gate="last"),
        dict(gate="uniform"),
        dict(layer_input="same"),
        dict(norm="post"),
        dict(rays="standardised"),
        dict(angle_zero="edge"),
        dict(rays="split", rotation="sixd"),
        dict(rotation="allocentric"),
        dict(translation="site"),
        dict(keypoint_head="heatmap"),
        dict(use_rays=False, use_class=False, use_3d=False),
        dict(use_class=False, use_3d=False),
        dict(use_class=False),
        dict(backbone="resnet18"),
        dict(encoder="truth"),
        dict(backbone_stride=16, dropout=0.1),
    ],
)
def test_every_switch_runs_forward_and_backward(changes):
    """With each switch every parameter gets a gradient, and the outputs are those that the switch leaves."""
    model, items = network(**changes), batch()
    if changes.get("encoder") == "truth":
        out = run(model, items, keypoints=items["keypoints"], label=items["label"])
    else:
        out = run(model, items)
    total_loss(loss_terms(out, items)).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
    assert (out["keypoints_3d"] is None) == (changes.get("use_3d") is False)
    assert (out["angles"] is None) == ("rotation" in changes)
    if "gate" in changes:
        shares = {"last": [0.0, 1.0], "uniform": [0.5, 0.5]}[changes["gate"]]
        assert torch.allclose(out["gate"][0], torch.tensor(shares))
    assert model.parameter_counts()["total"] == parameter_count(model)


@pytest.mark.parametrize("zero, degrees", [("middle", 0), ("edge", 180)])
def test_where_the_sigmoid_puts_level_flight(zero, degrees):
    """Where the sigmoid is 0.5, all angles are 0 with angle_zero=middle and half a turn with edge."""
    model, items = network(angle_zero=zero), batch()
    with torch.no_grad():
        for parameter in model.decoder.mlp_pose[-1].parameters():
            parameter.zero_()
    torch.testing.assert_close(run(model, items)["angles"], torch.full((3, 3), degrees / 360))


def test_truth_replaces_what_the_encoder_says():
    """A given label replaces the predicted class alone; given keypoints and label cost nothing."""
    model, items = network().eval(), batch()
    wrong_label = (items["label"] + 1) % 7
    predicted, mislabelled = run(model, items), run(model, items, label=wrong_label)
    assert torch.equal(predicted["keypoints"], mislabelled["keypoints"])
    assert torch.equal(mislabelled["class_probs"].argmax(-1), wrong_label)
    assert not torch.allclose(predicted["t"], mislabelled["t"])
    true = run(model, items, keypoints=items["keypoints"], label=items["label"])
    terms = loss_terms(true, items)
    assert terms["L_2D"] == 0
    assert terms["L_cls"] < 1e-6


def test_backbone_shapes_and_size():
    x = torch.zeros(1, 3, 96, 96)
    assert CompactResNet(8)(x).shape == (1, 256, 12, 12)
    assert CompactResNet(16)(x).shape == (1, 256, 6, 6)
    assert parameter_count(CompactResNet()) < 3e6
    assert ModelConfig(backbone="resnet50", image_size=224).tokens == 49


def test_backbone_from_a_half_precision_file(tmp_path):
    """A backbone is stored in half precision and loaded in single precision."""
    source = backbone.Backbone(ModelConfig())
    file = tmp_path / "weights.safetensors"
    save_file(backbone.save_backbone(source), file)
    for value in load_file(file).values():
        assert value.dtype in (torch.float16, torch.int64)
    loaded = backbone.Backbone(ModelConfig(backbone_weights=str(file)))
    for key, value in loaded.state_dict().items():
        assert value.dtype != torch.float16
        torch.testing.assert_close(value, source.state_dict()[key], atol=1e-3, rtol=1e-3)


def test_backbone_weights_that_are_missing_or_do_not_fit(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="nowhere.safetensors not found.*backbone_weights=none"):
        DroneKeyPP(ModelConfig(backbone_weights="nowhere.safetensors"))
    broken = tmp_path / "broken.safetensors"
    broken.write_bytes(b"not one")
    with pytest.raises(InputError, match="broken.safetensors is not a readable"):
        DroneKeyPP(ModelConfig(backbone_weights=str(broken)))
    save_file({"x": torch.zeros(1)}, broken)
    with pytest.raises(InputError, match="belongs to another configuration"):
        DroneKeyPP(ModelConfig(backbone_weights=str(broken)))

    def offline(*_, **__):
        raise OSError("no network")

    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", offline)
    monkeypatch.setattr("torchvision.models._api.load_state_dict_from_url", offline)
    with pytest.raises(InputError, match="resnet18 could not be downloaded.*backbone_weights=none"):
        DroneKeyPP(ModelConfig(backbone="resnet18", backbone_weights="imagenet", image_size=64))


def test_saving_and_reading_back_gives_the_same_answers(tmp_path):
    """The loaded network has the same settings and weights, running statistics included."""
    model, items = network(rays="split", rotation="sixd"), batch()
    model.prepare(FakeDrones(64).data)
    run(model, items)  # moves the running statistics
    model.save_pretrained(tmp_path / "a")
    loaded = DroneKeyPP.from_pretrained(tmp_path / "a")
    assert loaded.config == model.config
    assert not loaded.training
    first, second = run(model.eval(), items), run(loaded, items)
    for name in ("keypoints", "class_probs", "R", "t"):
        assert torch.equal(first[name], second[name]), name
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["config.json", "model.safetensors"]


def test_a_checkpoint_needs_no_backbone_file(tmp_path):
    """A checkpoint holds the weights of its backbone: it loads after their file is gone."""
    file = tmp_path / "weights.safetensors"
    save_file(backbone.save_backbone(backbone.Backbone(ModelConfig())), file)
    DroneKeyPP(ModelConfig(backbone_weights=str(file))).save_pretrained(tmp_path / "a")
    file.unlink()
    DroneKeyPP.from_pretrained(tmp_path / "a")


def test_every_bad_checkpoint_is_one_clear_error(tmp_path):
    """Whatever is wrong with the two files of a checkpoint is told in one line that names the file."""
    network().save_pretrained(tmp_path)
    config, weights = tmp_path / "config.json", tmp_path / "model.safetensors"
    good_config, good_weights = config.read_text(), weights.read_bytes()

    def fails(match):
        """Loading raises the error. Afterwards both files are good again."""
        with pytest.raises(InputError, match=match) as error:
            DroneKeyPP.from_pretrained(tmp_path)
        assert "\n" not in str(error.value)
        config.write_text(good_config)
        weights.write_bytes(good_weights)

    def changed(**settings):
        """The good config.json with other settings."""
        description = json.loads(good_config)
        description["settings"].update(settings)
        del description["checksum"]
        return json.dumps(description)

    config.unlink()
    fails("config.json not found")
    weights.unlink()
    fails("model.safetensors not found")
    config.write_text("{")
    fails("config.json: .*not valid JSON")
    config.write_text("[1]")
    fails("config.json: not the description of a checkpoint but a list")
    config.write_bytes(b"\xff\xfe\x00")
    fails("config.json")
    config.write_text(changed(colour=1))
    fails("config.json: unknown setting 'colour' with pose=mlp; known: backbone")
    weights.write_bytes(good_weights[:-100])
    fails("model.safetensors is not a readable safetensors file")
    config.write_text(good_config.replace('"width": ', '"wider": '))
    fails("config.json: unknown setting 'wider'")
    config.write_text(good_config.replace('"layers": ', '"layers": 1'))
    fails("config.json: was changed after it was written .* delete its checksum if you mean the change")
    config.write_text(changed(width=32))
    fails("model.safetensors: .* has shape .* needs")
    config.write_text(changed(layers=3))
    fails("model.safetensors lacks")
    config.write_text(changed(layers=1))
    fails("model.safetensors has an unknown tensor")
    DroneKeyPP.from_pretrained(tmp_path)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    write_beside(tmp_path / "a", b"old")

    def full_disk(*_):
        raise OSError("full")

    monkeypatch.setattr("os.replace", full_disk)
    with pytest.raises(OSError):
        write_beside(tmp_path / "a", b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").read_bytes() == b"old"


def test_bad_input_to_the_network():
    model, items = network(), batch()
    wrong_size = r"image has shape \(3, 3, 24, 24\), needed is \(B, 3, 32, 32\)"
    with pytest.raises(InputError, match=wrong_size):
        model(items["image"][..., :24, :24], items["K"], items["square"])
    with pytest.raises(InputError, match="square has shape"):
        model(items["image"], items["K"], items["square"][:1])
    with pytest.raises(InputError, match="without an image"):
        model(None, items["K"], items["square"])
    with pytest.raises(InputError, match="true keypoints and label"):
        run(network(encoder="truth"), items)


def test_settings_round_trip_and_read_text():
    """Settings come back from JSON, and may be given as text."""
    config = ModelConfig.from_dict({"rays": "split", "layers": 5, "backbone_weights": "x.safetensors"})
    assert config.decoder.rays == "split"
    assert ModelConfig.from_json(config.to_json()) == config
    from_text = config.replace(layers="2", use_3d="false", dropout="1e-1", backbone_weights="none")
    assert from_text == config.replace(layers=2, use_3d=False, dropout=0.1, backbone_weights=None)


@pytest.mark.parametrize(
    "changes, match",
    [
        (dict(colour=1), "unknown setting 'colour' with pose=mlp; known: backbone, "),
        (dict(rays="bent"), "rays='bent' is not one of: raw, "),
        (dict(layers=0), "layers=0 must be at least 1"),
        (dict(layers=1.5), "layers=1.5 does not fit: expected int"),
        (dict(width=2000000000), "width=2000000000 must be at most 8192"),
        (dict(layers="many"), "layers='many' does not fit"),
        (dict(use_3d="perhaps"), "use_3d='perhaps' does not fit: expected bool"),
        (dict(dropout=float("nan")), "dropout=nan does not fit"),
        (dict(dropout=1.0), "dropout=1 must be below 1"),
        (dict(width=30), "multiple of heads"),
        (dict(image_size=100), "image_size=100 must be a multiple of 16"),
        (dict(backbone_stride=4), "backbone_stride=4"),
        (dict(layers=None), "layers=None does not fit"),
        (dict(backbone_weights="imagenet"), "needs a torchvision backbone"),
        (dict(layers=True), "layers=True does not fit"),
    ],
)
def test_bad_settings(changes, match):
    with pytest.raises(InputError, match=match):
        ModelConfig.from_dict(changes)


def test_the_fakes_project_onto_their_keypoints():
    """The fake data set that all these tests use is consistent: its poses project onto its keypoints."""
    data = FakeDrones(20).data
    pixels = camera.project(data["keypoints_3d"] + data["t"][:, None], data["K"])
    torch.testing.assert_close(camera.to_crop(pixels, data["square"]), data["keypoints"], atol=1e-4, rtol=0)
    assert np.isfinite(data["R"].numpy()).all()
    assert torch.allclose(turn(2, 90)[:, 0], torch.tensor([0.0, 1.0, 0.0]), atol=1e-6)


def test_a_classifier_on_features_leaves_the_backbone_alone():
    """With classifier=features the class is read from the mean feature, and its loss trains nothing else."""
    model, items = network(classifier="features"), batch()
    out = run(model, items)
    assert out["class_probs"].shape == (3, 7)
    model.losses(out, items, 10.0)["L_cls"].backward()
    for parameter in (*model.backbone.parameters(), *model.encoder.parameters()):
        assert parameter.grad is None
    for parameter in model.classifier.parameters():
        assert parameter.grad.abs().max() > 0
    assert model.idle_parameters  # the [cls] token's own layer is not asked
    assert not network().idle_parameters
    assert model.parameter_counts()["total"] == parameter_count(model)
    features = model.backbone(items["image"])
    torch.testing.assert_close(out["class_logits"], model.classifier(features.mean(dim=(2, 3))))
