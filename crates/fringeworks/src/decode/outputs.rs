//! Maps of the decoder: those that it writes, and what is known of every pixel beforehand.

use crate::{Error, check_length};

/// Maps of one kind.
pub type Maps<'a> = Vec<&'a mut [f32]>;

/// Output maps, each with one value per pixel of the frames.
pub struct Outputs<'a> {
    /// Projector coordinate, px; NaN where not measured.
    pub coordinate: &'a mut [f32],
    /// Standard deviation of the coordinate, px.
    pub sigma: &'a mut [f32],
    /// Modulation of the set with the shortest period, counts; empty within kernels that go on.
    pub modulation: &'a mut [f32],
    /// Mean of the phase frames, counts; empty within kernels that go on.
    pub background: &'a mut [f32],
    /// Codes of [`crate::Reason`].
    pub reason: &'a mut [u8],
    /// Wrapped phase of every set, rad; or no maps.
    pub phases: Maps<'a>,
    /// Modulation of every set, counts; or no maps.
    pub modulations: Maps<'a>,
    /// Variance of the phase of every set by noise, times the pixel's factor, rad²; or no maps.
    pub variances: Maps<'a>,
    /// Middle and half width of the range that the Gray code leaves to every pixel, px, the middle NaN
    /// where it leaves several; or no maps.
    pub cells: Maps<'a>,
    /// Disagreement of the sets, χ²; or empty.
    pub disagreement: &'a mut [f32],
    /// Read, not written: factor on the variances of the pixel's phases, ≥ 1; or empty.
    pub inflation: &'a [f32],
}

/// The first `n` pixels of all maps, and the rest.
fn halves<'a>(maps: Maps<'a>, n: usize) -> (Maps<'a>, Maps<'a>) {
    maps.into_iter().map(|map| map.split_at_mut(n)).unzip()
}

impl<'a> Outputs<'a> {
    /// No maps, to be filled in.
    ///
    /// ```
    /// use fringeworks::decode::Outputs;
    ///
    /// let mut coordinate = [0.0; 4];
    /// let out = Outputs {
    ///     coordinate: &mut coordinate,
    ///     ..Outputs::none()
    /// };
    /// assert!(out.phases.is_empty());
    /// ```
    pub fn none() -> Self {
        Self {
            coordinate: &mut [],
            sigma: &mut [],
            modulation: &mut [],
            background: &mut [],
            reason: &mut [],
            phases: Vec::new(),
            modulations: Vec::new(),
            variances: Vec::new(),
            cells: Vec::new(),
            disagreement: &mut [],
            inflation: &[],
        }
    }

    pub(super) fn check(&self, pixels: usize, sets: usize) -> Result<(), Error> {
        check_length("coordinate", self.coordinate.len(), pixels)?;
        check_length("sigma", self.sigma.len(), pixels)?;
        check_length("modulation", self.modulation.len(), pixels)?;
        check_length("background", self.background.len(), pixels)?;
        check_length("reason", self.reason.len(), pixels)?;
        for maps in [&self.phases, &self.modulations, &self.variances] {
            if !maps.is_empty() {
                check_length("phases", maps.len(), sets)?;
            }
            for map in maps {
                check_length("phases", map.len(), pixels)?;
            }
        }
        if !self.cells.is_empty() {
            check_length("cells", self.cells.len(), 2)?;
        }
        for map in &self.cells {
            check_length("cells", map.len(), pixels)?;
        }
        if !self.disagreement.is_empty() {
            check_length("disagreement", self.disagreement.len(), pixels)?;
        }
        if !self.inflation.is_empty() {
            check_length("inflation", self.inflation.len(), pixels)?;
        }
        Ok(())
    }

    /// Split into the first `n` pixels and the rest.
    pub(super) fn split(self, n: usize) -> (Self, Self) {
        let part = |map: &'a mut [f32]| map.split_at_mut(n.min(map.len()));
        let (coordinate, coordinate_rest) = part(self.coordinate);
        let (sigma, sigma_rest) = part(self.sigma);
        let (modulation, modulation_rest) = part(self.modulation);
        let (background, background_rest) = part(self.background);
        let (reason, reason_rest) = self.reason.split_at_mut(n);
        let (phases, phases_rest) = halves(self.phases, n);
        let (modulations, modulations_rest) = halves(self.modulations, n);
        let (variances, variances_rest) = halves(self.variances, n);
        let (cells, cells_rest) = halves(self.cells, n);
        let (disagreement, disagreement_rest) = part(self.disagreement);
        let (inflation, inflation_rest) = self.inflation.split_at(n.min(self.inflation.len()));
        let first = Self {
            coordinate,
            sigma,
            modulation,
            background,
            reason,
            phases,
            modulations,
            variances,
            cells,
            disagreement,
            inflation,
        };
        let rest = Self {
            coordinate: coordinate_rest,
            sigma: sigma_rest,
            modulation: modulation_rest,
            background: background_rest,
            reason: reason_rest,
            phases: phases_rest,
            modulations: modulations_rest,
            variances: variances_rest,
            cells: cells_rest,
            disagreement: disagreement_rest,
            inflation: inflation_rest,
        };
        (first, rest)
    }
}
