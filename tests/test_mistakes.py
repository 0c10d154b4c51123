"""Mistakes that people make with files and arrays, and what they are told."""

from __future__ import annotations

import codecs
import inspect
import shutil

import numpy as np
import pytest
import tifffile
from PIL import Image

import fringeworks as fw
from fringeworks.cli.output import TARGETS
from fringeworks.files.tiff import read_tiff
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.signal.response import phase_of_steps
from tests.commands import COMMANDS, run

PLAN = PatternPlan(320, 200, tuple(PhaseSteps("x", p, equal_steps(4)) for p in (20.0, 320.0)))


def shown(plan):
    return [np.rint(20.0 + 0.7 * frame).astype(np.uint8) for frame in fw.encode(plan)]


@pytest.fixture
def shots(tmp_path):
    """Frames with plain names, 1.png to 8.png, and their plan."""
    folder = tmp_path / "shots"
    folder.mkdir()
    for k, frame in enumerate(shown(PLAN), start=1):
        Image.fromarray(frame).save(folder / f"{k}.png")
    fw.files.write_plan(folder / "plan.toml", PLAN)
    return folder


def test_a_result_does_not_replace_what_is_read(shots, tmp_path):
    photograph = (shots / "3.png").read_bytes()
    plan = shots / "plan.toml"
    for arguments, said in (
        (
            ("decode", shots, "--json", shots / "3.png"),
            "expected .json, got .png; --json writes no other kind",
        ),
        (("decode", shots, "--figure", shots / "3.png"), "--figure would replace what"),
        (
            ("--log", plan, "decode", shots),
            "expected one of .log, .txt, got .toml; --log writes no other kind",
        ),
        (("decode", shots, "--plan", plan, "--out", plan), "--out would replace what"),
    ):
        assert said in run(*arguments, code=2).stderr
    assert (shots / "3.png").read_bytes() == photograph
    assert fw.files.read_plan(plan) == PLAN
    run("decode", shots, "--json", shots / "new.json", "--figure", tmp_path / "new.png")


def parameters():
    """Every output of every command with every input, by the names of their parameters."""
    for name, command in COMMANDS.items():
        hints = inspect.signature(command.callback).parameters
        kinds = {key: str(one.annotation) for key, one in hints.items()}
        inputs = [key for key, kind in kinds.items() if "Path" in kind and key not in TARGETS]
        for target in sorted(TARGETS.keys() & kinds.keys()):
            for source in inputs:
                yield pytest.param(name, target, source, id=f"{name}-{target}-{source}")


@pytest.mark.parametrize(("name", "target", "source"), list(parameters()))
def test_no_output_of_a_command_replaces_an_input(tmp_path, name, target, source):
    """Refused before anything is read or computed: the file is none of any kind."""
    callback = COMMANDS[name].callback
    suffix = next(iter(TARGETS[target]), ".ply")
    path = tmp_path / f"mine{suffix}"
    path.write_text("mine")
    kind = str(inspect.signature(callback).parameters[source].annotation)
    empty = inspect.Parameter.empty
    given = {
        key: None if one.default is empty else one.default
        for key, one in inspect.signature(callback).parameters.items()
    }
    several = "list[" in kind
    with pytest.raises(fw.FileProblem, match=f"--{target.removesuffix('_file')} would replace"):
        callback(**given | {source: [path] if several else path, target: path})
    assert path.read_text() == "mine"


@pytest.mark.parametrize("target", ["json_file", "csv", "markdown"])
def test_no_output_of_a_command_has_a_suffix_of_another_kind(tmp_path, target):
    path = tmp_path / "photo.png"
    path.write_text("mine")
    asked = [c for c in COMMANDS.values() if target in inspect.signature(c.callback).parameters]
    assert asked
    for command in asked:
        if hints := inspect.signature(command.callback).parameters:
            given = dict.fromkeys(hints) | {target: path}
            with pytest.raises(fw.FileProblem, match="writes no other kind"):
                command.callback(**given)
    assert path.read_text() == "mine"


