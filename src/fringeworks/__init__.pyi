"""The public names along the way of the light, each with the file that it is loaded from."""

__version__: str

# Types.
from .types import (
    Alignment as Alignment,
    Area as Area,
    Axis as Axis,
    BestFit as BestFit,
    BoardNotFound as BoardNotFound,
    CameraNoise as CameraNoise,
    CameraSettings as CameraSettings,
    CoordinateMap as CoordinateMap,
    DatumPlanes as DatumPlanes,
    DatumPoints as DatumPoints,
    Delay as Delay,
    Decoded as Decoded,
    DeviceProblem as DeviceProblem,
    DisplacementMap as DisplacementMap,
    FileProblem as FileProblem,
    FrameFinding as FrameFinding,
    FrameFindingKind as FrameFindingKind,
    FramesContradictPlan as FramesContradictPlan,
    HeightMap as HeightMap,
    InputError as InputError,
    KnownPose as KnownPose,
    MissingPackage as MissingPackage,
    MultiRig as MultiRig,
    Pair as Pair,
    PartModel as PartModel,
    PartTolerance as PartTolerance,
    Pinhole as Pinhole,
    PointCloud as PointCloud,
    Points as Points,
    Profile as Profile,
    Provenance as Provenance,
    Reason as Reason,
    ReferencePlaneGeometry as ReferencePlaneGeometry,
    Recipe as Recipe,
    Region as Region,
    Rig as Rig,
    RigMismatch as RigMismatch,
    Source as Source,
    TriangleMesh as TriangleMesh,
    UnknownMethod as UnknownMethod,
    count_reasons as count_reasons,
    made_by as made_by,
    multi_rig_parameters as multi_rig_parameters,
    fingerprint as fingerprint,
)

# Patterns: what is projected.
from .patterns.plan import (
    Block as Block,
    GrayCode as GrayCode,
    PatternPlan as PatternPlan,
    PhaseSteps as PhaseSteps,
    Uniform as Uniform,
    equal_steps as equal_steps,
)
from .patterns.order_chain import (
    OrderChain as OrderChain,
)
from .patterns.encode import (
    encode as encode,
)
from .patterns.propose import (
    Proposal as Proposal,
    propose as propose,
)
from .files.plan import (
    read_plan as read_plan,
    write_patterns as write_patterns,
    write_plan as write_plan,
)

# Captures: what the camera saw.
from .files.capture import (
    read_capture as read_capture,
)
from .files.pair import (
    read_pair as read_pair,
    write_pair as write_pair,
)
from .files.sequence import (
    FrameSequence as FrameSequence,
    read_sequence as read_sequence,
)
from .files.stack import (
    read_poses as read_poses,
    read_stack as read_stack,
    write_stack as write_stack,
)
from .files.exposures import (
    is_exposures as is_exposures,
    read_exposures as read_exposures,
)
from .files.images import (
    read_frame as read_frame,
    write_frame as write_frame,
)
from .files.limits import (
    file_limits as file_limits,
)
from .files.folder import (
    FolderInUse as FolderInUse,
)

# Devices: projectors that show pictures and cameras that grab frames.
from .devices.protocols import (
    Camera as Camera,
    CameraLimits as CameraLimits,
    VideoMode as VideoMode,
    Grab as Grab,
    Projector as Projector,
    TriggeredCamera as TriggeredCamera,
)
from .devices.window import (
    WindowProjector as WindowProjector,
)
from .devices.memory_projector import (
    MemoryProjector as MemoryProjector,
)
from .devices.webcam import (
    WebcamCamera as WebcamCamera,
)
from .devices.genicam import (
    GenicamCamera as GenicamCamera,
)
from .devices.folder_camera import (
    FolderCamera as FolderCamera,
)
from .devices.virtual_bench import (
    virtual_bench as virtual_bench,
)
from .devices.opening import (
    camera_kind as camera_kind,
    open_camera as open_camera,
    open_devices as open_devices,
    open_projector as open_projector,
    projector_kind as projector_kind,
    scanner_kind as scanner_kind,
)
from .devices.listing import (
    list_devices as list_devices,
)
from .devices.registry import (
    ListedDevice as ListedDevice,
)
from .devices.clock import (
    Clock as Clock,
)

