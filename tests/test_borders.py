"""What people hand to networks, metrics and geometry: the usual slips are refused by the argument's name."""

import numpy as np
import pytest
import torch
from fakes import FakeDrones, tiny, tiny_config
from torch.utils.data import default_collate

from dronekeypp import camera, rotations
from dronekeypp.baselines.dronepose import DronePose, DronePoseConfig
from dronekeypp.checked import check_covariance, check_shapes
from dronekeypp.errors import InputError
from dronekeypp.evaluate import evaluate, frame_errors
from dronekeypp.evaluate.pose_errors import add, adds, mspd, mssd
from dronekeypp.model import DroneKeyPP
from dronekeypp.model.inputs import without_checks
from dronekeypp.presets import TrainConfig
from dronekeypp.train import fit

# --- networks -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return DroneKeyPP(tiny_config()).eval()


@pytest.fixture(scope="module")
def items():
    dataset = FakeDrones(3, 32)
    return default_collate([dataset[i] for i in range(3)])


def ask(network, items, **changes):
    """The answer about a batch of which some inputs are changed: {name: function of the input}."""
    inputs = {name: items[name] for name in ("image", "K", "square")}
    for name, change in changes.items():
        inputs[name] = change(items[name])
    with torch.inference_mode():
        return network(**inputs)


def crop_matrices(items):
    """The camera matrices of the crops, as if they were the frames'."""
    pairs = zip(items["K"], items["square"], strict=True)
    return torch.tensor(
        np.stack([camera.crop_intrinsics(K.numpy(), s.numpy(), 96) for K, s in pairs])
    ).float()


def resized(K, factor):
    return torch.diag(torch.tensor([factor, factor, 1.0])) @ K