def test_inputs_in_the_words_of_an_option_count(tmp_path):
    (tmp_path / "4mm.png").write_text("mine")
    words = (
        "--reference",
        "0.png",
        "--plane",
        f"4={tmp_path / '4mm.png'}",
        "--pitch-mm-per-px",
        "1",
    )
    done = run("calibrate-plane", *words, "--out", tmp_path / "4mm.png", code=2)
    assert "--out would replace" in done.stderr
    assert (tmp_path / "4mm.png").read_text() == "mine"


def test_no_call_of_the_api_writes_to_what_it_reads(shots, tmp_path):
    (tmp_path / "recipe.toml").write_text("mine")
    (tmp_path / "rig.html").write_text("mine")
    for call in (
        lambda: fw.batch.run_batch(shots, tmp_path / "recipe.toml", shots),
        lambda: fw.batch.run_batch(shots, tmp_path / "recipe.toml", tmp_path / "recipe.toml"),
        lambda: fw.batch.run_sequence(shots, tmp_path / "recipe.toml", f"{shots}/../shots"),
        lambda: fw.write_report(tmp_path / "rig.html", tmp_path / "rig.html"),
        lambda: fw.write_report(tmp_path / "rig.html", {"a": tmp_path / "rig.html"}),
        lambda: fw.write_report(tmp_path / "rig.html", [], rig=tmp_path / "rig.html"),
    ):
        with pytest.raises(fw.FileProblem, match="would replace what the same call reads"):
            call()
    assert (tmp_path / "recipe.toml").read_text() == (tmp_path / "rig.html").read_text() == "mine"


WRITERS = [n for n in dir(fw.files) if n.startswith("write_")]


@pytest.mark.parametrize("name", WRITERS)
def test_no_writer_takes_a_file_of_another_kind(tmp_path, name):
    """A photograph, a letter, a program: refused before the thing is looked at, and left alone."""
    mine = tmp_path / "letter.docx"
    mine.write_bytes(b"mine")
    more = (PLAN,) if name == "write_stack" else ()
    with pytest.raises(fw.InputError):
        getattr(fw.files, name)(mine, _anything(name), *more)
    assert mine.read_bytes() == b"mine"
    assert [path.name for path in tmp_path.iterdir()] == ["letter.docx"]


def _anything(name):
    """A thing of the writer's kind, where it needs one before it looks at the path."""
    return {
        "write_plan": PLAN,
        "write_flash_images": PLAN,
        "write_patterns": PLAN,
        "write_stack": [],
        "write_frame": np.zeros((4, 5), np.uint8),
        "write_pair": fw.Pair(reference=np.ones((9, 9)), object=np.ones((9, 9))),
    }.get(name)


@pytest.mark.parametrize("extra", ["preview.jpg", "note.tif", "IMG_0001.png"])
def test_images_that_are_too_many_are_named(shots, extra):
    Image.fromarray(np.zeros((200, 320), np.uint8)).save(shots / extra)
    with pytest.raises(fw.FramesContradictPlan, match=f"not named like the others: {extra}"):
        fw.read(shots)


@pytest.mark.parametrize("first", [9995, 9999, 9993])
def test_numbers_that_wrap_are_in_the_order_of_the_shots(shots, first):
    for k in range(1, 9):
        number = (first + k - 2) % 9999 + 1
        (shots / f"{k}.png").rename(shots / f"DSC_{number:04d}.png")
    found = fw.read(shots)
    assert all(np.array_equal(a, b) for a, b in zip(found.frames, shown(PLAN), strict=True))
    assert any("numbers in the names wrap" in note for note in found.notes)


