"""A function for each set of the sample data: where it lies, and what is in it.

All of them fetch the archive of the release where it is not there yet, and check its hash. Without
a network, the environment variable ``FRINGEWORKS_SAMPLES`` names the folder that holds the archive.
"""

from __future__ import annotations

from pathlib import Path

from fringeworks.files.sample_sets import sample_data


def ball() -> Path:
    """Return the folder of two frames: a painted ball of 500 × 500 pixels over a reference plane.

    Returns
    -------
    Path of the folder of a pair: its frames, its geometry, and the true heights.

    Raises
    ------
    FileProblem where the archive cannot be fetched, or is not that of this version. MissingPackage
    where it is to be fetched without the package ``pooch`` (the extra "data").
    """
    return sample_data("pair") / "part"


def bust() -> Path:
    """Return the folder of a bust before a wall, under 12 frames of fringes.

    Returns
    -------
    Path of a folder: ``bust`` is the capture, with its true depth in ``truth.npz``; ``rig.toml`` is
    the rig that took it.

    Raises
    ------
    As ``ball``.
    """
    return sample_data("stack")


def board() -> Path:
    """Return the folder of a chessboard in eight poses, to calibrate from.

    Returns
    -------
    Path of a folder that holds a capture of 24 frames for each pose, ``pose_0`` to ``pose_7``. The
    board is "chessboard:11x8:12".

    Raises
    ------
    As ``ball``.
    """
    return sample_data("board")


def views() -> Path:
    """Return the folder of a part that was turned by 90° between four captures.

    Returns
    -------
    Path of a folder: ``view_0`` to ``view_3`` are the captures, with the true depth in
    ``truth.npz`` of each; ``rig.toml`` is the rig that took them. The axis of the table is along y,
    through (0, 0, 510) mm in camera coordinates.

    Raises
    ------
    As ``ball``.
    """
    return sample_data("views")


def parts() -> Path:
    """Return the folder of five parts with a step of 10 mm, which is too high in the last one.

    Returns
    -------
    Path of a folder: ``part_0`` to ``part_4`` are the captures, with the true depth in
    ``truth.npz`` of each; ``rig.toml`` is the rig that took them.

    Raises
    ------
    As ``ball``.
    """
    return sample_data("batch")