# Scans: showing, grabbing, and what the devices can do.
from .scan.setup import (
    Setup as Setup,
    SetupStopped as SetupStopped,
    SetupTests as SetupTests,
    set_up as set_up,
)
from .files.setup import (
    StoredSetup as StoredSetup,
    check_setup_target as check_setup_target,
    read_setup as read_setup,
    write_setup as write_setup,
)
from .scan.delay import (
    measure_delay as measure_delay,
)
from .scan.frames import (
    take_frames as take_frames,
)
from .scan.capture import (
    capture as capture,
)
from .scan.live import (
    LiveCloud as LiveCloud,
    live as live,
)
from .scan.live_calibration import (
    TakenPose as TakenPose,
    calibrate_live as calibrate_live,
    PoseTaker as PoseTaker,
    take_poses as take_poses,
)
from .scan.exposure import (
    auto_exposure as auto_exposure,
    exposure_series as exposure_series,
)
from .scan.hdr import (
    capture_hdr as capture_hdr,
)

# Signal: what is in a frame before analysis.
from .signal.response import (
    Response as Response,
    apply_response as apply_response,
)
from .files.response import (
    read_response as read_response,
    write_response as write_response,
)
from .signal.denoise import (
    Denoiser as Denoiser,
    Decomposition as Decomposition,
    decompose_frame as decompose_frame,
    decompose_rows as decompose_rows,
    denoise as denoise,
)

# Pair: two frames to heights.
from .pair.analyse import (
    analyse as analyse,
    get_method as get_method,
    methods as methods,
)
from .pair.bound import bound_px as bound_px
from .pair.registry import (
    Method as Method,
    MethodOption as MethodOption,
    Smoothing as Smoothing,
    Solution as Solution,
)
from .pair.plugins import (
    method as method,
)
from .devices.plugins import (
    load_plugin as load_plugin,
)
from .pair.prepared import (
    PreparedPair as PreparedPair,
    prepare as prepare,
)
from .pair.carrier import (
    Carrier as Carrier,
)
from .pair.unwrap import (
    Unwrapped as Unwrapped,
    unwrap as unwrap,
)
from .pair.methods.wavelet import (
    wavelet_frequencies as wavelet_frequencies,
    wavelet_ridge as wavelet_ridge,
)
from .pair.methods.windowed_fourier import (
    Ridge as Ridge,
    windowed_fourier_filter as windowed_fourier_filter,
    windowed_fourier_ridge as windowed_fourier_ridge,
)
from .pair.reference_plane import (
    displacement_from_height as displacement_from_height,
    height_from_displacement as height_from_displacement,
    to_surface as to_surface,
)
from .pair.plane_calibration import (
    PixelCalibration as PixelCalibration,
    PlaneCalibration as PlaneCalibration,
    calibrate_pixels as calibrate_pixels,
    calibrate_reference_plane as calibrate_reference_plane,
    height_by_pixel as height_by_pixel,
)
from .files.reference_plane import (
    read_reference_plane as read_reference_plane,
    write_reference_plane as write_reference_plane,
)

# Stack: shifted frames and Gray code to projector coordinates.
from .stack.frames import (
    Stack as Stack,
)
from .stack.options import (
    DecodeOptions as DecodeOptions,
)
from .stack.decode import (
    decode as decode,
)
from .stack.decoder import (
    Decoder as Decoder,
)
from .stack.motion import (
    Motion as Motion,
)
from .stack.sequence import (
    Moment as Moment,
    SequenceDecoder as SequenceDecoder,
    SequenceOptions as SequenceOptions,
    decode_sequence as decode_sequence,
)
from .pipeline.sequences import (
    MeasuredMoment as MeasuredMoment,
    measure_sequence as measure_sequence,
)
from .stack.stream import (
    StreamingDecoder as StreamingDecoder,
)
from .stack.fuse import (
    fuse as fuse,
)
from .stack.shifts import (
    estimate_shifts as estimate_shifts,
)
from .stack.light_separation import (
    LightSeparation as LightSeparation,
    separate_light as separate_light,
)
from .stack.wrapped import (
    WrappedPhase as WrappedPhase,
    wrapped_phase as wrapped_phase,
)
from .stack.even_light import (
    texture as texture,
)
from .files.archives import (
    read_coordinates as read_coordinates,
    read_light as read_light,
    read_phase as read_phase,
    write_coordinates as write_coordinates,
    write_light as write_light,
    write_phase as write_phase,
)