def test_a_folder_of_captures_lists_them(shots, tmp_path):
    for name in ("p0", "p1"):
        shutil.copytree(shots, tmp_path / "poses" / name)
    for read in (fw.read, fw.files.read_stack):
        with pytest.raises(fw.FileProblem, match="holds captures: p0, p1; give one of them"):
            read(tmp_path / "poses")


@pytest.mark.parametrize("suffix", [".XCF", ".gif", ".tga"])
def test_files_that_are_not_read_are_counted(shots, suffix):
    for path in shots.glob("*.png"):
        path.rename(path.with_suffix(suffix))
    with pytest.raises(fw.FileProblem, match=f"got 8 {suffix.lower()} files, which are not read"):
        fw.read(shots)


@pytest.mark.parametrize("mark", [codecs.BOM_UTF8 + b"%", codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE])
def test_byte_order_marks_are_read(shots, tmp_path, mark):
    coding = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}.get(mark, "utf-8")
    text = (shots / "plan.toml").read_text("utf-8")
    (shots / "plan.toml").write_bytes(mark.removesuffix(b"%") + text.encode(coding))
    assert fw.files.read_plan(shots / "plan.toml") == PLAN
    (tmp_path / "p.xyz").write_bytes(mark.removesuffix(b"%") + "1 2 3\n4 5 6\n".encode(coding))
    assert fw.read(tmp_path / "p.xyz").xyz_mm.shape == (2, 3)


@pytest.mark.parametrize("compression", ["tiff_lzw", "packbits", "tiff_deflate"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, bool])
def test_compressed_tiffs_are_read(tmp_path, compression, kind):
    rng = np.random.default_rng(0)
    page = rng.integers(0, 2 if kind is bool else np.iinfo(kind).max, (3, 40, 50)).astype(kind)
    pages = [Image.fromarray(one) for one in page]
    pages[0].save(tmp_path / "one.tif", compression=compression)
    pages[0].save(
        tmp_path / "all.tif", compression=compression, save_all=True, append_images=pages[1:]
    )
    assert np.array_equal(read_tiff(tmp_path / "one.tif")[0], page[0])
    assert np.array_equal(read_tiff(tmp_path / "all.tif")[0], page)


def test_white_may_be_zero(tmp_path):
    page = np.arange(200, dtype=np.uint8).reshape(10, 20)
    tifffile.imwrite(tmp_path / "one.tif", ~page, photometric="miniswhite")
    assert np.array_equal(read_tiff(tmp_path / "one.tif")[0], page)


def test_masks_of_numpy_count_or_are_refused():
    ramp = np.add.outer(np.linspace(0, 20, 64), np.linspace(0, 30, 64))
    phase = np.ma.array(np.angle(np.exp(1j * ramp)))
    phase[20:40, 20:40] = np.ma.masked
    found = fw.unwrap(phase).phase
    assert np.isnan(found[20:40, 20:40]).all()
    assert np.isfinite(found).sum() == found.size - 400
    frames = [np.ma.array(frame) for frame in shown(PLAN)]
    frames[2][5, 5] = np.ma.masked
    pair = [np.ma.array(np.ones((50, 60)), mask=np.eye(50, 60, dtype=bool))] * 2
    for call in (
        lambda: fw.decode(frames, PLAN),
        lambda: fw.reconstruct(fw.Pair(*pair)),
        lambda: fw.signal.denoise.denoise(pair[0]),
        lambda: fw.stack.wrapped_phase(frames[:4], equal_steps(4)),
        lambda: phase_of_steps(frames[:4], equal_steps(4)),
    ):
        with pytest.raises(fw.InputError, match="expected an array without a mask of NumPy"):
            call()


