"""Damaged and hostile files: every reader answers with one sentence, in bounded time and memory."""

from __future__ import annotations

import os
import struct
import sys
import time
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image

import fringeworks as fw
from fringeworks import FileProblem, InputError
from tests import hostile
from tests.commands import run
from tests.public import public, public_names

try:
    import resource
except ImportError:  # Windows
    resource = None

MUTATIONS = int(os.environ.get("FRINGEWORKS_MUTATIONS", "1000"))
"""In all, over every reader; ``make fuzz`` takes more."""
SECONDS = 5.0
"""Longest time that a small damaged file may take; a usual one takes milliseconds."""
GROWTH_MB = 600
"""Largest growth of the peak memory by all readers together."""


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    return hostile.targets(tmp_path_factory.mktemp("good"))


def place(folder, target, content):
    folder = folder / target.name.replace("/", "-")  # plans beside files matter
    folder.mkdir(exist_ok=True)
    for name, data in {target.name: content, **target.beside}.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_bytes(data)
    return folder / target.name


def peak_mb():
    """Peak memory of this process; 0 where the system does not tell it."""
    if resource is None:
        return 0.0
    unit = 1 << 20 if sys.platform == "darwin" else 1 << 10  # bytes there, kilobytes elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def test_good_files_are_read(targets, tmp_path):
    for target in targets:
        assert target.read(place(tmp_path, target, target.content)) is not None, target.name


def test_mutations_raise_nothing_but_input_errors(targets, tmp_path, capfd):
    before, each = peak_mb(), MUTATIONS / sum(target.share for target in targets)
    refused = longest = 0
    for target in targets:
        count = max(int(each * target.share), 2) + 1
        for content in hostile.mutations(target, count, seed=13):
            path = place(tmp_path, target, content)
            started = time.perf_counter()
            try:
                target.read(path)
            except InputError as error:
                refused += 1
                longest = max(longest, len(str(error)))
            except Exception as error:
                pytest.fail(f"{target.name}: {type(error).__name__}: {error}")
            assert time.perf_counter() - started < SECONDS, target.name
    assert longest < 1500
    assert refused > 0.4 * MUTATIONS
    assert capfd.readouterr() == ("", "")
    assert peak_mb() - before < GROWTH_MB


def refused(read, path, words, seconds=SECONDS, growth_mb=GROWTH_MB):
    """A reader refuses a file soon, in little memory, in one sentence that has these words."""
    before, started = peak_mb(), time.perf_counter()
    with pytest.raises(InputError, match=words) as caught:
        read(path)
    assert time.perf_counter() - started < seconds
    assert peak_mb() - before < growth_mb
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1500
    return caught.value


