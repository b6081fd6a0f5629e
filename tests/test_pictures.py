"""Pictures of every kind, and when the frames of a video were taken."""

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from dronekeypp.errors import InputError
from dronekeypp.footage import IMAGES, Footage, open_footage, open_video, read_picture, videos, writable_rate

NOISE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
WRITERS = [suffix for suffix in IMAGES if suffix not in (".pbm", ".pgm", ".pxm", ".pnm")]


@pytest.mark.parametrize("suffix", WRITERS)
def test_every_suffix_of_opencv_is_read(tmp_path, suffix):
    shade = cv2.GaussianBlur(NOISE, (0, 0), 8)  # smooth, so that lossy formats change little
    shade = cv2.normalize(shade, None, 0, 255, cv2.NORM_MINMAX)
    deep = suffix in (".pfm", ".hdr", ".pic")
    path = tmp_path / f"shot{suffix}"
    assert cv2.imwrite(str(path), shade[..., ::-1] / np.float32(255) if deep else shade[..., ::-1])
    limit = 15 if deep else 6  # deep pictures are stretched
    assert np.abs(read_picture(path).astype(int) - shade).mean() < limit
    assert open_footage(tmp_path).names == (path.name,)


@pytest.mark.parametrize("kind", [np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [1, 3])
def test_deep_pictures_are_stretched(tmp_path, kind, channels):
    """Those of a thermal camera use a few thousand of 65536 values; cut to 8 bits they are all one grey."""
    ramp = np.linspace(7000, 9000, 48 * 64).reshape(48, 64)
    image = np.dstack([ramp] * channels).astype(kind)
    cv2.imwrite(str(tmp_path / "shot.tif"), image)
    found = read_picture(tmp_path / "shot.tif")
    wanted = np.clip((ramp - 7002) / 1996 * 255, 0, 255)
    assert found.dtype == np.uint8 and found.shape == (48, 64, 3)
    np.testing.assert_allclose(found, np.dstack([wanted] * 3), atol=1.5)


def test_a_deep_picture_of_one_value_or_of_none(tmp_path):
    for name, image in (("flat", np.full((8, 8), 700.0)), ("none", np.full((8, 8), np.nan))):
        cv2.imwrite(str(tmp_path / f"{name}.tif"), image.astype(np.float32))
        assert not read_picture(tmp_path / f"{name}.tif").any()
    hot = np.full((8, 8), np.inf, np.float32)
    hot[0] = np.arange(8)
    cv2.imwrite(str(tmp_path / "hot.tif"), hot)
    found = read_picture(tmp_path / "hot.tif")
    assert found[0, -1, 0] == 255 and not found[1:].any()


def png_of(width, height):
    """A small file that promises a large picture."""
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(100_000))),
        (b"IEND", b""),
    ]
    chunks = [struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d)) for t, d in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def tiff_of(width, height):
    tags = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (262, 3, 1, 1), (273, 4, 1, 200)]
    tags += [(278, 4, 1, height), (279, 4, 1, 100)]
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(300)


BOMBS = {
    "a.png": png_of(50_000, 50_000),
    "b.png": png_of(20_000, 20_000),  # below OpenCV's own limit
    "c.tif": tiff_of(30_000, 30_000),
    "d.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n" + bytes(100),
    "e.pfm": b"PF\n30000 30000\n-1.0\n" + bytes(100),
    "f.bmp": b"BM" + struct.pack("<IHHIIiiHH", 200, 0, 0, 54, 40, 30_000, 30_000, 1, 24) + bytes(140),
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_not_decoded(tmp_path, name, monkeypatch):
    """The header tells. Nothing asks for memory."""
    (tmp_path / name).write_bytes(BOMBS[name])
    monkeypatch.setattr(cv2, "imdecode", None)
    assert read_picture(tmp_path / name) is None


def test_what_is_no_plain_file_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "a.png")
    (tmp_path / "b.png").symlink_to("/dev/zero")
    (tmp_path / "c.png").mkdir()
    (tmp_path / "d.png").write_bytes(b"")
    (tmp_path / "e.png").write_bytes(b"no picture")
    cv2.imwrite(str(tmp_path / "f.png"), NOISE)
    source = open_footage(tmp_path)
    assert [image is not None for _, image in source.read()] == [False] * 5 + [True]
    assert source.digest()
    for name in ("a.png", "b.png"):
        with pytest.raises(InputError, match="a pipe or a device"):
            open_footage(tmp_path / name)


@pytest.mark.parametrize("suffix", [".webp", ".png", ".tif", ".avif"])
def test_a_file_of_several_pictures_is_refused(tmp_path, suffix):
    """Only the first would be read, and a flight would be one frame long without a word."""
    pages = [Image.fromarray(np.roll(NOISE, i, axis=1)) for i in range(3)]
    pages[0].save(tmp_path / f"flight{suffix}", save_all=True, append_images=pages[1:])
    with pytest.raises(InputError, match="holds 3 pictures, and only the first would be read"):
        open_footage(tmp_path / f"flight{suffix}")
    pages[0].save(tmp_path / f"one{suffix}")
    assert open_footage(tmp_path / f"one{suffix}").names == (f"one{suffix}",)


def test_smaller_versions_in_a_tiff_are_no_pictures_of_their_own(tmp_path):
    small = Image.fromarray(NOISE[::2, ::2])
    small.encoderinfo = {"tiffinfo": {254: 1}}
    Image.fromarray(NOISE).save(tmp_path / "map.tif", save_all=True, append_images=[small])
    assert open_footage(tmp_path / "map.tif").names == ("map.tif",)


