"""The network of Sec. III: its layers against torch's own, its claims as properties, its files, and every bad input."""

import json
import math

import numpy as np
import pytest
import torch
from fakes import FakeDrones, tiny, turn
from safetensors.torch import load_file, save_file
from torch import nn

from dronekeypp import camera
from dronekeypp.errors import InputError
from dronekeypp.files import write_beside
from dronekeypp.model import (
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


def batch(n=3, size=32):
    return next(iter(torch.utils.data.DataLoader(FakeDrones(n, size), batch_size=n)))


def network(**changes):
    torch.manual_seed(0)
    return DroneKeyPP(ModelConfig(**tiny(**changes)))


def run(model, items, **more):
    return model(items["image"], items["K"], items["square"], **more)


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
        for a, b in (
            (theirs.self_attn.out_proj, ours.attention.out),
            (theirs.linear1, ours.ffn[0]),
            (theirs.linear2, ours.ffn[3]),
        ):
            a.load_state_dict(b.state_dict())
    x = torch.randn(2, 5, 12)
    torch.testing.assert_close(ours(x)[0], theirs(x))


def test_layers_do_not_know_the_order_of_tokens_but_positions_do():
    torch.manual_seed(0)
    layer, x = EncoderLayer(ModelConfig(width=16, heads=2, ffn=32)), torch.randn(1, 9, 16)
    order = torch.randperm(9)
    torch.testing.assert_close(layer(x[:, order])[0], layer(x)[0][:, order])  # equivariant
    positions = sine_positions(3, 16)
    moved = layer(x[:, order] + positions)[0]
    assert (moved - layer(x + positions)[0][:, order]).abs().max() > 0.01


def test_positions_are_all_different():
    positions = sine_positions(12, 128)
    assert positions.shape == (144, 128)
    apart = torch.cdist(positions, positions) + 10 * torch.eye(144)
    assert apart.min() > 0.5


def test_shapes_and_properties_of_the_output():
    model, items = network(layers=3), batch()
    out = run(model, items)
    B, N, d, M = 3, 3, 16, 16
    expected = {
        "keypoints": (B, 4, 2), "keypoints_px": (B, 4, 2), "gate": (B, N), "ir": (B, N, d), "cr": (B, N, 4, 2), "class_logits": (B, 7),
        "class_probs": (B, 7), "rays": (B, 4, 3), "e_ray": (B, 64), "e_cls": (B, 64), "keypoints_3d": (B, 4, 3), "angles": (B, 3),
        "R": (B, 3, 3), "t": (B, 3),
    }  # fmt: skip
    assert {name: tuple(out[name].shape) for name in expected} == expected
    assert [tuple(a.shape) for a in out["attention"]] == [(B, 2, 1 + M, 1 + M)] * N
    torch.testing.assert_close(out["gate"].sum(-1), torch.ones(B))
    torch.testing.assert_close(out["class_probs"].sum(-1), torch.ones(B))
    torch.testing.assert_close(
        out["R"] @ out["R"].transpose(1, 2), torch.eye(3).expand(B, 3, 3), atol=1e-5, rtol=0
    )
    assert (out["angles"] >= 0).all() and (out["angles"] < 1).all()
    torch.testing.assert_close(out["rays"][..., 2], torch.ones(B, 4))
    torch.testing.assert_close(out["keypoints_px"], camera.from_crop(out["keypoints"], items["square"]))
    torch.testing.assert_close(out["rays"], camera.rays(out["keypoints_px"], items["K"]))


def test_equations_2_to_4_by_hand():
    model, items = network(), batch()
    out = run(model, items)
    W, b = model.encoder.to_keypoints.weight, model.encoder.to_keypoints.bias
    for n in range(3):
        total = torch.zeros(8)
        for layer in range(2):
            total += out["gate"][n, layer] * (W @ out["ir"][n, layer] + b)
        torch.testing.assert_close(out["keypoints"][n].flatten(), total.clamp(min=0))
    torch.testing.assert_close(
        out["gate"], torch.softmax(out["ir"][:, -1] @ model.encoder.to_gate.weight.T, -1)
    )


def test_a_heatmap_keypoint_is_the_mean_place_of_its_map():
    model, items = network(keypoint_head="heatmap", gate="last", layers=1), batch()
    with torch.no_grad():
        model.encoder.to_heatmap.weight.zero_()
    assert torch.allclose(run(model, items)["keypoints"], torch.tensor(0.5))  # all cells alike: the middle
    centres = model.encoder.centres
    assert centres[0].tolist() == [0.125, 0.125] and centres[1].tolist() == [
        0.375,
        0.125,
    ]  # 4 x 4 cells: x runs first
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
    items = batch(8)
    rays = camera.rays(camera.from_crop(items["keypoints"], items["square"]), items["K"])
    s = torch.tensor([[0.1, -0.2, -1.5]]).expand(8, 3)
    t = from_site(s, rays)
    centre, spread = centre_and_spread(rays)
    torch.testing.assert_close(
        t[:, 2:] * spread, torch.full((8, 1), math.exp(-1.5))
    )  # depth times spread: a size in metres
    torch.testing.assert_close(t[:, :2] / t[:, 2:], centre + spread * s[:, :2])
    # twice as far, the same drone looks half as large: the same three numbers say so
    far = torch.cat([centre[:, None] + (rays[..., :2] - centre[:, None]) / 2, rays[..., 2:]], dim=-1)
    torch.testing.assert_close(from_site(s, far)[:, 2], 2 * t[:, 2], rtol=0.01, atol=0)  # SMALLEST_SPREAD


def test_an_allocentric_head_turns_with_the_ray():
    model, items = network(rotation="allocentric", translation="site"), batch()
    with torch.no_grad():
        for layer in (model.decoder.mlp_pose[-1], model.decoder.embed_rays):
            layer.weight.zero_()  # the same six numbers for every picture: the identity, seen along the ray
    out = run(model, items)
    ray = torch.nn.functional.normalize(out["rays"].mean(dim=1), dim=-1)
    torch.testing.assert_close(out["R"][:, :, 2], ray)
    torch.testing.assert_close(
        out["R"] @ out["R"].transpose(1, 2), torch.eye(3).expand(3, 3, 3), atol=1e-5, rtol=0
    )


def test_a_backbone_in_bfloat16_trains_and_answers_in_float32():
    model, items = network(), batch()
    exact = model.train()(items["image"], items["K"], items["square"])["keypoints"]
    model.backbone.bfloat16 = True
    rough = run(model, items)["keypoints"]
    assert rough.dtype == torch.float32 and not torch.equal(rough, exact)
    torch.testing.assert_close(rough, exact, atol=0.05, rtol=0)
    rough.sum().backward()
    assert all(p.dtype == p.grad.dtype == torch.float32 for p in model.backbone.parameters())
    answers = run(model.eval(), items)["keypoints"]
    model.backbone.bfloat16 = False
    assert torch.equal(run(model, items)["keypoints"], answers)  # only training is rough


def test_relu_is_alive_at_the_start_and_cuts_below_zero():
    model, items = network(), batch(16)
    assert (run(model, items)["keypoints"] > 0.2).all()
    with torch.no_grad():
        model.encoder.to_keypoints.bias.fill_(-5)
    assert (run(model, items)["keypoints"] == 0).all()


def test_the_pool_leaves_cls_out():
    model, items = network(layers=1), batch()
    features = model.backbone(items["image"])
    before = model.encoder(features)
    with torch.no_grad():
        model.encoder.blocks[0].attention.qkv.weight.zero_()  # no mixing: [cls] cannot reach the image tokens
        model.encoder.blocks[0].attention.qkv.bias.zero_()
        reference = model.encoder(features)["ir"]
        model.encoder.cls.fill_(100.0)
    torch.testing.assert_close(model.encoder(features)["ir"], reference)
    assert before["ir"].shape == reference.shape


def test_cutting_and_resizing_a_crop_never_changes_a_ray():
    model, items = network(encoder="truth"), batch()
    pixels = camera.from_crop(items["keypoints"], items["square"])
    other = items["square"] * torch.tensor([0.9, 1.1, 1.7])
    first = model(None, items["K"], items["square"], items["keypoints"], items["label"])
    second = model(None, items["K"], other, camera.to_crop(pixels, other), items["label"])
    torch.testing.assert_close(first["rays"], second["rays"], atol=1e-6, rtol=0)
    torch.testing.assert_close(first["t"], second["t"], atol=1e-4, rtol=0)
    # without rays the decoder sees the crop's own coordinates: where the crop was is lost
    blind = network(encoder="truth", use_rays=False)
    first = blind(None, items["K"], items["square"], items["keypoints"], items["label"])
    second = blind(None, items["K"], other, items["keypoints"], items["label"])
    assert torch.equal(first["t"], second["t"]) and first["e_ray"] is None


@pytest.mark.parametrize("mode, size", [("raw", 12), ("standardised", 12), ("split", 11)])
def test_ray_features(mode, size):
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
        assert (deviation[2::3] < 1e-3).all()  # z is always 1
        deviation = deviation.view(4, 3)[:, :2]
    torch.testing.assert_close(deviation, torch.ones_like(deviation), atol=1e-3, rtol=0)


def test_split_rays_part_position_distance_and_shape():
    features = RayFeatures("split")
    square = torch.tensor([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
    here = torch.cat([square, torch.ones(4, 1)], dim=1)[None]
    there = torch.cat([square / 2 + torch.tensor([0.2, -0.3]), torch.ones(4, 1)], dim=1)[
        None
    ]  # moved, and twice as far
    a, b = features.unscaled(here)[0], features.unscaled(there)[0]
    torch.testing.assert_close(b[:2] - a[:2], torch.tensor([0.2, -0.3]))
    torch.testing.assert_close(a[2] - b[2], torch.tensor(2.0).log(), atol=1e-3, rtol=0)
    torch.testing.assert_close(a[3:], b[3:], atol=1e-3, rtol=0)
    together = here * 0 + 1
    together.requires_grad_()
    features(together).sum().backward()
    assert torch.isfinite(together.grad).all()


@pytest.mark.parametrize(
    "changes",
    [
        dict(pool="mean"), dict(gate="last"), dict(gate="uniform"), dict(layer_input="same"), dict(norm="post"),
        dict(rays="standardised"), dict(angle_zero="edge"), dict(rays="split", rotation="sixd"),
        dict(rotation="allocentric"), dict(translation="site"), dict(keypoint_head="heatmap"),
        dict(use_rays=False, use_class=False, use_3d=False), dict(use_class=False, use_3d=False),
        dict(use_class=False), dict(backbone="resnet18"), dict(encoder="truth"), dict(backbone_stride=16, dropout=0.1),
    ],
)  # fmt: skip
def test_every_switch_runs_forward_and_backward(changes):
    model, items = network(**changes), batch()
    truth = (
        dict(keypoints=items["keypoints"], label=items["label"]) if changes.get("encoder") == "truth" else {}
    )
    out = run(model, items, **truth)
    total_loss(loss_terms(out, items)).backward()
    assert all(p.grad is not None for p in model.parameters())
    assert (out["keypoints_3d"] is None) == (changes.get("use_3d") is False)
    assert (out["angles"] is None) == ("rotation" in changes)
    if "gate" in changes:
        assert torch.allclose(
            out["gate"][0], torch.tensor([0.0, 1.0] if changes["gate"] == "last" else [0.5, 0.5])
        )
    counts = model.parameter_counts()
    assert counts["total"] == sum(p.numel() for p in model.parameters())


@pytest.mark.parametrize("zero, degrees", [("middle", 0), ("edge", 180)])
def test_where_the_sigmoid_puts_level_flight(zero, degrees):
    model, items = network(angle_zero=zero), batch()
    with torch.no_grad():
        for p in model.decoder.mlp_pose[-1].parameters():
            p.zero_()  # sigmoid(0) = 0.5
    torch.testing.assert_close(run(model, items)["angles"], torch.full((3, 3), degrees / 360))


def test_truth_replaces_what_the_encoder_says():
    model, items = network().eval(), batch()
    plain, wrong = run(model, items), run(model, items, label=(items["label"] + 1) % 7)
    assert torch.equal(plain["keypoints"], wrong["keypoints"])
    assert torch.equal(wrong["class_probs"].argmax(-1), (items["label"] + 1) % 7)
    assert not torch.allclose(plain["t"], wrong["t"])
    true = run(model, items, keypoints=items["keypoints"], label=items["label"])
    terms = loss_terms(true, items)
    assert terms["L_2D"] == 0 and terms["L_cls"] < 1e-6


def test_backbone_shapes_and_size():
    x = torch.zeros(1, 3, 96, 96)
    assert CompactResNet(8)(x).shape == (1, 256, 12, 12)
    assert CompactResNet(16)(x).shape == (1, 256, 6, 6)
    assert sum(p.numel() for p in CompactResNet().parameters()) < 3e6
    assert ModelConfig(backbone="resnet50", image_size=224).tokens == 49


def test_backbone_from_a_half_precision_file(tmp_path):
    source = backbone.Backbone(ModelConfig())
    file = tmp_path / "weights.safetensors"
    save_file(backbone.save_backbone(source), file)
    assert all(v.dtype in (torch.float16, torch.int64) for v in load_file(file).values())
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
    model, items = network(rays="split", rotation="sixd"), batch()
    model.fit_rays([FakeDrones(64).data])
    run(model, items)  # moves the running statistics
    model.save_pretrained(tmp_path / "a")
    again = DroneKeyPP.from_pretrained(tmp_path / "a")
    assert again.config == model.config and not again.training
    first, second = run(model.eval(), items), run(again, items)
    assert all(torch.equal(first[name], second[name]) for name in ("keypoints", "class_probs", "R", "t"))
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["config.json", "model.safetensors"]


def test_a_checkpoint_needs_no_backbone_file(tmp_path):
    file = tmp_path / "weights.safetensors"
    save_file(backbone.save_backbone(backbone.Backbone(ModelConfig())), file)
    DroneKeyPP(ModelConfig(backbone_weights=str(file))).save_pretrained(tmp_path / "a")
    file.unlink()
    DroneKeyPP.from_pretrained(tmp_path / "a")


def test_every_bad_checkpoint_is_one_clear_error(tmp_path):
    network().save_pretrained(tmp_path)
    config, weights = tmp_path / "config.json", tmp_path / "model.safetensors"
    good_config, good_weights = config.read_text(), weights.read_bytes()

    def fails(match):
        with pytest.raises(InputError, match=match) as error:
            DroneKeyPP.from_pretrained(tmp_path)
        assert "\n" not in str(error.value)
        config.write_text(good_config)
        weights.write_bytes(good_weights)

    config.unlink()
    fails("config.json not found")
    weights.unlink()
    fails("model.safetensors not found")
    config.write_text("{")
    fails("config.json: .*not valid JSON")
    config.write_text("[1]")
    fails("config.json: .*mapping")
    config.write_bytes(b"\xff\xfe\x00")
    fails("config.json")
    config.write_text(json.dumps({**json.loads(good_config), "colour": 1}))
    fails("config.json: unknown setting 'colour'; known: backbone")
    weights.write_bytes(good_weights[:-100])
    fails("model.safetensors is not a readable safetensors file")
    config.write_text(json.dumps({**json.loads(good_config), "width": 32}))
    fails("model.safetensors: .* has shape .* needs")
    config.write_text(json.dumps({**json.loads(good_config), "layers": 3}))
    fails("model.safetensors lacks")
    config.write_text(json.dumps({**json.loads(good_config), "layers": 1}))
    fails("model.safetensors has an unknown tensor")
    DroneKeyPP.from_pretrained(tmp_path)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    write_beside(tmp_path / "a", b"old")
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError):
        write_beside(tmp_path / "a", b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_bytes() == b"old"


def test_bad_input_to_the_network():
    model, items = network(), batch()
    with pytest.raises(
        InputError, match=r"image has shape \(3, 3, 24, 24\), the network needs \(3, 3, 32, 32\)"
    ):
        model(items["image"][..., :24, :24], items["K"], items["square"])
    with pytest.raises(InputError, match="square has shape"):
        model(items["image"], items["K"], items["square"][:1])
    with pytest.raises(InputError, match="without an image"):
        model(None, items["K"], items["square"])
    with pytest.raises(InputError, match="true keypoints and label"):
        run(network(encoder="truth"), items)


def test_settings_round_trip_and_read_text():
    config = ModelConfig(rays="split", layers=5, backbone_weights="x.safetensors")
    assert ModelConfig.from_json(config.to_json()) == config
    assert config.replace(
        layers="2", use_3d="false", dropout="1e-1", backbone_weights="none"
    ) == config.replace(layers=2, use_3d=False, dropout=0.1, backbone_weights=None)


@pytest.mark.parametrize(
    "changes, match",
    [
        (dict(colour=1), "unknown setting 'colour'; known: backbone, "), (dict(rays="bent"), "rays='bent' is not one of: raw, "),
        (dict(layers=0), "layers=0 must be at least 1"), (dict(layers=1.5), "layers=1.5 does not fit: expected int"),
        (dict(width=2000000000), "width=2000000000 must be at most 8192"),
        (dict(layers="many"), "layers='many' does not fit"), (dict(use_3d="perhaps"), "use_3d='perhaps' does not fit: expected bool"),
        (dict(dropout=float("nan")), "dropout=nan does not fit"), (dict(dropout=1.0), "dropout=1 must be below 1"),
        (dict(width=30), "multiple of heads"), (dict(image_size=100), "image_size=100 must be a multiple of 16"),
        (dict(backbone_stride=4), "backbone_stride=4"), (dict(layers=None), "layers=None does not fit"),
        (dict(backbone_weights="imagenet"), "needs a torchvision backbone"), (dict(layers=True), "layers=True does not fit"),
    ],
)  # fmt: skip
def test_bad_settings(changes, match):
    with pytest.raises(InputError, match=match):
        ModelConfig.from_dict(changes)


def test_the_fakes_project_onto_their_keypoints():
    data = FakeDrones(20).data
    pixels = camera.project(data["keypoints_3d"] + data["t"][:, None], data["K"])
    torch.testing.assert_close(camera.to_crop(pixels, data["square"]), data["keypoints"], atol=1e-4, rtol=0)
    assert np.isfinite(data["R"].numpy()).all() and torch.allclose(
        turn(2, 90)[:, 0], torch.tensor([0.0, 1.0, 0.0]), atol=1e-6
    )


def test_a_classifier_on_features_leaves_the_backbone_alone():
    model, items = network(classifier="features"), batch()
    out = run(model, items)
    assert out["class_probs"].shape == (3, 7)
    model.losses(out, items, 10.0)["L_cls"].backward()
    assert all(p.grad is None for p in model.backbone.parameters()) and all(
        p.grad is None for p in model.encoder.parameters()
    )
    assert all(p.grad.abs().max() > 0 for p in model.classifier.parameters())
    assert model.idle_parameters and not network().idle_parameters  # the [cls] token's own layer is not asked
    assert model.parameter_counts()["total"] == sum(p.numel() for p in model.parameters())
    features = model.backbone(items["image"])
    torch.testing.assert_close(out["class_logits"], model.classifier(features.mean(dim=(2, 3))))
