"""Rigs of two cameras as other programs write them: OpenCV, MATLAB, and what people call things."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.limits import MAX_LENGTH_PX, parsing, told
from fringeworks.files.named_numbers import read_numbers
from fringeworks.files.opencv_rig import pinhole_from, rotation_of
from fringeworks.rig.pinhole import check_lens, rotation
from fringeworks.types import FloatMap, InputError, MultiRig, Pinhole

SIDES = (("1", "2"), ("0", "1"), ("left", "right"), ("l", "r"))
"""What tells the names of two cameras apart; the first that both have is taken."""
MATRICES = (
    "cameramatrix",
    "cameramtx",
    "cammatrix",
    "mtx",
    "intrinsicmatrix",
    "intrinsicsmatrix",
    "intrinsicmtx",
    "intrinsics",
    "intrinsic",
    "intrinsicscameramatrix",
    "m",
    "k",
    "kk",
)
"""Names of camera matrices, in small letters without marks."""
DISTORTIONS = (
    "distcoeffs",
    "distcoeff",
    "distortioncoefficients",
    "distortioncoeffs",
    "distortion",
    "intrinsicsdistcoeffs",
    "dist",
    "kc",
    "d",
)
"""Names of distortion coefficients."""
PROJECTIONS = ("p", "projection", "projectionmatrix")
"""Names of projection matrices after rectification."""
ROTATIONS = ("r", "rot", "rotation", "rotationmatrix", "rotmat", "om", "rvec")
"""Names of the rotation from the first camera to the second."""
TRANSLATIONS = ("t", "trans", "translation", "translationvector", "tvec")
"""Names of the translation from the first camera to the second."""
SIZES = ("imagesize", "imgsize", "size", "framesize", "camerasize")
"""Names of the frames' columns and rows."""
MATLAB = "cameraparameters{}"
"""Prefix of MATLAB's stereoParameters."""
PREFIX = re.compile(r"^(?:stereo(?:params?|parameters|calib\w*?)?|calib(?:ration)?)[._]", re.I)
"""Name of a variable or a table that holds all the others."""
SAME = 1e-6
"""Largest part of a rectified projection matrix that is not 0, over the focal length."""


def read_stereo_rig(
    path: StrPath,
    *more: StrPath,
    camera_sizes: Sequence[tuple[int, int]] | None = None,
    unit_mm: float | None = None,
    rectified: bool = False,
) -> MultiRig:
    """Read two calibrated cameras from files of other programs, without a projector.

    Parameters
    ----------
    path, *more : path
        ``.yml``, ``.yaml`` and ``.xml`` of OpenCV, ``.json``, or text of MATLAB (``.m``, ``.txt``).
        What is spread over several files, such as intrinsics.yml and extrinsics.yml, is taken
        together.
    camera_sizes : two (columns, rows), optional
        For files that do not say them.
    unit_mm : float > 0, optional
        Unit of length of the translation, mm: 1000 for metres. By default 1.
    rectified : bool
        Whether the frames are rectified; P1 and P2 of ``stereoRectify`` then describe them. Files
        that have nothing else are of rectified frames.

    Returns
    -------
    MultiRig without a covariance: its points have the σ of noise, and of the misfit that the frames
    show.

    Raises
    ------
    FileProblem for a missing or damaged file. InputError for missing matrices and sizes.

    Notes
    -----
    Known are the names of OpenCV's samples (M1, D1, M2, D2, R, T; cameraMatrix1, distCoeffs1), left
    and right in their place, those of Bouguet's toolbox (fc_left, cc_left, kc_left, om, T), and of
    MATLAB's stereoParameters, whose matrices are transposed and whose pixels count from 1.
    """
    path = Path(path)
    if unit_mm is not None and not 0 < unit_mm < np.inf:
        raise InputError(f"unit_mm: expected > 0, got {unit_mm}")
    numbers: dict[str, FloatMap] = {}
    for file in (path, *(Path(m) for m in more)):
        with parsing(file, "a rig of two cameras"):
            numbers |= {_plain_name(k): v for k, v in read_numbers(file).items()}
    with parsing(path, "a rig of two cameras"):
        found = _Numbers(numbers)
        if camera_sizes is not None and len(camera_sizes) != 2:
            raise InputError(f"camera_sizes: expected two, got {len(camera_sizes)}")
        has_matrices = found.sides(MATRICES) is not None or found.by_matlab or found.by_bouguet
        posed = found.named(ROTATIONS) is not None
        if rectified or not (has_matrices or posed or found.sides(PROJECTIONS) is None):
            cameras, T = found.rectified(camera_sizes)
        else:
            cameras, T = found.raw(camera_sizes)
        T[:3, 3] *= 1.0 if unit_mm is None else unit_mm
        for number, camera in enumerate(cameras, 1):
            check_lens(camera, f"camera {number}")
        return MultiRig(cameras, None, None, np.stack((np.eye(4), T)))