@pytest.mark.parametrize("size", [(300, 480), (400, 300)])
def test_a_projector_that_is_too_small_in_the_plan_is_named(size):
    true = PatternPlan(480, 300, (GrayCode("x", 1.0, 480, inverse=True),))
    noise = np.random.default_rng(0).integers(0, 3, (true.frames, 300, 480))
    frames = [f + n.astype(np.uint8) for f, n in zip(shown(true), noise, strict=True)]
    wrong = PatternPlan(*size, (GrayCode("x", 1.0, size[0], inverse=True),))
    found = fw.decode(frames, wrong)
    (named,) = (f for f in found.findings if f.kind == "beyond the projector")
    assert ("exchanged" in named.causes[0]) == (size == (300, 480))
    assert abs(named.figures["farthest_px"] - 480) < 8
    beyond = 1.0 - size[0] / 480
    assert abs(named.figures["share"] - beyond) < 0.02
    assert " % of the codes along x lie beyond" in named.seen
    assert not any("order ambiguous" in f.seen for f in found.findings)
    right = fw.decode(frames, true)
    assert not any(f.kind == "beyond the projector" for f in right.findings)


def gray(step, *, axis="x", **words):
    return GrayCode(axis, step, 480 if axis == "x" else 300, inverse=True, **words)


def noisy(plan, seed=0):
    """What a camera of 300 rows sees of a plan for 480 × 300 px."""
    noise = np.random.default_rng(seed).integers(0, 3, (plan.frames, 300, 480))
    return [f + n.astype(np.uint8) for f, n in zip(shown(plan), noise, strict=True)]


@pytest.mark.parametrize("fringes", [(), (PhaseSteps("x", 24.0, equal_steps(4)),)])
def test_inverted_codes_are_not_said_to_lie_beyond_the_projector(fringes):
    step = 12.0 if fringes else 1.0
    true = PatternPlan(480, 300, (*fringes, gray(step, inverted=True)))
    with pytest.raises(fw.FramesContradictPlan) as refused:
        fw.decode(noisy(true), PatternPlan(480, 300, (*fringes, gray(step))))
    assert str(refused.value).count("inverted, light for dark") == 1
    assert str(refused.value).count("inverted = true") == 1
    assert not any(f.kind == "beyond the projector" for f in refused.value.findings)


@pytest.mark.parametrize("bit", [0, 2])
def test_one_inverted_bit_is_named(bit):
    light = (Uniform("white"), Uniform("black"))
    code, shows = (GrayCode("y", 1.0, 300, inverted=which) for which in ((), (bit,)))
    true = PatternPlan(480, 300, (shows, *light))
    said = rf"the bit y-gray-{bit} is inverted, light for dark.*says so by inverted = \[{bit}\]$"
    with pytest.raises(fw.FramesContradictPlan, match=said):
        fw.decode(noisy(true), PatternPlan(480, 300, (code, *light)))


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("says", [False, True])
def test_the_first_bit_of_one_code_of_two(axis, says):
    """The message says what to write, also where the plan says that bits are the other way."""
    codes = {a: gray(1.0, axis=a, least_first=says and a == axis) for a in "xy"}
    shows = {a: gray(1.0, axis=a, least_first=(not says) and a == axis) for a in "xy"}
    plan, true = (PatternPlan(480, 300, tuple(c.values())) for c in (codes, shows))
    with pytest.raises(fw.FramesContradictPlan) as refused:
        fw.decode(noisy(true), plan)
    word, which = ("false", "most") if says else ("true", "least")
    assert f"the Gray code along {axis} begins with its {which} significant" in str(refused.value)
    assert f"write least_first = {word} in the Gray code along {axis} of" in str(refused.value)


