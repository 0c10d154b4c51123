"""The kinds of files: what each holds, its suffixes, and how it is read, written and checked.

A kind is declared here once. The modules that read and write it are loaded when they are needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

from fringeworks.files.atomic import StrPath, check_target
from fringeworks.types import FileProblem, InputError
from fringeworks.types.packages import need_opencv

ARCHIVE = ".npz"
"""Suffix of files that are told apart by the names of their arrays."""
TOML = ".toml"
"""Suffix of files that are told apart by the kind that they name."""


CSV = ".csv"
"""Suffix of tables, which are told apart by the kind that they name."""
POINT_SUFFIXES = (".e57", ".las", ".laz")
"""Files of points that packages read and write."""
MAIN_PARTS = {
    "Measurement": "points",
    "MultiMeasurement": "points",
    "MergedPart": "points",
    "Reconstruction": "surface",
    "Calibration": "rig",
    "MultiCalibration": "rig",
}
"""Results of chains by the names of their types, and the part that a file holds. The types are
defined in later rooms."""


def main_part(thing: Any) -> Any:
    """The part of a chain's result that a file holds, and that later stages take; any other thing
    as it is."""
    part = MAIN_PARTS.get(type(thing).__name__)
    return thing if part is None else getattr(thing, part)


class Functions(NamedTuple):
    """What reads and what writes a kind of files."""

    read: Callable[[Path], Any]
    write: Callable[..., Any]
    """Called with the path, the thing, and options by name."""


@dataclass(frozen=True)
class Format:
    """A kind of files."""

    name: str
    holds: str
    """What a file holds, for messages."""
    types: Sequence[str]
    """Names of the types that are written; every type has one format."""
    suffixes: Sequence[str]
    """Suffixes of the files that are written; none for folders."""
    load: Callable[[], Functions]
    """Loads the functions that read and write."""
    reads: Sequence[str] = ()
    """Suffixes that no other kind has."""
    arrays: Sequence[str] = ()
    """Names of arrays, one of which every archive has and no other kind has."""
    kinds: Sequence[str] = ()
    """Kinds that descriptions in TOML name."""
    tables: Sequence[str] = ()
    """Kinds that tables (CSV) name."""
    advice: str = ""
    """What to do about another suffix, for messages."""
    needs: Callable[[str], None] = lambda _: None
    """Refuses a suffix for which a package is missing."""

    def read(self, path: Path) -> Any:
        """Read a file."""
        return self.load().read(path)

    def write(self, path: StrPath, thing: Any, **options: Any) -> None:
        """Write a file, whole or not at all; refuse options that the format does not have."""
        self.check(path)
        function = self.load().write
        try:
            signature(function).bind(path, thing, **options)
        except TypeError as error:
            raise InputError(f"{Path(path).name}: options of {self.holds}: {error}") from error
        function(path, thing, **options)

    def check(self, path: StrPath) -> None:
        """Refuse a file that cannot be written, before anything is computed for it."""
        suffix = Path(path).suffix.lower()
        if self.suffixes:
            check_target(path, self.suffixes, self.advice)
            self.needs(suffix)
        elif any(suffix in one.suffixes for one in FORMATS.values()):
            raise FileProblem(
                f"{path}: expected a folder for {self.holds}, got the name of a file ({suffix})"
            )


FORMATS: dict[str, Format] = {}
"""All kinds of files by name, in the order in which they are declared."""


def declare(
    name: str, holds: str, types: Sequence[str], suffixes: Sequence[str] = (), **more: Any
) -> Callable[[Callable[[], Functions]], None]:
    """Declare a kind of files by what loads its functions; see ``Format``."""

    def declared(load: Callable[[], Functions]) -> None:
        FORMATS[name] = Format(name, holds, types, suffixes, load, **more)

    return declared


def format_of(kind: type) -> Format | None:
    """The kind of files that things of a type, or of its base, are written to; None for none."""
    for base in kind.__mro__:
        if base.__module__.partition(".")[0] in ("fringeworks", "numpy", "builtins"):
            for one in FORMATS.values():
                if base.__name__ in one.types:
                    return one
    return None


def check_target_of(path: StrPath, *names: str) -> None:
    """Refuse a file that no one of some formats can be written to, before anything is computed.

    Parameters
    ----------
    path : path
    *names : str
        Of ``FORMATS``.

    Raises
    ------
    FileProblem that says which suffixes there are, or that the folder is missing; MissingPackage
    for a suffix that needs a package which is not installed.
    """
    suffix = Path(path).suffix.lower()
    several = [FORMATS[name] for name in names]
    fitting = next((one for one in several if suffix in one.suffixes), None)
    if fitting is not None or len(several) == 1:
        (fitting or several[0]).check(path)
    else:
        check_target(path, dict.fromkeys(s for one in several for s in one.suffixes))


@declare("pair", "a pair of frames", ["Pair"], arrays=["reference", "object"])
def _() -> Functions:
    from fringeworks.files.pair import read_pair_file, write_pair

    return Functions(read_pair_file, write_pair)


@declare("stack", "a stack of frames", ["Stack"], arrays=["frames"])
def _() -> Functions:
    from fringeworks.files.stack import read_stack, write_stack
    from fringeworks.stack.frames import Stack

    def write(folder: StrPath, stack: Stack, **options: Any) -> Path:
        return write_stack(
            folder,
            stack.frames,
            stack.plan,
            camera=stack.camera,
            projector=stack.projector,
            saturation=stack.saturation,
            white_balance=stack.white_balance,
            **options,
        )

    return Functions(read_stack, write)


@declare("plan", "a plan", ["PatternPlan"], [TOML], kinds=["plan"])
def _() -> Functions:
    from fringeworks.files.plan import read_plan, write_plan

    return Functions(read_plan, write_plan)


def _need_point_package(suffix: str) -> None:
    from fringeworks.files.point_writers import need_package

    need_package(suffix)


@declare(
    "points",
    "a point cloud",
    ["PointCloud"],
    [".ply", ".xyz", ARCHIVE, ".pcd", ".mcap", ".mat", CSV, *POINT_SUFFIXES, ".vtp", ".vti"],
    arrays=["xyz_mm"],
    needs=_need_point_package,
)
def _() -> Functions:
    from fringeworks.files.points import read_cloud, write_points

    return Functions(read_cloud, write_points)


@declare(
    "merged",
    "points without a frame",
    ["Points"],
    [".ply", ".xyz", ".pcd", ".mcap", CSV, *POINT_SUFFIXES, ".vtp"],
    reads=[".xyz", ".pcd", *POINT_SUFFIXES],
    tables=["points"],
    needs=_need_point_package,
)
def _() -> Functions:
    from fringeworks.files.points import read_point_file, write_merged_points
    from fringeworks.types import Points

    def write(path: StrPath, points: Points) -> None:
        write_merged_points(path, points, provenance=points.provenance)

    return Functions(read_point_file, write)


@declare(
    "surface",
    "a height map",
    ["HeightMap"],
    [".tif", ".tiff", ARCHIVE, ".ply", ".x3p", ".gsf", CSV, ".vti"],
    reads=[".x3p", ".gsf"],
    arrays=["values"],
    tables=["heights"],
)
def _() -> Functions:
    from fringeworks.files.point_table import Kind
    from fringeworks.files.surfaces import read_surface, write_surface
    from fringeworks.types import HeightMap

    def write(path: StrPath, surface: HeightMap, *, kind: Kind = "points") -> None:
        write_surface(path, surface, ply=kind)

    return Functions(read_surface, write)


@declare(
    "mesh",
    "a mesh",
    ["TriangleMesh"],
    [".stl", ".obj", ".glb", ".3mf", ".ply", ".vtp"],
    reads=[".stl", ".obj", ".off", ".glb", ".3mf", ".step", ".stp", ".iges", ".igs"],
)
def _() -> Functions:
    from fringeworks.files.mesh import read_triangles
    from fringeworks.files.mesh_writer import write_mesh

    return Functions(read_triangles, write_mesh)


@declare(
    "coordinate",
    "projector coordinates",
    ["Decoded"],
    [ARCHIVE, CSV, ".vti", ".mat"],
    arrays=["x_coordinate_px", "y_coordinate_px"],
    tables=["coordinates"],
    advice="coordinates are written as .npz, .csv, .vti or .mat, and become points with a rig",
)
def _() -> Functions:
    from fringeworks.files.archives import read_coordinates, write_coordinates

    return Functions(read_coordinates, write_coordinates)


@declare("phase", "a wrapped phase", ["WrappedPhase"], [ARCHIVE], arrays=["phase_rad"])
def _() -> Functions:
    from fringeworks.files.archives import read_phase, write_phase

    return Functions(read_phase, write_phase)


@declare("light", "separated light", ["LightSeparation"], [ARCHIVE], arrays=["indirect_sigma"])
def _() -> Functions:
    from fringeworks.files.archives import read_light, write_light

    return Functions(read_light, write_light)


OPENCV_SUFFIXES = (".xml", ".yml", ".yaml")
"""Files of OpenCV's FileStorage."""