def png_of(width, height):
    """A PNG of one colour: a few kilobytes for any size."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    pack = zlib.compressobj(1)
    rows = b"".join(pack.compress(bytes(width + 1)) for _ in range(height)) + pack.flush()
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_huge_pictures_need_a_raised_limit(tmp_path, capfd):
    path = tmp_path / "a.png"
    path.write_bytes(png_of(6000, 6000))
    with fw.files.file_limits(max_gb=0.1):
        refused(fw.files.read_frame, path, "6000 × 6000 px.* of at most 0.1 GB, got 0.288 GB")
    assert fw.files.read_frame(path)[0].shape == (6000, 6000)
    whole = bytearray(png_of(64, 64))
    whole[16:24] = struct.pack(">II", 60000, 60000)
    whole[29:33] = struct.pack(">I", zlib.crc32(bytes(whole[12:29])))
    path.write_bytes(whole)
    refused(fw.files.read_frame, path, "raise the limit", growth_mb=50)
    with pytest.raises(InputError, match="max_gb: expected > 0"), fw.files.file_limits(max_gb=0):
        pass
    assert capfd.readouterr() == ("", "")


def looping_tiff():
    """Two directories, the second of which leads back to the first."""
    entry = struct.pack("<HHII", 256, 3, 1, 8)
    one = struct.pack("<H", 1) + entry + struct.pack("<I", 8 + 18)
    return (
        b"II*\0" + struct.pack("<I", 8) + one + struct.pack("<H", 1) + entry + struct.pack("<I", 8)
    )


def test_tiffs_that_loop_or_unpack_to_gigabytes(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(looping_tiff())
    refused(fw.files.read_frame, path, "pages one after the other, got more or a loop")
    tifffile.imwrite(path, np.zeros((64, 64), np.uint8), compression="zlib")
    with tifffile.TiffFile(path) as file:
        tags = file.pages[0].tags
        places = [tags[name].valueoffset for name in ("StripOffsets", "StripByteCounts")]
    bomb = zlib.compress(bytes(1 << 27), 9)
    content = bytearray(path.read_bytes())
    for at, value in zip(places, (len(content), len(bomb)), strict=True):
        content[at : at + 4] = struct.pack("<I", value)
    path.write_bytes(bytes(content) + bomb)
    refused(fw.files.read_frame, path, "no larger than the image", growth_mb=64)


def test_variables_that_unpack_to_gigabytes(tmp_path):
    path = tmp_path / "a.mat"
    # 20 000 × 20 000 zeros of MATLAB's version 5, compressed twice by their evenness.
    head = struct.pack("<6I2i2I", 14, 0, 6, 8, 6, 0, 0, 0, 0, 0)[:24]
    head += struct.pack("<2I2i", 5, 8, 20000, 20000) + struct.pack("<HH4s", 1, 1, b"S\0\0\0")
    size = 20000 * 20000 * 8
    body = head[8:] + struct.pack("<2I", 9, size)
    pack = zlib.compressobj(9)
    data = (
        pack.compress(struct.pack("<2I", 14, len(body) + size) + body + bytes(1 << 20))
        + pack.flush()
    )
    start = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(start + struct.pack("<2I", 15, len(data)) + data)
    refused(fw.files.read_capture, path, "raise the limit of memory", growth_mb=100)


def test_archives_that_declare_more_than_they_hold(tmp_path, targets):
    (good,) = (t for t in targets if t.name == "map.npz")
    path = tmp_path / "a.npz"

    def claimed(data):
        return (
            data.replace(b"(9, 12)", b"(9e9,)") if b"e9" in data else data.replace(b"12)", b"99)")
        )

    path.write_bytes(hostile.repacked(good.content, "values.npy", claimed))
    refused(fw.files.read_surface, path, "expected values of .* bytes, got")
    path.write_bytes(
        hostile.repacked(good.content, "reason.npy", lambda _: hostile._npy(np.zeros((3, 3), "u1")))
    )
    refused(
        fw.files.read_surface,
        path,
        r"expected reason as unsigned integers of shape \(h, w\), got uint8 \(3, 3\)",
    )
    path.write_bytes(
        hostile.repacked(good.content, "sigma.npy", lambda _: hostile._npy(np.zeros((9, 12), "c8")))
    )
    refused(fw.files.read_surface, path, "expected sigma as floats")


def test_numbers_and_names_without_end(tmp_path):
    good = hostile.PLAN.decode()
    for old, new, words in (
        ("[64, 48]", f"[{10**400}, 48]", "400 digits"),
        ("[64, 48]", f"[{10**300}, 48]", "projector.0"),
        ("[64, 48]", "[0, 0]", "projector.0"),
        ("16.0", "9" * 5000, "400 digits"),
        ("16.0", "[" * 5000, "expected TOML"),
        ("16.0", "nan", "finite"),
        ("axis", "x" * 5000, "unknown key|missing key"),
        ("axis", "a." * 400_000 + "b", "keys of at most 32 parts"),
        ("kind", "# " + "a" * (1 << 20) + "\nkind", "at most 1 MB"),
    ):
        (tmp_path / "plan.toml").write_text(good.replace(old, new, 1))
        refused(fw.files.read_plan, tmp_path / "plan.toml", words)
    refused(fw.files.read_plan, tmp_path / ("a" * 5000), "no such file")
    refused(fw.files.read_capture, tmp_path / "a\0b", "nothing there")
    (tmp_path / "p.ply").write_bytes(hostile.PLY.replace(b"vertex 4", b"vertex 1" + b"0" * 30))
    refused(fw.files.read_points, tmp_path / "p.ply", "vertices with x, y, z")


NAMES = (name for name in public_names() if name.startswith("files.read_"))
MORE = {"files.read_study": ("diameter",)}
"""What else these readers need."""
READERS = ["read", *sorted(name for name in NAMES if name != "files.read_pair")]


@pytest.mark.parametrize("name", READERS)
def test_names_that_no_file_can_have_are_refused(name, tmp_path):
    for letters in ("b" * 5000, "b\0"):
        for path in (tmp_path / letters, f"a/{letters}.toml", f"{letters}.zarr", f"{letters}.png"):
            with pytest.raises(fw.InputError):
                next(iter(public(name)(path, *MORE.get(name, ()))))


def test_recipes_with_long_names_are_refused_in_a_sentence(tmp_path):
    path = tmp_path / "recipe.toml"
    for text in ('within = "{}"', '[areas.hole]\nmask = "{}"'):
        path.write_text(f'kind = "recipe"\n{text.format("a" * 5000)}\n')
        with pytest.raises(fw.FileProblem) as error:
            fw.files.read_recipe(path)
        assert len(str(error.value)) < 1500


@pytest.mark.parametrize(("old", "new"), [("100.", ".Inf"), ("100.", "nan"), ("2000.", "-.Inf")])
def test_rigs_without_finite_numbers(tmp_path, targets, old, new):
    (good,) = (t for t in targets if t.name == "other.xml")
    path = tmp_path / "rig.xml"
    path.write_text(good.content.decode().replace(old, new, 1))
    refused(fw.files.read_rig, path, "expected")


def test_captures_stay_in_their_folder(tmp_path):
    secret = tmp_path / "secret.toml"
    secret.write_text('kind = "password 1234"\n')
    folder = tmp_path / "capture"
    folder.mkdir()
    for name in ("../secret.toml", str(secret)):
        (folder / "capture.toml").write_text(f'kind = "stack"\nplan = "{name}"\n')
        error = refused(fw.files.read_capture, folder, "expected files inside this folder")
        assert "1234" not in str(error)
        with fw.files.file_limits(outside=True):
            refused(fw.files.read_capture, folder, "kind")
    Image.fromarray(np.arange(1024, dtype=np.uint8).reshape(32, 32)).save(tmp_path / "a.png")
    (folder / "link.png").symlink_to(tmp_path / "a.png")
    (folder / "capture.toml").write_text('kind = "pair"\n[frames]\nobject = "link.png"\n')
    refused(fw.files.read_capture, folder, "inside this folder")
    with fw.files.file_limits(outside=True):
        assert fw.files.read_capture(folder).object.shape == (32, 32)
    for arguments, code in ((("--outside",), 0), ((), 2)):
        done = run(*arguments, "reconstruct", folder, code=code)
        assert len(done.stderr.splitlines()) == (code == 2)
        assert ("inside this folder" in done.stderr) == (not arguments)


def test_files_of_unreliable_kinds_print_nothing(tmp_path, capfd):
    (tmp_path / "empty.xyz").write_text("# nothing\n")
    refused(fw.files.read_points, tmp_path / "empty.xyz", "expected")
    with pytest.raises(FileProblem, match="PNG, JPEG, BMP, WebP, PGM or PPM"):
        (tmp_path / "a.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n")
        fw.files.read_frame(tmp_path / "a.png")
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="the system lists no open files")
def test_writing_keeps_the_umask_and_reaches_the_disk(tmp_path, monkeypatch):
    synced, renamed = [], []
    monkeypatch.setattr(os, "umask", lambda *_: pytest.fail("the umask belongs to the process"))
    real_sync, real_rename = os.fsync, type(tmp_path).replace

    def fsync(number):
        synced.append(os.readlink(f"/proc/self/fd/{number}"))
        return real_sync(number)

    def replace(self, target):
        renamed.append(len(synced))
        return real_rename(self, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(type(tmp_path), "replace", replace)
    from fringeworks.files.atomic import write_text

    write_text(tmp_path / "a.txt", "a")
    # The file before its name, then the folder that holds the name.
    assert renamed == [1]
    assert synced[1] == str(tmp_path)
    assert (tmp_path / "a.txt").read_text() == "a"


def test_arrays_of_zarr_are_bounded_and_damage_is_told(tmp_path):
    zarr = pytest.importorskip("zarr")
    frames = np.random.default_rng(0).integers(0, 255, (3, 24, 32), dtype=np.uint8)
    zarr.create_array(tmp_path / "a", data=frames, chunks=(1, 24, 32))
    sequence = fw.files.read_sequence(tmp_path / "a")
    assert len(sequence) == 3
    np.testing.assert_array_equal(list(sequence), frames)
    chunk = tmp_path / "a/c/1/0/0"
    chunk.write_bytes(chunk.read_bytes()[:-9])
    refused(
        lambda path: list(fw.files.read_sequence(path)),
        tmp_path / "a",
        "a readable array of frames, got",
    )
    zarr.create_array(tmp_path / "b", shape=(2, 200_000, 200_000), chunks=(1, 64, 64), dtype="u1")
    refused(
        lambda path: list(fw.files.read_sequence(path)),
        tmp_path / "b",
        "one entry .* of at most 2 GB",
    )
    zarr.create_group(tmp_path / "c")
    refused(fw.files.read_sequence, tmp_path / "c", "expected counts .* got no array")


def test_set_ups_name_plans_in_their_folder(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "plan.toml").write_bytes(hostile.PLAN)
    for name in ("../plan.toml", "", "/dev/zero", "a\\u0000b", "no.toml"):
        text = hostile.SETUP.decode().replace('"plan.toml"', f'"{name}"')
        (tmp_path / "a/setup.toml").write_text(text)
        refused(fw.files.read_setup, tmp_path / "a/setup.toml", "expected")
