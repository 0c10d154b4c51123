"""The image of the service: rules that a linter of Dockerfiles holds, and files that are there."""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
WORDS = {
    *("FROM", "RUN", "WORKDIR", "COPY", "USER", "VOLUME", "EXPOSE", "HEALTHCHECK", "STOPSIGNAL"),
    *("ENTRYPOINT", "CMD", "ENV", "ARG", "LABEL"),
}


def instructions(text):
    """Word and arguments of each instruction, lines that go on joined."""
    joined = re.sub(r"\\\n\s*", " ", re.sub(r"^#.*\n", "", text, flags=re.M))
    return [tuple(line.split(" ", 1)) for line in joined.splitlines() if line.strip()]


def faults(text):
    """What a linter says, in the words of hadolint's rules."""
    found = instructions(text)
    words = [word for word, _ in found]
    said = [f"unknown instruction {word}" for word in words if word not in WORDS]
    for word, given in found:
        if word == "FROM":
            image = given.split(" ")[0]
            if ":" not in image or image.endswith(":latest"):
                said.append(f"DL3006, DL3007: {image} without a version")
        if word == "RUN":
            if "apt-get install" in given:
                if "--no-install-recommends" not in given or "-y" not in given.split():
                    said.append("DL3014, DL3015: apt-get without -y or --no-install-recommends")
                if "rm -rf /var/lib/apt/lists" not in given or "apt-get update" not in given:
                    said.append("DL3009: lists of apt stay in the layer")
                packages = given.partition("--no-install-recommends")[2].partition("&&")[0]
                said += [f"DL3008: {p} without a version" for p in packages.split() if "=" not in p]
            for call in re.findall(r"pip install[^&]*", given):
                if "--no-cache-dir" not in call:
                    said.append("DL3042: pip keeps its cache in the layer")
                pinned = ("--constraint", "--require-hashes", "--no-index")
                if not any(option in call for option in pinned):
                    said.append("DL3013: pip without pinned versions")
            if re.search(r"\bsudo\b|\bcurl\b|\bwget\b|\|", given):
                said.append("DL3004, DL4006: sudo, downloads or pipes")
        if word in ("CMD", "ENTRYPOINT") and not given.startswith("["):
            said.append(f"DL3025: {word} not as JSON")
        if word == "WORKDIR" and not given.startswith("/"):
            said.append("DL3000: WORKDIR is not absolute")
        if word == "ENV" and re.search(r"TOKEN|SECRET|PASSWORD", given):
            said.append("a secret in the image")
    last = found[len(words) - 1 - words[::-1].index("FROM") :]
    users = [given for word, given in last if word == "USER"]
    if not users or users[-1] in ("root", "0"):
        said.append("DL3002: the last user is root")
    for word in ("ENTRYPOINT", "CMD", "HEALTHCHECK"):
        if [w for w, _ in last].count(word) != 1:
            said.append(f"DL4003, DL4004, DL3012: expected one {word}")
    return said


TEXT = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_the_dockerfile_has_no_faults():
    assert faults(TEXT) == []


@pytest.mark.parametrize(
    ("was", "becomes", "said"),
    [
        ("python:3.11-slim-bookworm", "python", "DL3006"),
        ("USER scanner\n", "", "DL3002"),
        ("--no-cache-dir --require-hashes", "--require-hashes", "DL3042"),
        (" --require-hashes --requirement", " --requirement", "DL3013"),
        (" --constraint constraints.txt maturin", " maturin", "DL3013"),
        ("=3.11.*", "", "DL3008"),
        ('CMD ["--rig"', 'CMD --rig ["', "DL3025"),
        ("--no-install-recommends ", "", "DL3014"),
        ("WORKDIR /data", "WORKDIR data", "DL3000"),
        ("STOPSIGNAL", "MAINTAINER", "unknown instruction"),
    ],
)
def test_faults_are_found(was, becomes, said):
    assert was in TEXT
    assert any(said in one for one in faults(TEXT.replace(was, becomes)))


def test_what_is_copied_is_there_and_enough():
    allowed = {
        line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line[:1] == "!"
    }
    copied = [g.split() for w, g in instructions(TEXT) if w == "COPY" and "--from" not in g]
    sources = {source for *given, _ in copied for source in given}
    assert sources == allowed
    assert all((ROOT / source).exists() for source in sources)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {project["readme"], *project["license-files"]} <= sources


def test_the_rust_of_the_image_is_that_of_the_workspace():
    wanted = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    assert f"FROM rust:{wanted['rust-version']}-" in TEXT


def test_the_command_of_the_image_is_one_of_the_program():
    from typer.main import get_command

    from fringeworks.cli.commands import face

    place = importlib.util.spec_from_file_location("image", ROOT / "release" / "image_steps.py")
    assert place is not None
    assert place.loader is not None
    steps = importlib.util.module_from_spec(place)
    place.loader.exec_module(steps)
    install, command, health = steps.steps()
    assert "--require-hashes" in install
    assert "--no-index --no-deps /tmp/wheels/*.whl" in install
    assert "/health" in health[-1]
    compile(health[-1], "health", "exec")
    assert command[:3] == ["fringeworks", "serve", "/data"]
    get_command(face.app).commands["serve"].make_context("fringeworks", command[2:])
    assert json.loads(json.dumps(command)) == command
