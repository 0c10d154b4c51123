"""The order of a folder's images, and the names of those that are missing."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.files.frame_order import by_name, in_plan_order
from fringeworks.files.images import write_frame
from fringeworks.files.plan import frame_names
from tests.stacks import guarded, multi, take

PLAN = multi((1, 8), 4, (300, 40))
GRAY = guarded(steps=3, size=(320, 24), inverse=True)


def shoot(folder, names, plan=PLAN):
    """Frames of a plan under these names."""
    fw.files.write_plan(folder / "plan.toml", plan)
    for name, frame in zip(names, take(plan), strict=True):
        write_frame(folder / name, frame)
    return folder


def refusal(folder):
    with pytest.raises(fw.FramesContradictPlan) as caught:
        fw.files.read_stack(folder)
    return str(caught.value)


@pytest.mark.parametrize("plan", [PLAN, GRAY], ids=["phases", "gray"])
def test_the_missing_frame_is_named_by_its_label(tmp_path, plan):
    names = frame_names(plan, ".png")
    for k, label in enumerate(plan.labels()):
        folder = tmp_path / str(k)
        folder.mkdir()
        (shoot(folder, names, plan) / names[k]).unlink()
        assert refusal(folder).endswith(f"got {plan.frames - 1} images; missing: {label}")


def test_several_missing_frames_are_named(tmp_path):
    names = frame_names(PLAN, ".png")
    shoot(tmp_path, names)
    for k in (0, 5, 7):
        (tmp_path / names[k]).unlink()
    assert refusal(tmp_path).endswith(
        "missing: x-phase-300px-0, x-phase-37.5px-1, x-phase-37.5px-3"
    )


@pytest.mark.parametrize(
    ("numbers", "gone", "told"),
    [
        (range(8), 5, "; missing: x-phase-37.5px-1 (shot005.png)"),
        (range(98, 106), 3, "; missing: x-phase-300px-3 (shot101.png)"),
        (range(0, 80, 10), 3, "; missing: x-phase-300px-3 (shot030.png)"),
        (range(8), 7, "; missing: x-phase-37.5px-3"),
        (
            range(1, 9),
            7,
            "; missing: 1 frame at the beginning or the end, as the numbers in the names have no gap",
        ),
    ],
)
def test_the_missing_frame_is_named_by_its_number(tmp_path, numbers, gone, told):
    names = [f"shot{n:03d}.png" for n in numbers]
    (shoot(tmp_path, names) / names[gone]).unlink()
    assert refusal(tmp_path).endswith(f"got 7 images{told}")


def test_missing_frames_within_and_at_an_end(tmp_path):
    names = [f"{k}_left.png" for k in range(3, 11)]
    shoot(tmp_path, names)
    (tmp_path / names[2]).unlink()
    (tmp_path / names[-1]).unlink()
    assert refusal(tmp_path).endswith(
        "; missing: 5_left.png, and 1 frame at the beginning or the end"
    )


def test_names_that_tell_nothing_are_not_interpreted(tmp_path):
    names = ["a.png", "bust.png", "c7.png", "d.png", "e.png", "f.png", "g.png", "h.png"]
    (shoot(tmp_path, names) / "c7.png").unlink()
    assert refusal(tmp_path).endswith("the plan has 8 frames, got 7 images")
    (tmp_path / "c7.png").write_bytes((tmp_path / "a.png").read_bytes())
    (tmp_path / "i.png").write_bytes((tmp_path / "a.png").read_bytes())
    assert refusal(tmp_path).endswith(
        "the plan has 8 frames, got 9 images; c7.png is a copy of a.png, i.png is a copy of a.png, "
        "i.png is a copy of c7.png"
    )


def test_labels_outrank_the_order_of_names(tmp_path):
    """Files that were renamed, or that another program numbered in its own order."""
    labels = GRAY.labels()
    names = [f"{len(labels) - k:02d}-{label}-left.png" for k, label in enumerate(labels)]
    stack = fw.files.read_stack(shoot(tmp_path, names, GRAY))
    np.testing.assert_array_equal(np.stack(stack.frames), take(GRAY))
    assert stack.notes == ("frames put into the order of the plan by the labels in their names",)
    assert [source.name.split("/")[-1] for source in stack.sources[:3]] == names[:3]


def test_a_word_that_is_also_a_label_is_no_label(tmp_path):
    """A white figure: "white" in all names tells nothing about the frames."""
    plan = guarded(steps=3, size=(320, 24))
    names = [f"white-figure-{k}.png" for k in range(plan.frames)]
    stack = fw.files.read_stack(shoot(tmp_path, names, plan))
    np.testing.assert_array_equal(np.stack(stack.frames), take(plan))
    (tmp_path / names[1]).unlink()
    assert "missing: x-phase-32px-1 (white-figure-1.png)" in refusal(tmp_path)


def test_a_list_that_contradicts_its_labels_is_refused(tmp_path):
    names = frame_names(PLAN, ".png")
    shoot(tmp_path, names)
    names[2], names[6] = names[6], names[2]
    (tmp_path / "capture.toml").write_text(f'kind = "stack"\nframes = {json.dumps(names)}\n')
    assert refusal(tmp_path).endswith(
        "expected x-phase-300px-2 as frame 2 of the list, got 6-x-phase-37.5px-2.png, whose name "
        "carries the label x-phase-37.5px-2"
    )
    del names[3]
    (tmp_path / "capture.toml").write_text(f'kind = "stack"\nframes = {json.dumps(names)}\n')
    assert refusal(tmp_path).endswith("missing: x-phase-300px-3")


def test_written_stacks_and_pictures_keep_their_order(tmp_path):
    plan = multi((1, 8), 12, (300, 40))
    folder = fw.files.write_stack(tmp_path / "stack", take(plan), plan)
    np.testing.assert_array_equal(np.stack(fw.files.read_stack(folder).frames), take(plan))
    (folder / "capture.toml").unlink()
    stack = fw.files.read_stack(folder)
    np.testing.assert_array_equal(np.stack(stack.frames), take(plan))
    assert stack.notes == ()


def dated(folder, names, minutes, *, fractions=True):
    """JPEGs of four steps that were taken at these minutes, in the order of the plan."""
    plan = fw.PatternPlan(64, 48, (fw.patterns.PhaseSteps("x", 16.0, fw.patterns.equal_steps(4)),))
    for k, (name, minute) in enumerate(zip(names, minutes, strict=True)):
        exif = Image.Exif()
        exif.get_ifd(0x8769)[0x9003] = f"2026:05:04 10:{minute:02d}:07"
        if fractions:
            exif.get_ifd(0x8769)[0x9291] = f"{k}50"
        Image.fromarray(np.full((4, 5), 40, np.uint8)).save(folder / name, exif=exif)
    paths, notes = in_plan_order(by_name(list(folder.glob("*"))), plan, folder, listed=False)
    return [path.name for path in paths], " ".join(notes)


@pytest.mark.parametrize("minutes", [(1, 2, 3, 4), (9, 9, 9, 9)])
@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("IMG_8712.jpg", "IMG_8713.jpg", "IMG_0004.jpg", "IMG_0005.jpg"), "wrap, by the times"),
        (("z17.jpg", "z18.jpg", "z2.jpg", "z3.jpg"), "wrap, by the times"),
        (("plum.jpg", "fig.jpg", "pear.jpg", "lime.jpg"), "order of their times in EXIF"),
        (("img1a2.jpg", "img0b9.jpg", "img7c1.jpg", "img3d3.jpg"), "order of their times in EXIF"),
    ],
)
def test_time_stamps_tell_the_order_that_names_do_not(tmp_path, names, said, minutes):
    found, note = dated(tmp_path, names, minutes)
    assert found == list(names)
    assert said in note


NAMES = tuple(f"P{k}.jpg" for k in range(4))


@pytest.mark.parametrize("minutes", [(1, 3, 2, 4), (4, 3, 2, 1)])
def test_numbers_that_times_contradict_are_told(tmp_path, minutes):
    found, note = dated(tmp_path, NAMES, minutes)
    assert found == list(NAMES)
    assert "times in EXIF contradict the numbers" in note


@pytest.mark.parametrize("minutes", [(1, 1, 1, 1), (1, 1, 2, 3), (1, 2, 3, 4)])
def test_equal_times_and_those_in_order_say_nothing(tmp_path, minutes):
    assert dated(tmp_path, NAMES, minutes, fractions=False) == (list(NAMES), "")