def _need_opencv(suffix: str) -> None:
    if suffix in OPENCV_SUFFIXES:
        need_opencv("a rig file of OpenCV")


@declare(
    "rig",
    "a rig",
    ["Rig"],
    [TOML, *OPENCV_SUFFIXES],
    reads=OPENCV_SUFFIXES,
    kinds=["rig"],
    needs=_need_opencv,
)
def _() -> Functions:
    from fringeworks.files.rig import read_rig, write_rig

    return Functions(read_rig, write_rig)


@declare("multi_rig", "a rig of several cameras", ["MultiRig"], [TOML], kinds=["multi-rig"])
def _() -> Functions:
    from fringeworks.files.multi_rig import read_multi_rig, write_multi_rig

    return Functions(read_multi_rig, write_multi_rig)


@declare("response", "a response", ["Response"], [TOML], kinds=["response"])
def _() -> Functions:
    from fringeworks.files.response import read_response, write_response

    return Functions(read_response, write_response)


@declare(
    "reference_plane",
    "a calibration of the two-frame path",
    ["ReferencePlaneGeometry", "PlaneCalibration", "PixelCalibration"],
    [TOML, ARCHIVE],
    arrays=["slope"],
    kinds=["reference-plane"],
)
def _() -> Functions:
    from fringeworks.files.reference_plane import read_reference_plane, write_reference_plane

    return Functions(read_reference_plane, write_reference_plane)


@declare("recipe", "a recipe", ["Recipe"], [TOML], kinds=["recipe"])
def _() -> Functions:
    from fringeworks.files.recipe import read_recipe, write_recipe

    return Functions(read_recipe, write_recipe)


@declare("setup", "a set-up", ["SetupTests", "StoredSetup"], [TOML], kinds=["setup"])
def _() -> Functions:
    from fringeworks.files.setup import read_setup, write_setup

    return Functions(read_setup, write_setup)


@declare(
    "frame",
    "a frame",
    ["ndarray"],
    [".png", ".tif", ".tiff"],
    reads=[".png", ".jpg", ".jpeg", ".bmp"],
)
def _() -> Functions:
    from fringeworks.files.images import read_frame, write_frame

    return Functions(lambda path: read_frame(path)[0], write_frame)


@declare("figures", "numerical results", ["dict"], [".json"], reads=[".json"])
def _() -> Functions:
    from fringeworks.files.figures import read_figures, write_figures

    return Functions(read_figures, write_figures)