@pytest.mark.parametrize(
    ("planned", "shows"), [(24.0, 16.0), (24.0, 20.0), (12.0, 8.0), (12.0, 13.0)]
)
def test_cells_that_the_plan_does_not_say_are_named(planned, shows):
    """As many bits, but other cells: the fringes at the borders tell their width."""
    fringes = PhaseSteps("x", 24.0, equal_steps(4))
    true = PatternPlan(480, 300, (fringes, gray(shows)))
    wrong = PatternPlan(480, 300, (fringes, gray(planned)))
    assert true.frames == wrong.frames
    with pytest.raises(fw.FramesContradictPlan) as refused:
        fw.decode(noisy(true), wrong)
    said = f"the frames fit this plan if step_px = {shows:g} in the Gray code along x"
    assert said in str(refused.value)
    assert fw.decode(noisy(true), true).x.coordinate_px[150, 240] == pytest.approx(240.0, abs=0.5)


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_cells_that_fit_the_number_of_frames_are_named(shots, step):
    wrong = PatternPlan(480, 300, (PLAN.blocks[0], gray(10.0)))
    true = PatternPlan(480, 300, (PLAN.blocks[0], gray(10.0 * step)))
    said = f"the number fits this plan if the Gray code along x has step_px = {10.0 * step:g}"
    with pytest.raises(fw.FramesContradictPlan, match=said):
        fw.decode(shown(true), wrong)
    for old in shots.iterdir():
        old.unlink()
    for k, frame in enumerate(shown(true), start=1):
        Image.fromarray(frame[:40]).save(shots / f"{k}.png")
    fw.files.write_plan(shots / "plan.toml", wrong)
    assert said in run("decode", shots, code=2).stderr
    # A gap in the names tells which frame is missing: no other cells are looked for.
    (shots / "3.png").unlink()
    assert "the number fits" not in run("decode", shots, code=2).stderr


@pytest.mark.parametrize("fringes", [(), (PhaseSteps("x", 24.0, equal_steps(4)),)])
def test_another_number_of_frames_of_exchanged_sides(fringes):
    """Some programs take the height first: the code then has another number of bits."""
    step = 12.0 if fringes else 2.0
    true = PatternPlan(480, 200, (*fringes, GrayCode("x", step, 480)))
    wrong = PatternPlan(200, 480, (*fringes, GrayCode("x", step, 200)))
    said = r"width and height of the projector are exchanged \(480 columns and 200 rows\)"
    with pytest.raises(fw.FramesContradictPlan, match=said):
        fw.decode(shown(true), wrong)
    # A projector that is wider than high is taken as it is.
    with pytest.raises(fw.FramesContradictPlan) as refused:
        fw.decode(shown(wrong), true)
    assert "exchanged" not in str(refused.value)


PLANS = [
    PLAN,
    PatternPlan(480, 300, (gray(1.0),)),
    PatternPlan(480, 300, (PhaseSteps("x", 24.0, equal_steps(4)), gray(12.0))),
]


@pytest.mark.parametrize("plan", PLANS, ids=["fringes", "code", "both"])
def test_frames_that_do_not_change_are_said(plan):
    """One file copied, or a camera that did not see the projector."""
    rng = np.random.default_rng(1)
    scene = np.clip(100 + 40 * rng.standard_normal((100, 120)), 0, 255)
    same = [scene.astype(np.uint8)] * plan.frames
    with pytest.raises(fw.FramesContradictPlan, match=f"all {plan.frames} are equal in every co"):
        fw.decode(same, plan)
    if isinstance(plan.blocks[0], PhaseSteps):
        noisy = [np.rint(scene / 2 + rng.normal(0, 2, scene.shape)) for _ in same]
        with pytest.raises(fw.InputError, match="was the projector on and in view"):
            fw.decode([np.clip(f, 0, 255).astype(np.uint8) for f in noisy], plan)


def test_two_results_of_a_command_have_two_names(shots, tmp_path):
    both = tmp_path / "a.pdf"
    done = run("decode", shots, "--figure", both, "--report", tmp_path / "." / "a.pdf", code=2)
    assert "--figure and --report would write the same file" in done.stderr
    assert not both.exists()
    (shots / "truth.npz").write_text("mine")
    done = run("decode", shots, "--out", shots / "truth.npz", code=2)
    assert "--out would replace what" in done.stderr
    assert (shots / "truth.npz").read_text() == "mine"