# Rig: camera and projector to points.
from .rig.calibration.board import (
    Board as Board,
    BoardKind as BoardKind,
    parse_board as parse_board,
)
from .rig.calibration.board_view import (
    BoardView as BoardView,
)
from .rig.calibration.corners import (
    find_board as find_board,
)
from .rig.calibration.calibrate import (
    Calibration as Calibration,
    Observation as Observation,
    calibrate as calibrate,
    observe as observe,
)
from .rig.calibration.cameras import (
    MultiCalibration as MultiCalibration,
    calibrate_cameras as calibrate_cameras,
)
from .rig.calibration.diagnosis import (
    Finding as Finding,
    diagnose as diagnose,
)
from .rig.calibration.drift import (
    RigCheck as RigCheck,
)
from .rig.calibration.drift_words import (
    Cause as Cause,
)
from .rig.calibration.verdict import (
    Verdict as Verdict,
    verdict as verdict,
)
from .stack.depth_plan import (
    propose_for_depth as propose_for_depth,
)
from .rig.depth_range import (
    DepthRange as DepthRange,
)
from .rig.triangulate import (
    Triangulator as Triangulator,
    triangulate as triangulate,
)
from .rig.device_pairs import (
    camera_pair as camera_pair,
)
from .rig.camera_points import (
    CameraPoints as CameraPoints,
)
from .files.multi_rig import (
    read_multi_rig as read_multi_rig,
    write_multi_rig as write_multi_rig,
)
from .files.rig import (
    read_rig as read_rig,
    write_rig as write_rig,
)

# Surfaces.
from .surface.clean import (
    clean_cloud as clean_cloud,
    crop_cloud as crop_cloud,
)
from .surface.cloud import (
    height_over_plane as height_over_plane,
    normals as normals,
)
from .surface.mesh import (
    cloud_mesh as cloud_mesh,
    decimate as decimate,
)
from .surface.form_geometry import (
    BodyKind as BodyKind,
)
from .surface.form import (
    Form as Form,
    fit_form as fit_form,
    fit_region as fit_region,
)
from .surface.form_report import (
    find_spheres as find_spheres,
)
from .surface.section import (
    difference as difference,
)
from .files.surfaces import (
    read_surface as read_surface,
    write_surface as write_surface,
)
from .files.points import (
    read_cloud as read_cloud,
    read_points as read_points,
    write_points as write_points,
)
from .files.mesh_writer import (
    write_mesh as write_mesh,
)
from .files.mesh import (
    read_mesh as read_mesh,
    read_model as read_model,
)

# Views of one part.
from .views.poses import (
    TurntableAxis as TurntableAxis,
    ViewPose as ViewPose,
    turntable_axis as turntable_axis,
)
from .views.camera_blur import (
    remove_blur as remove_blur,
)
from .scan.turntable import (
    scan_turntable as scan_turntable,
)
from .views.closed_mesh import (
    closed_mesh as closed_mesh,
)
from .views.board_pose import (
    BoardPose as BoardPose,
    board_pose as board_pose,
)
from .views.registration import (
    Registration as Registration,
)
from .views.pose_graph import (
    Closure as Closure,
)
from .views.fusion import (
    Fused as Fused,
)
from .files.merged import (
    write_merged_points as write_merged_points,
)

# Chains: from a capture to a result.
from .pipeline.pairs import (
    Reconstruction as Reconstruction,
    calibrate_plane as calibrate_plane,
    reconstruct as reconstruct,
)
from .pipeline.pair_points import (
    measure_pair as measure_pair,
)
from .pipeline.stacks import (
    Measurement as Measurement,
    decode_stack as decode_stack,
    measure as measure,
    light_from_stack as light_from_stack,
    phase_from_stack as phase_from_stack,
    response_from_stack as response_from_stack,
)
from .pipeline.merging import (
    MergedPart as MergedPart,
    merge as merge,
)
from .pipeline.boards import (
    calibrate_stacks as calibrate_stacks,
    observe_stack as observe_stack,
)
from .pipeline.cameras import (
    MultiMeasurement as MultiMeasurement,
    calibrate_camera_stacks as calibrate_camera_stacks,
    measure_cameras as measure_cameras,
)
from .pipeline.rig_check import (
    adjust_rig as adjust_rig,
    check_rig as check_rig,
)