SLIPS = {
    "a picture of 0 to 255": (dict(image=lambda x: 255 * x), r"^image lies between .* divide by 255"),
    "a picture of bytes": (
        dict(image=lambda x: (255 * x).to(torch.uint8)),
        r"^image is torch.uint8, .* divide by 255",
    ),
    "a picture with the mean taken off": (
        dict(image=lambda x: (x - 0.45) / 0.22),
        "^image lies between .* the network normalises pictures itself",
    ),
    "a picture with NaN": (dict(image=lambda x: x * torch.nan), "^image lies between nan"),
    "a picture with its channels last": (
        dict(image=lambda x: x.permute(0, 2, 3, 1)),
        r"^image has shape \(3, 32, 32, 3\), needed is \(B, 3, 32, 32\)",
    ),
    "K transposed": (dict(K=lambda K: K.transpose(1, 2)), "^K: the rows must be .* is it transposed"),
    "a negative focal length": (dict(K=lambda K: K * torch.tensor([-1.0, 1, 1])), "^K: focal lengths"),
    "K of float64": (dict(K=lambda K: K.double()), "^K is torch.float64, the network's weights are"),
    "K in shares": (
        dict(K=lambda K: torch.diag(torch.tensor([1 / 1920, 1 / 1080, 1.0])) @ K),
        "^square .* is far from the principal point .* of K",
    ),
    "K of a fifth of the resolution": (
        dict(K=lambda K: resized(K, 0.2)),
        "^square .* at one resolution",
    ),
    "K of one frame": (dict(K=lambda K: K[:1]), r"^square has shape \(3, 3\), .* K has B = 1"),
    "an array": (dict(K=lambda K: K.numpy()), "^K is a ndarray; the network takes tensors"),
    "squares in shares": (
        dict(square=lambda s: s / 1920),
        r"^square has a side of .* \(x, y, side\) in pixels",
    ),
    "squares without a side": (
        dict(square=lambda s: s * torch.tensor([1.0, 1, 0])),
        "^square has a side of 0",
    ),
    "squares of two corners": (
        dict(square=lambda s: torch.cat([s, s[:, 2:]], 1)),
        r"^square has shape \(3, 4\), needed is \(B, 3\)",
    ),
    "a square with NaN": (dict(square=lambda s: s * torch.nan), "^square holds NaN"),
    "keypoints in pixels": (
        dict(keypoints=lambda k: 96 * k),
        "^keypoints lie between .* crop units are needed",
    ),
    "a label that is no class": (dict(label=lambda x: x * 0 + 7), "^label from 7 to 7: .* classes 0 to 6"),
    "a label of floats": (dict(label=lambda x: x.float()), "^label is torch.float32, class indices"),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_network_refuses(slip, network, items):
    changes, message = SLIPS[slip]
    with pytest.raises(InputError, match=message) as caught:
        ask(network, items, **changes)
    assert "\n" not in str(caught.value)


def test_a_network_refuses_the_matrix_of_the_crop(network, items):
    with pytest.raises(InputError, match="K is not that of the crop"):
        ask(network, items, K=lambda K: crop_matrices(items))


def test_every_method_checks(items):
    config = {key: value for key, value in tiny().items() if key in DronePoseConfig.keys()}
    model = DronePose(DronePoseConfig(**config, use_rays=True)).eval()
    with pytest.raises(InputError, match="^image lies between"):
        ask(model, items, image=lambda x: 255 * x)


def test_what_is_sound_is_answered(network, items):
    """Mirrored squares, squares at the frame's edge, and an empty batch."""
    ask(network, items)
    ask(network, items, square=lambda s: camera.mirror_square(s, items["K"]))
    ask(network, items, square=lambda s: torch.tensor([[0.0, 0, 50], [1870, 1030, 50], [420, 0, 1080]]))
    ask(network, items, keypoints=lambda k: k, label=lambda x: x)


def test_a_frame_cut_from_a_larger_one_is_asked_about_as_the_message_says(network, items):
    """The right half of a frame has its principal point at its left edge. Moving both changes no ray."""
    half, square = items["K"] - 955 * torch.tensor([[0.0, 0, 1], [0, 0, 0], [0, 0, 0]]), torch.zeros(3, 3)
    square += torch.tensor([800.0, 500, 90])
    with pytest.raises(InputError, match="give both in pixels of the larger"):
        ask(network, items, K=lambda K: half, square=lambda s: square)
    moved = ask(network, items, square=lambda s: square + torch.tensor([955.0, 0, 0]))
    with without_checks(network):
        answer = ask(network, items, K=lambda K: half, square=lambda s: square)
    torch.testing.assert_close(moved["t"], answer["t"])


def test_in_training_only_shapes_are_looked_at(network, items):
    network.train()
    try:
        network(255 * items["image"], items["K"], items["square"])
        with pytest.raises(InputError, match="^square has shape"):
            network(items["image"], items["K"], items["square"][:1])
    finally:
        network.eval()


def test_whoever_has_checked_may_ask_without(network, items):
    with without_checks(network):
        ask(network, items, image=lambda x: 255 * x)
    with pytest.raises(InputError):
        ask(network, items, image=lambda x: 255 * x)


def test_a_recorded_graph_is_not_checked(network, items):
    """torch.export sees no values; the checks would be part of no graph."""
    inputs = tuple(items[name] for name in ("image", "K", "square"))
    program = torch.export.export(network, inputs)
    with torch.inference_mode():
        torch.testing.assert_close(program.module()(*inputs)["R"], network(*inputs)["R"])


class Bytes(FakeDrones):
    """The same frames with pictures of 0 to 255."""

    def __getitem__(self, i):
        item = super().__getitem__(i)
        return {**item, "image": 255 * item["image"]}


class OtherClasses(FakeDrones):
    """The same frames, with labels from 5 on."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.data["label"] = self.data["label"] + 5


def test_data_sets_of_ones_own_are_looked_at():
    model, config = DroneKeyPP(tiny_config()), TrainConfig(epochs=1, batch=8, device="cpu")
    with pytest.raises(InputError, match="^image lies between"):
        fit(model, Bytes(8), FakeDrones(8), config)
    with pytest.raises(InputError, match="^image lies between"):
        evaluate(model, Bytes(8))
    with pytest.raises(InputError, match=r"^label from \d to 11: the network has the classes 0 to 6"):
        fit(model, OtherClasses(8), FakeDrones(8), config)
    with pytest.raises(InputError, match=r"^labels from \d to 11, and the network tells 7 classes apart"):
        evaluate(model, OtherClasses(8))


# --- metrics ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def truth():
    dataset = FakeDrones(3)
    return {name: value for name, value in dataset.annotations().items()}


def test_one_frame_is_not_compared_with_three(truth):
    for name in ("R", "t", "keypoints"):
        with pytest.raises(InputError, match=f"^the predicted {name} has shape .* B = 3"):
            frame_errors({name: truth[name][:1]}, truth)


@pytest.mark.parametrize("change", [5, -1, torch.diag(torch.tensor([1.0, 1.0, -1.0]))])
def test_what_is_no_rotation_has_no_error(truth, change):
    """5 R, −R and a reflection: the formula of the angle gives 0° or 180° for the first two."""
    no_rotation = truth["R"] * change if isinstance(change, int) else truth["R"] @ change
    with pytest.raises(InputError, match="^the predicted R: (not orthonormal|determinant −1)"):
        frame_errors({"R": no_rotation}, truth)
    with pytest.raises(InputError, match="^R1: (not orthonormal|determinant −1)"):
        rotations.geodesic_degrees(no_rotation, truth["R"])
    poses = [no_rotation.numpy(), truth["t"].numpy(), truth["R"].numpy(), truth["t"].numpy()]
    for error in (add, adds):
        with pytest.raises(InputError, match="^R_est: (not orthonormal|determinant −1)"):
            error(*poses, np.eye(3))


def test_a_frame_without_a_pose_stays_nan(truth):
    R = truth["R"].clone()
    R[1] = torch.nan
    assert frame_errors({"R": R}, truth)["R_deg"].tolist()[::2] == [0.0, 0.0]
    assert rotations.geodesic_degrees(R, truth["R"]).isnan().tolist() == [False, True, False]


def test_shapes_of_the_fields_errors(truth):
    R, t, K = (truth[name].double().numpy() for name in ("R", "t", "K"))
    identity = np.eye(4)[None]
    with pytest.raises(InputError, match="^t_est has shape .* R_est has B = 1"):
        add(R[:1], t, R, t, np.eye(3))
    with pytest.raises(InputError, match=r"^points has shape \(3,\), needed is \(M, 3\)"):
        adds(R, t, R, t, np.zeros(3))
    with pytest.raises(InputError, match=r"^symmetries has shape"):
        mssd(R, t, R, t, np.eye(3), np.eye(4))
    with pytest.raises(InputError, match="^symmetries: not orthonormal"):
        mssd(R, t, R, t, np.eye(3), 2 * identity)
    with pytest.raises(InputError, match="^K: .* is it transposed"):
        mspd(R, t, R, t, K.swapaxes(1, 2), np.eye(3), identity)
    assert mspd(R, t, R, t, K, np.eye(3), identity).max() == 0


def test_the_angle_is_of_as_many_rotations(truth):
    R = truth["R"]
    with pytest.raises(InputError, match="not as many rotations"):
        rotations.geodesic_degrees(R[:2], R)
    assert rotations.geodesic_degrees(R[0], R).shape == (3,)  # one against many
    with pytest.raises(InputError, match=r"^R2 has shape \(3, 3, 2\), needed is \(…, 3, 3\)"):
        rotations.geodesic_degrees(R, R[..., :2])


# --- geometry ---------------------------------------------------------------------------------------------

K = camera.intrinsics(1500, 1920, 1080)
PIXELS = np.array([[900.0, 500.0], [910.0, 505.0]])
POINTS = np.array([[0.1, 0.2, 3.0], [0.0, 0.1, 4.0]])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: camera.rays(POINTS, K), r"^pixels has shape \(2, 3\), needed is \(…, 2\)"),
        (lambda: camera.rays(torch.tensor(POINTS), torch.tensor(K)), r"^pixels has shape"),
        (lambda: camera.rays(PIXELS, K.T), "^K: .* is it transposed"),
        (lambda: camera.rays(PIXELS, K * [-1, 1, 1]), "^K: focal lengths"),
        (lambda: camera.rays(PIXELS.tolist(), K), "^pixels is a list"),
        (lambda: camera.rays(pixels=POINTS, K=K), "^pixels has shape"),
        (lambda: camera.project(PIXELS, K), r"^points has shape \(2, 2\), needed is \(…, 3\)"),
        (lambda: camera.project(POINTS, K[:2]), r"^K has shape \(2, 3\)"),
        (lambda: camera.to_crop(PIXELS, np.array([0.0, 0, -5])), "^square: .* side must be positive"),
        (lambda: camera.from_crop(PIXELS, np.array([0.0, 0])), "^square has shape"),
        (lambda: camera.crop_intrinsics(K, (0, 0, -90), 96), "^crop square .* side must be positive"),
        (lambda: camera.crop_intrinsics(K.T, (0, 0, 90), 96), "^K: .* is it transposed"),
        (lambda: camera.crop_intrinsics(K, (0, 0, 90), 0), "^size=0"),
        (lambda: camera.clamp_square((0, 0, -90), 1920, 1080), "^crop square .* side must be positive"),
        (lambda: camera.clamp_square((0, 0, 90), -1920, 1080), "^a frame of -1920"),
        (lambda: camera.square_around((0, 0, 90, 90), -1.2), "^margin=-1.2"),
        (lambda: camera.square_around((0, 0, 90)), r"^box has shape \(3,\), 4 numbers"),
        (lambda: camera.crop_image(np.zeros((9, 9, 3), np.uint8), (0, 0, -3), 8), "^crop square"),
        (lambda: camera.crop_image(np.zeros((0, 9, 3), np.uint8), (0, 0, 3), 8), "^image: a picture"),
        (lambda: camera.intrinsics(-1500, 1920, 1080), "^focal=-1500"),
        (lambda: camera.check_intrinsics(K * 1j), "holds complex128 values"),
        (lambda: camera.check_intrinsics([["fx", 0, 0]] * 3), "numbers are needed"),
        (lambda: rotations.check_rotation(np.eye(3) > 0), "holds bool values"),
    ],
)
def test_geometry_refuses(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_letters_stand_for_one_size_in_all_arguments():
    check_shapes(R=(np.zeros((5, 3, 3)), ("B", 3, 3)), t=(None, ("B", 3)))
    with pytest.raises(InputError, match=r"^t has shape \(4, 3\), needed is \(B, 3\), and R has B = 5"):
        check_shapes(R=(np.zeros((5, 3, 3)), ("B", 3, 3)), t=(np.zeros((4, 3)), ("B", 3)))


def test_covariances_of_any_unit_pass():
    """Radians² and metres² may differ by many orders; rounding of float32 is no fault."""
    rng = np.random.default_rng(0)
    mixed = rng.normal(size=(100, 6, 6)) * np.array([1e-4, 1e-4, 1e-4, 10, 10, 10])[:, None]
    covariance = mixed @ mixed.swapaxes(1, 2)
    check_covariance("covariance", covariance.astype(np.float32).astype(np.float64))
    check_covariance("covariance", np.zeros((6, 6)))