def test_masked_frames_are_not_written(tmp_path):
    frames = [np.ma.array(frame) for frame in shown(PLAN)]
    frames[1][3, 3] = np.ma.masked
    for call in (
        lambda: fw.files.write_stack(tmp_path / "new", frames, PLAN),
        lambda: fw.files.write_frame(tmp_path / "one.png", frames[1]),
    ):
        with pytest.raises(fw.InputError, match="expected an array without a mask of NumPy"):
            call()
    assert not (tmp_path / "one.png").exists()


def test_one_photograph_given_twice_is_said():
    x = np.arange(200.0)
    frame = np.rint(np.tile(120 + 80 * np.cos(2 * np.pi * x / 20), (100, 1))).astype(np.uint8)
    kinds = [f.kind for f in fw.reconstruct(fw.Pair(frame, frame.copy())).surface.findings]
    assert "same frame" in kinds
    kinds = [
        f.kind for f in fw.reconstruct(fw.Pair(frame, np.roll(frame, 1, 0) + 1)).surface.findings
    ]
    assert "same frame" not in kinds


RIG = fw.simulate.standard_rig(scale=0.1)
PROPOSED = fw.propose(160, 100, 9)
BLACK = [np.zeros((4, 5), np.uint8)] * 9
AHEAD = np.zeros((4, 4))
AHEAD[2, 3] = 500.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: list(fw.encode(PROPOSED[0])), "plan: .* got Proposal; a Proposal has one as its"),
        (lambda: fw.decode(BLACK, PROPOSED), "plan: .* got list; a Proposal has one as its .plan"),
        (lambda: fw.Stack(BLACK, PROPOSED[0]), "plan: .* got Proposal; a Proposal has one as its"),
        (lambda: fw.Stack(BLACK, 9), "plan: expected a PatternPlan, got int$"),
        (lambda: fw.write(RIG, "rig.toml"), "path: expected a path, .* got a Rig first"),
        (
            lambda: fw.capture("virtual", "virtual", PROPOSED[0].plan, "part"),
            "projector: expected a Projector, as open_devices returns, got 'virtual'",
        ),
        (lambda: fw.save_figure(RIG, "a.png"), r"figure: expected a figure, as .plot\(\) returns"),
        (lambda: fw.triangulate("part", RIG), "decoded: expected Decoded, as decode returns"),
        (lambda: fw.rig.DepthRange(RIG, "450:560"), "two depths in mm, .* got '450:560'"),
        (lambda: fw.rig.DepthRange(RIG, 450.0), "two depths in mm, .* got 450.0"),
        (lambda: fw.Recipe(tolerances=("flat",)), "expected each as a PartTolerance, got str"),
    ],
)
def test_what_is_handed_over_in_place_of_another_thing_is_named(call, words):
    with pytest.raises(fw.InputError, match=words):
        call()


def test_what_measure_returns_goes_into_the_next_verbs(tmp_path):
    plan = fw.simulate.fringe_plan(RIG, both=False)
    ball = [fw.simulate.Body(fw.simulate.Sphere(30.0), np.eye(4) + AHEAD)]
    stack = fw.Stack(list(fw.simulate.photograph(fw.simulate.look(RIG, ball), plan)), plan)
    found = fw.measure(stack, RIG)
    model = fw.write(tmp_path / "ball.stl", fw.surface.cloud_mesh(found.points))
    assert fw.fit(found, "sphere").forms == fw.fit(found.points, "sphere").forms
    assert fw.inspect(found, fw.Recipe()).surface == found.points
    still = fw.evaluate.KnownPose(np.eye(4))
    ways = [fw.deviation(part, model, align=still) for part in (found, found.points)]
    np.testing.assert_array_equal(ways[0].distance_mm, ways[1].distance_mm)
    with pytest.raises(fw.InputError, match="board: expected the board that turns with the part"):
        fw.merge([found, found])
