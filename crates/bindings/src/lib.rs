//! Python bindings of the kernels: borrow the arrays, detach from the interpreter, call the kernel and
//! return its result.

mod albedo;
mod decode;
mod edges;
mod emd;
mod filters;
mod form;
mod inverse;
mod isolated;
mod measure;
mod moving;
mod png;
mod propagate;
mod rig;
mod rows;
mod sample;
mod threads;
mod unwrap;
mod vertices;
mod vote;
mod windowed;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    #[pymodule_export]
    use super::albedo::joint_albedo;
    #[pymodule_export]
    use super::decode::{DecodeSettings, decode_frames};
    #[pymodule_export]
    use super::edges::{blur_shift, edge_rings};
    #[pymodule_export]
    use super::emd::decompose_rows;
    #[pymodule_export]
    use super::filters::{
        area_means, box_means, interpolate_linear, median_of_nine, moving_means, weighted_sums,
        widen,
    };
    #[pymodule_export]
    use super::form::{form_distances, form_moments, form_scores, near_groups};
    #[pymodule_export]
    use super::inverse::{invert_rows, row_extrema};
    #[pymodule_export]
    use super::isolated::{add_residual_chi, mark_isolated, raise_factors, typical_step};
    #[pymodule_export]
    use super::measure::measure_points;
    #[pymodule_export]
    use super::moving::{fit_moving, turn_back, warp_by_flow};
    #[pymodule_export]
    use super::png::read_grey_png;
    #[pymodule_export]
    use super::propagate::error_sums;
    #[pymodule_export]
    use super::rig::{Triangles, Triangulation};
    #[pymodule_export]
    use super::sample::{
        column_harmonics, fit_samples, fitted_inside, gram, phase_residuals, quantiles,
        ripple_scores, ripple_sums, ripple_values, robust_fit, second_magnitudes, similar_groups,
        smooth_windows, third_chi_squares, trimmed_variance, window_sums,
    };

    #[pymodule_export]
    use super::unwrap::{average_phasor, count_residues, unwrap_reliability, wavelet_ridge_rows};
    #[pymodule_export]
    use super::vertices::pack_vertices;
    #[pymodule_export]
    use super::vote::{vote_cells, vote_orders};
    #[pymodule_export]
    use super::windowed::{
        invert_windowed, relocate_surfaces, smooth_within_walls, wall_sides, warp_windowed,
    };

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        super::threads::count_forks(m.py())?;
        m.add("version", env!("CARGO_PKG_VERSION"))?;
        m.add("optimised", fringeworks::is_optimised())
    }
}
