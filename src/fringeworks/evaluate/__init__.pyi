"""Errors against a known truth, and comparison of methods."""

from .truth_errors import (
    Errors as Errors,
    errors as errors,
)
from .scored_scenes import (
    BenchmarkScene as BenchmarkScene,
    benchmark_scene as benchmark_scene,
    benchmark_scenes as benchmark_scenes,
)
from .scoring import (
    Score as Score,
    score as score,
)
from .depth_sets import (
    score_depths as score_depths,
)
from .form import (
    FormEvaluation as FormEvaluation,
)
from .captures import (
    CaptureComparison as CaptureComparison,
    compare_captures as compare_captures,
)
from .compare import (
    CompareOptions as CompareOptions,
    SceneOptions as SceneOptions,
    compare_everywhere as compare_everywhere,
)
from .best_method import (
    best_methods as best_methods,
)
from .deviation import (
    Deviation as Deviation,
)
from .model_faces import (
    FaceSamples as FaceSamples,
    smooth_faces as smooth_faces,
)
from .foresight import (
    Foresight as Foresight,
    foresee as foresee,
)
from .view_plan import (
    ForeseenFace as ForeseenFace,
    ViewPlan as ViewPlan,
    plan_views as plan_views,
    turned_poses as turned_poses,
)
from .scan_step import (
    OpenCheck as OpenCheck,
    ScanState as ScanState,
    ScanStep as ScanStep,
    next_step as next_step,
)
from .adaptive_scan import (
    ScanUntil as ScanUntil,
    scan_until as scan_until,
)
from .spots import (
    Spot as Spot,
    find_spots as find_spots,
)
from .gauge_anova import (
    GaugeComponent as GaugeComponent,
    GaugeStudy as GaugeStudy,
    gauge_study as gauge_study,
)
from .gauge_bias import (
    GaugeLinearity as GaugeLinearity,
    GaugeType1 as GaugeType1,
    gauge_linearity as gauge_linearity,
    gauge_type1 as gauge_type1,
)
from .nelson import (
    ControlSeries as ControlSeries,
    NelsonSignal as NelsonSignal,
    control_series as control_series,
)
from .vibrations import (
    AreaTracker as AreaTracker,
    Displacement as Displacement,
    Vibration as Vibration,
    vibration as vibration,
)
from .acceptance.certify import (
    Certificate as Certificate,
    QualityParameter as QualityParameter,
    certify as certify,
)
from .acceptance.measured import (
    PositionResult as PositionResult,
)
from .acceptance.positions import (
    ArtefactPlace as ArtefactPlace,
    PositionCheck as PositionCheck,
    check_positions as check_positions,
    plan_positions as plan_positions,
)
from ..types.certificate import (
    AcceptanceTest as AcceptanceTest,
    BallBar as BallBar,
    PlaneArtefact as PlaneArtefact,
    TestScan as TestScan,
    TestVolume as TestVolume,
)
from .budget import (
    Budget as Budget,
    BudgetLine as BudgetLine,
)
from .monte_carlo import (
    MonteCarlo as MonteCarlo,
)
from ..types import (
    StatedUncertainty as StatedUncertainty,
    Area as Area,
    NominalFace as NominalFace,
    Datum as Datum,
    PartTolerance as PartTolerance,
    ToleranceZone as ToleranceZone,
    PartModel as PartModel,
    Alignment as Alignment,
    BestFit as BestFit,
    DatumPoints as DatumPoints,
    DatumPlanes as DatumPlanes,
    KnownPose as KnownPose,
)
from .inspect import (
    Check as Check,
    Inspection as Inspection,
    judge_part as judge_part,
)
from .selftest.promises import (
    Judged as Judged,
    Promise as Promise,
    promise_table as promise_table,
)
from .selftest.run import (
    SelfTest as SelfTest,
)