def test_pictures_that_are_not_decoded_stay_frames(tmp_path):
    """They cannot be read, and are reported; left out, they would move the frames behind them."""
    for name in ("1.png", "3.png"):
        cv2.imwrite(str(tmp_path / name), NOISE)
    for name in ("2.HEIC", "3.dng", "notes.txt", ".4.heic"):
        (tmp_path / name).write_bytes(b"any")
    source = open_footage(tmp_path)
    assert source.names == ("1.png", "2.HEIC", "3.png")  # 3.dng is the raw picture of 3.png
    assert [image is not None for _, image in source.read()] == [True, False, True]
    for name in ("1.png", "3.png"):
        (tmp_path / name).unlink()
    with pytest.raises(InputError, match="no image in this folder .*; it holds 1 .HEIC, 1 .dng, 1 .txt"):
        open_footage(tmp_path)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp"])
def test_pictures_stand_upright_as_viewers_show_them(tmp_path, orientation, suffix):
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"shot{suffix}"
    lossless = {"lossless": True} if suffix == ".webp" else {}
    Image.fromarray(NOISE).save(path, exif=exif, **lossless)
    with Image.open(path) as image:
        upright = np.asarray(ImageOps.exif_transpose(image))
    np.testing.assert_array_equal(read_picture(path), upright)


def test_pictures_of_many_modes(tmp_path):
    """Printing inks, palettes, transparency, one bit: the colours are those that Pillow shows."""
    shade = cv2.GaussianBlur(NOISE, (0, 0), 4)
    for mode, suffix in (("CMYK", ".jpg"), ("CMYK", ".tif"), ("P", ".png"), ("LA", ".png"), ("1", ".png")):
        image = Image.fromarray(shade).convert(mode)
        image.save(tmp_path / f"{mode}{suffix}")
        with Image.open(tmp_path / f"{mode}{suffix}") as stored:
            wanted = np.asarray(stored.convert("RGB")).astype(int)
        assert np.abs(read_picture(tmp_path / f"{mode}{suffix}") - wanted).max() <= 3, mode
    seen_through = Image.fromarray(NOISE).convert("RGBA")
    seen_through.putalpha(1)
    seen_through.save(tmp_path / "alpha.png")
    np.testing.assert_array_equal(read_picture(tmp_path / "alpha.png"), NOISE)


def write_video(path, rate=25.0, frames=5):
    writer = cv2.VideoWriter(str(path.absolute()), cv2.VideoWriter_fourcc(*"mp4v"), rate, (64, 48))
    for i in range(frames):
        writer.write(np.roll(NOISE, i, axis=1))
    writer.release()


def test_names_with_colons_and_percent_signs(tmp_path, monkeypatch):
    """Relative, as people type them: FFmpeg takes what is before a colon for a protocol."""
    monkeypatch.chdir(tmp_path)
    for name in ("12:30:15.mp4", "file:x.mp4", "at_50%d.mp4"):
        write_video(tmp_path / name)
        source = open_footage(Path(name))
        assert source.rate == 25 and len([image for _, image in source.read() if image is not None]) == 5


class FakeVideo:
    """A container that says these times, and this rate."""

    def __init__(self, rate, milliseconds):
        self.rate, self.left, self.now = rate, list(milliseconds), 0.0

    def grab(self):
        self.now = self.left.pop(0) if self.left else None
        return self.now is not None

    def get(self, what):
        return {cv2.CAP_PROP_FPS: self.rate, cv2.CAP_PROP_POS_MSEC: self.now}.get(what, 0)

    def release(self):
        pass


@pytest.mark.parametrize(
    "rate, milliseconds, wanted, times",
    [
        (25.0, [0, 40, 80, 120], 25.0, None),
        (29.97, [0, 33, 67, 100, 133], 29.97, None),  # rounded, as Matroska does
        (50.0, [0, 140, 280, 300, 440], 1000 / 110, (0, 0.14, 0.28, 0.3, 0.44)),  # as a browser writes
        (1000.0, [0, 100, 200, 300], 10.0, (0, 0.1, 0.2, 0.3)),  # even, but not at that rate
        (float("nan"), [0, 100, 200, 300], 10.0, (0, 0.1, 0.2, 0.3)),
        (25.0, [0, 0, 0, 0], 25.0, None),  # a raw stream
        (25.0, [0, 80, 40, 120], 25.0, None),  # in the order of decoding
        (0.0, [0], None, None),
    ],
)
def test_times_come_from_the_container(tmp_path, monkeypatch, rate, milliseconds, wanted, times):
    path = tmp_path / "video.webm"
    path.write_bytes(b"any")
    monkeypatch.setattr(videos, "open_video", lambda path: FakeVideo(rate, milliseconds))
    source = open_footage(path)
    assert source.rate == (None if wanted is None else pytest.approx(wanted))
    assert source.times == (None if times is None else pytest.approx(times))
    even = np.arange(len(milliseconds)) / (wanted or 30)
    np.testing.assert_allclose(source.frame_times(), even if times is None else times)


def test_images_have_30_frames_a_second_unless_told(tmp_path):
    assert Footage(tmp_path, ("a", "b"), None).frame_times().tolist() == [0, 1 / 30]
    assert Footage(tmp_path, ("a", "b"), 10.0).frame_times().tolist() == [0, 0.1]


@pytest.mark.parametrize(
    "rate, wanted",
    [
        (29.97, 29.97),
        (196.263, 196.26),
        (1234.567, 1234.6),
        (24000 / 1001, 23.976),
        (1e6, 65535),
        (1e-6, 0.01),
    ],
)
def test_rates_that_mpeg_4_can_have(tmp_path, rate, wanted):
    assert writable_rate(rate) == wanted
    write_video(tmp_path / "a.mp4", writable_rate(rate))
    video = open_video(tmp_path / "a.mp4")
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(wanted) and video.get(cv2.CAP_PROP_FRAME_COUNT) == 5