def _plain_name(name: str) -> str:
    """A name in small letters without marks, and without that of the whole."""
    return re.sub(r"[^a-z0-9]", "", PREFIX.sub("", name).lower())


@dataclass(frozen=True)
class _Numbers:
    """Matrices by their plain names."""

    numbers: dict[str, FloatMap]

    @property
    def by_matlab(self) -> bool:
        """Whether the names are those of MATLAB's stereoParameters."""
        return any(MATLAB.format("1") in name for name in self.numbers)

    @property
    def by_bouguet(self) -> bool:
        """Whether the names are those of Bouguet's toolbox."""
        return {"fcleft", "ccleft", "fcright", "ccright"} <= self.numbers.keys()

    def named(self, bases: Sequence[str], side: str = "") -> FloatMap | None:
        """The first matrix with one of the names, of a side; None where there is none."""
        for base in bases:
            names = [f"{base}{side}"]
            if side:
                names += [f"{side}{base}", f"cam{side}{base}", f"camera{side}{base}"]
                names += [f"{base}cam{side}", f"{base}camera{side}", f"{side}camera{base}"]
            for name in names:
                if name in self.numbers:
                    return self.numbers[name]
        return None

    def sides(self, bases: Sequence[str]) -> tuple[str, str] | None:
        """The names of both sides that matrices have; None where there are none."""
        for first, second in SIDES:
            if self.named(bases, first) is not None and self.named(bases, second) is not None:
                return first, second
        return None

    def raw(
        self, sizes: Sequence[tuple[int, int]] | None
    ) -> tuple[tuple[Pinhole, Pinhole], FloatMap]:
        """Both cameras with their lenses, and the pose of the second."""
        sides = self.sides(MATRICES)
        if self.by_matlab:
            parts = [self._of_matlab(n) for n in ("1", "2")]
        elif self.by_bouguet:
            parts = [self._of_bouguet(n) for n in ("left", "right")]
        elif sides is not None:
            parts = [self._of_side(n) for n in sides]
        else:
            raise InputError(
                "missing camera matrices, such as M1 and M2 or cameraMatrix1 and cameraMatrix2; "
                f"it has {self._told()}; where intrinsics and extrinsics are two files, name both"
            )
        wanted = self._sizes(sizes, sides)
        first, second = (
            pinhole_from(f"camera {n}", K, d, size)
            for n, ((K, d), size) in enumerate(zip(parts, wanted, strict=True), 1)
        )
        return (first, second), self._pose()

    def _of_side(self, side: str) -> tuple[FloatMap, FloatMap]:
        K, d = self.named(MATRICES, side), self.named(DISTORTIONS, side)
        if K is None or d is None:
            raise InputError(
                f"missing distortion of camera {side}, such as D{side} or distCoeffs{side}; zeros "
                "where it has none"
            )
        return _square(K, f"matrix of camera {side}"), d.ravel()

    def _of_matlab(self, number: str) -> tuple[FloatMap, FloatMap]:
        """Camera of stereoParameters: pixels count from 1, IntrinsicMatrix is transposed."""
        prefix = MATLAB.format(number)
        K, transposed = (self.numbers.get(f"{prefix}{n}") for n in ("k", "intrinsicmatrix"))
        radial, tangential = (
            self.numbers.get(f"{prefix}{n}distortion") for n in ("radial", "tangential")
        )
        if K is None and transposed is not None:
            K = _square(transposed, f"CameraParameters{number}.IntrinsicMatrix").T
        if K is None or radial is None or tangential is None:
            raise InputError(
                f"CameraParameters{number}: expected IntrinsicMatrix or K, RadialDistortion and "
                f"TangentialDistortion, got {self._told()}"
            )
        if K.shape == (3, 3) and K[0, 2] == 0 == K[1, 2] and K[2, 0] != 0:
            K = K.T
        K = _square(K, f"CameraParameters{number}.K").copy()
        K[:2, 2] -= 1.0
        k, p = np.zeros(3), tangential.ravel()
        k[: radial.size] = radial.ravel()[:3]
        if radial.size > 3 or p.size != 2:
            raise InputError(f"CameraParameters{number}: expected 2 or 3 radial and 2 tangential")
        return K, np.array([k[0], k[1], p[0], p[1], k[2]])

    def _of_bouguet(self, side: str) -> tuple[FloatMap, FloatMap]:
        f, c, k = (self.numbers.get(f"{n}{side}") for n in ("fc", "cc", "kc"))
        if f is None or c is None or k is None or f.size != 2 or c.size != 2:
            raise InputError(f"expected fc_{side}, cc_{side} and kc_{side}, got {self._told()}")
        skew = self.numbers.get(f"alphac{side}", np.zeros(1))
        (fx, fy), (cx, cy) = f.ravel(), c.ravel()
        K = np.array([[fx, float(skew.ravel()[0]) * fx, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        return K, k.ravel()

    def _pose(self) -> FloatMap:
        """Pose of the second camera, (4, 4), in the file's unit."""
        transposed = self.numbers.get("rotationofcamera2")
        R = self.named((*ROTATIONS, "posecamera2r", "posecamera2rotation"))
        if transposed is not None:
            R = _square(transposed, "RotationOfCamera2").T
        t = self.named(
            (*TRANSLATIONS, "translationofcamera2", "posecamera2translation", "posecamera2t")
        )
        if R is None or t is None or t.size != 3:
            raise InputError(
                f"missing R and T from the first camera to the second; it has {self._told()}; "
                "where intrinsics and extrinsics are two files, name both"
            )
        T = np.eye(4)
        T[:3, :3] = rotation(R.ravel()) if R.size == 3 else rotation_of(_square(R, "R"))
        T[:3, 3] = t.ravel()
        return T

    def rectified(
        self, sizes: Sequence[tuple[int, int]] | None
    ) -> tuple[tuple[Pinhole, Pinhole], FloatMap]:
        """Both cameras after rectification, from P1 and P2."""
        sides = self.sides(PROJECTIONS)
        if sides is None:
            raise InputError(f"missing P1 and P2 of rectified frames; it has {self._told()}")
        P = [self.named(PROJECTIONS, n) for n in sides]
        if any(p is None or p.shape != (3, 4) for p in P):
            raise InputError("P1, P2: expected matrices of 3 rows and 4 columns")
        one, two = (np.asarray(p, np.float64) for p in P)
        cameras = tuple(
            pinhole_from(f"camera {n}", p[:, :3], np.zeros(5), size)
            for n, (p, size) in enumerate(
                zip((one, two), self._sizes(sizes, sides), strict=True), 1
            )
        )
        shift = np.linalg.solve(two[:, :3], two[:, 3])
        if np.abs(one[:, 3]).max() > SAME * abs(one[0, 0]) or not np.abs(shift).max() > 0:
            raise InputError("P1, P2: expected the baseline in the last column of P2 alone")
        T = np.eye(4)
        T[:3, 3] = shift
        return (cameras[0], cameras[1]), T

    def _sizes(
        self, given: Sequence[tuple[int, int]] | None, sides: tuple[str, str] | None
    ) -> list[tuple[int, int]]:
        """Columns and rows of both cameras."""
        found = [self._size(side) for side in sides or ("1", "2")]
        if given is None and None not in found:
            return [size for size in found if size is not None]
        if given is None:
            raise InputError(
                "missing camera_size: columns and rows of the cameras' frames; "
                "read_stereo_rig(…, camera_sizes=…) or rig convert --camera-size 1280x1024 state it"
            )
        for number, (told_size, size) in enumerate(zip(found, given, strict=True), 1):
            if told_size not in (None, tuple(size)):
                raise InputError(
                    f"camera {number}: expected frames of {told_size[0]} × {told_size[1]} px as "
                    f"the file says, got {size[0]} × {size[1]}"
                )
        return [(int(w), int(h)) for w, h in given]

    def _size(self, side: str) -> tuple[int, int] | None:
        """Columns and rows of a camera; None where the file does not say them."""
        matlab = self.numbers.get(f"{MATLAB.format(side)}imagesize")
        size = matlab if matlab is not None else self.named(SIZES, side)
        if size is None:
            size = self.named(SIZES)
        if size is None or size.size != 2:
            return None
        a, b = (float(v) for v in size.ravel())
        if not all(v == int(v) and 2 <= v <= MAX_LENGTH_PX for v in (a, b)):
            raise InputError(f"size: expected columns and rows, got {told([a, b])}")
        # MATLAB counts rows first.
        return (int(b), int(a)) if self.by_matlab else (int(a), int(b))

    def _told(self) -> str:
        """The names that there are, for messages."""
        return told(", ".join(self.numbers)) if self.numbers else "nothing"


def _square(K: FloatMap, name: str) -> FloatMap:
    """Nine finite values as a matrix of 3 × 3."""
    if K.size != 9 or not np.isfinite(K).all():
        raise InputError(f"{name}: expected 3 rows and 3 columns of finite numbers")
    return K.reshape(3, 3)