# Simulation.
from .simulate.scene import (
    standard_scene as standard_scene,
)
from .simulate.fringes import (
    PairOptions as PairOptions,
)
from .simulate.bodies import (
    Mesh as Mesh,
)

# Evaluation.
from .evaluate.errors import (
    Errors as Errors,
    errors as errors,
)
from .evaluate.captures import (
    CaptureComparison as CaptureComparison,
    compare_captures as compare_captures,
    rows_of_captures as rows_of_captures,
)
from .evaluate.compare import (
    CompareOptions as CompareOptions,
    SceneOptions as SceneOptions,
    compare as compare,
    compare_everywhere as compare_everywhere,
)
from .evaluate.best_method import (
    Cell as Cell,
    best_methods as best_methods,
    format_map as format_map,
)
from .evaluate.deviation import (
    Deviation as Deviation,
    deviation as deviation,
)
from .evaluate.spots import (
    Spot as Spot,
    find_spots as find_spots,
)
from .evaluate.vibration import (
    AreaTracker as AreaTracker,
    Displacement as Displacement,
    Vibration as Vibration,
    vibration as vibration,
)
from .evaluate.inspect import (
    Check as Check,
    Inspection as Inspection,
    inspect as inspect,
    judge_part as judge_part,
    masked as masked,
)
from .evaluate.selftest.cases import (
    CaseResult as CaseResult,
)
from .evaluate.selftest.promises import (
    Judged as Judged,
    Promise as Promise,
    promise_table as promise_table,
)
from .evaluate.selftest.run import (
    SelfTest as SelfTest,
    selftest as selftest,
)
from .batch.scans import (
    Scan as Scan,
    find_scans as find_scans,
)
from .batch.report import (
    write_batch_report as write_batch_report,
)
from .batch.sequence import (
    SequenceResult as SequenceResult,
    run_sequence as run_sequence,
)
from .batch.sequence_report import (
    write_sequence_report as write_sequence_report,
)
from .batch.run import (
    BatchResult as BatchResult,
    run_batch as run_batch,
)
from .files.read_write import (
    read as read,
    write as write,
)
from .files.recipe import (
    read_recipe as read_recipe,
    write_recipe as write_recipe,
)
from .evaluate.form import (
    FormEvaluation as FormEvaluation,
    evaluate_form as evaluate_form,
)

# Scans: showing patterns and grabbing frames.
from .scan.poses import (
    PoseJudgement as PoseJudgement,
    judge_poses as judge_poses,
)

# Reports.
from .report.summary import (
    summarise as summarise,
)
from .report.tables import (
    format_table as format_table,
)
from .files.figures import (
    to_json as to_json,
)
from .report.figures import (
    best_map as best_map,
    save_figure as save_figure,
)
from .report.setup_figures import (
    setup_sheet as setup_sheet,
)
from .report.page.report import (
    ReportWritten as ReportWritten,
    write_report as write_report,
)
from .report.page.tolerances import (
    Tolerance as Tolerance,
    parse_tolerance as parse_tolerance,
)
from .report.board_sheet import (
    board_sheet as board_sheet,
    write_board as write_board,
)

from .report.viewer.pack import (
    PackedSurface as PackedSurface,
    pack_surface as pack_surface,
)
from .report.viewer.page import (
    viewer_fragment as viewer_fragment,
    viewer_page as viewer_page,
    viewer_script as viewer_script,
    viewer_style as viewer_style,
)

# Showcase.
from .showcase.demo import (
    DemoResult as DemoResult,
    write_demo as write_demo,
)
from .showcase.dissertation import (
    write_paper as write_paper,
)

# Studio.
from .studio.run import (
    run_studio as run_studio,
)
