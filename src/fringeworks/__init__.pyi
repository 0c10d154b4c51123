"""The public names, each with the file that it is loaded from on first use."""

from .evaluate.errors import (
    compare as compare,
)
from .evaluate.errors import (
    errors as errors,
)
from .files.coordinates import (
    read_coordinates as read_coordinates,
)
from .files.coordinates import (
    write_coordinates as write_coordinates,
)
from .files.pair import (
    read_capture as read_capture,
)
from .files.pair import (
    read_pair as read_pair,
)
from .files.pair import (
    write_pair as write_pair,
)
from .files.plan import (
    read_plan as read_plan,
)
from .files.plan import (
    write_patterns as write_patterns,
)
from .files.plan import (
    write_plan as write_plan,
)
from .files.points import (
    read_points as read_points,
)
from .files.points import (
    write_points as write_points,
)
from .files.rig import (
    read_rig as read_rig,
)
from .files.rig import (
    write_rig as write_rig,
)
from .files.stack import (
    read_stack as read_stack,
)
from .files.stack import (
    write_stack as write_stack,
)
from .files.surfaces import (
    write_surface as write_surface,
)
from .pair.analyse import (
    analyse as analyse,
)
from .pair.analyse import (
    methods as methods,
)
from .pair.methods.wavelet import (
    wavelet_frequencies as wavelet_frequencies,
)
from .pair.methods.wavelet import (
    wavelet_ridge as wavelet_ridge,
)
from .pair.methods.windowed_fourier import (
    windowed_fourier_filter as windowed_fourier_filter,
)
from .pair.methods.windowed_fourier import (
    windowed_fourier_ridge as windowed_fourier_ridge,
)
from .pair.plane_calibration import (
    calibrate_reference_plane as calibrate_reference_plane,
)
from .pair.reference_plane import (
    displacement_from_height as displacement_from_height,
)
from .pair.reference_plane import (
    height_from_displacement as height_from_displacement,
)
from .pair.reference_plane import (
    to_surface as to_surface,
)
from .pair.unwrap import (
    unwrap as unwrap,
)
from .patterns.encode import (
    encode as encode,
)
from .patterns.plan import (
    GrayCode as GrayCode,
)
from .patterns.plan import (
    PatternPlan as PatternPlan,
)
from .patterns.plan import (
    PhaseSteps as PhaseSteps,
)
from .patterns.plan import (
    Uniform as Uniform,
)
from .patterns.plan import (
    equal_steps as equal_steps,
)
from .patterns.propose import (
    Proposal as Proposal,
)
from .patterns.propose import (
    propose as propose,
)
from .pipeline import (
    Reconstruction as Reconstruction,
)
from .pipeline import (
    calibrate_stacks as calibrate_stacks,
)
from .pipeline import (
    reconstruct as reconstruct,
)
from .pipeline import (
    reconstruct_points as reconstruct_points,
)
from .rig.calibration.board import (
    Board as Board,
)
from .rig.calibration.board import (
    parse_board as parse_board,
)
from .rig.calibration.calibrate import (
    Calibration as Calibration,
)
from .rig.calibration.calibrate import (
    calibrate as calibrate,
)
from .rig.calibration.calibrate import (
    observe as observe,
)
from .rig.calibration.corners import (
    find_board as find_board,
)
from .rig.calibration.diagnosis import (
    diagnose as diagnose,
)
from .rig.triangulate import (
    triangulate as triangulate,
)
from .simulate.scene import (
    standard_scene as standard_scene,
)
from .stack.decode import (
    StreamingDecoder as StreamingDecoder,
)
from .stack.decode import (
    decode as decode,
)
from .stack.frames import (
    Stack as Stack,
)
from .stack.shifts import (
    estimate_shifts as estimate_shifts,
)
from .surface.cloud import (
    height_over_plane as height_over_plane,
)
from .surface.cloud import (
    normals as normals,
)
from .surface.form import (
    fit_form as fit_form,
)
from .types import (
    CameraNoise as CameraNoise,
)
from .types import (
    CoordinateMap as CoordinateMap,
)
from .types import (
    Decoded as Decoded,
)
from .types import (
    DisplacementMap as DisplacementMap,
)
from .types import (
    HeightMap as HeightMap,
)
from .types import (
    InputError as InputError,
)
from .types import (
    Pair as Pair,
)
from .types import (
    Pinhole as Pinhole,
)
from .types import (
    PointCloud as PointCloud,
)
from .types import (
    Reason as Reason,
)
from .types import (
    ReferencePlaneGeometry as ReferencePlaneGeometry,
)
from .types import (
    Rig as Rig,
)
